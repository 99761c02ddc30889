"""SelectScript in editors, in the order in which one file needs the other.

`keywords` is the table of keywords, read from the grammar's; `marks` says which words of a text are keywords where they
stand; `lexer` gives that to Pygments, `textmate` writes the grammar for editors that read TextMate's. `sql` is for what
scripts become.
"""
