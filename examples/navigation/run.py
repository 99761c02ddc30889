"""Robot navigation: the paper's last listing in a hall, and the same task with a search that moves nothing."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from page import Page

import ss2sql
from ss2sql.vtables.pybullet import PyBulletWorld

LEAD = """A robot stands in a factory hall, a simulation in PyBullet, and has to go to the green disc two doors away.
The script of the paper moves it from place to place and asks whether it collides there. `add` is replaced, so that +
adds vectors."""


def add(left: object, right: object) -> object:
    """Plus, with lists of numbers added place by place."""
    if isinstance(left, list) and isinstance(right, list):
        return [a + b for a, b in zip(left, right, strict=True)]
    return left + right  # type: ignore[operator]


class Robot:
    """What the script calls: it moves the robot of a hall, and notes where that has been."""

    def __init__(self, space: PyBulletWorld) -> None:
        self.space = space
        self.visited: dict[tuple[float, ...], None] = {}
        self.bells = 0

    def move(self, robot: str, place: list[float]) -> list[float]:
        """Puts the robot there, into a wall if need be, and gives the place."""
        self.visited[tuple(place)] = None
        return self.space.move(robot, place)

    def play_sound(self, file: str) -> None:
        """Rings."""
        self.bells += 1


def main(lines: int | None = None) -> Page:
    page = Page("Navigation in a hall", LEAD, lines)
    with ss2sql.scenes.hall(seed=0) as hall, ss2sql.connect() as ss:
        space = PyBulletWorld(hall)
        robot = Robot(space)
        ss.attach("space", space)
        ss.function(add)
        ss.function("move", robot.move)
        ss.function("playSound", robot.play_sound)
        moving = page.run(ss, HERE / "1_paths.ss", rows=8)
        lengths = sorted(map(len, moving.value))
        page.say(f"{len(lengths):,} paths of {lengths[0]} to {lengths[-1]} steps; the bell rang {robot.bells} times.")
        space.move("YouBot", list(hall.places["start"]))  # the search has left it elsewhere
        page.run(ss, HERE / "2_best.ss", rows=8)
        ways = [[space.position("YouBot"), *path] for path in moving.value]
        page.heading("What they cost, and a picture")
        page.picture("\n".join(costs(shown.heading, shown.result, shown.seconds) for shown in page.shown))
        file = page.file("navigation.png")
        ss2sql.scenes.render(hall, file, paths=ways, visited=robot.visited)
        page.say(f"The {len(ways):,} paths in red and all places that the robot was put to in yellow: {file}")
    return page


def costs(heading: str, result: ss2sql.Result, seconds: float) -> str:
    """Calls and time of a search, in one line."""
    calls = {name: result.stats.calls[name] for name in ("move", "checkCollision", "collision")}
    shown = ", ".join(f"{count} calls of {name}" for name, count in calls.items() if count)
    return f"{heading:26}{shown}, {seconds:.2f} s"


if __name__ == "__main__":
    main()
