"""The paper's queries over 200 random scenes of each simulator, beside plain loops over the simulator's interface.

Before and after steps, births and deaths: the same rows in the same order, none twice, none lost. The engines take
turns, for most of the time goes into compiling the scripts, which each scene does anew.
"""

from __future__ import annotations

from collections.abc import Callable
from math import dist
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import pytest
from body_queries import Plain
from pyode import load
from sessions import ENGINES

import ss2sql

SCENES = 200
AT_ONCE = 20  # scenes of one test
FIRST = range(0, SCENES, AT_ONCE)
# A scene, what a loop finds in it, and what changes it; by a seed.
Case: TypeAlias = tuple[Any, Callable[[], list[Plain]], Callable[[], object]]

SCRIPTS = {
    "heavy": "SELECT mass, pos FROM space WHERE isSphere(this) AND mass(this) > 50;",
    "all": "SELECT id, name, type, x, y, z, mass FROM space AS rows;",
    "heaviest": """
        spheres = SELECT obj FROM space WHERE isSphere(this) AS list;
        maxMass = max(SELECT mass FROM spheres AS list);
        SELECT name FROM space WHERE isSphere(this) AND mass == maxMass AS list;""",
    "pairs": """
        SELECT a.id, b.id FROM a = space, b = space
        WHERE a.id < b.id AND distance(a.this, b.this) <= 3 AS rows;""",
}


def expected(bodies: list[Plain]) -> dict[str, Any]:
    """What the scripts come to."""
    spheres = [body for body in bodies if body.type == "sphere"]
    found = {
        "heavy": [{"mass": body.mass, "pos": list(body.pos)} for body in spheres if body.mass > 50],
        "all": [(body.id, body.name, body.type, *body.pos, body.mass) for body in bodies],
        "pairs": [(a.id, b.id) for a in bodies for b in bodies if a.id < b.id and dist(a.pos, b.pos) <= 3],
    }
    if spheres:
        most = max(body.mass for body in spheres)
        found["heaviest"] = [body.name for body in spheres if body.mass == most]
    return found


def check(first: int, case: Callable[[int], Case]) -> None:
    """Asks for some scenes, and once more when they have changed."""
    with ss2sql.connect() as ss:
        for seed in range(first, first + AT_ONCE):
            scene, look, change = case(seed)
            ss.attach("space", scene)
            engine = ENGINES[seed % len(ENGINES)]
            queries = {name: ss.compile(text, engine=engine) for name, text in SCRIPTS.items()}
            for _ in range(2):
                bodies = look()
                assert bodies
                for name, wanted in expected(bodies).items():
                    assert queries[name].run().value == wanted, (name, engine, seed)
                change()
            ss.detach("space")


@pytest.mark.parametrize("first", FIRST)
def test_pybullet(first: int) -> None:
    pybullet: Any = pytest.importorskip("pybullet")
    from ss2sql.scenes import chaos
    from ss2sql.scenes.bullet import connect

    client: Any = connect()  # one for all: each takes 29 MB that never come back
    kinds = {pybullet.GEOM_SPHERE: "sphere", pybullet.GEOM_BOX: "box", pybullet.GEOM_CYLINDER: "cylinder",
             pybullet.GEOM_CAPSULE: "capsule", pybullet.GEOM_PLANE: "plane"}  # fmt: skip

    def case(seed: int) -> Case:
        scene, dice = chaos(seed, 2 + seed % 9, client), Random(seed)

        def look() -> list[Plain]:
            found = []
            for body in sorted(client.getBodyUniqueId(place) for place in range(client.getNumBodies())):
                kind = kinds[client.getCollisionShapeData(body, -1)[0][2]]
                place, _ = client.getBasePositionAndOrientation(body)
                found.append(Plain(body, scene.names[body], kind, place, client.getDynamicsInfo(body, -1)[0]))
            return found

        def change() -> None:
            scene.step(dice.randint(1, 30))
            scene.explode(dice.choice(list(scene.forces)))
            scene.bear()
            scene.step(dice.randint(0, 3))

        return scene, look, change

    try:
        check(first, case)
    finally:
        client.disconnect()


@pytest.mark.parametrize("first", FIRST)
def test_mujoco(first: int) -> None:
    pytest.importorskip("mujoco")
    from mujoco_rooms import loop

    from ss2sql.scenes.mujoco_chaos import chaos

    def case(seed: int) -> Case:
        scene = chaos(seed, 2 + seed % 9)  # nobody is born here, and nobody dies
        return scene, lambda: loop(scene.model, scene.data), lambda: scene.step(1 + seed % 30)

    check(first, case)


@pytest.mark.parametrize("first", FIRST)
def test_ode(first: int) -> None:
    with TemporaryDirectory() as folder:
        if load(Path(folder)) is None:
            pytest.skip("ODE is not installed for this Python: apt-get install python3-pyode")
        from ode_rooms import loop

        from ss2sql.scenes.ode_chaos import chaos

        def case(seed: int) -> Case:
            scene, dice = chaos(seed, 2 + seed % 9), Random(seed)
            numbers: dict[Any, int] = {}

            def look() -> list[Plain]:
                # A geom keeps its number, and the next one goes to the next that is born.
                geoms = [*scene.walls, *scene.particles]
                living = [numbers.setdefault(geom, len(numbers) + 1) for geom in geoms]
                bodies = zip(living, loop(scene), strict=True)
                return [Plain(number, b.name, b.type, b.pos, b.mass) for number, b in bodies]

            def change() -> None:
                scene.step(dice.randint(1, 30))
                scene.explode(dice.choice(scene.particles))

            return scene, look, change

        check(first, case)
