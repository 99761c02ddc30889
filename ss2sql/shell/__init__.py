"""The shell, `ss2sql repl`.

repl_command starts it. statement_splitter cuts what is typed into statements and dot commands; shell runs them and
prints what they give, by settings and dot_commands; symbols, completion_context and completion say what could stand at
the cursor. piped_input reads from a pipe; terminal, with history and colors, is what prompt_toolkit shows.
"""
