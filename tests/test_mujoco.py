"""MuJoCo as a world: each column is what MuJoCo itself says, or what follows from the definition of shapes."""

from __future__ import annotations

from collections import Counter
from math import cos, hypot, pi, sin, sqrt
from typing import Any

import numpy as np
import pytest
from simulators import ARGUMENTS, MuJoCo, agree, answer

import ss2sql
from ss2sql.vtables.mujoco import MuJoCoWorld
from ss2sql.vtables.mujoco.mujoco_tables import MuJoCoGeoms, MuJoCoJoints

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install mujoco")
ROBOT = """
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="ball" pos="0 0 0.3"><freejoint/><geom name="ball" type="sphere" size=".3" mass="60"/></body>
    <body name="crate" pos="1 0 .5" quat="0.5 0.5 0.5 0.5">
      <freejoint/><geom type="box" size=".1 .2 .3" mass="20"/>
    </body>
    <body name="base" pos="3 0 1">
      <geom type="cylinder" size=".1 .2" mass="5"/>
      <body name="arm" pos=".5 0 0">
        <joint name="elbow" type="hinge" axis="0 0 1" limited="true" range="-1 2"/>
        <geom type="capsule" size=".05 .2" mass="2"/><geom type="sphere" size=".1" pos="0 0 .5" mass="1"/>
        <site name="hand"/>
      </body>
    </body>
    <body name="lift" pos="-3 0 1">
      <joint name="rail" type="slide"/><geom type="ellipsoid" size=".1 .2 .3" mass="3"/>
    </body>
    <body name="ghost" pos="0 3 1" mocap="true"/>"""
AROUND = """
    <compiler angle="radian"/><actuator><motor joint="elbow"/></actuator>
    <sensor><accelerometer name="felt" site="hand"/><jointpos name="turned" joint="elbow"/></sensor>"""


@pytest.fixture
def robot() -> tuple[Any, Any]:
    return MuJoCo().made(ROBOT, AROUND)


@pytest.fixture
def ss(ss: ss2sql.Session, robot: tuple[Any, Any]) -> ss2sql.Session:
    ss.attach("space", robot[1])
    return ss


def test_queries_over_a_robot_give_what_loops_give(robot: tuple[Any, Any], ss: ss2sql.Session, engine: Any) -> None:
    for _ in range(2):
        agree(ss, MuJoCo().look(*robot), engine)
        for _ in range(20):
            mujoco.mj_step(*robot)
        mujoco.mj_forward(*robot)


def test_a_pair_of_model_and_data_is_their_world(ss: ss2sql.Session, robot: tuple[Any, Any], engine: Any) -> None:
    for pair in (robot, list(robot)):
        ss.attach("pair", pair)
        wanted = answer(ss, "SELECT name, x FROM space AS rows;", engine)
        assert answer(ss, "SELECT name, x FROM pair AS rows;", engine) == wanted


def test_a_model_without_data_is_refused_with_the_cure(ss: ss2sql.Session, robot: tuple[Any, Any]) -> None:
    with pytest.raises(ss2sql.SessionError, match="attach its MjData"):
        ss.attach("model", robot[0])


def test_functions_take_a_shape_for_itself_and_not_for_the_body_of_its_number(
    robot: tuple[Any, Any], ss: ss2sql.Session, engine: Any
) -> None:
    """And for its body where only bodies have what they ask for."""
    model, data = robot
    columns = "distance(this, [0, 0, 0]), within(this, aabb), position(this), linearVelocity(this, 2), collision(this)"
    data.qvel[2] = 7.0  # of the ball
    mujoco.mj_forward(model, data)
    wanted = [
        [hypot(*place), True, list(place[:2]), 7.0 if body == 1 else 0.0, body in (0, 1)]
        for place, body in zip(data.geom_xpos.tolist(), model.geom_bodyid.tolist(), strict=True)
    ]
    assert answer(ss, f"SELECT {columns} FROM space.geoms AS rows;", engine) == wanted
    floor = "SELECT b.id FROM g=space.geoms, b=space WHERE g.name == 'floor' AND above(b.this, g.this) AS list;"
    assert answer(ss, floor, engine) == list(range(1, model.nbody))
    with pytest.raises(ss2sql.ExecutionError, match="joints have no column 'aabb'"):
        answer(ss, "SELECT above(this, 1) FROM space.joints AS list;", engine)


