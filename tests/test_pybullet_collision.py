"""Collisions in PyBullet: tests that move nothing say what moving there would say."""

from __future__ import annotations

from collections import Counter
from random import Random
from typing import Any

import pytest

import ss2sql

pytest.importorskip("pybullet")

from bullet_rooms import ENGINES, Counting, ball, box, furnish, jointed, live, message, values

from ss2sql.vtables.pybullet import PyBulletWorld
from ss2sql.vtables.pybullet.posture import posture


@pytest.fixture
def ss(ss: ss2sql.Session, client: Any) -> ss2sql.Session:
    ss.attach("space", client)
    return ss


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


def test_collision_equals_moving_there_and_moves_nothing(client: Any) -> None:
    session = ss2sql.connect()
    session.attach("space", client)  # it outlives the resets, so its shapes have to be made anew
    counts: Counter[bool] = Counter()
    for seed in range(12):
        dice = Random(seed)
        client.resetSimulation()
        furnish(client, dice, 5)
        place = [dice.uniform(-2, 2) for _ in range(3)]
        robot = jointed(client, dice, 3.0, place, client.getQuaternionFromEuler([0.3, 0.2, dice.uniform(-3, 3)]))
        if seed % 2:
            client.stepSimulation()
        poses = []
        for turned in (False, True) * 12:
            pose = [dice.uniform(-2.5, 2.5) for _ in range(3)]
            poses.append(pose + list(client.getQuaternionFromEuler([dice.uniform(-3, 3)] * 3)) * turned)
        before = snapshot(client)
        for margin in (0.0, 0.2, -0.05):
            script = "SELECT collision(robot, this, margin) FROM poses AS list"
            found = values(session, script, robot=robot, poses=poses, margin=margin)
            assert snapshot(client) == before
            expected = [moved_collides(client, robot, pose, margin) for pose in poses]
            for body, (frame, speed) in zip(live(client), before[0], strict=True):
                client.resetBasePositionAndOrientation(body, *frame)
                client.resetBaseVelocity(body, *speed)
            before = snapshot(client)
            assert found == expected
            counts.update(found)
    assert min(counts.values()) > 50


def test_collision_sees_what_the_last_step_has_moved(client: Any, ss: ss2sql.Session) -> None:
    robot, quick = ball(client, 0.2, (0, 0, 5)), ball(client, 0.1, (0, 0, 0))
    client.resetBaseVelocity(quick, (200, 0, 0))
    client.stepSimulation()
    place = list(client.getBasePositionAndOrientation(quick)[0])
    assert values(ss, "[collision(r, p), collision(r, [0, 0, 0]), collision(r)]", r=robot, p=place) == [
        True,
        False,
        False,
    ]


def test_collision_of_two_bodies_and_of_those_that_stand(client: Any, ss: ss2sql.Session) -> None:
    ground, robot, other = box(client, (9, 9, 1)), ball(client, 0.5, (0, 0, 1)), ball(client, 0.5, (3, 0, 4))
    script = """[collision(r, g), collision(r, o), collision(r), collision(o), collision(r, [2, 0]),
                 collision(r, [2, 0], -0.001)]"""
    assert values(ss, script, r=robot, g=ground, o=other) == [True, False, True, False, True, False]
    assert "X007" in message(ss, "collision(r, [1])", r=robot)
    assert "X007" in message(ss, "collision(r, [1, 2], 'near')", r=robot)


def test_move_and_check_run_in_written_order(client: Any, ss: ss2sql.Session) -> None:
    wall, robot = box(client, (1, 1, 1), (2, 0, 0)), ball(client, 0.2)
    assert wall != robot
    found = ss.run(
        "SELECT checkCollision(r), move(r, this), checkCollision(r) FROM [[2, 0], [5, 5], [2, 0, 7]] AS rows", r=robot
    )
    assert found.value == [(False, [2, 0], True), (True, [5, 5], False), (False, [2, 0, 7], False)]
    assert values(ss, "SELECT pos FROM space WHERE id == r AS value", r=robot) == [2, 0, 7]


