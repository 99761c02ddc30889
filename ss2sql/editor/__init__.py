"""SelectScript in editors.

keywords is the table of keywords, read from the grammar's, and says which words of a text are keywords; lexer gives
that to Pygments. The grammar for editors that read TextMate's is written by docs/textmate.py.
"""
