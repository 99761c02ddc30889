"""AS environment: a simulation with only the selected bodies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("pybullet")

from little_scenes import GREY, ask, refused
from little_scenes import fixture_scene as fixture_scene

from ss2sql import scenes
from ss2sql.scenes.scene import Scene
from ss2sql.scenes.solids import Sphere

# --- environment ---------------------------------------------------------------------------------------

COLUMNS = (
    "name, type, pos, quat, velocity, angularVelocity, mass, colour, volume, isSensor, friction, restitution, force"
)


def close_to(one: Any, other: Any) -> bool:
    """Whether two values are equal up to rounding."""
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(close_to, one, other))
    return one == (pytest.approx(other, abs=1e-9) if isinstance(one, float) else other)


def test_an_environment_has_the_rows_of_the_query(client: Any, engine: Any) -> None:
    world = scenes.chaos(seed=7, bodies=25, client=client)
    world.step(30)
    where = f"SELECT {COLUMNS}, aabb FROM space WHERE mass > 20 ORDER BY name AS rows;"
    wanted = ask(world, where, engine)
    with ask(world, "SELECT obj FROM space WHERE mass > 20 AS environment;", engine) as copy:
        assert len(wanted) == len(copy.names) > 5
        assert close_to(ask(copy, f"SELECT {COLUMNS}, aabb FROM space ORDER BY name AS rows;", engine), wanted)
        assert copy.time == world.time
        assert len(world.names) > len(copy.names)
        assert {world.names[old]: copy.names[new] for old, new in copy.ids.items()} == {
            n: n for n in copy.names.values()
        }


def test_an_environment_of_bodies_from_files_and_with_joints(client: Any) -> None:
    world = scenes.hall(seed=2, client=client)
    arm = client.getNumJoints(world.robot) - 2
    client.resetJointState(world.robot, arm, 0.7)
    chosen = "name IN ['YouBot', 'table_1', 'shelf_2', 'crate_1', 'sensor_3', 'target', 'barrel_1']"
    wanted = ask(world, f"SELECT {COLUMNS} FROM space WHERE {chosen} ORDER BY name AS rows;")
    assert len(wanted) == 7
    links = "SELECT pos, quat, mass, friction FROM space.links WHERE body == robot AND number < 9 AS rows;"
    joints = "SELECT type, position FROM space.joints WHERE body == robot AS rows;"
    with ask(world, f"SELECT obj FROM space WHERE {chosen} AS environment;") as copy:
        assert close_to(ask(copy, f"SELECT {COLUMNS} FROM space ORDER BY name AS rows;"), wanted)
        robot = copy.body("YouBot")
        for script in (links, joints):
            assert close_to(ask(copy, script, robot=robot), ask(world, script, robot=world.robot)), script
        assert copy.sensors[copy.body("sensor_3")] == world.sensors[world.body("sensor_3")]
        grids = [
            ask(s, "SELECT obj FROM space WHERE name == 'shelf_2' AS occupancygrid(1.0, 0.05);") for s in (world, copy)
        ]
        assert np.array_equal(*grids)
        assert grids[0].any()


def test_an_environment_moves_by_itself(scene: Scene) -> None:
    ball = scene.add("ball", Sphere(0.1), (0.0, 0.0, 10.0), GREY, 2.0)
    scene.client.setGravity(0, 0, -10)
    scene.client.resetBaseVelocity(ball, (1.0, 0.0, 0.0))
    with ask(scene, "SELECT obj FROM space AS environment;") as copy:
        copy.step(24)
        scene.step(24)
        pos = [s.client.getBasePositionAndOrientation(b)[0] for s, b in ((scene, ball), (copy, copy.body("ball")))]
        assert pos[0] == pytest.approx(pos[1], abs=1e-9)
        copy.remove(copy.body("ball"))
        assert ask(scene, "SELECT name FROM space AS list;") == ["ball"]


def test_an_empty_environment(scene: Scene, engine: Any) -> None:
    with ask(scene, "SELECT obj FROM space AS environment;", engine) as copy:
        assert ask(copy, "SELECT obj FROM space AS list;", engine) == []
        assert ask(copy, "SELECT count(this) FROM space GROUP BY 1 AS list;", engine) == []


def test_an_environment_of_a_client_without_a_scene(scene: Scene) -> None:
    scene.add("ball", Sphere(0.5), (1.0, 2.0, 3.0), GREY, 2.0)
    with ask(scene.client, "SELECT obj FROM space AS environment;") as copy:
        assert copy.bounds == (pytest.approx((0.5, 1.5, 2.5), abs=1e-6), pytest.approx((1.5, 2.5, 3.5), abs=1e-6))
        assert scenes.render(copy, None, size=(64, 48)).shape == (48, 64, 3)


def test_a_terrain_cannot_be_copied(scene: Scene, capfd: pytest.CaptureFixture[str]) -> None:
    client = scene.client
    shape = client.createCollisionShape(
        client.GEOM_HEIGHTFIELD, meshScale=[1, 1, 1], heightfieldData=[0.0] * 16, numHeightfieldRows=4,
        numHeightfieldColumns=4,
    )  # fmt: skip
    scene.adopt(client.createMultiBody(0, shape), "hills")
    assert "cannot copy the shape of 'hills'" in refused(scene, "SELECT obj FROM space AS environment;")
