"""Questions to a simulation of PyBullet, beside loops over the functions of PyBullet itself."""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import lru_cache
from math import dist
from typing import Any

from problems.base import Problem, Script, Target, Work, same

KINDS = 7  # masses


@lru_cache
def simulation(size: int) -> tuple[Any, list[int]]:
    """Balls and crates, one in each 8 cubic metres, and their ids in random order."""
    import pybullet
    from pybullet_utils.bullet_client import BulletClient

    chance, half = random.Random(size), size ** (1 / 3)
    client: Any = BulletClient(pybullet.DIRECT)
    shapes = (
        client.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.2),
        client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=(0.2, 0.2, 0.2)),
    )
    for number in range(size):
        place = [chance.uniform(-half, half) for _ in range(3)]
        client.createMultiBody(1 + number % KINDS, shapes[number % 2], basePosition=place)
    ids = list(range(size))
    chance.shuffle(ids)
    return client, ids


def script(text: str) -> Callable[[int], Script]:
    """Scripts find the simulation as `space`, and all ids in random order as `wanted`."""

    def of(size: int) -> Script:
        client, ids = simulation(size)
        return Script(text, variables={"wanted": ids}, attached={"space": client})

    return of


def scan(size: int) -> Work:
    client, _ = simulation(size)
    import pybullet

    number = client._client
    where, velocity = pybullet.getBasePositionAndOrientation, pybullet.getBaseVelocity
    dynamics, joints, id_at = pybullet.getDynamicsInfo, pybullet.getNumJoints, pybullet.getBodyUniqueId

    def run() -> list[Any]:
        rows = []
        count = pybullet.getNumBodies(physicsClientId=number)
        for body in sorted([id_at(place, physicsClientId=number) for place in range(count)]):
            (x, y, z), _ = where(body, physicsClientId=number)
            (vx, vy, vz), _ = velocity(body, physicsClientId=number)
            mass = dynamics(body, -1, physicsClientId=number)[0]
            for link in range(joints(body, physicsClientId=number)):  # a body may have links, each with a mass
                mass += dynamics(body, link, physicsClientId=number)[0]
            rows.append((body, x, y, z, vx, vy, vz, mass))
        return rows

    return Work(run)


def scan_of_client(size: int) -> Work:
    client, _ = simulation(size)

    def run() -> list[Any]:
        rows = []
        for body in sorted([client.getBodyUniqueId(place) for place in range(client.getNumBodies())]):
            (x, y, z), _ = client.getBasePositionAndOrientation(body)
            (vx, vy, vz), _ = client.getBaseVelocity(body)
            mass = client.getDynamicsInfo(body, -1)[0]
            for link in range(client.getNumJoints(body)):
                mass += client.getDynamicsInfo(body, link)[0]
            rows.append((body, x, y, z, vx, vy, vz, mass))
        return rows

    return Work(run)


def scan_with_lists(size: int) -> Work:
    client, _ = simulation(size)
    import pybullet

    number = client._client
    where, dynamics, joints = pybullet.getBasePositionAndOrientation, pybullet.getDynamicsInfo, pybullet.getNumJoints
    info, id_at = pybullet.getBodyInfo, pybullet.getBodyUniqueId

    def run() -> list[Any]:
        rows = []
        count = pybullet.getNumBodies(physicsClientId=number)
        for body in sorted([id_at(place, physicsClientId=number) for place in range(count)]):
            name = info(body, physicsClientId=number)[1].decode() or f"body_{body}"
            mass = dynamics(body, -1, physicsClientId=number)[0]
            for link in range(joints(body, physicsClientId=number)):
                mass += dynamics(body, link, physicsClientId=number)[0]
            pos, quat = where(body, physicsClientId=number)
            x, y, z = pos
            rows.append((body, name, mass, x, y, z, list(pos), list(quat)))
        return rows

    return Work(run)


def look_up(size: int) -> Work:
    client, ids = simulation(size)
    import pybullet

    number, dynamics, info = client._client, pybullet.getDynamicsInfo, pybullet.getBodyInfo

    def run() -> list[Any]:
        rows = []
        for body in ids:
            info(body, physicsClientId=number)  # raises where there is no such body
            rows.append((dynamics(body, -1, physicsClientId=number)[0],))
        return rows

    return Work(run)


def near(size: int) -> Work:
    """The nested loop."""
    client, _ = simulation(size)
    import pybullet

    number, where = client._client, pybullet.getBasePositionAndOrientation

    def run() -> list[Any]:
        count = pybullet.getNumBodies(physicsClientId=number)
        ids = sorted([pybullet.getBodyUniqueId(place, physicsClientId=number) for place in range(count)])
        places = {body: where(body, physicsClientId=number)[0] for body in ids}
        return [(a, b) for a in ids for b in ids if a != b and dist(places[a], places[b]) <= 1]

    return Work(run)


def near_asking(size: int) -> Work:
    """The nested loop, with positions read in it."""
    client, _ = simulation(size)
    import pybullet

    number, where = client._client, pybullet.getBasePositionAndOrientation

    def run() -> list[Any]:
        count = pybullet.getNumBodies(physicsClientId=number)
        ids = sorted([pybullet.getBodyUniqueId(place, physicsClientId=number) for place in range(count)])

        def at(body: int) -> Any:
            return where(body, physicsClientId=number)[0]

        return [(a, b) for a in ids for b in ids if a != b and dist(at(a), at(b)) <= 1]

    return Work(run)


COLUMNS = "SELECT id, x, y, z, vx, vy, vz, mass FROM space AS rows;"
ITEMS = "SELECT id, x, y, pos[2], linearVelocity(this, 0), vy, vz, mass FROM space AS rows;"
LISTS = "SELECT id, name, mass, x, y, z, pos, quat FROM space AS rows;"
BY_ID = "SELECT b.mass FROM a = wanted, b = space WHERE b.id == a.this AS rows;"
NEAR = "SELECT a.id, b.id FROM a = space, b = space WHERE a.id != b.id AND distance(a.this, b.this) <= 1 AS rows;"


def problem(name: str, about: str, size: int, text: str, by_hand: Any, *targets: Target) -> Problem:
    return Problem(
        f"worlds-{name}", f"PyBullet: {about}", "bodies", (size,), 20, script(text), {"python": by_hand}, "the rows",
        answer=lambda rows: same([list(row) for row in rows]), targets=targets,
    )  # fmt: skip


PROBLEMS = (
    problem(
        "scan", "8 columns of all bodies, beside a loop over the functions of the module", 2_000, COLUMNS, scan,
        Target(1.5), Target(1.5, contender="native"),
    ),
    problem(
        "scan-client", "the same as items of lists, beside a loop over a BulletClient", 2_000, ITEMS, scan_of_client,
        Target(1.0), Target(1.0, contender="native"),
    ),
    problem(
        "scan-lists", "8 columns with names and lists, beside a loop over the functions of the module", 2_000, LISTS,
        scan_with_lists, Target(2.0), Target(2.0, contender="native"),
    ),
    problem(
        "lookup", "the mass of each body by its id, in a join", 2_000, BY_ID, look_up,
        Target(0.02, None), Target(0.02, None, "native"),
    ),
    problem(
        "near", "pairs within 1 m, beside a nested loop over positions that are read once", 1_000, NEAR, near,
    ),
    problem(
        "near-asking", "the same, beside a nested loop that asks for each position", 1_000, NEAR, near_asking,
        Target(0.02), Target(0.02, contender="native"),
    ),
)  # fmt: skip
