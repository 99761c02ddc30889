"""PyBullet as a world: what scripts see is what a plain loop over the simulator's own functions sees."""

from __future__ import annotations

import os
from collections import Counter
from math import dist, hypot, pi
from random import Random
from typing import Any

import pytest

import ss2sql

pytest.importorskip("pybullet")

import pybullet
from bullet_rooms import (
    ENGINES,
    Counting,
    ball,
    box,
    furnish,
    kind_of,
    live,
    mass_of,
    message,
    stir,
    values,
)

from ss2sql.scenes import Sensor, chaos
from ss2sql.scenes.bullet import connect
from ss2sql.vtables.pybullet import PyBulletWorld

SCENES = int(os.environ.get("SS2SQL_SCENES", "50"))  # more by night


@pytest.fixture
def ss(ss: ss2sql.Session, client: Any) -> ss2sql.Session:
    ss.attach("space", client)
    return ss


# --- the paper's queries against plain loops -----------------------------------------------------------


def check_queries(client: Any, queries: dict[str, Any]) -> None:
    ids = live(client)
    masses = {body: mass_of(client, body) for body in ids}
    places = {body: list(client.getBasePositionAndOrientation(body)[0]) for body in ids}
    spheres = [body for body in ids if kind_of(client, body) == "sphere"]
    expected: dict[str, Any] = {
        "heavy": [{"mass": masses[b], "pos": places[b]} for b in spheres if masses[b] > 50],
        "largest": max((masses[b] for b in spheres), default=None),
        "moving": [masses[b] for b in ids if masses[b] > 0],
        "rising": [client.getBaseVelocity(b)[0][2] for b in ids if masses[b] > 0],
        "kinds": [(b, kind_of(client, b)) for b in ids],
        "corner": [b for b in ids if places[b][0] > 0 and places[b][1] <= 1.5],
        "pairs": [(a, b) for a in ids for b in ids if a != b and dist(places[a], places[b]) <= 2],
    }
    expected["near"] = expected["pairs"]
    for name, query in queries.items():
        for engine, compiled in query.items():
            assert compiled.run().value == expected[name], (name, engine)


PAPER = {
    "heavy": "SELECT mass, pos FROM space WHERE isSphere(this) AND mass(this) > 50",
    "largest": """spheres = SELECT obj FROM space WHERE isSphere(this) AS list;
                  IF([] == spheres; None; max(SELECT mass(this) FROM spheres AS list))""",
    "moving": "SELECT mass FROM space WHERE hasBody(this) AS list",
    "rising": "SELECT linearVelocity(this, 2) FROM space WHERE hasBody(this) AS list",
    "kinds": "SELECT id, type FROM space AS rows",
    "corner": "SELECT id FROM space WHERE x > 0 AND posY(this) <= 1.5 AS list",
    "pairs": "SELECT a.id, b.id FROM a = space, b = space WHERE a.id != b.id AND distance(a.this, b.this) <= 2 AS rows",
    "near": "SELECT a.id, b.id FROM a = space, b = space.near(a.this, 2) WHERE a.id != b.id AS rows",
}


def test_queries_equal_plain_loops_while_the_world_moves(client: Any) -> None:
    session = ss2sql.connect()
    session.attach("space", client)
    queries = {n: {e: session.compile(text, engine=e) for e in ENGINES} for n, text in PAPER.items()}
    for seed in range(SCENES):
        dice = Random(seed)
        client.resetSimulation()
        furnish(client, dice, 7)
        check_queries(client, queries)
        for change in ("step", "birth", "death"):
            stir(client, dice, change)
        check_queries(client, queries)


def test_check_world_finds_nothing(client: Any) -> None:
    dice = Random(5)
    furnish(client, dice, 12)
    client.setGravity(0, 0, -9.81)
    pairs = [(None, None, 0.5), *((a, b, 1.0) for a in live(client)[:2] for b in live(client)[:3])]
    arguments = {
        "closest": pairs,
        "near": [([0.0, 0.0, 1.0], 2.0), ([0.0, 0.0], 1.0)],
        "overlaps": [([[-1, -1, -1], [1, 1, 1]],)],
        "rays": [([0.0, 0.0, 9.0], [0.0, 0.0, -9.0]), ([[3.0, 0.0, 1.0]], [[-3.0, 0.0, 1.0]])],
        "contacts": [()],
    }
    report = ss2sql.check_world(
        client, seed=2, queries=60, change=lambda dice: stir(client, dice, "any"), arguments=arguments
    )
    assert report.queries == 60
    assert report.skipped == []