def test_a_name_of_several_bodies_is_none_of_one() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body pos='1 0 0'/><body pos='2 0 0'/><body name='only'/></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with ss2sql.connect() as session:
        session.attach("space", data)
        with pytest.raises(ss2sql.ExecutionError, match="2 bodies are called ''"):
            session.run("position('');")


def test_a_body_without_a_position_fails_where_it_is_read(
    robot: tuple[Any, Any], ss: ss2sql.Session, engine: Any
) -> None:
    robot[1].xpos[1] = np.nan
    for condition in ("x >= -1e9", "NOT x < -1e9", "x + 0 >= 0", "distance(this, [0, 0, 0]) < 9", "pos[0] < 9"):
        with pytest.raises(ss2sql.ExecutionError, match=r"of bodies\[1\] holds NaN.*\n(.*\n)*.*WHERE id != 1 AND"):
            answer(ss, f"SELECT id FROM space WHERE {condition};", engine)
        found = answer(ss, f"SELECT id FROM space WHERE id != 1 AND ({condition}) AND pos[0] > -1 AS list;", engine)
        assert {0, 2, 3} <= set(found)
    for script in ("SELECT distance(this, [0, 0, 0]) FROM space;", "SELECT id FROM space.near([0, 0, 0], 9);"):
        with pytest.raises(ss2sql.ExecutionError, match=r"of bodies\[1\] holds NaN"):
            answer(ss, script, engine)


def test_check_world_passes_for_the_robot(robot: tuple[Any, Any]) -> None:
    model, data = robot
    report = ss2sql.check_world(
        MuJoCoWorld(model, data), queries=40, arguments=ARGUMENTS, change=lambda random: mujoco.mj_step(model, data)
    )
    assert (report.elements, report.skipped) == ({"bodies": 7, "geoms": 7, "joints": 4, "sensors": 2}, [])


# --- columns of bodies ---------------------------------------------------------------------------------


def test_angles_make_the_matrix_that_mujoco_has(robot: tuple[Any, Any], ss: ss2sql.Session) -> None:
    model, data = robot
    random = np.random.default_rng(1)
    for turn in [*random.normal(size=(20, 4)), (1, 0, 1, 0), (1, 0, -1, 0), (0, 1, 0, 1), (1, 1, 1, 1)]:
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
        assert np.allclose((*angular, *linear), MuJoCo().velocity(model, data, number), atol=1e-12)


def test_volumes_of_shapes_and_meshes(ss: ss2sql.Session) -> None:
    volumes = dict(answer(ss, "SELECT name, volume FROM space AS rows;"))
    ball, arm = 4 / 3 * pi * 0.3**3, 4 / 3 * pi * 0.05**3 + pi * 0.05**2 * 0.4 + 4 / 3 * pi * 0.1**3
    assert volumes["world"] is None  # a plane has no end
    assert [volumes[name] for name in ("ball", "crate", "arm", "base", "lift", "ghost")] == pytest.approx(
        [ball, 0.2 * 0.4 * 0.6, arm, pi * 0.1**2 * 0.4, 4 / 3 * pi * 0.1 * 0.2 * 0.3, 0.0]
    )
    _, data = MuJoCo().made(
        """<body name="solid"><geom type="mesh" mesh="corner"/></body>
           <body name="shown">
             <geom type="mesh" mesh="corner" contype="0" conaffinity="0"/><geom type="sphere" size="1"/>
           </body>""",
        '<asset><mesh name="corner" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/></asset>',
    )
    ss.attach("space", data)
    rows = answer(ss, "SELECT type, volume, isMesh FROM space WHERE id > 0 AS rows;")
    assert rows == [["mesh", pytest.approx(1 / 6), True], ["sphere", pytest.approx(4 / 3 * pi), False]]


