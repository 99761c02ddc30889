"""Every model that pybullet_data ships, loaded and asked for all columns in a process of its own.

PyBullet may end this process, with some models when it loads them. So `ask` starts children, each of which goes on
behind the model where the one before it ended. A child is this file, with the models on its standard input.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

TABLES = ("space", "space.links", "space.joints", "space.shapes", "space.contacts")
ENGINES = ("database", "native")
SOFT = " (soft)"  # after the name of a file of points that is loaded as a soft body
SOFT_BODIES = [f"{name}.obj{SOFT}" for name in ("bunny", "cloth_z_up", "cube", "duck", "sphere_smooth")]
TURNS = ((0, 0, 0), (0.3, 0.5, 0.7), (0.785398163, 0, 0), (0, 0.785398163, 0.785398163), (0, 0, 0.785398163))


def models(*endings: str) -> list[str]:
    """The models of pybullet_data, by the endings of their files."""
    import pybullet_data

    root = Path(pybullet_data.getDataPath())
    return sorted(str(path.relative_to(root)) for ending in endings for path in root.rglob(f"*.{ending}"))


def ask(names: Sequence[str]) -> Iterator[dict[str, Any]]:
    """What each model gives: `model`, `ended` with how the child ended, or `failed` with why PyBullet refused it, or
    `rows`, by tables and columns, `others` that may be refused, and how far `AS environment` has `moved` a shape."""
    left = list(names)
    while left:
        command = [sys.executable, "-W", "ignore", __file__]
        child = subprocess.run(command, input="\n".join(left), capture_output=True, text=True, check=False)
        lines = [line.removeprefix("=> ") for line in child.stdout.splitlines() if line.startswith("=> ")]
        found = [json.loads(line) for line in lines]
        yield from (one for one in found if "at" not in one)
        done = {one["model"] for one in found if "at" not in one}
        left = [name for name in left if name not in done]
        if child.returncode == 0:
            assert not left, child.stdout
            return
        assert found, child.stderr
        last = found[-1]
        yield {"model": last["model"], "ended": child.returncode, "at": last["at"]}
        left.remove(last["model"])


def _load(client: Any, name: str) -> None:
    file = name.removesuffix(SOFT)
    if name.endswith(SOFT):
        client.resetSimulation(client.RESET_USE_DEFORMABLE_WORLD)
        client.loadSoftBody(file, mass=1, useMassSpring=1)
        return
    client.resetSimulation()
    load = {".urdf": client.loadURDF, ".sdf": client.loadSDF, ".xml": client.loadMJCF}[Path(file).suffix]
    load(file)


def _columns(queries: dict[tuple[str, str], Any]) -> dict[str, dict[str, dict[str, int]]]:
    """How often each column of each table gives what: a short text as it is, any other value by its type."""
    found: dict[str, dict[str, dict[str, int]]] = {}
    for table in TABLES:
        by_engine = [queries[table, engine].run(engine=engine) for engine in ENGINES]
        rows, other = ([repr(row) for row in result.value] for result in by_engine)
        assert rows == other, [pair for pair in zip(rows, other, strict=True) if pair[0] != pair[1]]
        names, lines = by_engine[0].columns, by_engine[0].value
        found[table] = {
            name: dict(Counter(str(row[n]) if name in ("type", "isRobot") else type(row[n]).__name__ for row in lines))
            for n, name in enumerate(names)
        }
    return found


def _measure_largest_shift(client: Any, copy: Any) -> float:
    """How far the side of a box around a link of a copy is from that of the original at most, in m."""
    shifts = [
        abs(a - b)
        for body, other in copy.ids.items()
        for link in range(-1, client.getNumJoints(body))
        for one, two in zip(client.getAABB(body, link), copy.client.getAABB(other, link), strict=True)
        for a, b in zip(one, two, strict=True)
    ]
    return max(shifts)


def main(names: Iterable[str]) -> None:
    import pybullet
    import pybullet_data
    from pybullet_utils.bullet_client import BulletClient

    import ss2sql

    client = BulletClient(pybullet.DIRECT)
    client.setAdditionalSearchPath(pybullet_data.getDataPath())
    ss = ss2sql.connect()
    ss.attach("space", client)
    queries = {(table, engine): ss.compile(f"SELECT * FROM {table} AS rows;") for table in TABLES for engine in ENGINES}
    others = {
        "collision": ss.compile("SELECT collision(this, [0.3, 0.2, 0.1, 0.0, 0.0, 0.0, 1.0]) FROM space AS list;"),
        "closest": ss.compile("SELECT b.distance FROM a = space, b = space.closest(a.id, a.id, 0.1) AS list;"),
        "occupancy": ss.compile("SELECT this FROM space AS occupancygrid(0.1, 0.1, [[0.0, 0.0], [1.0, 1.0]]);"),
        "environment": ss.compile("SELECT this FROM space AS environment;"),
    }

    def say(**words: Any) -> None:
        sys.stdout.write(f"\n=> {json.dumps(words)}\n")  # after what PyBullet has written in the same line
        sys.stdout.flush()

    for name in names:
        say(model=name, at="loading")
        try:
            _load(client, name)
        except pybullet.error as error:
            say(model=name, failed=str(error))
            continue
        say(model=name, at="asking")
        rows = _columns(queries)
        told, moved = {}, 0.0
        for word, query in others.items():
            say(model=name, at=word)
            try:
                value = query.run().value
                told[word] = type(value).__name__
                if word == "environment":
                    moved = _measure_largest_shift(client, value)
                    value.close()
            except ss2sql.Error as error:
                told[word] = error.message
        for turn in TURNS[: 1 if name.endswith(SOFT) else None]:
            say(model=name, at="asking after steps")
            client.stepSimulation()
            types = _columns(queries)["space"]["type"]
            for body in ss.eval("SELECT id FROM space AS list;"):
                client.resetBasePositionAndOrientation(body, (0, 0, 1), client.getQuaternionFromEuler(turn))
            assert types == _columns(queries)["space"]["type"] == rows["space"]["type"], name
        capsules = ss.eval("SELECT link, radius, length, pos FROM space.shapes WHERE type == 'capsule' AS rows;")
        say(model=name, rows=rows, others=told, capsules=capsules, moved=moved)


if __name__ == "__main__":
    main(sys.stdin.read().splitlines())