# --- columns -------------------------------------------------------------------------------------------


def test_a_sphere_measures_what_geometry_says(client: Any, ss: ss2sql.Session) -> None:
    ball(client, 0.5, (1, 2, 3), mass=4.0)
    (row,) = values(ss, "SELECT aabb, volume, mass, distance(this, [1, 2, 7]) FROM space")
    assert row["aabb"] == [[0.5, 1.5, 2.5], [1.5, 2.5, 3.5]]
    assert row["volume"] == pytest.approx(4 / 3 * pi * 0.5**3)
    assert (row["mass"], row["distance"]) == (4.0, 4.0)
    assert values(ss, "SELECT distance(this, [4, 6]), position(this) FROM space AS rows") == [(5.0, [1.0, 2.0])]


@pytest.mark.parametrize(
    ("kind", "sizes", "name", "volume"),
    [
        (pybullet.GEOM_BOX, {"halfExtents": (0.5, 1, 1.5)}, "box", 6.0),
        (pybullet.GEOM_CYLINDER, {"radius": 0.5, "height": 2}, "cylinder", pi / 2),
        (pybullet.GEOM_CAPSULE, {"radius": 0.5, "height": 2}, "capsule", pi / 2 + pi / 6),
        (pybullet.GEOM_PLANE, {"planeNormal": (0, 0, 1)}, "plane", None),
        (pybullet.GEOM_MESH, {"vertices": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]}, "mesh", None),
    ],
)
def test_shapes_have_types_and_volumes(
    client: Any, ss: ss2sql.Session, kind: int, sizes: Any, name: str, volume: float | None
) -> None:
    client.createMultiBody(0, client.createCollisionShape(kind, **sizes))
    columns = f"type, volume, is{name.capitalize()}, isSphere, isRobot, isEnabled, hasBody"
    ((its, found, yes, *others),) = values(ss, f"SELECT {columns} FROM space AS rows")
    assert (its, yes, others) == (name, True, [False, False, True, False])
    assert found == (volume if volume is None else pytest.approx(volume))
    assert values(ss, "SELECT type FROM space.shapes AS list") == [name]


def test_what_cannot_be_touched_is_a_ghost_and_height_fields_are_terrain(client: Any, ss: ss2sql.Session) -> None:
    seen = client.createVisualShape(pybullet.GEOM_SPHERE, radius=0.3, rgbaColor=(1, 0, 0, 1))
    client.createMultiBody(0, -1, seen, (0, 0, 5))
    field = client.createCollisionShape(
        pybullet.GEOM_HEIGHTFIELD, meshScale=[1, 1, 1], heightfieldData=[0, 1] * 8, numHeightfieldRows=4,
        numHeightfieldColumns=4,
    )  # fmt: skip
    client.createMultiBody(0, field)
    found = values(ss, "SELECT type, isEnabled, volume, colour FROM space AS rows")
    assert found[0] == ("ghost", False, 0.0, [1.0, 0.0, 0.0, 1.0])
    assert found[1][:3] == ("terrain", True, None)
    assert values(ss, "SELECT id FROM space WHERE x == 0 AND z >= 5 AS list") == [0]  # no box leads to it


