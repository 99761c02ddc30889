"""ODE as a world, beside ODE's own interface. It runs where python3-pyode is installed."""

from __future__ import annotations

import gc
from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from simulators import ARGUMENTS, MuJoCo, Ode, answer

import ss2sql
from ss2sql.vtables.ode import OdeWorld


class Room(Ode):
    """A floor and some bodies, of which two are in an inner space."""

    def __init__(self) -> None:
        super().__init__()
        ode, self.world = self.ode, self.kept()
        self.space = ode.HashSpace()
        self.floor = ode.GeomPlane(self.space, (0, 0, 1), 0)
        self.floor.name = "floor"
        self.ball = self.add(self.world, ode.GeomSphere(self.space, 0.5), 60.0, (0, 0, 0.75), "ball")
        self.box = self.add(self.world, ode.GeomBox(self.space, (1, 1, 1)), 10.0, (2, 0, 0.5), "box")
        self.post = ode.GeomCylinder(self.space, 0.25, 2)
        self.post.setPosition((0, 3, 1))
        self.inner = ode.SimpleSpace(self.space)
        self.rod = self.add(self.world, ode.GeomCapsule(self.inner, 0.25, 1), 70.0, (3, 3, 1), "rod")
        self.pearl = self.add(self.world, ode.GeomSphere(self.inner, 0.1), 51.0, (-1, 0, 1), None)


@pytest.fixture
def room() -> Room:
    return Room()


@pytest.fixture
def ss(ss: ss2sql.Session, room: Room) -> ss2sql.Session:
    ss.attach("space", room.space)
    return ss


def test_check_world_passes_for_spaces_in_spaces(room: Room) -> None:
    report = ss2sql.check_world(room.space, queries=30, arguments=ARGUMENTS)
    assert report.elements == {"bodies": 6}


# --- columns -------------------------------------------------------------------------------------------


def test_the_geoms_of_inner_spaces_belong_to_it(ss: ss2sql.Session, engine: Any) -> None:
    rows = answer(ss, "SELECT name, type, mass, hasBody FROM space AS rows;", engine)
    assert rows[:4] == [
        ["floor", "plane", 0.0, False], ["ball", "sphere", 60.0, True], ["box", "box", 10.0, True],
        ["cylinder_4", "cylinder", 0.0, False],
    ]  # fmt: skip
    assert sorted(rows[4:]) == [["rod", "capsule", 70.0, True], ["sphere_6", "sphere", 51.0, True]]


def test_velocity_force_and_turn(room: Room, ss: ss2sql.Session, engine: Any) -> None:
    body = room.ball.getBody()
    body.setLinearVel((1, 2, 3))
    body.setAngularVel((4, 5, 6))
    body.addForce((7, 8, 9))
    body.addTorque((1, 1, 2))
    body.setQuaternion((0.5, 0.5, 0.5, 0.5))
    names = "velocity, vx, linearVelocity(this, 2), angularVelocity, force, torque, quat, qw, pose"
    assert answer(ss, f"SELECT {names} FROM space WHERE name == 'ball' AS rows;", engine) == [
        [[1, 2, 3], 1, 3, [4, 5, 6], [7, 8, 9], [1, 1, 2], [0.5] * 4, 0.5, [0, 0, 0.75, 0.5, 0.5, 0.5, 0.5]]
    ]
    body.setQuaternion((sqrt(0.5), 0, 0, sqrt(0.5)))
    assert answer(ss, "SELECT rot FROM space WHERE name == 'ball' AS list;", engine) == [pytest.approx([0, 0, pi / 2])]


def test_volumes_and_boxes(ss: ss2sql.Session, engine: Any) -> None:
    rows = answer(ss, "SELECT name, volume, aabb FROM space AS rows;", engine)
    volumes = {name: volume for name, volume, _ in rows}
    boxes = {name: box for name, _, box in rows}
    assert volumes["floor"] is None
    assert boxes["floor"] == [[-1e30, -1e30, -1e30], [1e30, 1e30, 0]]
    assert [volumes[name] for name in ("ball", "box", "rod", "cylinder_4")] == pytest.approx(
        [4 / 3 * pi * 0.5**3, 1.0, 4 / 3 * pi * 0.25**3 + pi * 0.25**2, pi * 0.25**2 * 2]
    )
    assert boxes["ball"] == [[-0.5, -0.5, 0.25], [0.5, 0.5, 1.25]]


