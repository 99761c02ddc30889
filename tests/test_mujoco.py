"""MuJoCo as a world: every query beside a loop over MuJoCo's own interface."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest
from body_queries import ARGUMENTS, agree, answer
from mujoco_rooms import fixture_robot as fixture_robot
from mujoco_rooms import fixture_ss as fixture_ss
from mujoco_rooms import loop, mujoco

import ss2sql
from ss2sql.scenes.mujoco_chaos import chaos
from ss2sql.vtables.mujoco import MuJoCoWorld

# --- the same as a loop --------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_queries_give_what_loops_give(seed: int, engine: Any) -> None:
    scene = chaos(seed, 10 + 10 * seed)
    with ss2sql.connect() as ss:
        ss.attach("space", scene)
        agree(ss, loop(scene.model, scene.data), engine)
        scene.step(30)
        agree(ss, loop(scene.model, scene.data), engine)


def test_a_robot_too(robot: tuple[Any, Any], ss: ss2sql.Session, engine: Any) -> None:
    agree(ss, loop(*robot), engine)
    for _ in range(20):
        mujoco.mj_step(*robot)
    agree(ss, loop(*robot), engine)


def test_check_world_passes_for_the_robot(robot: tuple[Any, Any]) -> None:
    model, data = robot
    report = ss2sql.check_world(
        MuJoCoWorld(model, data), queries=40, arguments=ARGUMENTS, change=lambda random: mujoco.mj_step(model, data)
    )
    assert report.elements == {"bodies": 7, "geoms": 7, "joints": 4, "sensors": 2}
    assert report.skipped == []


# --- the other tables ----------------------------------------------------------------------------------


def test_joints(ss: ss2sql.Session, engine: Any) -> None:
    rows = answer(ss, "SELECT name, type, lower, upper FROM space.joints AS rows;", engine)
    assert rows == [
        ["", "free", None, None], ["", "free", None, None], ["elbow", "hinge", -1, 2], ["rail", "slide", None, None],
    ]  # fmt: skip


def test_joints_move(robot: tuple[Any, Any], ss: ss2sql.Session) -> None:
    model, data = robot
    data.joint("elbow").qpos, data.joint("elbow").qvel = 0.25, 0.5
    mujoco.mj_forward(model, data)
    assert answer(ss, "SELECT angle, speed, axis FROM space.joints WHERE name == 'elbow';") == [
        {"angle": 0.25, "speed": 0.5, "axis": [0, 0, 1]}
    ]
    joined = "SELECT b.name FROM j = space.joints, b = space WHERE j.body == b.id AND j.name == 'rail' AS list;"
    assert answer(ss, joined) == ["lift"]


def test_sensors(robot: tuple[Any, Any], ss: ss2sql.Session, engine: Any) -> None:
    rows = answer(ss, "SELECT name, type, value, values FROM space.sensors AS rows;", engine)
    felt = robot[1].sensor("felt").data.tolist()
    assert rows == [["felt", "accelerometer", None, felt], ["turned", "jointpos", 0.0, [0.0]]]


def test_geoms(ss: ss2sql.Session, engine: Any) -> None:
    rows = answer(ss, "SELECT name, type, body FROM space.geoms WHERE isSphere(this) AS rows;", engine)
    assert rows == [["ball", "sphere", 1], ["", "sphere", 4]]
    assert answer(ss, "SELECT pos FROM space.geoms WHERE id == 4 AS list;", engine) == [[3.5, 0, 1]]


def test_contacts_are_those_of_mujoco(robot: tuple[Any, Any], engine: Any, ss: ss2sql.Session) -> None:
    model, data = robot
    data.joint(0).qpos[:3] = (0, 0, 0.29)
    mujoco.mj_forward(model, data)
    (contact,) = data.contact
    pressed = np.zeros(6)
    mujoco.mj_contactForce(model, data, 0, pressed)
    script = "SELECT idA, idB, pointA, pointB, normal, distance, normalForce FROM space.contacts AS rows;"
    assert answer(ss, script, engine) == [
        [0, 1, pytest.approx([0, 0, 0]), pytest.approx([0, 0, -0.01]), [0, 0, -1],
         pytest.approx(-0.01), pytest.approx(pressed[0])]
    ]  # fmt: skip
    assert contact.dist == pytest.approx(-0.01)
    turned = "SELECT idA, pointA, c.normal FROM f = space, c = space.contacts(f.this) WHERE f.name == 'ball' AS rows;"
    assert answer(ss, turned, engine) == [[1, pytest.approx([0, 0, -0.01]), [0, 0, 1]]]


# --- functions -----------------------------------------------------------------------------------------


def test_distances_between_surfaces(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT c.distance FROM a = space, c = space.closest(a.this, 2, 5.0) WHERE a.name == 'ball' AS list;"
    # the box is turned: its half edges of 0.1, 0.2 and 0.3 lie along y, z and x; its nearest corner edge is at x = 0.7
    assert answer(ss, script, engine) == pytest.approx([0.4], abs=1e-6)


def test_bodies_are_moved_and_tried_out(robot: tuple[Any, Any], ss: ss2sql.Session, engine: Any) -> None:
    _, data = robot
    before = data.qpos.copy()
    script = "[collision('ball', [0.5, 0, 0.5]), collision('ball', [-2, 2, 2]), collision('ball', 2)];"
    assert answer(ss, script, engine) == [True, False, False]
    assert (data.qpos == before).all()
    assert answer(ss, "[move('ball', [0.5, 0, 0.5]), checkCollision('ball'), position('ball')];", engine) == [
        [0.5, 0, 0.5], True, [0.5, 0],
    ]  # fmt: skip
    assert answer(ss, "[move('ghost', [1, 1, 1, 0, 0, 0, 2]), position('ghost')];", engine)[1] == [1, 1]
    with pytest.raises(ss2sql.Error, match="the body 'base' cannot be moved freely"):
        answer(ss, "move('base', [1, 1]);", engine=engine)


def test_above_below_within_and_overlaps(ss: ss2sql.Session, engine: Any) -> None:
    def names(condition: str, source: str = "space") -> Any:
        return answer(ss, f"SELECT name FROM {source} WHERE {condition} AS list;", engine)

    assert names("within(this, [[-1, -1, -1], [2, 1, 2]])") == ["ball", "crate"]
    assert names("above(this, [[2, -1, -1], [4, 1, 0]])") == ["base", "arm"]
    assert names("below(this, [[-1, -1, 1], [1, 1, 2]])") == ["world", "ball", "crate"]
    assert names("hasBody", "space.overlaps([[0.5, -1, 0], [1.2, 1, 1]])") == ["crate"]


def test_the_clock_is_that_of_mujoco(robot: tuple[Any, Any], ss: ss2sql.Session) -> None:
    mujoco.mj_step(*robot)
    assert answer(ss, "getTime();") == robot[1].time > 0


# --- whole arrays --------------------------------------------------------------------------------------


class Counting:
    """MuJoCo's data, or its model, that count how often their arrays are fetched."""

    def __init__(self, real: Any, counts: Counter[str]) -> None:
        self.__dict__.update(real=real, counts=counts)

    def __getattr__(self, name: str) -> Any:
        self.counts[name] += 1
        return getattr(self.real, name)


