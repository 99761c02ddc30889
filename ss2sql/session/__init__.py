"""What users hold: sessions, compiled scripts, and their runs.

In order of control flow: session is what `connect` gives, the public face, host its inside; compiled_script holds
statements, compiled_query decides for each query which of the engines runs it; execution runs a script. variables is
what scripts see, triggers among them.
"""