def test_links_and_joints_of_a_robot(client: Any, ss: ss2sql.Session) -> None:
    tip = client.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.1, collisionFramePosition=(1, 0, 0))
    shape = client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=(0.2, 0.2, 0.2))
    robot = client.createMultiBody(
        5, shape, basePosition=(0, 0, 1), linkMasses=[2], linkCollisionShapeIndices=[tip], linkVisualShapeIndices=[-1],
        linkPositions=[(0, 0, 0)], linkOrientations=[(0, 0, 0, 1)], linkInertialFramePositions=[(1, 0, 0)],
        linkInertialFrameOrientations=[(0, 0, 0, 1)], linkParentIndices=[0],
        linkJointTypes=[pybullet.JOINT_REVOLUTE], linkJointAxis=[(0, 0, 1)],
    )  # fmt: skip
    client.resetJointState(robot, 0, pi / 2)
    assert values(ss, "SELECT type, mass, isRobot, isBox FROM space AS rows") == [("compound", 7.0, True, False)]
    ((number, parent, base_at), (one, above, tip_at)) = values(
        ss, "SELECT number, parent, pos FROM space.links AS rows"
    )
    assert (number, parent, base_at, one, above) == (-1, None, [0, 0, 1], 0, -1)
    assert tip_at == pytest.approx([0, 1, 1], abs=1e-9)  # the joint has turned it
    assert values(ss, "SELECT number, type, parent, angle FROM space.joints WHERE body == 0 AS rows") == [
        (0, "revolute", -1, pi / 2)
    ]
    box_around = values(ss, "SELECT aabb FROM space AS value")  # with all its links
    assert box_around[1][1] > 1.0
    assert values(ss, "SELECT distance(this, [0, 1, 1]) FROM space.links AS list")[1] == pytest.approx(0, abs=1e-9)
    assert values(ss, "SELECT l.number FROM b = space, l = space.links WHERE l.body == b.id AS list") == [-1, 0]


def test_names_come_from_the_file_the_scene_or_the_caller(client: Any) -> None:
    a, b = ball(client), ball(client)
    session = ss2sql.connect()
    session.attach("space", PyBulletWorld(client, names={b: "target"}))
    assert values(session, "SELECT name FROM space AS list") == [f"body_{a}", "target"]
    assert values(session, "SELECT id FROM space WHERE name == 'target' AS list") == [b]
    client.resetBasePositionAndOrientation(b, (3, 4, 5), (0, 0, 0, 1))
    assert values(session, "position('target')") == [3.0, 4.0]
    client.removeBody(b)
    assert "no body is called 'target'" in message(session, "position('target')")


# --- functions of two bodies ---------------------------------------------------------------------------


def test_above_below_and_within_go_by_boxes(client: Any, ss: ss2sql.Session) -> None:
    table, cup, far = box(client, (2, 2, 1)), box(client, (0.2, 0.2, 0.4), (0.5, 0, 0.69)), ball(client, 0.2, (5, 0, 3))
    script = "SELECT above(this, table), below(table, this), within(this, [[-1, -1, -1], [1, 1, 1]]) FROM space AS rows"
    assert values(ss, script, table=table) == [(False, False, True), (True, True, True), (False, False, False)]
    assert values(ss, "within(cup, table)", cup=cup, table=table) is False
    assert values(ss, "above(far, cup)", far=far, cup=cup) is False


def test_a_sensor_sees_what_is_in_its_cone_and_not_hidden(client: Any) -> None:
    eye = box(client, (0.1, 0.1, 0.1))
    seen, aside, far = ball(client, 0.2, (3, 0.5, 0)), ball(client, 0.2, (1, 3, 0)), ball(client, 0.2, (9, 0, 0))
    wall, hidden = box(client, (0.2, 2, 2), (2, -1.2, 0)), ball(client, 0.2, (4, -1.5, 0))
    session = ss2sql.connect()
    session.attach("space", PyBulletWorld(client, sensors={eye: Sensor((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), 5.0, 90.0)}))
    assert values(session, "SELECT id FROM space WHERE isSensor(this) AS list") == [eye]
    script = "SELECT id FROM space WHERE id != eye AND isSensing(eye, this) AS list"
    assert values(session, script, eye=eye) == [seen, wall]
    assert not {aside, far, hidden} & set(values(session, script, eye=eye))
    assert "X007" in message(session, "isSensing(n, n)", n=wall)