CORRIDOR = """
start_pos = position(robot); target_pos = [4, 0];
directions = [[1, 0], [0, 1], [0, -1], [-1, 0]];
SELECT (this + cur_pos) FROM directions WHERE target_pos == {there}
START WITH cur_pos = start_pos, level = 1
CONNECT BY MEMORIZE 8 MAXIMUM 20 cur_pos = {there}, level = level + 1
STOP WITH target_pos == {there} OR distance(target_pos, this + cur_pos) > 8 - level OR {hits}
AS list
"""


def test_the_papers_search_finds_the_same_with_moving_and_with_pure_tests(client: Any) -> None:
    robot = ball(client, 0.3)
    box(client, (0.5, 1, 1), (2, 0, 0))
    counted = Counting(client)
    session = ss2sql.connect()
    session.attach("space", PyBulletWorld(counted, names={robot: "robot"}))
    session.function("add", lambda a, b: [x + y for x, y in zip(a, b, strict=True)] if isinstance(a, list) else a + b)
    session.set("robot", "robot")
    moving = CORRIDOR.format(there="move(robot, this + cur_pos)", hits="IF(checkCollision(robot))")
    pure = CORRIDOR.format(there="(this + cur_pos)", hits="collision(robot, this + cur_pos)")
    paths = session.run(moving).value
    assert counted.calls["resetBasePositionAndOrientation"] > 100
    client.resetBasePositionAndOrientation(robot, (0, 0, 0), (0, 0, 0, 1))
    counted.calls.clear()
    result = session.run(pure)
    assert result.value == paths
    assert counted.calls["resetBasePositionAndOrientation"] == 0
    assert len(paths) == 20
    assert [len(path) for path in paths] == sorted(len(path) for path in paths)
    assert len(paths[0]) == 6  # around the box
    for path in paths:
        assert path[-1] == [4, 0]
        assert not any(moved_collides(client, robot, [*spot, 0.0]) for spot in path[:-1])


def test_posture_is_bullets_own(client: Any) -> None:
    for seed in range(8):
        dice = Random(seed)
        client.resetSimulation()
        robot = jointed(client, dice, 3.0, [0, 0, 1], (0, 0.6, 0, 0.8), links=4)
        client.resetBaseVelocity(robot, (3, 2, 1), (4, 0, 3))
        client.stepSimulation()
        frames = posture(client, robot, client.getBasePositionAndOrientation(robot))
        for link in range(4):
            place, turn = client.getLinkState(robot, link, computeForwardKinematics=True)[:2]
            assert frames[link][0] == pytest.approx(place, abs=1e-12)
            assert abs(sum(a * b for a, b in zip(turn, frames[link][1], strict=True))) == pytest.approx(1)


def test_collision_sees_links_that_the_last_step_has_moved(client: Any, ss: ss2sql.Session) -> None:
    counts: Counter[bool] = Counter()
    for seed in range(6):
        dice = Random(seed)
        client.resetSimulation()
        arms = [jointed(client, dice, 3.0, [dice.uniform(-1, 1) for _ in range(3)], (0, 0, 0, 1)) for _ in range(3)]
        for arm in arms:
            client.resetBaseVelocity(arm, [dice.uniform(-200, 200) for _ in range(3)], (9, -20, 30))
        robot = ball(client, 0.15, (0, 0, 90))
        client.stepSimulation()
        links = [posture(client, arm, client.getBasePositionAndOrientation(arm)) for arm in arms]
        centres = [frame[0] for frames in links for frame in frames.values()]
        poses = [[part + dice.uniform(-0.4, 0.4) for part in dice.choice(centres)] for _ in range(60)]
        found = values(ss, "SELECT collision(r, this) FROM poses AS list", r=robot, poses=poses)
        assert found == [moved_collides(client, robot, pose) for pose in poses]
        counts.update(found)
    assert min(counts.values()) > 30


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
