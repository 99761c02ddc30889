"""A floor made of lists: the simulator of this example."""

from __future__ import annotations

PLAN = """
################
#..............#
#..............#
#...######.....#
#...#....#.....#
#...#....#.....#
#........#.....#
#...#....#.....#
#...######..#..#
#...........#..#
#...........#..#
################
"""


class Floor:
    """Walls, a robot, and a bell that counts how often it rang. A place is [x, y], y counted downwards."""

    def __init__(self, plan: str = PLAN, robots: dict[str, list[float]] | None = None) -> None:
        self.rows = [list(line) for line in plan.split()]
        self.robots = robots or {"YouBot": [2.0, 5.0]}
        self.bells = 0

    def position(self, robot: str) -> list[float]:
        """Where the robot stands."""
        return self.robots[robot]

    def move(self, robot: str, place: list[float]) -> list[float]:
        """Puts the robot there, into a wall if need be, and gives the place."""
        self.robots[robot] = place
        return place

    def check_collision(self, robot: str) -> bool:
        """Whether the robot stands in a wall or outside the floor."""
        x, y = map(int, self.robots[robot])
        inside = 0 <= y < len(self.rows) and 0 <= x < len(self.rows[0])
        return not inside or self.rows[y][x] == "#"

    def play_sound(self, file: str) -> None:
        """Rings."""
        self.bells += 1

    def drawing(self, start: list[float], paths: list[list[list[float]]]) -> str:
        """The floor with the first path as o, every other place of any path as a dot."""
        marks = {}
        for path in reversed(paths):
            for x, y in path:
                marks[int(x), int(y)] = "o" if path is paths[0] else "·"
        marks[int(start[0]), int(start[1])] = "S"
        marks[int(paths[0][-1][0]), int(paths[0][-1][1])] = "T"
        lines = []
        for y, row in enumerate(self.rows):
            cells = (marks.get((x, y), "█" if cell == "#" else " ") for x, cell in enumerate(row))
            lines.append("".join(cell * 2 if cell == "█" else f"{cell} " for cell in cells))
        return "\n".join(lines)


def add(left: object, right: object) -> object:
    """Plus, with lists of numbers added place by place."""
    if isinstance(left, list) and isinstance(right, list):
        return [a + b for a, b in zip(left, right, strict=True)]
    return left + right  # type: ignore[operator]
