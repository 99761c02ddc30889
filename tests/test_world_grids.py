"""AS occupancygrid and AS sensorgrid, against what geometry says."""

from __future__ import annotations

from math import cos, hypot, pi, radians, sin, tan
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pybullet")

from bullet_rooms import Counting
from little_scenes import GREY, ask
from little_scenes import fixture_scene as fixture_scene

import ss2sql
from ss2sql import scenes
from ss2sql.vtables.pybullet import PyBulletWorld
from ss2sql.vtables.pybullet.environment import GAP, THIN
from ss2sql.vtables.pybullet.scene import Box, Capsule, Cylinder, Plane, Scene, Sensor, Sphere

# --- occupancygrid -------------------------------------------------------------------------------------

AREA = "[[-2, -2], [2, 2]]"


def cells_where(inside: Any, cell: float, low: float = -2.0, high: float = 2.0) -> Any:
    """The cells whose square has a part inside of a convex set, given by the distance from a point to the set."""
    count = round((high - low) / cell)
    found = np.zeros((count, count), dtype=bool)
    for row in range(count):
        for column in range(count):
            x, y = low + column * cell, low + row * cell
            found[row, column] = inside(x, y, x + cell, y + cell)
    return found


def disc(x: float, y: float, radius: float) -> Any:
    def inside(x1: float, y1: float, x2: float, y2: float) -> bool:
        return hypot(max(x1 - x, 0, x - x2), max(y1 - y, 0, y - y2)) < radius - 2e-4

    return inside


def rectangle(a: float, b: float, angle: float) -> Any:
    """Whether a square and a rectangle around the origin, turned by an angle, overlap: no axis separates them."""
    u, v = (cos(angle), sin(angle)), (-sin(angle), cos(angle))
    corners = [(i * a * u[0] + j * b * v[0], i * a * u[1] + j * b * v[1]) for i in (-0.5, 0.5) for j in (-0.5, 0.5)]

    def inside(x1: float, y1: float, x2: float, y2: float) -> bool:
        square = [(x, y) for x in (x1, x2) for y in (y1, y2)]
        for axis in ((1.0, 0.0), (0.0, 1.0), u, v):
            mine, its = ([p[0] * axis[0] + p[1] * axis[1] for p in points] for points in (square, corners))
            if max(mine) < min(its) + 2e-4 or max(its) < min(mine) + 2e-4:
                return False
        return True

    return inside


def stadium(x1: float, y1: float, x2: float, y2: float) -> bool:
    return hypot(max(x1 - 0.5, 0, -0.5 - x2), max(y1, 0, -y2)) < 0.3 - 2e-4


def nowhere(*_: float) -> bool:
    return False


@pytest.mark.parametrize(
    ("solid", "place", "turned", "z", "cell", "inside"),
    [
        *[(Box(2.13, 0.61, 1.0), (0, 0, 0), (0, 0, radians(d)), 0.2, 0.1, rectangle(2.13, 0.61, radians(d)))
          for d in (0, 30, 45, 77)],
        (Sphere(0.8), (0.13, -0.21, 0), (0, 0, 0), 0.81, 0.1, nowhere),
        (Cylinder(0.7, 1.0), (0.1, 0.2, 0), (0, 0, 0), 0.4, 0.1, disc(0.1, 0.2, 0.7)),
        (Cylinder(0.7, 1.0), (0.1, 0.2, 0), (0, 0, 0), 0.6, 0.1, nowhere),
        (Capsule(0.3, 1.0), (0, 0, 0), (0, pi / 2, 0), 0.0, 0.1, stadium),
        # what touches a cell only is not in it, and a wall thinner than the cells stays closed
        (Box(1.0, 1.0, 1.0), (0, 0, 0.5), (0, 0, 0), 0.5, 0.25, lambda x1, y1, x2, y2: max(-x1, -y1, x2, y2) <= 0.5),
        (Box(0.01, 9.0, 1.0), (0.13, 0, 0.5), (0, 0, 0), 0.5, 0.25, lambda x1, y1, x2, y2: x1 < 0.13 < x2),
    ],
    ids=["box 0", "box 30", "box 45", "box 77", "above", "cylinder", "above a cylinder", "capsule", "touching", "wall"],
)  # fmt: skip
def test_solids_stand_in_their_cells(
    scene: Scene, engine: Any, solid: Any, place: Any, turned: Any, z: float, cell: float, inside: Any
) -> None:
    body = scene.add("thing", solid, (9.0, 9.0, 9.0), GREY, 1.0, turned=turned)
    _, turn = scene.client.getBasePositionAndOrientation(body)
    scene.client.resetBasePositionAndOrientation(body, place, turn)  # it is found where it is now
    grid = ask(scene, f"SELECT obj FROM space AS occupancygrid({z}, {cell}, {AREA});", engine)
    assert np.array_equal(grid, cells_where(inside, cell))


