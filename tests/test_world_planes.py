"""AS plane, AS environment, AS prolog, and what they have in common with the other representations of worlds."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pybullet")

import pybullet_data
from golden import each_row
from little_scenes import GREY, ask, refused
from little_scenes import fixture_scene as fixture_scene
from prolog_facts import facts
from sessions import leaping

import ss2sql
from ss2sql import scenes
from ss2sql.language.area_grid import Grid
from ss2sql.runtime.representations.as_plane import blur_grid_cells
from ss2sql.vtables.pybullet.scene import Box, Scene, Sphere

# --- plane ---------------------------------------------------------------------------------------------

POINTS = [[[0.05, 0.05, 3.0], 2.0], [[0.06, 0.01, 9.0], 3.0], [[0.95, 0.15, -1.0], 5.0], [[7.0, 0.0, 0.0], 100.0]]


def test_a_plane_adds_up_what_lies_in_each_cell(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT this[0], this[1] FROM points AS plane('XY', [0, 0], [10, 4, 0.1]);"
    grid = ss.run(script, engine=engine, points=POINTS).value
    wanted = np.zeros((4, 10))
    wanted[0, 0] = 5.0  # two of them in the first cell
    wanted[1, 9] = 5.0  # rows are the second axis; what lies at x = 7 is outside
    assert isinstance(grid, Grid)
    assert np.array_equal(grid, wanted)
    assert (grid.origin, grid.cell) == ((0.0, 0.0), 0.1)
    assert grid.extent == pytest.approx((0.0, 1.0, 0.0, 0.4))
    assert grid.index(0.95, 0.15) == (1, 9)
    assert grid.index(7.0, 0.0) is None
    xs, ys = grid.centres()
    assert (xs[9], ys[1]) == pytest.approx((0.95, 0.15))


@pytest.mark.parametrize(
    ("query", "grid"),
    [
        *[(f"this, 1 FROM [[0.5, 0.7, 3.5]] AS plane('{plane}', [0, 0], [1, 4, 1.0])", row)
          for plane, row in (("XY", [[1], [0], [0], [0]]), ("xz", [[0], [0], [0], [1]]), ("YZ", [[0], [0], [0], [1]]))],
        # None counts nothing, and no rows are zeros
        ("[0.5, 0.5], this FROM [None, 2, True] AS plane('XY', [0, 0], [1, 1, 1])", [[3.0]]),
        ("[0, 0], this FROM [] AS plane('XY', [-1, -1], [3, 2, 0.5], 1)", [[0.0] * 3] * 2),
    ],
)  # fmt: skip
def test_planes(ss: ss2sql.Session, query: str, grid: Any, engine: Any) -> None:
    assert ss.run(f"SELECT {query};", engine=engine).value.tolist() == grid


def test_the_listing_of_the_paper(client: Any, engine: Any) -> None:
    world = scenes.chaos(seed=4, bodies=40, client=client)
    script = """
        Mass    = SELECT mass FROM space WHERE hasBody(this)
                  AS plane('XY', [-5,-5], [100,100,0.1], 3);
        Velocity= SELECT linearVelocity(this, 2) FROM space
                  WHERE hasBody(this)
                  AS plane('XY', [-5,-5], [100,100,0.1], 3);
        [Mass, Velocity];"""
    mass, velocity = ask(world, script, engine)
    bodies = [body for body in world.names if client.getDynamicsInfo(body, -1)[0]]
    for grid, values in (
        (mass, [client.getDynamicsInfo(body, -1)[0] for body in bodies]),
        (velocity, [client.getBaseVelocity(body)[0][2] for body in bodies]),
    ):
        plain = np.zeros((100, 100))
        for body, value in zip(bodies, values, strict=True):
            x, y, _ = client.getBasePositionAndOrientation(body)[0]
            plain[int((y + 5) / 0.1), int((x + 5) / 0.1)] += value
        assert grid == pytest.approx(blur_grid_cells(plain, 3))


def test_the_place_is_a_list_an_element_or_that_of_the_source(scene: Scene, engine: Any) -> None:
    scene.add("ball", Sphere(0.1), (1.5, 2.5, 0.0), GREY, 7.0)
    for columns in ("mass", "pos, mass", "obj, mass", "name, this, mass", "position(this), mass"):
        grid = ask(scene, f"SELECT {columns} FROM space AS plane('XY', [0, 0], [4, 4, 1]);", engine)
        assert grid[2, 1] == grid.sum() == 7.0
    moved = ask(scene, "SELECT pos + [], mass FROM space AS plane('XZ', [0, 0], [4, 4, 1]);", engine)
    assert moved[0, 1] == 7.0


def test_of_several_sources_the_columns_decide_whose_body_it_is(client: Any, engine: Any) -> None:
    scene, other = Scene(0, client), scenes.chaos(seed=1, bodies=0)
    for world, place in ((scene, 0.5), (other, 3.5)):
        world.add("ball", Sphere(0.1), (place, 0.5, 0.0), GREY, 7.0)
        world.add("crate", Box(0.1, 0.1, 0.1), (place, 1.5, 0.0), GREY, 5.0)
    two = "FROM a = space, b = space WHERE a.name == 'ball' AND b.name == 'crate'"
    listed = "FROM w = wanted JOIN b = space ON b.name == w.name"
    rows = [{"name": "crate", "factor": 1}]
    with ss2sql.connect() as ss:
        ss.attach("space", scene)
        ss.attach("real", other)
        for columns, sources, cell in (
            ("b.mass", two, (1, 0)),
            ("mass(b.this)", two, (1, 0)),
            ("a.mass", two, (0, 0)),
            ("b.this, a.mass + b.mass", two, (1, 0)),
            ("b.mass * w.factor", listed, (1, 0)),
            ("w.factor", listed, (1, 0)),
            ("r.mass", "FROM s = space, r = real WHERE s.name == 'ball' AND r.name == 'crate'", (1, 3)),
        ):
            for form in ("plane('XY', [0, 0], [4, 4, 1])", "occupancygrid(0, 1, [[0, 0], [4, 4]])"):
                grid = ss.run(f"SELECT {columns} {sources} AS {form};", engine=engine, wanted=rows).value
                assert np.argwhere(grid).tolist() == [list(cell)]
        assert list(ss.run(f"SELECT b.mass {two} AS environment;", engine=engine).value.names.values()) == ["crate"]
        for form in ("plane('XY', [0, 0], [4, 4, 1])", "occupancygrid(0, 1)", "environment"):
            for columns in ("a.mass + b.mass", "1"):
                with pytest.raises(ss2sql.RepresentationError, match=r"b\.this") as caught:
                    ss.run(f"SELECT {columns} {two} AS {form};", engine=engine)
                assert caught.value.code == "V001"
    other.close()


def test_a_blur_is_a_gaussian(engine: Any) -> None:
    with ss2sql.connect() as ss:
        grid = ss.run("SELECT this, 8 FROM [[10.5, 20.5]] AS plane('XY', [0, 0], [30, 40, 1], 2);", engine=engine).value
    assert grid.sum() == pytest.approx(8.0)  # the borders are more than 3 x 2 cells away
    assert np.unravel_index(grid.argmax(), grid.shape) == (20, 10)
    for x, y in ((1, 0), (0, 2), (3, 4)):
        assert grid[20 + y, 10 + x] / grid[20, 10] == pytest.approx(np.exp(-(x * x + y * y) / (2 * 2**2)))
    assert grid[20 + 7, 10] == 0.0
    assert np.array_equal(blur_grid_cells(np.eye(3), 0), np.eye(3))
    whole = sum(np.exp(-x * x / 2) for x in range(-3, 4)) ** 2  # of which all but the middle leaves the grid
    assert blur_grid_cells(np.ones((1, 1)), 1) == pytest.approx(1 / whole)


def test_planes_of_partitions_and_paths(scene: Scene, engine: Any) -> None:
    scene.add("ball", Sphere(0.1), (0.5, 0.5, 0.0), GREY, 7.0)
    scene.add("crate", Box(0.1, 0.1, 0.1), (1.5, 0.5, 0.0), GREY, 5.0)
    grids = ask(scene, "SELECT mass FROM space GROUP BY type AS plane('XY', [0, 0], [2, 1, 1]);", engine)
    assert {kind: grid.tolist() for kind, grid in grids.items()} == {"sphere": [[7.0, 0.0]], "box": [[0.0, 5.0]]}
    search = """SELECT at, 1 FROM [[1, 0]] START WITH at = [0.5, 0.5] CONNECT BY at = [at[0] + this[0], 0.5]
                STOP WITH at[0] > 2 AS plane('XY', [0, 0], [3, 1, 1]);"""
    with ss2sql.connect() as ss:
        paths = ss.run(search, engine=engine).value
    assert [path.tolist() for path in paths] == [[[1.0, 0.0, 0.0]], [[1.0, 1.0, 0.0]]]  # the third step stops


@each_row("representations/wrong-arguments", "script", "words")
def test_wrong_arguments(scene: Scene, script: str, words: str) -> None:
    scene.add("ball", Sphere(0.1), (0.5, 0.5, 0.0), GREY, 7.0)
    assert words in refused(scene, script)


@pytest.mark.parametrize("name", ["occupancygrid", "sensorgrid", "sensormap", "environment"])
def test_representations_of_a_world_that_nobody_has_attached(ss: ss2sql.Session, engine: Any, name: str) -> None:
    with pytest.raises(ss2sql.ResolveError, match="R006"):
        ss.run(f"SELECT this FROM [1] AS {name}(0, 1);", engine=engine)


def test_grids_can_be_pickled_and_lose_their_place_when_they_are_cut() -> None:
    grid = Grid(np.arange(6.0).reshape(2, 3), (1, 2), 0.5)
    again = pickle.loads(pickle.dumps(grid))
    assert np.array_equal(again, grid)
    assert (again.origin, again.cell) == ((1.0, 2.0), 0.5)
    assert not hasattr(grid[1:], "origin")
    assert not hasattr(grid * 2, "origin")
    assert grid.sum() == 15.0


def test_columns_of_a_representation_stay_hidden(scene: Scene, engine: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also when the run is cut off."""
    scene.add("ball", Sphere(0.1), (1.5, 2.5, 0.0), GREY, 7.0)
    script = "SELECT a.mass FROM a = space, b = range(99999) WHERE leap(b.this) AS plane('XY', [0, 0], [4, 4, 1]);"
    with ss2sql.connect() as ss:
        ss.attach("space", scene)
        result = ss.run("SELECT mass FROM space AS plane('XY', [0, 0], [4, 4, 1]);", engine=engine)
        assert (result.columns, list(result)) == (("mass",), [(7.0,)])
        ss.function("leap", leaping(monkeypatch, 3000), volatility="stable")
        with pytest.raises(ss2sql.Timeout) as caught:
            ss.run(script, engine=engine, timeout=3600)
    assert caught.value.partial is not None
    assert caught.value.partial.columns == ("mass",)
    assert set(caught.value.partial) <= {(7.0,)}