def test_boxes_hold_the_outermost_points_of_turned_shapes(ss: ss2sql.Session, engine: Any) -> None:
    """All are turned by 45 degrees around x, and then so that x, y and z become y, z and x."""
    a, b, c, r = 0.1, 0.2, 0.3, sqrt(0.5)
    halves = {
        "sphere": (a, a, a), "box": (a, (b + c) * r, (b + c) * r), "capsule": (a, b * r + a, b * r + a),
        "cylinder": (a, (a + b) * r, (a + b) * r), "ellipsoid": (a, hypot(b, c) * r, hypot(b, c) * r),
    }  # fmt: skip
    less, more = (cos(pi / 8) - sin(pi / 8)) / 2, (cos(pi / 8) + sin(pi / 8)) / 2
    turn = f"{less} {more} {more} {less}"
    _, data = MuJoCo().made("".join(
        f'<body name="{kind}" pos="1 2 3" quat="{turn}"><geom type="{kind}" size="{a} {b} {c}"/></body>'
        for kind in halves
    ))  # fmt: skip
    ss.attach("space", data)
    for kind, (low, high) in answer(ss, "SELECT name, aabb FROM space WHERE id > 0 AS rows;", engine):
        y, z, x = halves[kind]
        assert (low, high) == (pytest.approx([1 - x, 2 - y, 3 - z]), pytest.approx([1 + x, 2 + y, 3 + z]))


def test_the_box_of_a_mesh_is_that_of_its_points(ss: ss2sql.Session, engine: Any) -> None:
    """Of one whose convex hull MuJoCo has, with more points inside, and of one that nothing can touch."""
    points = np.random.default_rng(1).normal(size=(40, 3))
    ball = " ".join(map(str, np.vstack((points, points / 3)).ravel()))
    turned = 'pos="1 2 3" quat=".3 .2 .5 .1"'
    model, data = MuJoCo().made(
        f"""<body {turned}><geom type="mesh" mesh="ball"/></body>
            <body {turned}><geom type="mesh" mesh="seen" contype="0" conaffinity="0"/></body>""",
        f'''<asset><mesh name="ball" vertex="{ball}" scale="1 .5 2"/>
            <mesh name="seen" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/></asset>''',
    )
    ss.attach("space", data)
    boxes = answer(ss, "SELECT aabb FROM space.geoms AS list;", engine)
    for geom, mesh in enumerate(model.geom_dataid):
        first = model.mesh_vertadr[mesh]
        corners = model.mesh_vert[first : first + model.mesh_vertnum[mesh]] @ data.geom_xmat[geom].reshape(3, 3).T
        corners += data.geom_xpos[geom]
        assert np.allclose(boxes[geom], [corners.min(axis=0), corners.max(axis=0)], atol=1e-6)


@pytest.mark.parametrize(
    ("condition", "names"),
    [("isRobot", ["base", "arm"]), ("isSensor(this)", ["arm"]), ("hasBody(this)", ["ball", "crate", "arm", "lift"]),
     ("NOT isEnabled", ["ghost"]), ("isSphere OR isBox", ["ball", "crate"]),
     ("below(this, [[-1, -1, 1], [1, 1, 2]])", ["world", "ball", "crate"])],
)  # fmt: skip
def test_who_is_what(ss: ss2sql.Session, engine: Any, condition: str, names: list[str]) -> None:
    assert answer(ss, f"SELECT name FROM space WHERE {condition} AS list;", engine) == names


def test_forces_are_those_applied_and_the_clock_is_that_of_mujoco(robot: tuple[Any, Any], ss: ss2sql.Session) -> None:
    robot[1].body("ball").xfrc_applied[:] = [1, 2, 3, 4, 5, 6]
    assert answer(ss, "SELECT force, torque FROM space WHERE name == 'ball';") == [
        {"force": [1, 2, 3], "torque": [4, 5, 6]}
    ]
    mujoco.mj_step(*robot)
    assert answer(ss, "getTime();") == robot[1].time > 0


# --- the other tables ----------------------------------------------------------------------------------