def test_large_plates_leave_nothing_out(client: Any) -> None:
    """The same as trying a plate of one cell at every cell, for every body."""
    world = scenes.chaos(seed=11, bodies=60, client=client)
    half = (0.25 - GAP * 0.25) / 2
    plate = client.createCollisionShape(client.GEOM_BOX, halfExtents=(half, half, THIN * 0.25 / 2))
    for z in (0.0, -3.3):
        grid = ask(world, f"SELECT obj FROM space AS occupancygrid({z}, 0.25);")
        wanted = np.zeros((40, 40), dtype=bool)
        for row, column in np.ndindex(40, 40):
            middle = (-5 + 0.25 * (column + 0.5), -5 + 0.25 * (row + 0.5), z)
            wanted[row, column] = any(
                client.getClosestPoints(
                    bodyA=-1, bodyB=body, distance=0.0, collisionShapeA=plate, collisionShapePositionA=middle
                )
                for body in world.names
            )
        assert np.array_equal(grid, wanted)
        assert 0 < wanted.sum() < 800


def test_an_endless_floor_below_the_grid_takes_a_few_plates(client: Any) -> None:
    """Instead of one for each of 4 million cells."""
    counted = Counting(client)
    client.createMultiBody(0, client.createCollisionShape(client.GEOM_PLANE))
    script = "SELECT obj FROM space AS occupancygrid(0.5, 0.02, [[-20, -20], [20, 20]]);"
    assert not ask(PyBulletWorld(counted), script).any()
    assert counted.calls["getClosestPoints"] < 50
    assert ask(PyBulletWorld(client), "SELECT obj FROM space AS occupancygrid(-1, 0.5, [[-2, -2], [3, 2]]);").all()


@pytest.mark.parametrize(
    ("script", "timeout"),
    [
        ("SELECT obj FROM space WHERE isPlane AS occupancygrid(-0.1, 0.002, [[-1, -1], [1, 1]]);", 0.3),
        ("SELECT obj FROM space WHERE isSensor AS sensorgrid(0.5, 0.002, [[-1, -1], [1, 1]]);", 0.3),
        ("SELECT obj FROM space WHERE isBox AS environment;", 0.05),
        ("SELECT count(*) FROM space.closest(None, None, -9);", 0.05),
    ],
    ids=["occupancygrid", "sensorgrid", "environment", "closest"],
)
def test_what_takes_long_can_be_stopped(scene: Scene, script: str, timeout: float) -> None:
    """Each takes a second or more; `closest` finds no pair."""
    scene.add("floor", Plane((0.0, 0.0, 1.0), 10.0), (0.0, 0.0, 0.0), GREY)
    for number in range(400):
        scene.add(f"crate_{number}", Box(0.5, 0.5, 0.5), (number, 50.0, 0.5), GREY)
    with_sensor(scene, (0.0, 0.0, 0.5), (0.0, 0.0, -1.0), 99.0, 360.0)
    with pytest.raises(ss2sql.Timeout):
        ask(scene, script, timeout=timeout)


