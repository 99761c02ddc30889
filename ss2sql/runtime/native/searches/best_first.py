"""Best-first search: the cheapest, respectively the likeliest, path is extended first.

Totals are made so that less is better: costs are added up from 0, probabilities multiplied from -1. Among equals the
smaller estimate comes first, then the step that was generated first, its result before its expansion. With a heuristic
a step has two entries in the queue, its result at its total and its expansion at its total plus the estimate of what
remains; without one they follow each other, so there is one entry for both.
"""

from textwrap import indent

TAKEN = -2  # less than every total

# Every path, or with NO CYCLE every path on which no row occurs twice.
BEST_FIRST = """
queue = []
number = 0
total = -1 if likeliest else 0
way = None
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
        if no_cycle and key in seen:
            pruned += 1
            continue
        JUDGE
        rank = total * weight if likeliest else total + weight
        if goes_on:
            NEXT
        number += 1
        new = place if no_cycle else (way, row)
        if not guided:
            heappush(queue, (rank, number, goal, goes_on, last, new, *state))
        if guided and goal:
            heappush(queue, (rank, 0, number, False, new, last))
        if guided and goes_on:
            heappush(queue, (rank + estimate, estimate, number, True, rank, new, *state))
    while queue:
        if not guided:
            total, _, goal, goes_on, last, way, *here = heappop(queue)
            if goal:
                yield found(path_to(way), last)
            if goes_on:
                break
        if guided:
            entry = heappop(queue)
            if entry[3]:
                _, _, _, _, total, way, *here = entry
                break
            _, _, _, _, way, last = entry
            yield found(path_to(way), last)
    else:
        return
    expanded += 1
"""

# Each row once, by its best path. A row enters the queue only if it is better than the best path to it so far.
# `best` holds the total of that path, or `TAKEN`, which is less than all totals, when it has come out of the queue.
UNGUIDED_UNIQUE = """
queue = []
number = 0
total = -1 if likeliest else 0
way = None
best = {}
while True:
    if leveled:
        at_level(depth_of(way), generated, pruned, True)
    for element in elements:
        ROW
        known = best.get(key)
        if known is TAKEN:
            pruned += 1
            continue
        JUDGE
        rank = total * weight if likeliest else total + weight
        if goes_on and not settled:
            NEXT
        if known is not None and known <= rank:
            pruned += 1
            continue
        best[key] = rank
        if goes_on and settled:
            NEXT
        number += 1
        new = (way, row)
        heappush(queue, (rank, number, key, goal, goes_on, last, new, *state))
    while queue:
        total, _, key, goal, goes_on, last, way, *here = heappop(queue)
        if best[key] is TAKEN:
            continue
        best[key] = TAKEN
        if goal:
            yield found(path_to(way), last)
        if goes_on:
            break
    else:
        return
    expanded += 1
"""

# The same with a heuristic. If that is inconsistent, a row is taken again when a cheaper way appears, and no step may
# be dropped unasked because of a way that costs more. What is no longer the best is neither given out nor expanded.
GUIDED_UNIQUE = """
queue = []
number = 0
total = 0
way = None
best = {}  # the least total of a path to each row so far
taken = {}  # those at which rows came out of the queue
given = set()
while True:
    if leveled:
        at_level(depth_of(way), generated, pruned, True)
    for element in elements:
        ROW
        known = taken.get(key)
        if known is not None and known <= total:
            pruned += 1
            continue
        JUDGE
        rank = total + weight
        if goes_on and not settled:
            NEXT
        known = best.get(key)
        if known is not None and known <= rank:
            pruned += 1
            continue
        best[key] = rank
        if goes_on and settled:
            NEXT
        number += 1
        new = (way, row)
        if goal:
            heappush(queue, (rank, 0, number, False, key, new, last))
        if goes_on:
            heappush(queue, (rank + estimate, estimate, number, True, key, rank, new, *state))
    while queue:
        entry = heappop(queue)
        key = entry[4]
        if entry[3]:
            _, _, _, _, _, total, way, *here = entry
            if best[key] < total:
                continue
            taken[key] = total
            break
        total, _, _, _, _, way, last = entry
        if best[key] < total:
            continue
        taken[key] = total
        if key not in given:
            given.add(key)
            yield found(path_to(way), last)
    else:
        return
    expanded += 1
"""

BEST_FIRST_UNIQUE = f"""
if guided:
{indent(GUIDED_UNIQUE, "    ")}
else:
{indent(UNGUIDED_UNIQUE, "    ")}
"""