def test_geoms_that_are_switched_off_and_geoms_inside_of_others(room: Room, ss: ss2sql.Session, engine: Any) -> None:
    wrapped = room.ode.GeomTransform(room.space)
    wrapped.setGeom(room.ode.GeomSphere(None, 0.5))
    wrapped.setPosition((9, 9, 9))
    wrapped.name = "wrapped"
    room.post.disable()
    assert answer(ss, "SELECT name FROM space WHERE NOT isEnabled AS list;", engine) == ["cylinder_4"]
    row = answer(ss, "SELECT type, volume, pos FROM space WHERE name == 'wrapped' AS rows;", engine)
    assert row == [["sphere", pytest.approx(pi / 6), [9, 9, 9]]]
    gap = "SELECT c.distance FROM a = space, c = space.closest(a.this, 1, 50) WHERE a.name == 'wrapped' AS list;"
    assert answer(ss, gap, engine) == [pytest.approx(8.5)]


# --- touching and distances ----------------------------------------------------------------------------


def test_contacts_are_those_of_collide(room: Room, ss: ss2sql.Session, engine: Any) -> None:
    room.ball.getBody().setPosition((0, 0, 0.25))
    script = "SELECT idA, idB, pos, normal, distance FROM space.contacts AS rows;"
    rows = answer(ss, script, engine)
    touching = [contact.getContactGeomParams() for contact in room.ode.collide(room.floor, room.ball)]
    known = [[1, 2, list(place), list(normal), -depth] for place, normal, depth, _, _ in touching]
    assert [row for row in rows if row[1] == 2] == known
    assert known[0][3:] == [[0, 0, -1], -0.25]
    turned = "SELECT idA, normal FROM f = space, c = space.contacts(f.this) WHERE f.name == 'ball' AS rows;"
    assert answer(ss, turned, engine) == [[2, [0, 0, 1]]]


SIZES = {"sphere": 1, "box": 3, "capsule": 2, "cylinder": 2}


def test_distances_agree_with_mujoco_for_random_solids(room: Room) -> None:
    """MuJoCo measures by itself what is computed here for ODE."""
    mujoco = pytest.importorskip("mujoco")
    ode, random = room.ode, np.random.default_rng(1)
    space, model, geoms = ode.SimpleSpace(), [], []
    for number in range(24):
        kind = list(SIZES)[number % 4]
        size, place, turn = random.uniform(0.1, 1, SIZES[kind]), random.uniform(-3, 3, 3), random.normal(size=4)
        made = {"sphere": ode.GeomSphere, "capsule": ode.GeomCapsule, "cylinder": ode.GeomCylinder}
        geom = ode.GeomBox(space, tuple(size)) if kind == "box" else made[kind](space, *size)
        geom.setPosition(tuple(place))
        geom.setQuaternion(tuple(turn / np.linalg.norm(turn)))
        geoms.append(geom)
        halves = size / 2 if kind == "box" else size * (1, 0.5)[: len(size)]
        texts = [" ".join(map(repr, map(float, values))) for values in (place, turn, halves)]
        model.append('<body pos="{}" quat="{}"><geom type="{}" size="{}"/></body>'.format(*texts[:2], kind, texts[2]))
    made, data = MuJoCo().made("".join(model))
    made.opt.ccd_tolerance, made.opt.ccd_iterations = 1e-12, 500
    world = OdeWorld(space)
    world.find_geoms()
    touching = 0
    for one in range(24):
        for other in range(one):
            known = mujoco.mj_geomDistance(made, data, one, other, 100, None)
            gap = world.measure_gap(one + 1, other + 1)
            touching += gap == 0
            assert gap == pytest.approx(max(known, 0.0), abs=1e-6)
    assert touching > 2


# --- lifetimes and moves -------------------------------------------------------------------------------


def test_nothing_is_kept_alive_and_numbers_stay(room: Room, ss: ss2sql.Session, engine: Any) -> None:
    (pearl,) = ss.eval("SELECT this FROM space WHERE name == 'sphere_6' AS list;")
    assert pearl.mass == 51.0
    room.pearl = None
    gc.collect()
    assert answer(ss, "len(SELECT this FROM space AS list);", engine) == 5
    with pytest.raises(ss2sql.Error, match="no longer exists"):
        pearl.mass  # noqa: B018
    room.space.remove(room.box)
    assert answer(ss, "SELECT name FROM space WHERE id == 3 AS list;", engine) == []
    room.space.add(room.box)
    assert answer(ss, "SELECT name FROM space WHERE id == 3 AS list;", engine) == ["box"]


def test_a_move_moves_the_body_and_no_plane(room: Room, ss: ss2sql.Session, engine: Any) -> None:
    assert answer(ss, "move('ball', [1.5, 0]);", engine) == [1.5, 0]
    assert room.ball.getBody().getPosition() == (1.5, 0, 0.75)
    with pytest.raises(ss2sql.Error, match="the plane floor cannot be moved"):
        ss.run("move('floor', [1, 1]);", engine=engine)