# --- environment ---------------------------------------------------------------------------------------

COLUMNS = (
    "name, type, pos, quat, velocity, angularVelocity, mass, colour, volume, isSensor, friction, restitution, force"
)


def close_to(one: Any, other: Any) -> bool:
    """Whether two values are equal up to rounding."""
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(close_to, one, other))
    return one == (pytest.approx(other, abs=1e-9) if isinstance(one, float) else other)


def test_an_environment_has_the_rows_of_the_query(client: Any, engine: Any) -> None:
    world = scenes.chaos(seed=7, bodies=25, client=client)
    world.step(30)
    where = f"SELECT {COLUMNS}, aabb FROM space WHERE mass > 20 ORDER BY name AS rows;"
    wanted = ask(world, where, engine)
    with ask(world, "SELECT obj FROM space WHERE mass > 20 AS environment;", engine) as copy:
        assert len(wanted) == len(copy.names) > 5
        assert close_to(ask(copy, f"SELECT {COLUMNS}, aabb FROM space ORDER BY name AS rows;", engine), wanted)
        assert copy.time == world.time
        assert len(world.names) > len(copy.names)
        assert {world.names[old]: copy.names[new] for old, new in copy.ids.items()} == {
            n: n for n in copy.names.values()
        }


def test_an_environment_of_bodies_from_files_and_with_joints(client: Any) -> None:
    world = scenes.hall(seed=2, client=client)
    arm = client.getNumJoints(world.robot) - 2
    client.resetJointState(world.robot, arm, 0.7)
    chosen = "name IN ['YouBot', 'table_1', 'shelf_2', 'crate_1', 'sensor_3', 'target', 'barrel_1']"
    wanted = ask(world, f"SELECT {COLUMNS} FROM space WHERE {chosen} ORDER BY name AS rows;")
    assert len(wanted) == 7
    links = "SELECT pos, quat, mass, friction FROM space.links WHERE body == robot AND number < 9 AS rows;"
    joints = "SELECT type, position FROM space.joints WHERE body == robot AS rows;"
    with ask(world, f"SELECT obj FROM space WHERE {chosen} AS environment;") as copy:
        assert close_to(ask(copy, f"SELECT {COLUMNS} FROM space ORDER BY name AS rows;"), wanted)
        robot = copy.body("YouBot")
        for script in (links, joints):
            assert close_to(ask(copy, script, robot=robot), ask(world, script, robot=world.robot)), script
        assert copy.sensors[copy.body("sensor_3")] == world.sensors[world.body("sensor_3")]
        grids = [
            ask(s, "SELECT obj FROM space WHERE name == 'shelf_2' AS occupancygrid(1.0, 0.05);") for s in (world, copy)
        ]
        assert np.array_equal(*grids)
        assert grids[0].any()