def test_scripts_read_a_grid_as_a_list_of_its_rows(scene: Scene, engine: Any) -> None:
    scene.add("box", Box(0.5, 0.5, 0.5), (1.0, 0.0, 0.5), GREY)
    made = f"g = SELECT obj FROM space AS occupancygrid(0.5, 0.5, {AREA});"
    grid = ask(scene, made, engine)
    rows = grid.tolist()
    assert rows[4][6:] != rows[4][:2]
    column = [row for row, cells in enumerate(rows) if cells[6]]
    for script, value in (
        ("[g[4, 6], g[-4][0], g[4]]", [True, False, rows[4]]), ("g[3:5]", rows[3:5]), ("len(g)", len(rows)),
        ("SELECT this FROM range(len(g)) WHERE g[this, 6] AS list", column),
        ('g["origin"]', [-2.0, -2.0]), ("SELECT origin FROM g AS list", [[-2.0, -2.0]]),
    ):  # fmt: skip
        assert ask(scene, f"{made} {script};", engine) == value
    for script, words in (("g[99, 0]", "index 99 is out of range"), ("g.origin", r"write g\[.origin.\]")):
        with pytest.raises(ss2sql.Error, match=words):
            ask(scene, f"{made} {script};", engine)


def test_only_the_selected_bodies_stand_in_the_grid(scene: Scene, engine: Any) -> None:
    scene.add("ball", Sphere(0.3), (-1.0, 0.0, 0.0), GREY)
    scene.add("crate", Box(0.4, 0.4, 0.4), (1.0, 1.0, 0.0), GREY)
    scene.add("paint", Box(3, 3, 3), (0.0, 0.0, 0.0), GREY, touchable=False)
    for columns in ("obj", "this", "mass", "name, obj"):
        grid = ask(scene, f"SELECT {columns} FROM space WHERE isSphere(this) AS occupancygrid(0, 0.1, {AREA});", engine)
        assert np.array_equal(grid, cells_where(disc(-1.0, 0.0, 0.3), 0.1))
    both = ask(scene, f"SELECT a.this, b.this FROM a = space, b = space AS occupancygrid(0, 0.1, {AREA});", engine)
    assert np.array_equal(
        both,
        cells_where(disc(-1.0, 0.0, 0.3), 0.1) | np.roll(cells_where(rectangle(0.4, 0.4, 0), 0.1), (10, 10), (0, 1)),
    )


def test_the_area_is_that_of_the_scene_or_of_all_bodies(scene: Scene, engine: Any) -> None:
    scene.add("ball", Sphere(0.5), (1.0, 2.0, 0.0), GREY)
    scene.add("crate", Box(1.0, 1.0, 1.0), (-3.0, 0.0, 0.0), GREY)
    grid = ask(scene.client, "SELECT obj FROM space WHERE isBox(this) AS occupancygrid(0, 0.5);", engine)
    assert grid.extent == pytest.approx((-3.5, 1.5, -0.5, 2.5), abs=0.01)
    scene.bounds = ((-4.0, -1.0, 0.0), (2.0, 3.0, 1.0))  # type: ignore[misc]
    grid = ask(scene, "SELECT obj FROM space WHERE isBox(this) AS occupancygrid(0, 0.5);", engine)
    assert grid.extent == (-4.0, 2.0, -1.0, 3.0)


def test_nothing_selected_is_a_grid_of_false_and_an_empty_world_has_no_cells(scene: Scene, engine: Any) -> None:
    assert ask(scene.client, "SELECT obj FROM space AS occupancygrid(0, 0.5);", engine).shape == (0, 0)
    scene.add("ball", Sphere(0.5), (1.0, 2.0, 0.0), GREY)
    grid = ask(scene, f"SELECT obj FROM space WHERE isBox(this) AS occupancygrid(0, 0.5, {AREA});", engine)
    assert (grid.shape, grid.any()) == ((8, 8), False)
    grid = ask(scene, SEEN, engine)
    assert (grid.shape, grid.any()) == ((40, 40), False)


