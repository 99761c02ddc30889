"""The shell, `ss2sql repl`.

shell starts it, runs statements and dot commands, which statement_splitter cuts from what is typed, and prints what
they give, by dot_commands; symbols and completion say what could stand at the cursor; terminal is what prompt_toolkit
shows.
"""
