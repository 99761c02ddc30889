"""Models of robots, soft bodies and others: PyBullet survives every column, and says what is so."""

from __future__ import annotations

from typing import Any

import pytest

import ss2sql

pytest.importorskip("pybullet")

import pybullet
import pybullet_data
from bullet_models import SOFT_BODIES, ask, models
from bullet_rooms import ENGINES

# In each of these PyBullet ends the process when it is asked what some link collides with, but for the first.
ROBOTS = (
    "mjcf/capsule.xml", "mjcf/capsule_fromtoX.xml", "mjcf/capsule_fromtoY.xml", "mjcf/capsule_fromtoZ.xml",
    "mjcf/ant.xml", "mjcf/half_cheetah.xml", "mjcf/hopper.xml", "mjcf/humanoid.xml", "mjcf/inverted_pendulum.xml",
    "mjcf/pusher.xml", "mjcf/reacher.xml", "mjcf/swimmer.xml", "mjcf/walker2d.xml",
)  # fmt: skip


def test_robots_of_mjcf_files_tell_all_columns() -> None:
    found = {one["model"]: one for one in ask((*ROBOTS, SOFT_BODIES[1]))}
    assert [name for name, one in found.items() if "rows" not in one] == []
    types = {name: one["rows"]["space"]["type"] for name, one in found.items()}
    assert types["mjcf/ant.xml"] == types["mjcf/walker2d.xml"] == {"compound": 1}
    assert types["mjcf/capsule_fromtoX.xml"] == types["mjcf/capsule.xml"] == {"plane": 1, "capsule": 1}
    assert types["mjcf/reacher.xml"] == {"plane": 1, "capsule": 4, "cylinder": 1, "compound": 1, "sphere": 1}
    assert types["cloth_z_up.obj (soft)"] == {"None": 1}
    robots = {name for name, one in found.items() if "True" in one["rows"]["space"]["isRobot"]}
    assert robots == {name for name in ROBOTS if "capsule" not in name}
    for way in ("", "_fromtoX", "_fromtoY", "_fromtoZ"):
        ((link, radius, length, place),) = found[f"mjcf/capsule{way}.xml"]["capsules"]
        assert (link, radius, length) == (-1, pytest.approx(0.05), pytest.approx(0.2))
        assert (place is None) is bool(way)  # PyBullet does not tell between which ends a capsule lies
    placed = found["mjcf/half_cheetah.xml"]["rows"]["space.shapes"]["pos"]
    assert placed == {"list": 6, "NoneType": 2}  # only one of its links has such a capsule
    collision = "cannot be tried at other places: PyBullet does not tell how the capsules of its link 0 lie"
    assert collision in found["mjcf/ant.xml"]["others"]["collision"]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_every_model_tells_all_columns() -> None:
    names = models("urdf", "sdf", "xml") + SOFT_BODIES
    found = {one["model"]: one for one in ask(names)}
    assert len(names) > 1100
    assert set(found) == set(names)
    assert {name: one for name, one in found.items() if one.get("at", "loading") != "loading"} == {}
    refused = [name for name, one in found.items() if "rows" not in one]
    assert len(refused) < 10, refused  # PyBullet itself does not load them
    moved = {name: one["moved"] for name, one in found.items() if not one.get("moved", 0.0) <= 4e-3}
    assert moved.keys() <= {"random_urdfs/168/168.urdf"}, moved  # a mesh without corners, which PyBullet puts anywhere


@pytest.mark.parametrize("turn", [(0, 0, 0), (0.3, 0.5, 0.7), (0.785398163, 0, 0), (0, 0.785398163, 0.785398163)])
@pytest.mark.parametrize(
    ("kind", "sizes", "name"),
    [
        (pybullet.GEOM_BOX, {"halfExtents": (0.3, 0.4, 0.5)}, "box"),
        (pybullet.GEOM_BOX, {"halfExtents": (0.05, 0.1, 0.4)}, "box"),
        (pybullet.GEOM_SPHERE, {"radius": 0.3}, "sphere"),
        (pybullet.GEOM_CYLINDER, {"radius": 0.1, "height": 0.6}, "cylinder"),
        (pybullet.GEOM_CAPSULE, {"radius": 0.1, "height": 0.6}, "capsule"),
        (None, {}, "ghost"),
    ],
)
def test_what_looks_like_a_capsule_is_what_it_collides_with(
    client: Any, ss: ss2sql.Session, kind: int | None, sizes: Any, name: str, turn: Any
) -> None:
    shape = -1 if kind is None else client.createCollisionShape(kind, **sizes)
    seen = client.createVisualShape(pybullet.GEOM_CAPSULE, radius=0.1, length=0.6)
    client.createMultiBody(1, shape, seen, (1, 2, 3), client.getQuaternionFromEuler(turn))
    ss.attach("space", client)
    for engine in ENGINES:
        assert ss.run("SELECT type FROM space AS list", engine=engine).value == [name]


def test_soft_bodies_give_none_and_never_the_numbers_of_others(client: Any, ss: ss2sql.Session) -> None:
    client.setAdditionalSearchPath(pybullet_data.getDataPath())
    client.resetSimulation(pybullet.RESET_USE_DEFORMABLE_WORLD)
    ball = client.loadURDF("sphere_small.urdf", (3, 0, 0))
    client.resetBaseVelocity(ball, (1, 2, 3), (4, 5, 6))
    client.loadSoftBody("cloth_z_up.obj", mass=1, useMassSpring=1)
    ss.attach("space", client)
    columns = "type, mass, friction, restitution, volume, vx, wz, isSphere, isRobot, isEnabled, hasBody"
    for engine in ENGINES:
        rows = ss.run(f"SELECT {columns} FROM space AS rows", engine=engine).value
        assert rows[0][0] == "sphere"
        assert rows[1] == ((None,) * 7) + (False, False, True, True)
        assert ss.run("SELECT velocity FROM space.links AS list", engine=engine).value[1] == [None, None, None]
        assert ss.run("SELECT mass FROM space.links AS list", engine=engine).value[1] is None
        with pytest.raises(ss2sql.ExecutionError, match="it is soft"):
            ss.run("SELECT collision(1, [0.0, 0.0, 5.0]) FROM [1] AS list", engine=engine)
