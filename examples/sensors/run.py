"""Sensor coverage: what the sensors of a hall see, what they do not, and when they see the robot."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import pairwise
from math import dist
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from page import Page

import ss2sql

LEAD = """Six sensors hang on the walls of a factory hall. Which places does none of them see? And who sees the robot
as it drives?"""
WAY = [(4, 3), (5, 3), (6, 4), (6, 8), (7, 9), (10, 9)]
SPEED, EVERY = 1.0, 0.1  # metres and times in a second


def main(lines: int | None = None) -> Page:
    page = Page("Sensor coverage", LEAD, lines)
    with ss2sql.scenes.hall(seed=0) as hall, ss2sql.connect() as ss:
        ss.attach("hall", hall)
        seen = page.run(ss, HERE / "1_coverage.ss", drawn=map_of).value
        occupied = page.run(ss, HERE / "2_floor.ss", drawn=map_of).value
        ss.set("seen", seen)
        ss.set("occupied", occupied)
        unseen = page.run(ss, HERE / "3_unseen.ss", rows=4)
        file = page.file("unseen.png")
        ss2sql.scenes.render(hall, file, visited=list(unseen), view="top")
        page.say(f"{len(unseen)} of {seen.size} cells; the picture marks them in yellow: {file}")
        page.run(ss, HERE / "4_alarm.ss")
        page.say("The robot drives off:")
        page.picture("\n".join(log_of_drive(ss, hall)))
    return page


def map_of(grid: Any) -> str:
    """A grid seen from above: nothing as a dot, else the number, two letters a cell."""
    return "\n".join("".join(f"{'.' if cell == 0 else int(cell)} " for cell in row) for row in grid[::-1])


def log_of_drive(ss: ss2sql.Session, hall: Any) -> list[str]:
    """Drives the robot along its way; what the trigger tells on the way."""
    log: list[str] = []
    spot = WAY[0]

    @ss.on_change(HERE / "4_alarm.ss", every=EVERY)
    def seen_by(names: list[str]) -> None:
        x, y = spot
        log.append(f"{hall.time:5.2f} s  at ({x:.1f}, {y:.1f})  {', '.join(names) or 'nobody'}")

    move = ss.compile('move("YouBot", place);')
    for x, y in spots():
        spot = x, y
        move.run(place=[x, y])
        hall.step(round(240 * EVERY))
    log.append(repr(seen_by))
    return log


def spots() -> Iterator[tuple[float, float]]:
    """Where the robot is at each tenth of a second."""
    for (x, y), (to_x, to_y) in pairwise(WAY):
        count = round(dist((x, y), (to_x, to_y)) / (SPEED * EVERY))
        for number in range(1, count + 1):
            part = number / count
            yield x + part * (to_x - x), y + part * (to_y - y)


if __name__ == "__main__":
    main()