def test_sensors_geoms_and_joints(robot: tuple[Any, Any], ss: ss2sql.Session, engine: Any) -> None:
    rows = answer(ss, "SELECT name, type, value, values FROM space.sensors AS rows;", engine)
    felt = robot[1].sensor("felt").data.tolist()
    assert rows == [["felt", "accelerometer", None, felt], ["turned", "jointpos", 0.0, [0.0]]]
    rows = answer(ss, "SELECT name, type, body FROM space.geoms WHERE isSphere(this) AS rows;", engine)
    assert rows == [["ball", "sphere", 1], ["", "sphere", 4]]
    assert answer(ss, "SELECT pos FROM space.geoms WHERE id == 4 AS list;", engine) == [[3.5, 0, 1]]
    model, data = robot
    rows = answer(ss, "SELECT name, type, lower, upper FROM space.joints AS rows;", engine)
    assert rows == [
        ["", "free", None, None], ["", "free", None, None], ["elbow", "hinge", -1, 2], ["rail", "slide", None, None],
    ]  # fmt: skip
    data.joint("elbow").qpos, data.joint("elbow").qvel = 0.25, 0.5
    mujoco.mj_forward(model, data)
    assert answer(ss, "SELECT angle, speed, axis FROM space.joints WHERE name == 'elbow';", engine) == [
        {"angle": 0.25, "speed": 0.5, "axis": [0, 0, 1]}
    ]
    joined = "SELECT b.name FROM j = space.joints, b = space WHERE j.body == b.id AND j.name == 'rail' AS list;"
    assert answer(ss, joined, engine) == ["lift"]


