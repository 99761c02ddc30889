"""OpenRAVE as a world. Where OpenRAVE itself cannot be imported, a stand-in for its documented interface is used."""

from __future__ import annotations

import sys
from math import pi, sqrt
from typing import Any

import fake_openravepy as fake
import numpy as np
import pytest
from simulators import ARGUMENTS, OpenRave, answer

import ss2sql
from ss2sql.vtables.openrave import OpenRaveWorld


@pytest.fixture(autouse=True)
def openravepy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "openravepy", fake)


@pytest.fixture
def room() -> fake.Environment:
    environment = fake.Environment()
    OpenRave.load(environment)
    return environment


@pytest.fixture
def ss(ss: ss2sql.Session, room: fake.Environment) -> ss2sql.Session:
    ss.attach("space", room)
    return ss


def test_check_world_passes(room: fake.Environment) -> None:
    report = ss2sql.check_world(OpenRaveWorld(room), queries=30, arguments=ARGUMENTS)
    assert report.elements == {"bodies": 3, "links": 4, "joints": 2}


def test_a_robot_is_the_sum_of_its_links(ss: ss2sql.Session, engine: Any) -> None:
    names = "type, mass, isRobot, isSensor, velocity, angularVelocity, volume, aabb, quat, rot"
    ((kind, mass, robot, sensor, velocity, spin, volume, (low, high), quat, rot),) = answer(
        ss, f"SELECT {names} FROM space WHERE name == 'YouBot' AS rows;", engine
    )
    assert (kind, mass, robot, sensor, velocity, spin) == ("compound", 21, True, True, [1, 2, 3], [4, 5, 6])
    assert volume == pytest.approx(1 * 0.6 * 0.4 + 4 / 3 * pi * 0.1**3)
    # the robot is turned by a right angle: its front, where the wheel is, looks along y
    assert low == pytest.approx([-3.3, -0.5, 0.6])
    assert high == pytest.approx([-2.7, 0.6, 1.2])
    assert quat == pytest.approx([0, 0, sqrt(0.5), sqrt(0.5)])  # the real part last
    assert rot == pytest.approx([0, 0, pi / 2])


def test_links_and_joints(ss: ss2sql.Session, engine: Any) -> None:
    rows = answer(ss, "SELECT body, number, name, type, mass FROM space.links WHERE body == 3 AS rows;", engine)
    assert rows == [[3, 0, "base", "box", 20], [3, 1, "wheel", "sphere", 1]]
    assert answer(ss, "SELECT pos FROM space.links WHERE name == 'wheel' AS list;", engine) == [
        pytest.approx([-3, 0.5, 0.7])
    ]
    rows = answer(ss, "SELECT body, name, type, angle, speed, lower, upper FROM space.joints AS rows;", engine)
    assert rows == [[3, "axle", "revolute", 0.25, 0, -1, 2], [3, "ball", "spherical", None, None, None, None]]


def test_distances_are_those_of_the_collision_checker(room: fake.Environment, ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT idB, distance FROM space.closest('ball', None, 9) AS rows;"
    assert answer(ss, script, engine)[0] == [2, pytest.approx(1.0)]
    assert room.checker.options == 0  # as it was
    room.checker.measures = False
    with pytest.raises(ss2sql.Error, match="measures no distances"):
        ss.run(script, engine=engine)
    assert room.checker.options == 0


def test_a_move_keeps_height_and_turn(room: fake.Environment, ss: ss2sql.Session, engine: Any) -> None:
    room.microseconds = 2_500_000
    assert answer(ss, "[move('YouBot', [2, 0]), checkCollision('YouBot'), getTime()];", engine) == [[2, 0], True, 2.5]
    assert room.bodies[2].GetTransform()[:3, 3].tolist() == [2, 0, 1]
    assert np.allclose(room.bodies[2].GetTransform()[:2, :2], [[0, -1], [1, 0]])


def test_openrave_itself_where_it_is_installed(monkeypatch: pytest.MonkeyPatch, engine: Any) -> None:
    monkeypatch.delitem(sys.modules, "openravepy")
    real = pytest.importorskip("openravepy", reason="OpenRAVE is not installed; it is built from its source")
    environment = real.Environment()
    try:
        for number, (x, radius) in enumerate([(0.0, 0.5), (2.0, 0.25)]):
            body = real.RaveCreateKinBody(environment, "")
            body.SetName(f"ball_{number}")
            body.InitFromSpheres(np.array([[0.0, 0.0, 0.0, radius]]), True)
            environment.Add(body)
            body.SetTransform([1, 0, 0, 0, x, 0, 1])
        with ss2sql.connect() as ss:
            ss.attach("space", environment)
            rows = answer(ss, "SELECT name, pos, isSphere FROM space AS rows;", engine)
            assert rows == [["ball_0", [0, 0, 1], True], ["ball_1", [2, 0, 1], True]]
            assert answer(ss, "[move('ball_1', [0.6, 0]), checkCollision('ball_1')];", engine) == [[0.6, 0], True]
        ss2sql.check_world(environment, queries=20)
    finally:
        environment.Destroy()