def test_contacts_and_closest_are_those_of_the_simulator(client: Any, ss: ss2sql.Session) -> None:
    client.setGravity(0, 0, -9.81)
    ground, rests, flies = box(client, (4, 4, 1)), ball(client, 0.5, (0, 0, 1.0)), ball(client, 0.5, (0, 0, 2.3))
    for _ in range(3):
        client.stepSimulation()
    found = values(ss, "SELECT idA, idB, distance, normalForce FROM space.contacts AS rows")
    assert found == [(p[1], p[2], p[8], p[9]) for p in client.getContactPoints()]
    assert {frozenset(pair[:2]) for pair in found} == {frozenset((ground, rests))}
    assert values(ss, "SELECT 1 FROM space.contacts(f) AS list", f=flies) == []
    gaps = values(ss, "SELECT idA, idB, distance FROM space.closest(None, None, 0.5) AS rows")
    z = {body: client.getBasePositionAndOrientation(body)[0][2] for body in (rests, flies)}
    assert [gap[:2] for gap in gaps] == [(ground, rests), (rests, flies)]
    assert gaps[1][2] == pytest.approx(z[flies] - z[rests] - 1)
    script = "SELECT mass(c.b) FROM s = space, c = space.closest(s.this, r, 1) WHERE s.id == f AS list"
    assert values(ss, script, r=rests, f=flies) == [1.0]


def test_overlaps_sees_where_bodies_are_now(client: Any, ss: ss2sql.Session) -> None:
    still, quick = ball(client, 0.5), ball(client, 0.1, (3, 0, 0))
    client.resetBaseVelocity(quick, (100, 0, 0))
    client.stepSimulation()  # PyBullet's own boxes are those of before the step
    x = client.getBasePositionAndOrientation(quick)[0][0]
    assert client.getOverlappingObjects((x - 0.01, -0.01, -0.01), (x + 0.01, 0.01, 0.01)) is None
    script = "SELECT id FROM space.overlaps([[x - 0.01, 0, 0], [x + 0.01, 0, 0]]) AS list"
    assert values(ss, script, x=x) == [quick]
    assert values(ss, "SELECT id FROM space.overlaps([[1, 1, 1], [0.4, 0, 0]]) AS list") == [still]
    assert values(ss, "SELECT id FROM space.overlaps([[7, 7, 7], [8, 8, 8]]) AS list") == []


def test_rays_hit_what_is_first_however_many_they_are(client: Any, ss: ss2sql.Session) -> None:
    wall, hidden = box(client, (1, 4, 4), (3, 0, 0)), box(client, (1, 1, 1), (6, 0, 0))
    script = "SELECT ray, id, distance, name(body) FROM space.rays(start, goal) AS rows"
    ((ray, body, far, name),) = values(ss, script, start=[0, 0, 0], goal=[9, 0, 0])
    assert (ray, body, name, far) == (0, wall, f"body_{wall}", pytest.approx(2.5))
    assert values(ss, script, start=[0, 0, 5], goal=[9, 0, 5]) == []
    ((_, body, far, _),) = values(ss, script, start=[3, 0, 0], goal=[9, 0, 0])  # from inside of the wall
    assert (body, far) == (hidden, pytest.approx(2.5))
    count = 16_383 + 5
    starts = [[0.0, (n % 7) / 10, 0.0] for n in range(count)]
    hits = ss.run(script, start=starts, goal=[[9.0, y, z] for _, y, z in starts], engine="native").value
    assert [hit[0] for hit in hits] == list(range(count))
    assert {hit[1] for hit in hits} == {wall}
    assert "X007" in message(ss, script, start=[[0, 0, 0]] * 2, goal=[[1, 1, 1]] * 3)


# --- how often the simulator is asked ------------------------------------------------------------------


def test_only_what_is_read_is_asked_for(client: Any) -> None:
    for number in range(20):
        ball(client, 0.1, (number, 0, 0), mass=number + 1)
    counted = Counting(client)
    session = ss2sql.connect()
    session.attach("space", PyBulletWorld(counted))

    def calls(script: str, engine: str, **named: Any) -> Counter[str]:
        counted.calls.clear()
        session.run(script, engine=engine, **named)
        return Counter({name: n for name, n in counted.calls.items() if name.startswith("get") and n})

    for engine in ENGINES:
        assert "getBasePositionAndOrientation" not in calls("SELECT mass FROM space", engine)
        found = calls("SELECT x, y, z, posX FROM space", engine)
        assert found["getBasePositionAndOrientation"] == 20
        assert calls("SELECT mass FROM space LIMIT 3", engine)["getDynamicsInfo"] == 3
        assert calls("SELECT mass FROM space WHERE id == 7", engine)["getDynamicsInfo"] == 1
        assert "getBodyUniqueId" not in calls("SELECT mass FROM space WHERE id == 7", engine)
        assert calls("SELECT mass FROM space WHERE x >= 2.5 AND x < 5.5", engine)["getDynamicsInfo"] == 3
        join = calls("SELECT b.mass FROM a = [1, 2, 1], b = space WHERE b.id == a.this", engine)
        assert join["getDynamicsInfo"] == 2  # the same body once
        many = calls("SELECT b.id FROM a = space, b = space WHERE b.x >= a.x - 1 AND b.x <= a.x + 1", engine)
        assert many["getBasePositionAndOrientation"] == 2 * 20  # for the search among neighbours, and for the column
        near = calls("SELECT b.id FROM a = space, b = space.near(a.pos, 1)", engine)
        assert near["getBasePositionAndOrientation"] == 2 * 20


