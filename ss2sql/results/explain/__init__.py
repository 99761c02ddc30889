"""What became of a script, as text and as data.

outline is what a result keeps; collector finds the findings, with engine_plans; explanation is what users get.
"""
