"""`near`: a world is asked only for the box around a point where a query wants what is at most so far from it."""

from __future__ import annotations

import ast
from math import dist
from random import Random
from typing import Any

import pytest
from golden import each_row
from sessions import code_of

import ss2sql
from ss2sql.vtables import Column, Element, Table, World, function

RANGE = "< <= > >="


class Points(Table):
    name, key = "points", "id"
    columns = (
        Column("id", int, filter="="),
        *(Column(axis, float, "m", filter=RANGE) for axis in "xyz"),
        Column("pos", (float, float, float), "m"),
        Column("size", float, "m"),
    )
    groups = {"axes": "x y z", "spot": "pos", "size": "size"}
    places = {"this": "x y z", "pos": "x y z"}

    def keys(self, where: Any) -> list[int]:
        wanted = where.equal("id")
        points = {key: point for key, point in self.world.source.items() if wanted in (None, key)}
        found = [k for k, p in points.items() if all(where.allows(a, v) for a, v in zip("xyz", p, strict=True))]
        self.world.given += len(found)
        return found

    def axes(self, key: int) -> tuple[float, ...]:
        return self.world.source[key]

    def spot(self, key: int) -> tuple[float, ...]:
        return self.world.source[key]

    def size(self, key: int) -> float:
        return 0.1 * key


class Space(World):
    tables = (Points,)

    def __init__(self, points: dict[int, tuple[float, float, float]]) -> None:
        super().__init__(points)
        self.given = 0  # keys that the adapter was asked for
        self.measured = 0

    def point(self, value: Any) -> Any:
        if isinstance(value, Element):
            return value.pos
        point = value if isinstance(value, list) else self.source[value]
        if len(point) not in (2, 3):
            raise ValueError("no point")
        return point

    @function
    def distance(self, one: Any, other: Any) -> float:
        """The straight way."""
        self.measured += 1
        a, b = self.point(one), self.point(other)
        return dist(a[: len(b)], b[: len(a)])


LINE = {number: (float(number), 0.0, 0.0) for number in range(1, 21)}


@pytest.fixture
def space() -> Space:
    return Space(dict(LINE))


@pytest.fixture
def ss(space: Space) -> ss2sql.Session:
    session = ss2sql.connect()
    session.attach("space", space)
    session.set("p", [5, 0.0, 0])
    session.set("r", 1)
    session.set("spots", [[3.0, 0.0, 0.0], [18.0, 0.0, 0.0]])
    return session


@each_row("rewrites/near", "script", "told")
def test_only_what_lies_in_the_box_is_asked_for(
    ss: ss2sql.Session, space: Space, engine: Any, script: str, told: str
) -> None:
    found, given = ast.literal_eval(told)
    assert ss.run(script, engine=engine).value == found
    assert given in (None, space.given)
    if script.startswith("SELECT a.id"):
        assert space.measured == (0 if "b.pos" in script else len(found))


def test_neighbours_in_another_world(ss: ss2sql.Session, space: Space, engine: Any) -> None:
    other = Space({7: (2.5, 0.0, 0.0), 8: (30.0, 0.0, 0.0)})
    ss.attach("other", other)
    script = "SELECT a.id, b.id FROM a = other, b = space WHERE {}distance(b.this, a.this) < 1 AS rows;"
    assert ss.run(script.format(""), engine=engine).value == [(7, 2), (7, 3)]
    assert (other.given, space.given) == (2, 2)
    assert ss.run(script.format("space."), engine=engine).value == [(7, 2), (7, 3)]
    assert ss.run("SELECT id FROM space WHERE distance(pos, p) < 1 AS list;", engine=engine).value == [5]


def test_what_is_not_certain_is_not_passed_on(ss: ss2sql.Session, space: Space, engine: Any) -> None:
    query = ss.compile("SELECT id FROM space WHERE distance(this, q) <= 1 AS list;")
    assert query.run(engine=engine, q=[5, 0, 0]).value == [4, 5, 6]  # of q nothing was known
    assert space.given == 20
    for wrong in ("[900, 0, 0, 0]", "[900]", "['a', 0, 0]", "'a'"):  # far away, but an error all the same
        with pytest.raises((ValueError, TypeError, KeyError)):
            ss.run(f"SELECT id FROM space WHERE distance(this, {wrong}) <= 1;", engine=engine)
    script = "SELECT id FROM space WHERE distance({}) <= {};"
    assert code_of(ss.run, script.format("this, [900, 0, 0]", "'a'"), engine=engine) == "X001"
    assert code_of(ss.run, script.format("pos, [900, 0]", 1), engine=engine)[0] == "X"


