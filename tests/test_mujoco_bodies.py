"""Columns of MuJoCo's bodies: each is what MuJoCo itself says, or what follows from the definition of shapes."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np
import pytest
from body_queries import answer
from mujoco_rooms import fixture_robot as fixture_robot
from mujoco_rooms import fixture_ss as fixture_ss
from mujoco_rooms import mujoco

import ss2sql
from ss2sql.scenes.mujoco_chaos import chaos


def test_quaternions_have_their_real_part_last(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT qx, qy, qz, qw, quat FROM space WHERE name == 'crate';"
    assert answer(ss, script, engine) == [{"qx": 0.5, "qy": 0.5, "qz": 0.5, "qw": 0.5, "quat": [0.5, 0.5, 0.5, 0.5]}]
    assert answer(ss, "SELECT quat FROM space WHERE name == 'ball' AS list;", engine) == [[0, 0, 0, 1]]


def test_angles_make_the_matrix_that_mujoco_has(robot: tuple[Any, Any], ss: ss2sql.Session) -> None:
    model, data = robot
    random = np.random.default_rng(1)
    for turn in [*random.normal(size=(50, 4)), (1, 0, 1, 0), (1, 0, -1, 0), (0, 1, 0, 1), (1, 1, 1, 1)]:
        data.joint(model.body("ball").jntadr[0]).qpos[3:] = np.asarray(turn) / np.linalg.norm(turn)
        mujoco.mj_forward(model, data)
        (roll, pitch, yaw), (*_, qx, qy, qz, qw) = answer(
            ss, "SELECT rot, pose FROM space WHERE name == 'ball' AS rows;"
        )[0]
        x, y, z = (_around(axis, angle) for axis, angle in zip("xyz", (roll, pitch, yaw), strict=True))
        assert np.allclose(z @ y @ x, data.body("ball").xmat.reshape(3, 3), atol=1e-7)
        assert np.allclose((qw, qx, qy, qz), data.body("ball").xquat)


def _around(axis: str, angle: float) -> Any:
    c, s = np.cos(angle), np.sin(angle)
    return np.array({"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
                     "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}[axis])  # fmt: skip


def test_velocities_are_those_of_mj_object_velocity(robot: tuple[Any, Any], ss: ss2sql.Session, engine: Any) -> None:
    model, data = robot
    data.qvel[:] = np.arange(1.0, model.nv + 1)
    mujoco.mj_step(model, data)
    rows = answer(ss, "SELECT id, velocity, angularVelocity FROM space AS rows;", engine)
    assert len(rows) == model.nbody
    for number, linear, angular in rows:
        known = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, number, known, 0)
        assert np.allclose((*angular, *linear), known, atol=1e-12)


def test_volumes_of_shapes(ss: ss2sql.Session) -> None:
    volumes = dict(answer(ss, "SELECT name, volume FROM space AS rows;"))
    ball, arm = 4 / 3 * pi * 0.3**3, 4 / 3 * pi * 0.05**3 + pi * 0.05**2 * 0.4 + 4 / 3 * pi * 0.1**3
    assert volumes["world"] is None  # a plane has no end
    assert [volumes[name] for name in ("ball", "crate", "arm", "base", "lift", "ghost")] == pytest.approx(
        [ball, 0.2 * 0.4 * 0.6, arm, pi * 0.1**2 * 0.4, 4 / 3 * pi * 0.1 * 0.2 * 0.3, 0.0]
    )


def test_meshes_have_a_volume_and_count_once_where_another_shape_shows_them() -> None:
    corners = "0 0 0  1 0 0  0 1 0  0 0 1"
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco><asset><mesh name="corner" vertex="{corners}"/></asset><worldbody>
          <body name="solid"><geom type="mesh" mesh="corner"/></body>
          <body name="shown">
            <geom type="mesh" mesh="corner" contype="0" conaffinity="0"/><geom type="sphere" size="1"/>
          </body>
        </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with ss2sql.connect() as ss:
        ss.attach("space", data)
        rows = answer(ss, "SELECT type, volume, isMesh FROM space WHERE id > 0 AS rows;")
    assert rows == [["mesh", pytest.approx(1 / 6), True], ["sphere", pytest.approx(4 / 3 * pi), False]]


def test_boxes_hold_the_outermost_points_of_shapes() -> None:
    scene = chaos(4, 40)
    scene.step(50)
    with ss2sql.connect() as ss:
        ss.attach("space", scene)
        boxes = answer(ss, "SELECT id, aabb FROM space WHERE hasBody AS rows;")
    for number, (low, high) in boxes:
        (geom,) = np.flatnonzero(scene.model.geom_bodyid == number)
        for axis in range(3):
            for side, sign in ((low, -1), (high, 1)):
                direction = np.zeros(3)
                direction[axis] = sign
                outermost = _furthest(scene.model, scene.data, geom, direction)
                assert side[axis] == pytest.approx(outermost[axis], abs=1e-9)


def _furthest(model: Any, data: Any, geom: int, direction: Any) -> Any:
    """The point of a shape that lies furthest in a direction, by the shape's definition."""
    axes, (a, b, c) = data.geom_xmat[geom].reshape(3, 3), model.geom_size[geom]
    local = direction @ axes
    match mujoco.mjtGeom(int(model.geom_type[geom])):
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            point = a * local
        case mujoco.mjtGeom.mjGEOM_BOX:
            point = np.sign(local) * (a, b, c)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            point = a * local + (0, 0, np.sign(local[2]) * b)
        case _:
            across = np.hypot(local[0], local[1])
            point = np.array([a * local[0] / across, a * local[1] / across, np.sign(local[2]) * b])
    return data.geom_xpos[geom] + axes @ point


def test_who_is_a_robot_who_senses_who_can_move(ss: ss2sql.Session, engine: Any) -> None:
    def names(condition: str) -> Any:
        return answer(ss, f"SELECT name FROM space WHERE {condition} AS list;", engine)

    assert names("isRobot") == ["base", "arm"]
    assert names("isSensor(this)") == ["arm"]
    assert names("hasBody(this)") == ["ball", "crate", "arm", "lift"]
    assert names("NOT isEnabled") == ["ghost"]
    assert names("isSphere OR isBox") == ["ball", "crate"]


def test_forces_are_those_that_were_applied(robot: tuple[Any, Any], ss: ss2sql.Session) -> None:
    robot[1].body("ball").xfrc_applied[:] = [1, 2, 3, 4, 5, 6]
    assert answer(ss, "SELECT force, torque FROM space WHERE name == 'ball';") == [
        {"force": [1, 2, 3], "torque": [4, 5, 6]}
    ]
