"""The steps from the states of one level for MEMORIZE, which makes nodes and edges of its graph of them.

`level` has the numbers of the nodes that are expanded with the states behind them; what is returned are those of the
next level that go on. See `Grow` in memorize/hunt.py and the graph in memorize/graph.py.
"""

GROW = """
following = []
for node, came in level:
    expanded += 1
    here = came
    first = len(targets)
    for element in elements:
        ROW
        if key in seen:
            WEIGH
            targets.append(seen[key])
            if weighed:
                weights.append(weight)
            if keyed:
                lasts.append(last)
            continue
        JUDGE
        if goes_on:
            NEXT
        target = seen[key] = len(rows)
        rows.append(row)
        goals.append(goal)
        edges.append(())
        targets.append(target)
        if weighed:
            weights.append(weight)
        if keyed:
            lasts.append(last)
        if goes_on:
            following.append((target, row if state_is_row else state))
    edges[node] = range(first, len(targets))
    if len(rows) > most:
        break
"""
