"""The shell, `ss2sql repl`, in the order in which one file needs the other.

shell/pieces.py splits typed text into statements and dot commands; shell/shell.py runs them and prints the results, by
shell/settings.py and shell/commands.py; shell/known.py, shell/sight.py and shell/completion.py suggest completions. All
of these work without a terminal: shell/piped.py reads from a pipe, shell/terminal.py, with shell/history.py, uses
prompt_toolkit, shell/colors.py colors the input.
"""
