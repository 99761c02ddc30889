"""PyBullet as a world: what scripts see is what the simulator's own functions say."""

from __future__ import annotations

from collections import Counter
from math import hypot, pi
from pathlib import Path
from random import Random
from typing import Any

import pytest

import ss2sql

pytest.importorskip("pybullet")

import pybullet
from bullet_rooms import ENGINES, Counting, ball, box, furnish, jointed, live, message, values

from ss2sql.scenes import Sensor, chaos
from ss2sql.vtables.pybullet import PyBulletWorld
from ss2sql.vtables.pybullet.client import start_bullet


@pytest.fixture
def ss(ss: ss2sql.Session, client: Any) -> ss2sql.Session:
    ss.attach("space", client)
    return ss


# --- columns -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "sizes", "name", "volume"),
    [(pybullet.GEOM_BOX, {"halfExtents": (0.5, 1, 1.5)}, "box", 6.0),
     (pybullet.GEOM_CYLINDER, {"radius": 0.5, "height": 2}, "cylinder", pi / 2),
     (pybullet.GEOM_CAPSULE, {"radius": 0.5, "height": 2}, "capsule", pi / 2 + pi / 6),
     (pybullet.GEOM_PLANE, {"planeNormal": (0, 0, 1)}, "plane", None),
     (pybullet.GEOM_MESH, {"vertices": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]}, "mesh", None)],
)  # fmt: skip
def test_shape_types(client: Any, ss: ss2sql.Session, kind: int, sizes: Any, name: str, volume: float | None) -> None:
    client.createMultiBody(0, client.createCollisionShape(kind, **sizes))
    columns = f"type, volume, is{name.capitalize()}, isSphere, isRobot, isEnabled, hasBody"
    ((its, found, yes, *others),) = values(ss, f"SELECT {columns} FROM space AS rows")
    assert (its, yes, others) == (name, True, [False, False, True, False])
    assert found == (volume if volume is None else pytest.approx(volume))
    assert values(ss, "SELECT type FROM space.shapes AS list") == [name]


def test_what_cannot_be_touched_is_a_ghost_and_height_fields_are_terrain(
    client: Any, ss: ss2sql.Session, tmp_path: Path
) -> None:
    seen = client.createVisualShape(pybullet.GEOM_SPHERE, radius=0.3, rgbaColor=(1, 0, 0, 1))
    client.createMultiBody(0, -1, seen, (0, 0, 5))
    field = client.createCollisionShape(
        pybullet.GEOM_HEIGHTFIELD, meshScale=[1, 1, 1], heightfieldData=[0, 1] * 8, numHeightfieldRows=4,
        numHeightfieldColumns=4,
    )  # fmt: skip
    client.createMultiBody(0, field)
    file = tmp_path / "ghost.urdf"
    file.write_text('<robot name="ghost"><link name="base"/></robot>', encoding="utf-8")
    client.loadURDF(str(file))  # the box around it has a margin
    found = values(ss, "SELECT type, isEnabled, volume, colour FROM space AS rows")
    assert (found[0], found[1][:3]) == (("ghost", False, 0.0, [1.0, 0.0, 0.0, 1.0]), ("terrain", True, None))
    assert found[2] == ("ghost", False, 0.0, None)
    assert "cannot be tried at other places: it is a terrain" in message(ss, "collision(1, [0, 0])")
    assert values(ss, "collision(2, [0, 0])") is False
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