def test_a_map_that_would_be_too_large_names_an_area_that_works(client: Any) -> None:
    client.createMultiBody(0, client.createCollisionShape(client.GEOM_BOX, halfExtents=(100, 100, 5)))
    with pytest.raises(ss2sql.RepresentationError, match="10000 x 10000 cells") as caught:
        ask(client, "SELECT obj FROM space AS occupancygrid(0.6, 0.02);")
    (_, shown) = caught.value.hints
    grid = ask(client, f"SELECT obj FROM space {shown[shown.index('AS ') :]};")
    assert grid.shape == (200, 200)


def test_worlds_cannot_be_mixed(scene: Scene) -> None:
    scene.add("ball", Sphere(0.5), (1.0, 2.0, 0.0), GREY)
    with Scene(0) as other, ss2sql.connect() as ss:
        other.add("ball", Sphere(0.5), (0.0, 0.0, 0.0), GREY)
        ss.attach("space", scene)
        ss.attach("there", other)
        with pytest.raises(ss2sql.RepresentationError, match="cannot mix worlds"):
            ss.run("SELECT a.this, b.this FROM a = space, b = there AS occupancygrid(0, 1, [[0, 0], [1, 1]]);")
        grid = ss.run("SELECT obj FROM space AS occupancygrid(0, 1, [[0, 0], [2, 3]]);").value  # the last one attached
        assert np.flatnonzero(grid.any(axis=1)).tolist() == [1, 2]  # the ball of `space`, whose y is 2


# --- sensorgrid ----------------------------------------------------------------------------------------


def with_sensor(scene: Scene, position: Any, direction: Any, far: float, angle: float) -> int:
    body = scene.add(scene.next_name("sensor"), Box(0.1, 0.1, 0.1), position, GREY)
    scene.sensors[body] = Sensor(position, direction, far, angle)
    return body


def middles(cell: float) -> Any:
    line = -2 + cell / 2 + cell * np.arange(round(4 / cell))
    return np.meshgrid(line, line)


SEEN = f"SELECT obj FROM space WHERE isSensor(this) AS sensorgrid(0.5, 0.1, {AREA});"


def test_a_sensor_sees_a_disc_below_it(scene: Scene, engine: Any) -> None:
    with_sensor(scene, (0.3, 0.2, 2.0), (0.0, 0.0, -1.0), 9.0, 60.0)
    grid = ask(scene, SEEN, engine)
    x, y = middles(0.1)
    assert grid.dtype.kind == "i"
    assert np.array_equal(grid, np.hypot(x - 0.3, y - 0.2) <= 1.5 * tan(radians(30)))


def test_a_sensor_sees_as_far_as_its_range(scene: Scene, engine: Any) -> None:
    with_sensor(scene, (0.0, 0.0, 0.5), (0.0, 0.0, -1.0), 1.23, 360.0)
    x, y = middles(0.1)
    assert np.array_equal(ask(scene, SEEN, engine), np.hypot(x, y) <= 1.23)


def test_a_wall_hides_what_is_behind_it(scene: Scene, engine: Any) -> None:
    with_sensor(scene, (-1.5, 0.03, 0.5), (1.0, 0.0, 0.0), 10.0, 90.0)
    scene.add("wall", Box(0.2, 1.0, 2.0), (0.0, 0.0, 0.5), GREY)
    x, y = middles(0.1)
    seen = np.abs(np.arctan2(y - 0.03, x + 1.5)) <= radians(45)
    with np.errstate(divide="ignore", invalid="ignore"):
        at_front = 0.03 + (y - 0.03) * 1.4 / (x + 1.5)  # where the ray passes the front of the wall, at x = -0.1
    hidden = (x > -0.1) & (np.abs(at_front) <= 0.5)
    # Rays also enter the wall through its sides: those that pass its front but are inside of it.
    in_wall = (np.abs(x) <= 0.1) & (np.abs(y) <= 0.5)
    assert np.array_equal(ask(scene, SEEN, engine), seen & ~hidden & ~in_wall)
    assert not (ask(scene, SEEN, engine) > 0)[:, 21:].all()
    low = ask(scene, f"SELECT obj FROM space WHERE isSensor(this) AS sensormap(3.5, 0.5, {AREA});", engine)
    assert low.shape == (8, 8)


