"""What became of a script, as text and as data.

outline is what a result keeps; collector finds the findings, with sqlite_plan, python_plan, level_counts and
termination; explanation_text writes them in the words of vocabulary; explanation is what users get.
"""
