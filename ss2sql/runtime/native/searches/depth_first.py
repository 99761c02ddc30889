"""Depth-first search: a step is evaluated when it is reached, and followed before its next sibling."""

DEPTH_FIRST = """
path = []
stack = []
if compared:
    seen = set()  # the rows on the path, or with UNIQUE all rows so far
while True:
    if leveled:
        at_level(len(path), generated, pruned, True)
    turns = iter(elements)
    while True:
        for element in turns:
            ROW
            if compared and key in seen:
                pruned += 1
                continue
            JUDGE
            if goes_on:
                NEXT
            if unique:
                seen.add(key)
            if goal:
                yield found((*path, row), last)
            if goes_on:
                if no_cycle:
                    seen.add(key)
                path.append(row)
                stack.append((turns, key, *saved))
                here = state
                expanded += 1
                break
        else:
            if not stack:
                return
            turns, key, *saved = stack.pop()
            path.pop()
            if no_cycle:
                seen.discard(key)
            if leveled:
                at_level(len(path), generated, pruned, False)
            continue
        break
"""