@pytest.mark.parametrize(("name", "answer"), [("distance", 0.0), ("le", True)])
def test_what_the_user_replaces_promises_nothing(ss: ss2sql.Session, engine: Any, name: str, answer: Any) -> None:
    ss.function(name, lambda one, other: answer, volatility="immutable")
    for place in ("this", "pos"):
        script = f"SELECT id FROM space WHERE distance({place}, p) <= 1 AS list;"
        assert len(ss.run(script, engine=engine).value) == 20


@pytest.mark.parametrize("scale", [1e-150, 1e-9, 1.0, 1e9, 1e90])
def test_what_is_just_as_far_as_the_radius_is_found(engine: Any, scale: float) -> None:
    """The box is no narrower than the distance, whatever floats make of both."""
    dice = Random(str(scale))
    place = lambda: tuple(scale * dice.choice((dice.uniform(-1, 1), dice.uniform(-1, 1) * 1e-9)) for _ in range(3))  # noqa: E731
    space = Space({number: place() for number in range(40)})  # type: ignore[misc]
    ss = ss2sql.connect()
    ss.attach("space", space)
    for number in range(12):
        centre, other = space.source[number], space.source[number + 1]
        radius = dist(other, centre)
        expected = [key for key, point in space.source.items() if dist(point, centre) <= radius]
        ss.set("p", list(centre))
        ss.set("r", radius)
        script = "SELECT id FROM space WHERE distance(this, p) <= r AS list;"
        assert number + 1 in expected
        assert ss.run(script, engine=engine).value == expected


def test_the_sql_is_what_one_would_write(ss: ss2sql.Session) -> None:
    script = "SELECT a.id, b.id FROM a = space, b = space WHERE distance(a.this, b.this) <= 0.5;"
    text = ss.compile(script).sql
    assert " ".join(text.split()) == (
        'SELECT a.id, b.id AS id_2 FROM "space.points" AS a CROSS JOIN "space.points" AS b WHERE '
        "b.x >= a.x - 0.5000005 AND b.x <= a.x + 0.5000005 "
        "AND b.y >= a.y - 0.5000005 AND b.y <= a.y + 0.5000005 "
        "AND b.z >= a.z - 0.5000005 AND b.z <= a.z + 0.5000005 "
        f"AND le(world_distance(a.this, b.this), 0.5, '1:{script.index('<=') + 1}')"
    )
    assert "near" in ss.compile("SELECT id FROM space WHERE distance(this, p) <= 1;").explain()


def other(name: str = "Other", **members: Any) -> type[Space]:
    """A space whose table has other members."""
    return type(name, (Space,), {"tables": (type(name, (Points,), members),)})


def shifted(self: Points, key: int) -> tuple[float, ...]:
    x, y, z = self.world.source[key]
    return x, y, z + 1


class Bent(Space):
    @function
    def distance(self, one: Any, other: Any) -> float:
        """Along the streets."""
        return sum(abs(a - b) for a, b in zip(self.point(one), self.point(other), strict=False))


def test_the_judge_measures_what_is_promised() -> None:
    assert ss2sql.check_world(Space(dict(LINE)), queries=10).elements == {"points": 20}
    for world in (Bent, other(spot=shifted)):
        with pytest.raises(ss2sql.BrokenRuleError) as caught:
            ss2sql.check_world(world(dict(LINE)))
        assert caught.value.rule == "places are true"


@pytest.mark.parametrize(
    "places", [{"this": "x"}, {"this": "x y w"}, {"pos": "x y"}, {"size": "x y z"}, {"where": "x y"}]
)
def test_places_are_checked_when_they_are_declared(ss: ss2sql.Session, places: dict[str, str]) -> None:
    assert code_of(ss.attach, "wrong", other(places=places)({})) == "S002"


@pytest.mark.parametrize(("places", "disable"), [({}, []), (Points.places, ["near"])], ids=["no places", "off"])
def test_without_places_or_switched_off_all_are_asked_for(places: Any, disable: list[str], engine: Any) -> None:
    space = other(places=places)(dict(LINE))
    with ss2sql.connect(disable=disable) as ss:
        ss.attach("space", space)
        found = ss.run("SELECT id FROM space WHERE distance(this, [5, 0, 0]) < 1 AS list;", engine=engine)
    assert (found.value, space.given) == ([5], 20)
