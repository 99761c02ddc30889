"""The steps from one state for MEMORIZE, which grows its graph from them, see `Step` in step.py."""

STEPS = """
expanded += 1
here = came
for element in elements:
    ROW
    if key in seen:
        WEIGH
        yield row, None, None, key, weight, 0, last
        continue
    JUDGE
    if goes_on:
        NEXT
    yield row, goal, state, key, weight, 0, last
"""
