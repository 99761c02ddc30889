"""One run of a script, as every engine sees it.

run_state is the run with its statistics, options and limits, and raises Ctrl-C where nothing is half done; value_sizes
bounds values; calls makes the calls of generated code, on arrays as well; post_processing groups, sorts and cuts
results; search_paths are the paths of a search.
"""