def test_names_and_sensors_end_with_their_bodies(client: Any) -> None:
    first, second = ball(client, 0.2), ball(client, 0.2, (1, 0, 0))
    eye = Sensor((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 5.0, 90.0)
    session = ss2sql.connect()
    session.attach("space", PyBulletWorld(client, names={first: "floor", second: "eye"}, sensors={second: eye}))
    script = "SELECT id, name, isSensor FROM space AS rows"
    assert values(session, script) == [(first, "floor", False), (second, "eye", True)]
    client.removeBody(second)
    assert values(session, script) == [(first, "floor", False)]
    assert ball(client, 0.2) == second
    assert values(session, script) == [(first, "floor", False), (second, f"body_{second}", False)]
    assert "no body is called 'eye'" in message(session, "position('eye')")
    session.attach("later", PyBulletWorld(client, names={second: "ball"}))
    assert values(session, "SELECT name FROM later AS list") == [f"body_{first}", "ball"]
    assert values(session, "SELECT name FROM space AS list") == ["floor", f"body_{second}"]
    with pytest.raises(ss2sql.Error, match="there is no body 9 for names="):
        PyBulletWorld(client, names={9: "ball"})


def test_columns_of_a_body_are_read_by_its_id_or_name(client: Any, ss: ss2sql.Session) -> None:
    for mass in range(9):
        ball(client, 0.2, (mass, 0, 0), mass=mass)
    assert values(ss, "[mass('body_3'), pos(1), name(2), isSphere('body_0')]") == [3.0, [1.0, 0.0, 0.0], "body_2", True]
    assert values(ss, "SELECT id FROM space WHERE mass > mass('body_5') AS list") == [6, 7, 8]
    assert values(ss, "SELECT mass(this) FROM [2, 'body_4'] AS list") == [2.0, 4.0]
    assert values(ss, "type('body_3')") == "str"  # that of any value
    assert "there is no body 9" in message(ss, "mass(9)")
    shown = message(ss, "mass('plane')")
    assert "some names are body_0, body_1, body_2; SELECT name FROM the world shows all" in shown
    assert "or its name, not [1]" in message(ss, "mass([1])")
    assert "SELECT angle FROM space.joints" in message(ss, "angle('body_3')")
    other = start_bullet()
    ball(other, 0.2, mass=50)
    ss.attach("twin", other)
    assert values(ss, "[space.mass(3), twin.mass('body_0'), twin.mass(0)]") == [3.0, 50.0, 50.0]
    assert "write space.mass(...)" in message(ss, "mass(3)")
    other.disconnect()


def test_the_database_says_which_values_of_groups_it_cannot_compare(client: Any, ss: ss2sql.Session) -> None:
    for x in range(3):
        box(client, (1, 1, 1), (x, 0, 0))
    shown = message(ss, "SELECT type, min(distance(this, [5, 0, 0])) FROM space GROUP BY type", engine="database")
    assert "an aggregate of values of several kinds" in shown
    assert "min(float(...))" in shown
    script = "SELECT type, min(float(distance(this, [5, 0, 0]))) AS d FROM space GROUP BY type AS rows"
    assert values(ss, script) == [("box", 3.0)]
    ordered = "SELECT type FROM space GROUP BY type ORDER BY distance('body_0', [count(*), 0, 0])"
    assert "order by float(...)" in message(ss, ordered, engine="database")
    assert values(ss, ordered.replace("distance(", "float(distance(") + ")") == [{"type": "box"}]


def test_a_body_without_a_position_is_an_error_that_names_it(client: Any, ss: ss2sql.Session) -> None:
    for x in range(3):
        box(client, (0.2, 0.2, 0.2), (x, 0, 0))
    client.resetBasePositionAndOrientation(1, [float("nan")] * 3, (0, 0, 0, 1))
    cases = [
        "SELECT pos FROM space", "SELECT id FROM space WHERE x >= -1e9", "SELECT id FROM space WHERE NOT x < -1e9",
        "SELECT id FROM space WHERE x + 0 >= 0", "SELECT id FROM space WHERE distance(this, [0, 0, 0]) < 9",
        "SELECT distance(this, [0, 0, 0]) FROM space", "position('body_1')", "distance('body_1', [0, 0, 0])",
        "SELECT id FROM space.near([0, 0, 0], 9)", "SELECT id FROM space.near(1, 9)",
        "SELECT id FROM space.overlaps([[-9, -9, -9], [9, 9, 9]])", "SELECT id FROM space WHERE above(1, this)",
    ]  # fmt: skip
    for script in cases:
        shown = message(ss, script)
        assert "of bodies[1] holds" in shown
        assert "leave it out first: WHERE id != 1 AND ..." in shown
    assert values(ss, "SELECT id FROM space WHERE id != 1 AND x >= 0 AND pos[1] == 0 AS list") == [0, 2]
    assert values(ss, "SELECT id FROM space WHERE id != 1 AND distance(this, [0, 0, 0]) <= 1 AS list") == [0]


# --- functions of two bodies ---------------------------------------------------------------------------


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
    shown = message(session, "SELECT id FROM space WHERE id == n AND isSensing(this, this)", n=wall)
    assert "X007" in shown
    assert f"'isSensing' needs a sensor, not 'body_{wall}'" in shown
    assert f"sensors are body_{eye};" in shown


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
    counted, places, masses = Counting(client), "getBasePositionAndOrientation", "getDynamicsInfo"
    session = ss2sql.connect()
    session.attach("space", PyBulletWorld(counted))
    for engine in ENGINES:
        for script, name, calls in (
            ("SELECT mass FROM space", places, 0), ("SELECT x, y, z, posX FROM space", places, 20),
            ("SELECT mass FROM space WHERE id == 7", masses, 1), ("SELECT id FROM space WHERE id == 7", masses, 0),
            ("SELECT mass FROM space WHERE id == 7", "getBodyUniqueId", 0),
            ("SELECT mass FROM space WHERE x >= 2.5 AND x < 5.5", masses, 3),
            # the same body once in a join; and places for the search among neighbours, and for the column
            ("SELECT b.mass FROM a = [1, 2, 1], b = space WHERE b.id == a.this", masses, 2),
            ("SELECT b.id FROM a = space, b = space WHERE b.x >= a.x - 1 AND b.x <= a.x + 1", places, 2 * 20),
            ("SELECT b.id FROM a = space, b = space.near(a.pos, 1)", places, 2 * 20),
        ):  # fmt: skip
            counted.calls.clear()
            session.run(script, engine=engine)
            assert counted.calls[name] == calls, (script, engine)
        joined = "SELECT b.id FROM a = space, b = space WHERE b.x >= a.x - 1 AND b.x <= a.x + 1"
        for more in ("", " AND b.y >= a.y - 1 AND b.y <= a.y + 1 AND b.z >= a.z - 1 AND b.z <= a.z + 1"):
            assert len(session.run(f"{joined}{more} AS list", engine=engine).value) == 20 + 2 * 19


def test_a_disconnected_client_says_so_even_if_its_number_lives_on() -> None:
    gone = start_bullet()
    session = ss2sql.connect()
    session.attach("space", gone)
    number = gone._client
    gone.disconnect()
    follower = start_bullet()
    try:
        assert follower._client == number
        ball(follower)
        assert "disconnected" in message(session, "SELECT id FROM space")
        assert "disconnected" in message(session, "SELECT id FROM space.links")
    finally:
        follower.disconnect()


def test_a_scene_brings_forces_and_cameras(client: Any) -> None:
    scene = chaos(seed=1, bodies=10, client=client)
    session = ss2sql.connect()
    session.attach("space", scene)
    scene.step(24)
    found = values(session, "SELECT id, force FROM space AS rows")
    assert {body: tuple(force) for body, force in found if any(force)} == {
        body: force for body, force in scene.forces.items() if hypot(*force)
    }
    assert values(session, "SELECT name FROM space.cameras WHERE angle < 90 AS list") == list(scene.views)
    seen = values(session, "SELECT sees FROM space.cameras WHERE name == 'front' AS value")
    assert set(seen) <= set(scene.names)
    assert len(seen) > 5
    assert max(values(session, "SELECT aabb[1][0] FROM space WHERE hasBody(this) AS list")) < 6


# --- collisions: tests that move nothing say what moving there would say --------------------------------


def moved_collides(client: Any, robot: int, pose: list[float], margin: float = 0.0) -> bool:
    """What moving the robot there, looking, and moving it back says."""
    before = client.getBasePositionAndOrientation(robot)
    client.resetBasePositionAndOrientation(robot, pose[:3], pose[3:] or before[1])
    found = any(client.getClosestPoints(robot, other, margin) for other in live(client) if other != robot)
    client.resetBasePositionAndOrientation(robot, *before)
    return found


def snapshot(client: Any) -> Any:
    """Everything that a test of a collision might have changed."""
    states = [(client.getBasePositionAndOrientation(b), client.getBaseVelocity(b)) for b in live(client)]
    joints = [client.getLinkState(b, n)[:2] for b in live(client) for n in range(client.getNumJoints(b))]
    return states, joints, client.getContactPoints()


def test_collision_equals_moving_there_and_moves_nothing(client: Any, ss: ss2sql.Session) -> None:
    """The session outlives the resets, so its shapes have to be made anew."""
    counts: Counter[bool] = Counter()
    for seed in range(12):
        dice = Random(seed)
        client.resetSimulation()
        furnish(client, dice, 5)
        place = [dice.uniform(-2, 2) for _ in range(3)]
        robot = jointed(client, dice, 3.0, place, client.getQuaternionFromEuler([0.3, 0.2, dice.uniform(-3, 3)]), 4)
        if seed % 2:  # so quick that the step moves them, and their links, to somewhere else
            for body in live(client):
                client.resetBaseVelocity(body, [dice.uniform(-200, 200) for _ in range(3)], (9, -20, 30))
            client.stepSimulation()
        poses = []
        for turned in (False, True) * 12:
            pose = [dice.uniform(-2.5, 2.5) for _ in range(3)]
            poses.append(pose + list(client.getQuaternionFromEuler([dice.uniform(-3, 3)] * 3)) * turned)
        before = snapshot(client)
        for margin in (0.0, 0.2, -0.05):
            script = "SELECT collision(robot, this, margin) FROM poses AS list"
            found = values(ss, script, robot=robot, poses=poses, margin=margin)
            assert snapshot(client) == before
            expected = [moved_collides(client, robot, pose, margin) for pose in poses]
            for body, (frame, speed) in zip(live(client), before[0], strict=True):
                client.resetBasePositionAndOrientation(body, *frame)
                client.resetBaseVelocity(body, *speed)
            before = snapshot(client)
            assert found == expected
            counts.update(found)
    assert min(counts.values()) > 50


def test_the_box_of_a_plane_ends_at_its_front(client: Any, ss: ss2sql.Session) -> None:
    for normal, place, turn in (
        ((0, 0, 1), (0, 0, -2), (0, 0, 0)), ((-1, 0, 0), (7, 0, 0), (0, 0, 0)), ((0, 0, 1), (0, 0, 9), (pi, 0, 0)),
        ((0, 0, 1), (0, 0, 0), (0.3, 0, 0)),
    ):  # fmt: skip
        shape = client.createCollisionShape(client.GEOM_PLANE, planeNormal=normal)
        client.createMultiBody(0, shape, basePosition=place, baseOrientation=client.getQuaternionFromEuler(turn))
    ball(client, 0.5, (0, 0, -1))
    far = 1e30
    boxes = values(ss, "SELECT aabb FROM space AS list")[:4]
    assert boxes == values(ss, "SELECT aabb FROM space.links AS list")[:4]
    assert boxes[0] == [[-far, -far, -far], [far, far, -2]]
    assert boxes[1] == [[7, -far, -far], [far, far, far]]
    assert boxes[2] == [[-far, -far, 9], [far, far, far]]
    assert boxes[3] == [[-far, -far, -far], [far, far, far]]
    assert values(ss, "[above(4, 0), below(0, 4), below(4, 2), below(4, 0), above(0, 4)]") == [True] * 3 + [False] * 2


def test_the_box_of_a_link_is_its_own(client: Any, ss: ss2sql.Session) -> None:
    robot = jointed(client, Random(3), 1.0, [0, 0, 2], (0, 0, 0, 1))
    columns = "within(this, box), above(this, under), below(this, over)"
    for link in range(-1, client.getNumJoints(robot)):
        (x1, y1, z1), (x2, y2, z2) = client.getAABB(robot, link)
        under, over = ([[x1, y1, z], [x2, y2, z]] for z in ((z1 + z2) / 2 - 0.001, (z1 + z2) / 2 + 0.001))
        own = [[x1, y1, z1], [x2, y2, z2]]
        script = f"SELECT {columns} FROM space.links WHERE number == {link} AS rows"
        assert values(ss, script, box=own, under=under, over=over) == [(True, True, True)]


def test_a_margin_counts_and_is_a_number(client: Any, ss: ss2sql.Session) -> None:
    ground, robot = box(client, (9, 9, 1)), ball(client, 0.5, (0, 0, 1))
    script = "[collision(r, g), collision(r, g, -0.001), collision(r, [2, 0]), collision(r, [2, 0], -0.001)]"
    assert values(ss, script, r=robot, g=ground) == [True, False, True, False]
    assert values(ss, "[collision(r, [2, 0, 2], 0.9), collision(r, [2, 0, 2], 1.1)]", r=robot) == [False, True]
    assert "X007" in message(ss, "collision(r, [1, 2], 'near')", r=robot)


def test_shapes_of_all_kinds_stand_in_the_way(client: Any, ss: ss2sql.Session) -> None:
    flat, solid = [0.0] * 12 + [1.0] * 4, [(-1, -1, 0), (1, -1, 0), (0, 1, 0), (0, 0, 1)]
    hills = client.createCollisionShape(
        client.GEOM_HEIGHTFIELD, meshScale=[1, 1, 1], heightfieldData=flat, numHeightfieldRows=4,
        numHeightfieldColumns=4,
    )  # fmt: skip
    hollow = client.createCollisionShape(
        client.GEOM_MESH, vertices=solid, indices=[0, 1, 2, 0, 2, 3, 0, 3, 1, 1, 2, 3],
        flags=client.GEOM_FORCE_CONCAVE_TRIMESH,
    )  # fmt: skip
    client.createMultiBody(0, hills, basePosition=(5, 0, 0))
    client.createMultiBody(0, hollow, basePosition=(0, 5, 0))
    round_box = client.createCollisionShape(client.GEOM_BOX, halfExtents=(0.2, 0.3, 0.4))
    client.createMultiBody(1, round_box, basePosition=(-5, 0, 0), useMaximalCoordinates=True)
    dice = Random(1)
    robot = jointed(client, dice, 3.0, [0, 0, 20], (0, 0, 0, 1))
    poses = [
        [x + dice.uniform(-1.5, 1.5), y + dice.uniform(-1.5, 1.5), dice.uniform(-1, 1)]
        for x, y in [(5, 0), (0, 5), (-5, 0)] * 30
    ]
    found = values(ss, "SELECT collision(robot, this) FROM poses AS list", robot=robot, poses=poses)
    assert found == [moved_collides(client, robot, pose) for pose in poses]
    assert min(Counter(found).values()) > 20


def test_only_what_is_near_is_asked() -> None:
    with ss2sql.scenes.hall(seed=0) as hall:
        counted = Counting(hall.client)
        session = ss2sql.connect()
        session.attach("space", PyBulletWorld(counted, names=hall.names))
        robot = next(body for body, name in hall.names.items() if name == "YouBot")
        dice = Random(0)
        poses = [[dice.uniform(0.5, 15.5), dice.uniform(0.5, 11.5), 0.11] for _ in range(200)]
        for pose in poses[::2]:
            pose.extend(hall.client.getQuaternionFromEuler([0, 0, dice.uniform(-3, 3)]))
        for engine in ENGINES:
            counted.calls.clear()
            found = session.run("SELECT collision('YouBot', this) FROM poses AS list", poses=poses, engine=engine).value
            assert counted.calls["getClosestPoints"] < 5 * len(poses)
            assert counted.calls["getAABB"] < 100  # once for each body and link of the hall
            assert counted.calls["getJointState"] <= 9  # once for each joint of the robot
        assert found == [moved_collides(hall.client, robot, pose) for pose in poses]
        assert min(Counter(found).values()) > 50
        counted.calls.clear()
        assert session.run("checkCollision('YouBot')").value is False
        assert counted.calls["getClosestPoints"] < 5
