"""Random programs over a world of balls, joined with lists, tables and data frames, while balls come and go.

Each program is written twice, over the world and over plain copies: `space` is then a list of rows, `space.near(...)`
the function `near_space`, columns are functions of rows, and a data frame is a dict of columns. Between statements,
and in some of them, `stir()` lets a ball die, be born and move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from typing import Any

from balls import Box

from .choices import Choices
from .expressions import Sight
from .flat import Flat, Origin
from .library import LIBRARY

DECISIONS = 320
BALL = {
    "id": "int", "name": "str", "x": "num", "y": "num", "z": "num", "mass": "num", "colour": "any", "heavy": "bool",
    "pos": "any",
}  # fmt: skip
FRAME = {"number": "int", "word": "str", "weight": "num", "flag": "bool"}
CALLED = ("mass", "x", "name", "heavy")  # columns that are called as functions of elements
BODY = "body"  # the kind of a source whose elements are objects of the world


def row_of(ball: Any) -> dict[str, Any]:
    """A ball as the world shows it."""
    place = {"x": ball.x, "y": ball.y, "z": ball.z}
    named = {"id": ball.id, "name": ball.name, **place, "mass": ball.mass, "colour": ball.colour}
    return {**named, "heavy": ball.mass > 50, "pos": [ball.x, ball.y, ball.z]}


def over_copies(text: str) -> str:
    """A text about the world as one about copies."""
    return text.replace("space.near(", "near_space(")


@dataclass(frozen=True)
class SceneCase:
    """A program over a world: its statements, what else it needs, and the seed of the world."""

    statements: tuple[str, ...]
    seed: int
    number: int  # of balls
    frame: dict[str, list[Any]]
    variables: dict[str, Any] = field(default_factory=dict)
    uses: tuple[str, ...] = ()
    tables: dict[str, list[dict[str, Any]]] = field(default_factory=dict)

    @property
    def script(self) -> str:
        return ";\n".join(self.statements)

    @property
    def copied(self) -> tuple[str, ...]:
        """The statements over copies."""
        return tuple(map(over_copies, self.statements))

    def box(self) -> Box:
        return Box.random(self.seed, self.number)

    def functions(self) -> dict[str, Callable[..., Any]]:
        return {name: LIBRARY[name][0]() for name in self.uses}


class Stirring:
    """The world's own function `stir`: the same changes for the same seed. `after` is called after each."""

    def __init__(self, case: SceneCase, after: Callable[[Box], None] = lambda box: None) -> None:
        self.box, self.dice, self.count, self.after = case.box(), Random(case.seed), 0, after

    def __call__(self) -> int:
        self.count += 1
        self.box.change(self.dice)
        self.after(self.box)
        return self.count

    def rows(self) -> list[dict[str, Any]]:
        return [row_of(ball) for ball in self.box.balls.values()]

    def near(self, x: float, y: float, z: float, radius: float = 1.0) -> list[dict[str, Any]]:
        """What `space.near` finds."""
        found = (
            b for b in self.box.balls.values() if (b.x - x) ** 2 + (b.y - y) ** 2 + (b.z - z) ** 2 <= radius * radius
        )
        return [row_of(ball) for ball in found]


def scene_program(data: bytes) -> SceneCase:
    """The program that the bytes stand for."""
    writer = Scenes(Choices(data))
    c = writer.choices
    statements = []
    for number in range(c.pick((1, 2, 3))):
        if number:
            statements.append("stir()")
        statements.append(f"found{number} = {writer.statement()}")
    statements.append(f"[{', '.join(f'found{number}' for number in range(sum('=' in s for s in statements)))}]")
    seed, balls = c.below(200), c.pick((5, 3, 8, 1, 0))
    return SceneCase(tuple(statements), seed, balls, writer.frame, writer.variables, tuple(writer.uses), writer.tables)


