"""A world that goes wrong at the k-th call of one of its methods, the scripts that call them, and what has to hold."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from faulty import COMMON, EXITS, Hostile, Patient, Source, doing, making, raising

import ss2sql
from ss2sql.vtables import Column, Gone, Table, TableFunction, World, function

SCRIPTS = {  # by the method that goes wrong
    "check": ["SELECT n FROM things AS list;", "SELECT weight(this) FROM things AS list;",
              "SELECT t.m FROM a = things, t = things.beside(a.this, 1) AS list;"],
    "keys": ["SELECT n, x FROM things WHERE x > 2 AS rows;",
             "SELECT a.this, b.x FROM a = range(20), b = things WHERE b.n == a.this AS rows;",
             "SELECT (SELECT b.x FROM b = things WHERE b.x < a.x AS list) FROM a = things AS list;",
             "SELECT s FROM things START WITH s = 0 CONNECT BY NO CYCLE MAXIMUM 9 s = s + n STOP WITH s > 6;"],
    "place": ["SELECT x, y FROM things AS rows;", "SELECT this FROM things WHERE y >= 2 ORDER BY -x AS list;",
              "SELECT count(y) FROM things GROUP BY x % 3 AS list;",
              "SELECT s FROM things START WITH s = 0.0 CONNECT BY NO CYCLE MAXIMUM 9 s = s + x STOP WITH s > 6;",
              "SELECT push(this), x FROM things AS rows;"],
    "color": ["SELECT color FROM things AS list;", "SELECT color(this) FROM things AS list;"],
    "mass": ["SELECT mass FROM things AS list;", "SELECT this FROM things WHERE mass > 3 ORDER BY -mass AS list;"],
    "size": ["SELECT size FROM things AS list;", "SELECT this FROM things WHERE size > 3 ORDER BY -size AS list;"],
    "tag": ["SELECT tag FROM things AS list;", "SELECT this FROM things WHERE tag != [3, 3] AS list;"],
    "friend": ["SELECT friend FROM things AS list;", "SELECT x(friend) FROM things AS list;"],
    "pairs": ["SELECT left, right FROM things.pairs AS rows;"],
    "beside": ["SELECT a.n, t.m FROM a = things, t = things.beside(a.this, 1) AS rows;"],
    "near": ["SELECT a.n, b.x FROM a = things, b = things.near(a.n) AS rows;"],
    "weight": ["SELECT weight(this) FROM things AS list;", "SELECT n FROM things WHERE weight(this) > 3 AS list;"],
    "push": ["SELECT push(this), x FROM things AS rows;"],
    "time": ["SELECT getTime() >= 0 FROM things AS list;"],
}  # fmt: skip


class Things(Table):
    name, key = "things", "n"
    columns = (
        Column("n", int, filter="="), Column("x", float, filter="< <= > >="), Column("y", float),
        Column("color", str), Column("mass", float), Column("size", float), Column("tag", object),
        Column("friend", object),
    )  # fmt: skip
    groups = {"place": "x y", "colored": "color", "tagged": "tag", "befriended": "friend"}
    arrays = {"masses": "mass"}
    blocks = {"sizes": "size"}

    def keys(self, where: Any) -> Any:
        alive = self.world.source.alive
        wanted = where.equal("n")
        return self.world.fault("keys", [n for n in alive if wanted is None or n == wanted])

    def place(self, key: Any) -> Any:
        return self.world.fault("place", (float(key), float(key)), key)

    def colored(self, key: Any) -> Any:
        return self.world.fault("color", f"color {key}", key)

    def tagged(self, key: Any) -> Any:
        return self.world.fault("tag", [key, key], key)

    def befriended(self, key: Any) -> Any:
        return self.world.fault("friend", self.element((key + 1) % 12), key)

    def masses(self, keys: Any) -> Any:
        return self.world.fault("mass", [float(key) for key in keys])

    def sizes(self, keys: Any) -> Any:
        return self.world.fault("size", [float(key) for key in keys])


class Pairs(Table):
    name = "pairs"
    columns = (Column("left", int), Column("right", int))
    groups = {"ends": "left right"}

    def keys(self, where: Any) -> Any:
        return self.world.fault("pairs", [(n, n + 1) for n in self.world.source.alive])

    def ends(self, key: Any) -> Any:
        return self.world.fault("pairs", key, key[0])


class Beside(TableFunction):
    name, columns = "beside", (Column("m", int), Column("what", object))

    def rows(self, thing: Any, radius: Any = 1) -> Any:
        return self.world.fault("beside", [(thing, [1]), (int(thing) + radius, "a")])


class Near(TableFunction):
    name, table = "near", "things"

    def rows(self, n: Any) -> Any:
        return self.world.fault("near", [m for m in self.world.source.alive if m in (n, n + 1)])


class Mishaps(World):
    tables = (Things, Pairs, Beside, Near)

    def fault(self, site: str, value: Any, key: Any = None) -> Any:
        if key is not None and key not in self.source.alive:
            raise Gone(f"{key} has died")
        return self.source.fault(site, value)

    def check(self) -> None:
        self.fault("check", None)

    @property
    def time(self) -> Any:
        return self.fault("time", 1.0)

    @function
    def weight(self, thing: Any) -> Any:
        return self.fault("weight", float(thing), thing)

    @function("volatile")
    def push(self, thing: Any) -> Any:
        return self.fault("push", 1, thing)


class OddKey:
    """Can be hashed, and that is all."""

    __eq__ = __repr__ = __lt__ = Hostile._fail  # type: ignore[assignment]

    def __hash__(self) -> int:
        return 1


KEYS: dict[str, Callable[[], Any]] = {  # of what `keys` and `rows` give beside GARBAGE
    "lists": lambda: [[1], [2]], "unhashable among others": lambda: [1, {}, 2], "huge key": lambda: [10**30],
    "odd keys": lambda: [OddKey(), OddKey()], "hostile tuple": lambda: [(1, Hostile())],
    "texts": lambda: ["1", "\ud800"], "floats": lambda: [1.5, float("nan"), float("nan")], "not alive": lambda: [99],
    "short rows": lambda: [(1,), ()], "long rows": lambda: [(1, 2, 3)],
    "array of rows": lambda: np.arange(4).reshape(2, 2),
}  # fmt: skip


class Lives(Source):
    """What the world is of. Its things die and are born by faults."""

    def __init__(self, site: str = "") -> None:
        super().__init__()
        self.alive = list(range(12))
        self.site = site

    def fault(self, site: str, value: Any) -> Any:
        return self.meet(value) if site == self.site else value


MOVED: dict[str, Callable[[Lives], Any]] = {
    "all die": lambda source: source.alive.clear(),
    "one dies": lambda source: source.alive.pop(),
    "one is born": lambda source: source.alive.append(50),
    "others": lambda source: source.alive.__setitem__(slice(None), range(60, 75)),
}
AGAIN: dict[str, Callable[[ss2sql.Session], Any]] = {
    "run": lambda ss: ss.run("SELECT n, x FROM things WHERE x > 2 AS rows;"),
    "run natively": lambda ss: ss.run("SELECT n, tag FROM things WHERE x > 2 AS rows;", engine="native"),
    "attach": lambda ss: ss.attach("more", [1, 2]),
    "detach": lambda ss: ss.detach("things"),
    "attach anew": lambda ss: ss.attach("things", Mishaps(Lives())),
    "tables": lambda ss: (ss.tables(), ss.describe("things")),
}
LONG = 20_000  # elements of a walk that should have been ended before


def endless(patient: Patient, _: Any) -> Any:
    """Numbers, while which come the run is interrupted."""
    for number in range(LONG):
        if number == 2000:
            patient.session.interrupt()
        yield number
    raise AssertionError("nothing has ended the walk")


class Inhabitant(Patient):
    """A session with a world that goes wrong in one call of one of its methods."""

    AGAIN, codes = AGAIN, ("X001", "X004", "X007", "X011", "T002")
    FAULTS = {
        **COMMON, **{name: making(make) for name, make in KEYS.items()}, "endless": endless, "Gone": raising(Gone),
        **{name: raising(kind) for name, kind in EXITS.items()},
        **{name: lambda patient, value, act=act: (act(patient.source), value)[1] for name, act in MOVED.items()},
        **{name: doing(act) for name, act in AGAIN.items()},
    }  # fmt: skip

    def __init__(self, site: str, script: str, engine: Any) -> None:
        self.world, self.own = Mishaps(Lives(site)), site in ("weight", "push")
        super().__init__(script, engine, site, script, engine, source=self.world.source)

    def prepare(self) -> None:
        session, self.world.source.alive[:] = self.session, range(12)
        assert session.host.memories.now is None
        assert self.world.remembered is None
        worlds = session.host.names.worlds
        if "things" not in worlds or worlds["things"].world is not self.world:
            session.attach("things", self.world)
