"""What became of a script, as text and as data.

collector finds the facts, from the outlines that a result keeps; explanation is what users get of them.
"""
