"""The one rule of the game, as the paper writes it."""


def move(step, towers):
    """The towers after a step [from, to], or an empty list where the step is not allowed."""
    if not towers or not towers[step[0]]:
        pass
    elif not towers[step[1]] or towers[step[1]][-1] > towers[step[0]][-1]:
        # put the top of one tower onto another
        towers[step[1]].append(towers[step[0]].pop())
        return towers
    return []