class Scenes(Flat):
    """Writes queries over the world and whatever else a query can walk."""

    def __init__(self, choices: Choices) -> None:
        super().__init__(choices)
        rows = range(choices.pick((3, 2, 4, 1)))
        self.frame = {
            "number": [choices.pick((1, 2, 3, 0)) for _ in rows],
            "word": [choices.pick(("a", "b", "", "ball")) for _ in rows],
            "weight": [choices.pick((0.5, 2.5, 20.0, 60.0)) for _ in rows],
            "flag": [choices.pick((True, False)) for _ in rows],
        }
        self.first, self.bodies = "", False  # the outermost first source: its name, whether it is the world
        self.keys = ""  # those of GROUP BY

    def statement(self) -> str:
        form = self.choices.weighted((70, "flat"), (20, "search"), (10, "stirred"))
        if form == "search":
            return self.hunt()
        if form == "stirred":
            where = self.choices.pick(("", " WHERE mass > 20", " WHERE x(this) < 2"))
            return f"SELECT id, x, stir(), mass(this) FROM space{where} AS list"
        return self.flat()

    def hunt(self) -> str:
        """A search from ball to ball."""
        c = self.choices
        source, after = c.pick(
            (
                ("n = space.near(p[0], p[1], p[2], 4)", "n.pos"),
                ("n = (SELECT * FROM space WHERE abs(x - p[0]) < 2)", "n.pos"),
                ("n = (SELECT pos, mass, id FROM space WHERE pos != p AND z <= p[2])", "n.pos"),
                ("n = space", "[n.x, n.y, n.z]"),
            )
        )
        options = c.pick(("UNIQUE", "NO CYCLE", "UNIQUE COST n.mass", "MEMORIZE 2", "DEPTH FIRST UNIQUE MAXIMUM 3"))
        where = c.pick(("", " WHERE n.mass > 30", " WHERE n.id % 2 == 0", " WHERE p != n.pos"))
        level = ", level = 1" if "NO CYCLE" in options else ""
        following, stop = (", level = level + 1", " STOP WITH level >= 2") if level else ("", "")
        return (
            f"SELECT n.id, n.pos FROM {source}{where} START WITH p = [0.0, 0.0, 0.0]{level} "
            f"CONNECT BY {options} p = {after}{following}{stop} AS {c.pick(('list', 'rows', 'dict'))}"
        )

    def origin(self, alias: str | None, sight: Sight) -> Origin:
        c = self.choices
        prefix = f"{alias} = " if alias else ""
        form = c.weighted((50, "world"), (18, "frame"), (32, "else"))
        places = [text[:-4] for text in sight.texts["any"] if text.endswith(".pos")]
        if form == "world" and places and c.chance(70):
            place = c.pick(places)
            radius = c.pick(("2", "4", "0.5", f"{place}.mass / 20"))
            point = ", ".join(f"{place}.{axis}" for axis in "xyz")
            alias = alias or "close"
            return Origin(f"{alias} = space.near({point}, {radius})", alias, BODY, BALL, known=False)
        if form == "world" and c.chance(15):
            where = c.pick(("x > 0", "heavy", "colour != 'red'", "id IN [1, 2, 3, 4]"))
            shown = c.pick(("*", "id, x, y, z, mass, pos"))
            columns = BALL if shown == "*" else {name: BALL[name] for name in shown.split(", ")}
            return Origin(f"{prefix}(SELECT {shown} FROM space WHERE {where})", alias, "row", columns)
        if form == "world":
            return Origin(f"{prefix}space", alias or "space", BODY, BALL)
        if form == "frame":
            return Origin(f"{prefix}frame", alias or "frame", "row", FRAME)
        return super().origin(alias, sight)

    @staticmethod
    def see(origins: list[Origin]) -> Sight:
        """As for other sources, but elements of the world are no values: they have columns, and functions of them."""
        seen = Flat.see([o for o in origins if o.kind != BODY])
        sight = Sight()
        for origin in origins:
            others = [other for other in origins if other is not origin]
            if origin.kind != BODY:
                continue
            for column, kind in origin.columns.items():
                # Where nobody knows the columns of copies a bare name would be that of a query around.
                if origin.known and not any(column in other.columns for other in others):
                    sight.add(column, kind)
                if origin.name is not None:
                    sight.add(f"{origin.name}.{column}", kind)
            for called in CALLED if origin.name is not None else ():
                sight.add(f"{called}({origin.name}.this)", BALL[called])
        hidden = {name for o in origins if o.kind == BODY for name in o.columns}
        first_is_body = bool(origins) and origins[0].kind == BODY
        for kind, texts in seen.texts.items():
            kept = [t for t in texts if t not in hidden and not (first_is_body and t.startswith("this"))]
            sight.texts[kind].extend(kept)
        return sight

    def sources(self, sight: Sight, number: int) -> tuple[str, Sight, list[Origin]]:
        text, own, origins = super().sources(sight, number)
        if self.nesting == 0:
            self.first = (origins[0].name or "") if origins[0].kind == BODY else "this"
            self.bodies = origins[0].kind == BODY
        return text, own, origins

    def key(self, sight: Sight) -> str:
        self.keys += (found := super().key(sight))
        return found

    def partition_columns(self, sight: Sight) -> str:
        """A column that surely is none of the keys."""
        if not self.bodies:
            return super().partition_columns(sight)
        other = next((name for name in BALL if name not in self.keys), "id")
        return f"[{self.first}.{other}, 'row']"

    def representation(self, sight: Sight) -> str:
        return f" AS {self.choices.pick(('rows', 'list', 'dict', 'value'))}"