def test_sensors_are_counted(scene: Scene, engine: Any) -> None:
    for x in (-1.0, 0.0, 1.0):
        with_sensor(scene, (x, 0.0, 2.0), (0.0, 0.0, -1.0), 9.0, 90.0)
    x, y = middles(0.1)
    assert np.array_equal(ask(scene, SEEN, engine), sum((np.hypot(x - at, y) <= 1.5).astype(int) for at in (-1, 0, 1)))


def test_the_ground_is_seen_and_its_own_body_does_not_hide(scene: Scene) -> None:
    scene.add("floor", Box(4, 4, 0.1), (0.0, 0.0, -0.05), GREY)
    body = with_sensor(scene, (0.0, 0.0, 1.2), (0.0, 0.0, -1.0), 9.0, 90.0)
    script = f"SELECT obj FROM space WHERE isSensor(this) AS sensorgrid(0.0, 0.1, {AREA});"
    x, y = middles(0.1)
    assert np.array_equal(ask(scene, script), np.hypot(x, y) <= 1.2)
    # The eye outside of the body, which hangs in front of it.
    scene.sensors[body] = Sensor((0.0, 0.0, 1.3), (0.0, 0.0, -1.0), 9.0, 90.0)
    assert np.array_equal(ask(scene, script), np.hypot(x, y) <= 1.3)


@pytest.mark.parametrize("height", [0.05, 0.1, 0.101, 0.11, 0.12])
def test_a_sensor_on_its_own_body_sees_what_it_sees_alone(scene: Scene, height: float, engine: Any) -> None:
    """From inside of it, on its top, and a little above, where a ray passes through a millimetre of it."""
    body = scene.add("sensor", Box(0.4, 0.4, 0.2), (0.0, 0.0, 0.0), GREY)
    crate = scene.add("crate", Box(0.2, 0.2, 0.2), (1.0, 0.0, 0.0), GREY)
    hidden = scene.add("hidden", Box(0.2, 0.1, 0.1), (1.5, 0.0, -0.05), GREY)
    grid = f"SELECT obj FROM space WHERE isSensor AS sensorgrid(-0.05, 0.1, {AREA})"
    script = f"[{grid}, isSensing(eye, crate), isSensing(eye, hidden)]"
    bare = scene.add("bare", Box(0.01, 0.01, 0.01), (0.0, 0.0, 3.0), GREY)
    found = []
    for eye in (body, bare):
        scene.sensors.clear()
        scene.sensors[eye] = Sensor((0.0, 0.0, height), (1.0, 0.0, 0.0), 2.5, 90.0)
        found.append(ask(scene, f"eye = {eye}; crate = {crate}; hidden = {hidden}; {script}", engine))
        scene.client.resetBasePositionAndOrientation(body, (0, 0, 9), (0, 0, 0, 1))
    assert np.array_equal(found[0][0], found[1][0])
    assert found[0][0].any()
    assert found[0][1:] == found[1][1:] == [True, False]


def test_more_rays_than_pybullet_takes_at_once(scene: Scene) -> None:
    with_sensor(scene, (0.0, 0.0, 0.5), (0.0, 0.0, -1.0), 99.0, 360.0)
    script = "SELECT obj FROM space AS sensorgrid(0.5, 0.02, [[-2, -2], [2, 2]]);"
    assert ask(scene, script).sum() == 200 * 200  # 40,000 rays
