"""SelectScript in editors, in the order in which one file needs the other.

editor/keywords.py is the table of keywords; editor/marks.py finds the words of a text that are keywords in their place;
editor/lexer.py is the lexer for Pygments, editor/textmate.py writes the grammar for editors that read TextMate's.
"""