@pytest.mark.parametrize("count", [10, 1000])
def test_a_scan_fetches_arrays_a_constant_number_of_times(count: int, engine: Any) -> None:
    bodies = "".join(
        f'<body name="b{n}" pos="{n % 10} {n // 10 % 10} {n // 100}"><freejoint/><geom size=".1"/></body>'
        for n in range(count)
    )
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    counts: Counter[str] = Counter()
    ss = ss2sql.connect()
    ss.attach("space", MuJoCoWorld(Counting(model, counts), Counting(data, counts)))
    counts.clear()
    script = "SELECT name, x, pos, quat, velocity, mass, volume, aabb FROM space WHERE isSphere(this) AS rows;"
    rows = answer(ss, script, engine)
    assert len(rows) == count
    del counts["_pybind11_conduit_v1_"]  # of MuJoCo's functions for names, which never change and are kept
    assert max(counts.values()) <= 20
    assert counts["xpos"] <= 6


# --- bad input -----------------------------------------------------------------------------------------


def test_data_that_nothing_has_been_computed_of_are_refused(robot: tuple[Any, Any], engine: Any) -> None:
    model, _ = robot
    data = mujoco.MjData(model)
    with ss2sql.connect() as ss:
        ss.attach("space", data)
        with pytest.raises(ss2sql.Error, match="has not computed these data yet"):
            answer(ss, "SELECT name FROM space;", engine=engine)
        mujoco.mj_forward(model, data)
        assert len(ss.run("SELECT name FROM space AS list;", engine)) == 7


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("SELECT colour FROM space;", "colour"),
        ("SELECT distance FROM space.closest(1, 2);", "lacks distance"),
        ("move('bal', [1, 2]);", "no body is called 'bal'"),
        ("move('ball', [1]);", r"a place \[x, y\]"),
        ("SELECT linearVelocity(this, 3) FROM space;", "an axis 0, 1 or 2"),
        ("SELECT name FROM space WHERE within(this, [1, 2]);", "a box"),
        ("SELECT name FROM space WHERE distance(this, [1]) < 1;", "two or three numbers"),
    ],
)
def test_wrong_use_is_told(ss: ss2sql.Session, engine: Any, script: str, message: str) -> None:
    with pytest.raises(ss2sql.Error, match=message):
        answer(ss, script, engine=engine)
    assert len(ss.run("SELECT name FROM space AS list;", engine)) == 7


def test_what_is_no_data_is_refused() -> None:
    with pytest.raises(ss2sql.Error, match="a int is no data of MuJoCo"):
        MuJoCoWorld(3)


# --- the scene -----------------------------------------------------------------------------------------


def test_chaos_is_the_same_for_the_same_seed() -> None:
    one, other, another = chaos(7, 30), chaos(7, 30), chaos(8, 30)
    assert one.mjcf == other.mjcf != another.mjcf
    one.step(100)
    for _ in range(100):
        other.step()
    assert np.array_equal(one.data.qpos, other.data.qpos)


def test_chaos_stays_in_its_box() -> None:
    scene = chaos(2, 60)
    for _ in range(20):
        scene.step(60)
        moving = scene.data.xpos[7:]
        assert np.abs(moving).max() < 5.05
    assert len(scene.names) == scene.model.nbody == 67
    assert np.linalg.norm(scene.data.qvel) > 1
