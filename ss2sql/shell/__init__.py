"""The shell, `ss2sql repl`, in the order in which one file needs the other.

`pieces` cuts what is typed into statements and dot commands; `shell` runs them and prints what they give, by `settings`
and `commands`; `known`, `sight` and `completion` say what could stand at the cursor. None of these needs a terminal:
`piped` reads from a pipe, `terminal`, with `history`, is what prompt_toolkit shows.
"""
