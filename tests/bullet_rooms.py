"""Rooms full of random things for PyBullet, and what a plain loop over its functions says of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from random import Random
from typing import Any

import pybullet
import pytest
from sessions import ENGINES

import ss2sql

KINDS = {
    pybullet.GEOM_SPHERE: "sphere", pybullet.GEOM_BOX: "box", pybullet.GEOM_CYLINDER: "cylinder",
    pybullet.GEOM_CAPSULE: "capsule", pybullet.GEOM_PLANE: "plane", pybullet.GEOM_MESH: "mesh",
}  # fmt: skip
JOINTS = [pybullet.JOINT_REVOLUTE, pybullet.JOINT_PRISMATIC, pybullet.JOINT_FIXED]
CORNERS = [(0, 0, 0), (0.4, 0, 0), (0, 0.5, 0), (0, 0, 0.6), (0.3, 0.3, 0.3)]


class Counting:
    """A client that counts how often each of its functions is called."""

    def __init__(self, client: Any) -> None:
        self._client = client._client
        self._inner = client
        self.calls: Counter[str] = Counter()

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._inner, name)
        if not callable(found) or isinstance(found, type):
            return found

        def counted(*arguments: Any, **named: Any) -> Any:
            self.calls[name] += 1
            return found(*arguments, **named)

        return counted


def shape(client: Any, dice: Random) -> int:
    a, b, c = (dice.uniform(0.1, 0.5) for _ in range(3))
    makers: list[Callable[[], int]] = [
        lambda: client.createCollisionShape(pybullet.GEOM_SPHERE, radius=a),
        lambda: client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=(a, b, c)),
        lambda: client.createCollisionShape(pybullet.GEOM_CYLINDER, radius=a, height=b),
        lambda: client.createCollisionShape(pybullet.GEOM_CAPSULE, radius=a, height=b),
        lambda: client.createCollisionShape(pybullet.GEOM_MESH, vertices=CORNERS),
    ]
    return dice.choice(makers)()


def thing(client: Any, dice: Random) -> int:
    """A random body: of one shape, of several, with links, or one that can only be seen."""
    place = [dice.uniform(-2, 2) for _ in range(3)]
    turn = client.getQuaternionFromEuler([dice.uniform(-3, 3) for _ in range(3)])
    mass = dice.choice((0.0, dice.uniform(1, 100), dice.uniform(1, 100)))
    chance = dice.random()
    if chance < 0.08:
        seen = client.createVisualShape(pybullet.GEOM_SPHERE, radius=0.3)
        body = client.createMultiBody(0, -1, seen, place, turn)
    elif chance < 0.2:
        body = jointed(client, dice, mass, place, turn)
    elif chance < 0.3:
        several = client.createCollisionShapeArray(
            [pybullet.GEOM_SPHERE, pybullet.GEOM_BOX], radii=[0.2, 0], halfExtents=[(1, 1, 1), (0.1, 0.2, 0.3)],
            collisionFramePositions=[(0, 0, 0), (0.4, 0, 0)],
        )  # fmt: skip
        body = client.createMultiBody(mass, several, -1, place, turn)
    else:
        body = client.createMultiBody(mass, shape(client, dice), -1, place, turn)
    if mass:
        client.resetBaseVelocity(body, [dice.uniform(-3, 3) for _ in range(3)], [dice.uniform(-3, 3) for _ in range(3)])
    return int(body)


def jointed(client: Any, dice: Random, mass: float, place: Any, turn: Any, links: int = 2) -> int:
    """A body whose links hang on each other by joints, turned at random."""
    body = client.createMultiBody(
        mass, shape(client, dice), -1, place, turn,
        baseInertialFramePosition=[dice.uniform(-0.1, 0.1) for _ in range(3)],
        linkMasses=[dice.uniform(1, 9) for _ in range(links)],
        linkCollisionShapeIndices=[shape(client, dice) for _ in range(links)], linkVisualShapeIndices=[-1] * links,
        linkPositions=[(0.5, 0.1, 0.2)] * links, linkOrientations=[(0, 0.6, 0, 0.8)] * links,
        linkInertialFramePositions=[(0.1, 0, 0)] * links, linkInertialFrameOrientations=[(0.6, 0, 0, 0.8)] * links,
        linkParentIndices=list(range(links)), linkJointTypes=(JOINTS * links)[:links],
        linkJointAxis=[(0, 0, 1)] * links,
    )  # fmt: skip
    for joint in range(links):
        client.resetJointState(body, joint, dice.uniform(-2, 2))
    return int(body)


def furnish(client: Any, dice: Random, count: int) -> None:
    if dice.random() < 0.5:
        client.createMultiBody(0, client.createCollisionShape(pybullet.GEOM_PLANE, planeNormal=(0, 0, 1)))
    for _ in range(count):
        thing(client, dice)


def stir(client: Any, dice: Random) -> None:
    """Steps, a birth or a death."""
    change = dice.choice(("step", "birth", "death", "death"))
    if change == "step":
        for _ in range(dice.randint(1, 10)):
            client.stepSimulation()
    elif change == "birth" or len(live(client)) < 3:
        thing(client, dice)
    else:
        client.removeBody(dice.choice(live(client)))


def live(client: Any) -> list[int]:
    return sorted(client.getBodyUniqueId(place) for place in range(client.getNumBodies()))


def mass_of(client: Any, body: int) -> float:
    links = range(-1, client.getNumJoints(body))
    return float(sum(client.getDynamicsInfo(body, link)[0] for link in links))


def kind_of(client: Any, body: int) -> str:
    links = range(-1, client.getNumJoints(body))
    shapes = [shape for link in links for shape in client.getCollisionShapeData(body, link)]
    if len(shapes) > 1:
        return "compound"
    return KINDS[shapes[0][2]] if shapes else "ghost"


def ball(client: Any, radius: float = 0.5, position: Any = (0, 0, 0), mass: float = 1.0) -> int:
    shape = client.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius)
    return int(client.createMultiBody(mass, shape, basePosition=position))


def box(client: Any, edges: Any, position: Any = (0, 0, 0), mass: float = 0.0) -> int:
    shape = client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[edge / 2 for edge in edges])
    return int(client.createMultiBody(mass, shape, basePosition=position))


def values(session: ss2sql.Session, script: str, **named: Any) -> Any:
    """The value, which is the same on both engines."""
    found = [session.run(script, engine=engine, **named).value for engine in ENGINES]
    assert found[0] == found[1]
    return found[0]


def message(session: ss2sql.Session, script: str, **named: Any) -> str:
    with pytest.raises(ss2sql.Error) as caught:
        session.run(script, **named)
    return f"{caught.value.code} {caught.value}"
