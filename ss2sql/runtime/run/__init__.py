"""One run of a script, as every engine sees it.

run_state is the run with its statistics and deadlines; option_checks checks what users give; keyboard_interrupt raises
Ctrl-C where nothing is half done; value_sizes bounds values; elements reads what stands in FROM; call_memory keeps the
results of calls, call_memo makes the calls of generated code, array_calls those of functions that take arrays;
post_processing groups, sorts and cuts results; search_paths are the paths of a search; error_locations finds the place
of an error.
"""
