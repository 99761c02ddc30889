"""Robot navigation: the paper's last listing on a floor made of lists."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from floor import Floor, add
from page import Page

import ss2sql

LEAD = """A robot looks for its way around walls. Its functions act on a simulator: move really puts the robot
somewhere, checkCollision asks whether it stands in a wall there. Such functions are called in the order in which they
are written, never remembered, so the search runs natively, not in SQLite."""


def main(lines: int | None = None) -> Page:
    page = Page("Robot navigation", LEAD, lines)
    floor = Floor()
    start = floor.position("YouBot")
    with ss2sql.connect() as ss:
        ss.function(add)
        ss.function("position", floor.position)
        ss.function("move", floor.move)
        ss.function("checkCollision", floor.check_collision)
        ss.function("playSound", floor.play_sound)
        result = page.run(ss, HERE / "paths.ss", rows=5)
    lengths = sorted(map(len, result.value))
    page.say(
        f"{len(lengths):,} paths of {lengths[0]} to {lengths[-1]} steps; the bell rang {floor.bells} times; move was "
        f"called {result.stats.calls['move']:,} times. S is the start, T the target, o the first path, dots are places "
        "of others:"
    )
    page.picture(floor.drawing(start, result.value))
    return page


if __name__ == "__main__":
    main()
