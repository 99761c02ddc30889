"""Scenes: they are the same for the same seed, they hold what they promise, and their pictures show it."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from itertools import product
from math import dist
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pybullet")

import pybullet
from bullet_rooms import mass_of
from pybullet_utils.bullet_client import BulletClient

import ss2sql
from ss2sql import scenes
from ss2sql.scenes import Scene, View
from ss2sql.scenes.chaos_scene import BOUNCE, INSIDE
from ss2sql.vtables.pybullet import client as bullet
from ss2sql.vtables.pybullet.scene import Sphere

DIRECTIONS = [(x, y) for x, y in product((-1, 0, 1), repeat=2) if (x, y) != (0, 0)]
SMALL = (160, 120)


def state(scene: Scene) -> dict[int, Any]:
    client = scene.client
    return {
        body: (name, client.getBasePositionAndOrientation(body), client.getBaseVelocity(body))
        for body, name in scene.names.items()
    }


def moving(scene: Scene) -> list[int]:
    return [body for body, name in scene.names.items() if not name.startswith("wall")]


# --- chaos ---------------------------------------------------------------------------------------------


def test_chaos_has_what_it_promises(client):
    scene = scenes.chaos(client=client)
    assert scene.client is client
    assert isinstance(client, BulletClient)
    assert len(scene.names) == client.getNumBodies() == 150 + 6
    kinds = Counter(name.rpartition("_")[0] for name in scene.names.values())
    assert (kinds.pop("wall"), set(kinds)) == (6, {"sphere", "box", "capsule", "cylinder"})
    assert min(kinds.values()) > 15
    assert all(re.fullmatch(r"(sphere|box|capsule|cylinder)_\d+", scene.names[body]) for body in moving(scene))
    assert [scene.body(name) for name in scene.names.values()] == list(scene.names)
    for body in scene.names:
        ((_, _, kind, size, *_),) = client.getCollisionShapeData(body, -1)
        if kind == pybullet.GEOM_PLANE:
            assert mass_of(scene.client, body) == 0
            continue
        assert 1 <= mass_of(scene.client, body) <= 100
        assert 0.06 <= min(part for part in size if part) <= max(size) <= 1.0
        assert dist(scene.forces[body], (0, 0, 0)) <= 4 * mass_of(scene.client, body)


def test_bodies_are_born_and_explode_into_white_splinters(client):
    scene = scenes.chaos(seed=18, bodies=150, client=client)
    scene.step(1200)
    assert len(scene.names) == client.getNumBodies() == scene.births - scene.deaths
    assert scene.births > 156
    assert scene.deaths > 0
    splinters = [body for body, name in scene.names.items() if name.startswith("particle_")]
    assert {client.getVisualShapeData(body)[0][7] for body in splinters} == {(1.0, 1.0, 1.0, 1.0)}
    assert len(set(scene.names.values())) == len(scene.names)


def test_an_explosion_keeps_the_mass_and_the_splinters_vanish(client):
    scene = scenes.chaos(seed=1, bodies=20, client=client)
    victim = moving(scene)[0]
    name, before = scene.names[victim], mass_of(scene.client, victim)
    scene.explode_body(victim)
    splinters = list(scene.ends)
    assert name not in scene.names.values()
    assert 6 <= len(splinters) <= 10
    assert sum(mass_of(scene.client, body) for body in splinters) == pytest.approx(before)
    names = {scene.names[body] for body in splinters}
    scene.step(11 * 240)
    assert not names & set(scene.names.values())


def test_bodies_bounce_at_walls(client):
    scene = scenes.chaos(bodies=0, client=client)
    ball = scene.add("ball", Sphere(0.3), (0, 0, 0), (1, 0, 0), mass=5.0)
    scene._make_bouncy(ball)
    client.resetBaseVelocity(ball, (4, 0, 0))
    scene.step(80 + 240)  # it has 4.7 m to go
    velocity, _ = client.getBaseVelocity(ball)
    assert velocity[0] == pytest.approx(-4 * 0.3, rel=0.05)
    scene = scenes.chaos(bodies=0, client=client)
    assert repr(scene) == "<chaos of seed 18: 6 bodies, 0.00 s>"
    ball = scene.add("ball", Sphere(0.3), (0, 0, 0), (1, 0, 0), mass=5.0)
    scene.ends[ball] = 99  # as that of a splinter
    client.resetBasePositionAndOrientation(ball, (4.99, 1.0, 0.0), (0, 0, 0, 1))
    client.resetBaseVelocity(ball, (4000, 7, 0))
    scene.after_step()
    assert client.getBasePositionAndOrientation(ball)[0] == pytest.approx((INSIDE, 1.0, 0.0))
    assert client.getBaseVelocity(ball)[0] == pytest.approx((-4000 * BOUNCE, 7, 0))


# --- hall ----------------------------------------------------------------------------------------------


def test_hall_has_what_it_promises(client):
    scene = scenes.hall(client=client)
    assert len(scene.names) == client.getNumBodies() == 55
    assert scene.body("YouBot") == scene.robot
    assert (client.getBodyInfo(scene.robot)[1], client.getNumJoints(scene.robot)) == (b"YouBot", 10 - 1)
    position, _ = client.getBasePositionAndOrientation(scene.robot)
    assert position[:2] == scene.places["start"]
    assert client.getBasePositionAndOrientation(scene.body("target"))[0][:2] == scene.places["target"] == (10.0, 9.0)
    assert {scene.names[body] for body in scene.sensors} == {f"sensor_{number}" for number in range(1, 7)}
    for body, sensor in scene.sensors.items():
        assert client.getBasePositionAndOrientation(body)[0] == pytest.approx(sensor.position)
        assert dist(sensor.direction, (0, 0, 0)) == pytest.approx(1)
        ahead = [p + sensor.range * d for p, d in zip(sensor.position, sensor.direction, strict=True)]
        assert 0 < ahead[0] < 16
        assert 0 < ahead[1] < 12
    assert {"wall", "column", "crate", "barrel", "shelf", "table", "machine", "tank"} <= {
        name.partition("_")[0] for name in scene.names.values()
    }


def test_things_in_the_hall_stand_still_and_the_seed_moves_some(client):
    scene = scenes.hall(seed=2, client=client)
    before = state(scene)
    scene.step(240)
    for body, (name, (position, _), _) in state(scene).items():
        assert dist(position, before[body][1][0]) < 0.01, name
    first, second = state(scenes.hall(seed=0, client=client)), state(scenes.hall(seed=1, client=client))
    moved = {first[body][0].partition("_")[0] for body in first if first[body] != second[body]}
    assert moved == {"crate", "barrel"}


@pytest.mark.parametrize(("seed", "step"), [(0, 0.5), (7, 1.0)])
def test_ways_through_the_hall_lead_through_doors_and_around_obstacles(client, seed, step):
    networkx = pytest.importorskip("networkx")
    scene = scenes.hall(seed, client=client)
    (_, _, z), turned = client.getBasePositionAndOrientation(scene.robot)
    others = [body for body in scene.names if body not in (scene.robot, scene.body("target"))]

    def is_free(spot: tuple[int, int]) -> bool:
        client.resetBasePositionAndOrientation(scene.robot, (spot[0] * step, spot[1] * step, z), turned)
        return not any(client.getClosestPoints(scene.robot, body, 0.0) for body in others)

    free = set(filter(is_free, product(range(int(16 / step) + 1), range(int(12 / step) + 1))))
    ways = networkx.Graph(((x, y), (x + a, y + b)) for x, y in free for a, b in DIRECTIONS if (x + a, y + b) in free)
    places = {name: (int(x / step), int(y / step)) for name, (x, y) in scene.places.items()}
    start, target = places["start"], places["target"]
    away = networkx.single_source_shortest_path_length(ways, start)
    assert away.keys() >= set(places.values())
    assert max(abs(a - b) for a, b in zip(start, target, strict=True)) < away[target] <= 20
    # The walls between the rooms can only be crossed at their doors; the robot is 0.58 m long and 0.39 m wide.
    assert {x * step for x, y in away if y * step == 6} <= {5.5, 6.0, 6.5, 13.0}
    assert {y * step for x, y in away if x * step == 8 and y * step > 6} <= {8.5, 9.0, 9.5}


# --- pictures ------------------------------------------------------------------------------------------


def colourfulness(pixels: Any) -> float:
    return float((pixels.max(axis=-1).astype(int) - pixels.min(axis=-1)).mean())


def test_a_picture_has_its_size_and_is_a_png(client, tmp_path):
    image = pytest.importorskip("matplotlib.image")
    scene = scenes.hall(client=client)
    pixels = scenes.render(scene, tmp_path / "hall.png", size=(320, 200))
    assert pixels.shape == (200, 320, 3)
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 1000
    assert (np.round(image.imread(tmp_path / "hall.png")[..., :3] * 255) == pixels).all()
    above = scenes.render(scene, None, size=SMALL, view="top")
    assert above.shape == (120, 160, 3)
    assert (above != scenes.render(scene, None, size=SMALL)).any()


def test_paths_are_red_and_visited_points_are_yellow(client):
    scene = scenes.hall(client=client)
    size = (320, 240)
    plain = scenes.render(scene, None, size=size, view="top")
    way = [(6.0, 4.0), (6.0, 8.0)]
    visited = np.array([(9.0, 3.0, 0.1)])
    pixels = scenes.render(scene, None, size=size, view="top", paths=[way], visited=visited)
    changed = (pixels != plain).any(axis=-1)
    red = (pixels[..., 0] > 150) & (pixels[..., 1] < 90) & changed
    yellow = (pixels[..., 0] > 200) & (pixels[..., 1] > 150) & (pixels[..., 2] < 100) & changed
    # The camera hangs over (8, 6), 23 m high, and sees 32 degrees: 240 pixels for 13.2 m of the floor.
    scale = 240 / (2 * 23 * np.tan(np.radians(16)))
    rows, columns = np.nonzero(red)
    assert columns.mean() == pytest.approx(160 - 2 * scale, abs=2)
    assert (rows.min(), rows.max()) == pytest.approx((120 - 2 * scale, 120 + 2 * scale), abs=2)
    rows, columns = np.nonzero(yellow)
    assert (columns.mean(), rows.mean()) == pytest.approx((160 + 1 * scale, 120 + 3 * scale), abs=2)
    assert changed.sum() < 400


def test_highlighted_bodies_keep_their_colours_and_the_others_fade(client):
    scene = scenes.chaos(client=client)
    spheres = [body for body in moving(scene) if scene.names[body].startswith("sphere")]
    heaviest = max(spheres, key=lambda body: mass_of(scene.client, body))
    looks = [client.getVisualShapeData(body) for body in scene.names]
    plain = scenes.render(scene, None, size=SMALL)
    faded = scenes.render(scene, None, size=SMALL, highlight=[])
    marked = scenes.render(scene, None, size=SMALL, highlight=[heaviest])
    assert colourfulness(faded) < 0.3 * colourfulness(plain)
    changed = (faded != marked).any(axis=-1)
    assert 10 < changed.sum() < 500
    assert colourfulness(marked[changed]) > 2 * colourfulness(faded[changed])
    assert [client.getVisualShapeData(body) for body in scene.names] == looks
    assert (scenes.render(scene, None, size=SMALL) == plain).all()


def test_bodies_of_a_plain_client_have_shadows_and_shine_through_when_highlighted(client):
    client.resetSimulation()
    grey, blue, red = (0.8, 0.8, 0.8, 1), (0.1, 0.2, 0.9, 1), (0.9, 0.1, 0.1, 1)

    def stand(half: tuple[float, float, float], place: tuple[float, float, float], colour: Any) -> int:
        shape = client.createVisualShape(pybullet.GEOM_BOX, halfExtents=half, rgbaColor=colour)
        touch = client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half)
        return int(client.createMultiBody(0, touch, shape, place))

    stand((4, 4, 0.1), (0, 0, -0.1), grey)
    stand((0.5, 0.5, 0.5), (0, 0, 1.5), blue)
    hidden = stand((0.3, 0.3, 0.1), (0, 0, 0.1), red)
    above = View((0, 0, 12), (0, 0, 0), 40, (0, 1, 0))
    pixels = scenes.render(client, None, size=(200, 200), view=above)
    scale = 200 / (2 * 12 * np.tan(np.radians(20)))
    # Light comes from (0.35, -0.5, 1.1): what is 1.5 m high has its shadow 0.48 m to the left and 0.68 m to the back.
    shadow = pixels[int(100 - 1.0 * scale), int(100 - 0.7 * scale)].astype(int)
    lit = pixels[int(100 + 1.5 * scale), int(100 + 1.5 * scale)].astype(int)
    assert shadow.max() < 0.85 * lit.max()
    assert pixels[100, 100].argmax() == 2
    marked = scenes.render(client, None, size=(200, 200), view=above, highlight=[hidden])
    assert marked[100, 100].argmax() == 0
    assert scenes.render(client, None, size=SMALL).shape == (120, 160, 3)


def test_a_floor_of_a_hundred_metres_does_not_make_a_robot_a_dot(client):
    client.resetSimulation()
    for half, height, colour in (((100, 100, 5), -5, (0.8, 0.8, 0.8, 1)), ((0.5, 0.5, 0.5), 0.5, (0.1, 0.2, 0.9, 1))):
        shown = client.createVisualShape(pybullet.GEOM_BOX, halfExtents=half, rgbaColor=colour)
        touch = client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half)
        client.createMultiBody(0, touch, shown, (0, 0, height))
    red, _, blue = scenes.render(client, None, size=SMALL).astype(int).transpose(2, 0, 1)
    assert (blue > red + 50).mean() > 0.1


# --- wrong use -----------------------------------------------------------------------------------------


def test_wrong_use_has_clear_errors(client):
    scene = scenes.hall(client=client)
    for action, text in (
        (lambda: scenes.render(scene, None, view="tob"), "did you mean 'top'?"),
        (lambda: scenes.render(client, None, view="top"), "only scenes have views with names"),
        (lambda: scenes.render(scene, None, highlight=[77_777]), "no body 77777"),
        (lambda: scenes.render(scene, None, size=(0, 10)), r"size \(0, 10\)"),
        (lambda: scenes.render(scene, None, size=SMALL, paths=[[(1,)]]), r"\(1,\) is not a point"),
        (lambda: scenes.render(scene, None, view=View((0, 0, 9), (0, 0, 0))), "cannot look straight along its own up"),
        (lambda: scenes.render([1, 2], None), "a list is no scene"),
        (lambda: scene.body("YouBott"), "did you mean 'YouBot'?"),
        (lambda: scenes.chaos(bodies=-1), "-1 bodies"),
    ):
        with pytest.raises(ss2sql.SessionError, match=text) as caught:
            action()
        assert caught.value.hints
    scene.step(3)
    assert scene.time == 3 / 240


def test_scenes_are_imported_when_they_are_asked_for(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    bullet.import_pybullet.cache_clear()
    bullet._make_client_type.cache_clear()
    with pytest.raises(ss2sql.SessionError, match=r"S003[\s\S]*pip install pybullet"):
        scenes.hall()
    code = (
        "import sys, ss2sql; assert 'ss2sql.scenes' not in sys.modules; ss2sql.scenes.chaos;"
        "assert 'pybullet' not in sys.modules; ss2sql.scenes.chaos(bodies=1).step()"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert ran.stdout == ""
