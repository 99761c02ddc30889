"""What users hold: sessions, compiled scripts, and their runs.

In order of control flow: connect makes a session, opening its connection; session is its public face, host its inside;
compiled_script holds statements, compiled_query decides for each query which of the engines runs it; execution runs a
script. variables, temporal_variables and session_functions are what scripts see; triggers repeats them; session_lock,
resources and progress serve a run; dataframe_answer, translation and world_description serve one method each.
"""