MODELS = (
    "r2d2.urdf", "husky/husky.urdf", "a1/a1.urdf", "aliengo/aliengo.urdf", "laikago/laikago.urdf",
    "kuka_iiwa/model.urdf", "table/table.urdf", "duck_vhacd.urdf", "cartpole.urdf",
)  # fmt: skip
FRAME = {"baseInertialFramePosition": (0.1, 0.5, 0.2), "baseInertialFrameOrientation": (0.0, 0.6, 0.0, 0.8)}
PLACED = {"collisionFramePosition": (0.1, 0.0, 0.0), "collisionFrameOrientation": (0.6, 0.0, 0.0, 0.8)}


def load_model(client: Any, name: str) -> int:
    """A body in any pose, with its joints in any position."""
    turn = client.getQuaternionFromEuler((0.2, 0.3, 0.4))
    if name.endswith("urdf"):
        client.setAdditionalSearchPath(pybullet_data.getDataPath())
        body: int = client.loadURDF(name, (1, 2, 3), turn)
    else:
        mesh = {"vertices": [(x, y, z) for x in (0, 1) for y in (0, 2) for z in (0, 3)]}
        shape = client.createCollisionShape(client.GEOM_MESH, **mesh, **(PLACED if "placed" in name else {}))
        body = client.createMultiBody(1, shape, basePosition=(1, 2, 3), baseOrientation=turn, **FRAME)
    for joint in range(client.getNumJoints(body)):
        client.resetJointState(body, joint, 0.1 * (joint % 7) - 0.3)
    client.performCollisionDetection()
    return body