# --- several worlds, and lists -------------------------------------------------------------------------


def test_worlds_join_with_lists_and_with_each_other(client: Any) -> None:
    other = connect()
    try:
        a, b = ball(client, position=(0, 0, 1), mass=2.0), ball(other, position=(0, 3, 5), mass=3.0)
        session = ss2sql.connect()
        session.attach("here", client)
        session.attach("there", PyBulletWorld(other._client))
        session.attach("masses", [{"mass": 2.0, "word": "light"}, {"mass": 3.0, "word": "heavy"}])
        script = "SELECT h.mass, t.mass, distance(h.this, t.this) FROM h = here, t = there AS rows"
        assert values(session, script) == [(2.0, 3.0, 5.0)]
        script = "SELECT m.word FROM m = masses, t = there WHERE m.mass == t.mass AS list"
        assert values(session, script) == ["heavy"]
        assert (a, b) == (0, 0)  # the same id in both
        assert values(session, "SELECT h.this == t.this FROM h = here, t = there AS list") == [False]
    finally:
        other.disconnect()
    assert "X011" in message(session, "SELECT mass FROM there")
    assert values(session, "SELECT mass FROM here AS list") == [2.0]


def test_a_disconnected_client_says_so_even_if_its_number_lives_on() -> None:
    gone = connect()
    session = ss2sql.connect()
    session.attach("space", gone)
    number = gone._client
    gone.disconnect()
    follower = connect()
    try:
        assert follower._client == number
        ball(follower)
        assert "disconnected" in message(session, "SELECT id FROM space")
        assert "disconnected" in message(session, "SELECT id FROM space.links")
    finally:
        follower.disconnect()


def test_a_removed_body_is_named(client: Any, ss: ss2sql.Session) -> None:
    kept, body = ball(client), ball(client)
    ss.run("bodies = SELECT obj FROM space AS list")
    client.removeBody(body)
    assert values(ss, "SELECT id FROM space AS list") == [kept]
    text = message(ss, "SELECT mass(this) FROM bodies AS list")
    assert text.startswith("X011")
    assert f"bodies[{body}] no longer exists" in text
    for column in ("name", "aabb", "velocity", "colour", "type", "volume", "isSensor", "force", "rot"):
        assert "no longer exists" in message(ss, f"SELECT {column}(this) FROM bodies")
    assert f"no body {body}" in message(ss, "position(n)", n=body)
    assert values(ss, "SELECT id FROM space WHERE id == 99999999999 AS list") == []


# --- scenes --------------------------------------------------------------------------------------------


def test_a_scene_brings_names_forces_and_its_clock(client: Any) -> None:
    scene = chaos(seed=1, bodies=10, client=client)
    session = ss2sql.connect()
    session.attach("space", scene)
    scene.step(24)
    assert values(session, "getTime()") == pytest.approx(0.1)
    found = values(session, "SELECT id, name, force FROM space AS rows")
    assert [(body, name) for body, name, _ in found] == sorted(scene.names.items())
    assert {body: tuple(force) for body, _, force in found if any(force)} == {
        body: force for body, force in scene.forces.items() if hypot(*force)
    }
    assert values(session, "SELECT name FROM space.cameras WHERE angle < 90 AS list") == list(scene.views)
    seen = values(session, "SELECT sees FROM space.cameras WHERE name == 'front' AS value")
    assert set(seen) <= set(scene.names)
    assert len(seen) > 5
    assert max(values(session, "SELECT aabb[1][0] FROM space WHERE hasBody(this) AS list")) < 6
