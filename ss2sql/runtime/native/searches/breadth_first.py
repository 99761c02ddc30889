"""Breadth-first search: the oldest path is extended first, so shorter paths come before longer ones.

Ties are in source order. With UNIQUE each row is reached once, by the first of its shortest paths.
"""

BREADTH_FIRST = """
queue = deque()
way = None
if unique:
    seen = set()
if no_cycle:
    trail = Trail()
    seen = trail.keys  # the rows on the way that is extended
while True:
    if no_cycle:
        trail.move_to(way)
    if leveled:
        at_level(depth_of(way), generated, pruned, True)
    for element in elements:
        ROW
        if compared and key in seen:
            pruned += 1
            continue
        JUDGE
        if goes_on:
            NEXT
        if unique:
            seen.add(key)
        new = place if no_cycle else (way, row)
        if goal:
            yield found(path_to(new), last)
        if goes_on:
            queue.append((new, *state))
    if not queue:
        return
    way, *here = queue.popleft()
    expanded += 1
"""