def test_copies_keep_the_ends_of_joints(client: Any) -> None:
    """A copy of a copy, too: PyBullet keeps to ends that it was told, but does not tell them again."""
    load_model(client, "kuka_iiwa/model.urdf")
    script = "SELECT lower, upper, maxForce, maxVelocity FROM space.joints LIMIT 7 AS rows;"
    wanted = ask(client, script)
    assert wanted[1] == pytest.approx((-2.094, 2.094, 300, 10), abs=1e-3)
    with ask(client, "SELECT obj FROM space AS environment;") as copy:
        assert ask(copy, script) == wanted
        with ask(copy, "SELECT obj FROM space AS environment;") as second:
            assert ask(second, script) == wanted
            second.client.resetJointState(0, 1, 2.0)
            second.client.setJointMotorControl2(0, 1, second.client.VELOCITY_CONTROL, targetVelocity=1, force=300)
            second.step(240)
            assert ask(second, "SELECT angle FROM space.joints WHERE number == 1 AS value;") < 2.11
        copy.remove(0)
        assert copy.joint_ends == {}


@pytest.mark.parametrize("name", [*MODELS, "mesh", "placed mesh"])
def test_an_environment_has_every_shape_where_it_was(client: Any, name: str) -> None:
    """Boxes of links from files are a little smaller: their loader gives their shapes margins."""
    body = load_model(client, name)
    low, high = map(np.array, client.getAABB(body))
    random = np.random.default_rng(1)
    ends = random.uniform(low - 0.3, high + 0.3, (2, 300, 3)).tolist()
    with ask(client, "SELECT obj FROM space AS environment;") as copy:
        copy.client.performCollisionDetection()
        for link in range(-1, client.getNumJoints(body)):
            one, other = client.getAABB(body, link), copy.client.getAABB(copy.ids[body], link)
            loose = name.endswith("urdf") and (link >= 0 or name in ("duck_vhacd.urdf", "laikago/laikago.urdf"))
            assert np.abs(np.subtract(one, other)).max() < (4e-3 if loose else 1e-6), link
        hits, others = client.rayTestBatch(*ends), copy.client.rayTestBatch(*ends)
        assert sum(hit[0] >= 0 for hit in hits) > 5
        different = [(a, b) for a, b in zip(hits, others, strict=True) if a[:2] != b[:2] or abs(a[2] - b[2]) > 1e-3]
        assert len(different) <= 2, different  # rays along an edge


