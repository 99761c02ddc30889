"""The shell, `ss2sql repl`.

repl_command starts it. statement_splitter cuts what is typed into statements and dot commands; shell runs them and
prints what they give, by dot_commands; symbols and completion say what could stand at the cursor; terminal is what
prompt_toolkit shows.
"""