@pytest.mark.parametrize("table", ["geoms", "joints"])
def test_parts_are_looked_up_by_their_body(
    robot: tuple[Any, Any], ss: ss2sql.Session, engine: Any, table: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    part, given = {"geoms": MuJoCoGeoms, "joints": MuJoCoJoints}[table], []
    keys = part.keys
    monkeypatch.setattr(part, "keys", lambda self, where: given.append(list(keys(self, where))) or given[-1])
    wanted = answer(ss, f"SELECT body, id FROM space.{table} AS rows;", engine)
    for body in range(robot[0].nbody):
        given.clear()
        found = answer(ss, f"SELECT id FROM space.{table} WHERE body == {body} AS list;", engine)
        assert found == [number for owner, number in wanted if owner == body]
        assert given == [found]
    for nobody in (-1, 0.5, 99):
        assert answer(ss, f"SELECT id FROM space.{table} WHERE body == {nobody} AS list;", engine) == []


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


def test_a_turned_box_is_measured_and_what_cannot_be_moved_stays(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT c.distance FROM a = space, c = space.closest(a.this, 2, 5.0) WHERE a.name == 'ball' AS list;"
    # the box is turned: its half edges of 0.1, 0.2 and 0.3 lie along y, z and x; its nearest corner edge is at x = 0.7
    assert answer(ss, script, engine) == pytest.approx([0.4], abs=1e-6)
    assert answer(ss, "[move('ghost', [1, 1, 1, 0, 0, 0, 2]), position('ghost')];", engine)[1] == [1, 1]
    with pytest.raises(ss2sql.Error, match="the body 'base' cannot be moved freely"):
        answer(ss, "move('base', [1, 1]);", engine)


ARM = """
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="robot" pos="0 0 .1"><freejoint/><geom type="cylinder" size=".2 .1" mass="3"/>
      <body name="arm" pos="0 0 .15"><joint axis="0 0 1"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".04"/>
        <body name="hand" pos=".5 0 0"><joint axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 .5 0 0" size=".04"/>
        </body>
      </body>
    </body>"""


def test_a_body_is_tried_with_all_that_hangs_on_it(ss: ss2sql.Session, engine: Any) -> None:
    """As MuJoCo measures between the tree of the robot and the rest of the world; each of its contacts is found, too.

    Its own search for contacts overlooks one place, where a cylinder reaches 27 mm into a box.
    """
    dice = np.random.default_rng(5)
    kinds = ("box", "cylinder", "capsule")
    around = "".join(
        f'<body pos="{x} {y} .2"><geom type="{kinds[k % 3]}" size=".15 .2 .2"/></body>'
        for k, (x, y) in enumerate(dice.uniform(-2, 2, (12, 2)))
    )
    model, data = MuJoCo().made(ARM + around)
    data.qpos[7:] = 0.3, 2.8  # the hand is turned back into the base, which is no collision of the robot
    mujoco.mj_forward(model, data)
    ss.attach("space", data)
    moved = mujoco.MjData(model)
    moved.qpos[:] = data.qpos
    roots = model.body_rootid[model.geom_bodyid]
    own, other = np.flatnonzero(roots == 1), np.flatnonzero(roots != 1)
    places, wanted, overlooked = dice.uniform(-2, 2, (300, 2)).tolist(), [], 0
    for place in places:
        moved.qpos[:2] = place
        mujoco.mj_forward(model, moved)
        wanted.append(any(mujoco.mj_geomDistance(model, moved, a, b, 1, None) <= -0.001 for a in own for b in other))
        contacts = roots[moved.contact.geom[moved.contact.dist <= -0.001]]
        overlooked += wanted[-1] - bool(((contacts == 1).sum(axis=1) == 1).any())
    ss.set("places", places)
    assert answer(ss, "SELECT collision('robot', this, -0.001) FROM places AS list;", engine) == wanted
    assert {True, False} == set(wanted)
    assert overlooked in (0, 1)
    assert not answer(ss, "collision('robot', [9, 9], -0.001);", engine)  # on its floor
    assert answer(ss, "collision('robot', [9, 9], 0.01);", engine)


def test_a_name_is_the_whole_robot(ss: ss2sql.Session, engine: Any) -> None:
    wall = '<body name="wall" pos="1.1 0 .3"><geom type="box" size=".1 1 .3"/></body>'
    data = MuJoCo().made(ARM + wall)[1]
    ss.attach("space", data)
    touching = (
        "[collision('robot', None, -0.001), collision('arm'), checkCollision('hand'), collision('wall', 'robot')];"
    )
    assert answer(ss, touching, engine) == [True] * 4
    data.qpos[7:] = 0, 3.1  # the hand is turned back along the arm into the base
    mujoco.mj_forward(data.model, data)
    parts = "[collision('hand', 'robot'), collision('arm', 'hand'), collision('hand', 'hand')];"
    assert answer(ss, parts, engine) == [True, False, False]  # neighbours at a joint do not touch in MuJoCo
    data.qpos[8] = 0
    mujoco.mj_forward(data.model, data)
    assert answer(ss, "[mass('robot'), aabb('robot')[1][0]];", engine) == [3, pytest.approx(1.04)]
    found = answer(ss, "SELECT name FROM space.overlaps([[1, 0, 0], [2, 0, 1]]) AS list;", engine)
    assert found == ["world", "robot", "arm", "hand", "wall"]
    contacts = "SELECT count(*) FROM space.contacts({}) AS value;"
    assert answer(ss, contacts.format("'robot', 'wall'"), engine) == answer(ss, contacts.format("'wall'"), engine) > 0
    (near,) = answer(ss, "SELECT distance FROM space.closest('robot', 'wall', 1) AS list;", engine)
    assert near < 0
    with pytest.raises(ss2sql.ExecutionError, match=r"bodies\[99\] no longer exists"):
        answer(ss, "collision(99);", engine)


@pytest.mark.parametrize("flag", ["", '<option><flag contact="disable"/></option>'])
def test_every_form_of_collision_has_one_rule_for_what_may_touch(ss: ss2sql.Session, engine: Any, flag: str) -> None:
    """A body in a wall: at a pose, now, and with the wall; MuJoCo itself looks for no contact of a mocap body there."""
    box, filtered = (
        '<geom type="box" size=".2 .2 .2"/>',
        '<geom name="{0}" type="box" size=".2 .2 .2" contype="2" conaffinity="2"/>',
    )
    names = {"tool": True, "crate": True, "left_out": False, "other_kind": False, "paired": True}
    _, data = MuJoCo().made(
        '<body name="wall" pos="1 0 .5"><geom name="wall" type="box" size=".1 1 .5"/></body>'
        + "".join(
            f"""<body name="{name}" pos="5 {9 * number} 0" mocap="{str(number == 0).lower()}">
            {"" if number == 0 else "<freejoint/>"}{box if number < 3 else filtered.format(name)}</body>"""
            for number, name in enumerate(names)
        ),
        f"""{flag}<contact><exclude body1="left_out" body2="wall"/><pair geom1="paired" geom2="wall"/></contact>""",
    )
    ss.attach("space", data)
    for name, touches in names.items():
        home = ss.eval("[x(n), y(n)]", n=name)
        there = "[collision(n, [1, 0, .5]), collision(n, [1, 0, .5], -0.1), collision(n, [1.29, 0, .5], 0.01)]"
        assert ss.eval(there, engine=engine, n=name) == [touches] * 3
        ss.eval("move(n, [1, 0, .5])", n=name)
        now = "[collision(n), checkCollision(n), collision(n, 'wall'), collision('wall', n), collision('wall')]"
        assert ss.eval(now, engine=engine, n=name) == [touches] * 5
        ss.eval("move(n, home)", n=name, home=home)
        away = "[collision(n), checkCollision(n), collision(n, 'wall'), collision(n, [1.4, 0, .5])]"
        assert ss.eval(away, engine=engine, n=name) == [False] * 4
    assert ss.eval("SELECT distance FROM space.closest('tool', 'wall', 99) AS list;", engine=engine) > [3]


def test_bodies_touch_a_terrain(ss: ss2sql.Session, engine: Any) -> None:
    ground = '<geom type="hfield" hfield="ground"/><body name="ball" pos="0 0 2"><freejoint/><geom size=".1"/></body>'
    model, data = MuJoCo().made(ground, '<asset><hfield name="ground" nrow="20" ncol="20" size="3 3 1 .1"/></asset>')
    model.hfield_data[:] = 1
    ss.attach("space", data)
    touching = "[collision('ball', [0, 0, 1.05]), collision('ball', [0, 0, 1.2]), collision('ball', 'world')];"
    assert answer(ss, touching, engine) == [True, False, False]


# --- whole arrays, and bad input -----------------------------------------------------------------------


class Counting:
    """MuJoCo's data, or its model, that count how often their arrays are fetched."""

    def __init__(self, real: Any, counts: Counter[str]) -> None:
        self.__dict__.update(real=real, counts=counts)

    def __getattr__(self, name: str) -> Any:
        self.counts[name] += 1
        return getattr(self.real, name)


@pytest.mark.parametrize("count", [10, 300])
def test_a_scan_fetches_arrays_a_constant_number_of_times(ss: ss2sql.Session, count: int, engine: Any) -> None:
    model, data = MuJoCo().made("".join(
        f'<body name="b{n}" pos="{n % 10} {n // 10 % 10} {n // 100}"><freejoint/><geom size=".1"/></body>'
        for n in range(count)
    ))  # fmt: skip
    counts: Counter[str] = Counter()
    ss.attach("space", MuJoCoWorld(Counting(model, counts), Counting(data, counts)))
    counts.clear()
    script = "SELECT name, x, pos, quat, velocity, mass, volume, aabb FROM space WHERE isSphere(this) AS rows;"
    assert len(answer(ss, script, engine)) == count
    del counts["_pybind11_conduit_v1_"]  # of MuJoCo's functions for names, which never change and are kept
    assert max(counts.values()) <= 20
    assert counts["xpos"] <= 6


def test_what_is_no_data_or_not_computed_is_refused(robot: tuple[Any, Any], ss: ss2sql.Session, engine: Any) -> None:
    with pytest.raises(ss2sql.Error, match="a int is no data of MuJoCo"):
        MuJoCoWorld(3)
    data = mujoco.MjData(robot[0])
    ss.attach("space", data)
    with pytest.raises(ss2sql.Error, match="has not computed these data yet"):
        answer(ss, "SELECT name FROM space;", engine)
    mujoco.mj_forward(robot[0], data)
    assert len(answer(ss, "SELECT name FROM space AS list;", engine)) == 7