def test_an_environment_moves_by_itself(scene: Scene) -> None:
    ball = scene.add("ball", Sphere(0.1), (0.0, 0.0, 10.0), GREY, 2.0)
    scene.client.setGravity(0, 0, -10)
    scene.client.resetBaseVelocity(ball, (1.0, 0.0, 0.0))
    with ask(scene, "SELECT obj FROM space AS environment;") as copy:
        copy.step(24)
        scene.step(24)
        pos = [s.client.getBasePositionAndOrientation(b)[0] for s, b in ((scene, ball), (copy, copy.body("ball")))]
        assert pos[0] == pytest.approx(pos[1], abs=1e-9)
        copy.remove(copy.body("ball"))
        assert ask(copy, "SELECT obj FROM space AS list;") == []
        assert ask(scene, "SELECT name FROM space AS list;") == ["ball"]
    with ask(scene, "SELECT obj FROM space WHERE isBox(this) AS environment;") as copy:
        assert ask(copy, "SELECT count(this) FROM space GROUP BY 1 AS list;") == []


def test_an_environment_of_a_client_without_a_scene(scene: Scene) -> None:
    scene.add("ball", Sphere(0.5), (1.0, 2.0, 3.0), GREY, 2.0)
    with ask(scene.client, "SELECT obj FROM space AS environment;") as copy:
        assert copy.bounds == (pytest.approx((0.5, 1.5, 2.5), abs=1e-6), pytest.approx((1.5, 2.5, 3.5), abs=1e-6))
        assert scenes.render(copy, None, size=(64, 48)).shape == (48, 64, 3)


def test_a_terrain_cannot_be_copied(scene: Scene, capfd: pytest.CaptureFixture[str]) -> None:
    client = scene.client
    shape = client.createCollisionShape(
        client.GEOM_HEIGHTFIELD, meshScale=[1, 1, 1], heightfieldData=[0.0] * 16, numHeightfieldRows=4,
        numHeightfieldColumns=4,
    )  # fmt: skip
    scene.adopt(client.createMultiBody(0, shape), "hills")
    assert "cannot copy the shape of 'hills'" in refused(scene, "SELECT obj FROM space AS environment;")


# --- prolog: what is written stands in tests/cases/representations/prolog.sheet; here it is read ----------


def test_prolog_reads_any_value(ss: ss2sql.Session) -> None:
    texts = ["", "a", "A b", "it's", "\\", "\n\t", "ü€", "\x07", "[]", "\\x41\\"]
    values = [*texts, 0, -3, 1e-7, -1e300, 5e-324, 2**62, 1.5, [1, [2, []]], {"k": -1, "it's": [2.0]}]
    text = ss.run("SELECT to(this[0], v) FROM values AS prolog;", values=[[value] for value in values]).value
    read = facts(text)
    assert [[*value.items()] if isinstance(value, dict) else value for value in values] == [one[-1] for one in read]
    assert {one[0] for one in read} == {"v"}


def test_facts_may_have_the_names_of_standard_predicates(ss: ss2sql.Session) -> None:
    """Those of the standard are defined anew, by their number of arguments."""
    standard = {"length/2", "sort/2", "is/2", "write/1", "write/2", "call/1", "call/2", "atom/1", "var/1"}
    for name in ("length", "sort", "atom", "is", "write", "name", "call", "var", "op"):
        for value, given in (("this * 2", (8,)), ("True", ())):
            text = ss.run(f"SELECT to({value}, {name}) FROM [4] AS prolog;").value
            assert facts(text) == [(name, 4, *given)]
            directive = f":- redefine_system_predicate({name}({', '.join('_' * (1 + len(given)))})).\n"
            assert text.startswith(directive) == (f"{name}/{1 + len(given)}" in standard)
