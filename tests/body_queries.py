"""The queries that run over every simulator, each beside the plain loop that it stands for."""

from __future__ import annotations

from dataclasses import dataclass
from math import dist
from typing import Any

import ss2sql


@dataclass
class Plain:
    """A body as a loop over the interface of its simulator finds it."""

    id: int
    name: str
    type: str
    pos: tuple[float, ...]
    mass: float


def answer(ss: ss2sql.Session, script: str, engine: Any = "auto") -> Any:
    """What a script gives; rows as lists."""
    value = ss.run(script, engine=engine).value
    return [list(row) if isinstance(row, tuple) else row for row in value] if isinstance(value, list) else value


def agree(ss: ss2sql.Session, bodies: list[Plain], engine: Any) -> None:
    """The session's `space` gives what loops over the bodies give: no row twice, none lost, the same order."""

    def run(script: str) -> Any:
        return answer(ss, script, engine)

    spheres = [body for body in bodies if body.type == "sphere"]
    heavy = [{"mass": body.mass, "pos": list(body.pos)} for body in spheres if body.mass > 50]
    assert run("SELECT mass, pos FROM space WHERE isSphere(this) AND mass(this) > 50;") == heavy
    assert run("SELECT id, name, type FROM space AS rows;") == [[b.id, b.name, b.type] for b in bodies]
    if spheres:
        heaviest = max(body.mass for body in spheres)
        script = """
            spheres = SELECT obj FROM space WHERE isSphere(this) AS list;
            maxMass = max(SELECT mass FROM spheres AS list);
            SELECT name FROM space WHERE isSphere(this) AND mass == maxMass AS list;"""
        assert run(script) == [body.name for body in spheres if body.mass == heaviest]
    pairs = [[a.id, b.id] for a in bodies for b in bodies if a.id < b.id and dist(a.pos, b.pos) <= 1]
    assert sorted(
        run("SELECT a.id, b.id FROM a = space, b = space WHERE a.id < b.id AND distance(a.this, b.this) <= 1 AS rows;")
    ) == sorted(pairs)
    for body in bodies[:3]:
        assert run(f"SELECT name FROM space WHERE id == {body.id} AS list;") == [body.name]
        x, y, z = body.pos
        box = f"x >= {x - 1!r} AND x <= {x + 1!r} AND y >= {y - 1!r} AND y <= {y + 1!r}"
        inside = [b.id for b in bodies if abs(b.pos[0] - x) <= 1 and abs(b.pos[1] - y) <= 1]
        found = run(f"SELECT id FROM space WHERE {box} AS list;")
        assert body.id in found
        assert set(found) <= {b.id for b in bodies}
        assert [i for i in found if _clear(bodies, i, x, y)] == [i for i in inside if _clear(bodies, i, x, y)]
        near = [b.id for b in bodies if dist(b.pos, body.pos) <= 2]
        assert run(f"SELECT id FROM space.near({[x, y, z]!r}, 2.0) AS list;") == near


def _clear(bodies: list[Plain], number: int, x: float, y: float) -> bool:
    """Whether a body lies not just on the edge, where rounding decides."""
    body = next(body for body in bodies if body.id == number)
    return all(abs(abs(p - q) - 1) > 1e-9 for p, q in zip(body.pos, (x, y), strict=False))


# What `space.closest` and other tables with parameters are called with by `check_world`.
ARGUMENTS = {
    "closest": [(None, None, 1.0), (2, None, 3.0)],
    "near": [([0, 0, 0], 4.0), ([0, 0], 3.0)],
    "overlaps": [([[-3, -3, -3], [2, 2, 2]],)],
    "contacts": [(), (2,)],
}
