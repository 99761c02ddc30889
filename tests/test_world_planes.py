"""AS plane, and what it has in common with the other representations of worlds."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pybullet")

from little_scenes import GREY, ask, refused
from little_scenes import fixture_scene as fixture_scene

import ss2sql
from ss2sql import scenes
from ss2sql.runtime.representations.grid import Grid
from ss2sql.runtime.representations.plane import blurred
from ss2sql.scenes.scene import Scene
from ss2sql.scenes.solids import Box, Sphere

# --- plane ---------------------------------------------------------------------------------------------

POINTS = [[[0.05, 0.05, 3.0], 2.0], [[0.06, 0.01, 9.0], 3.0], [[0.95, 0.15, -1.0], 5.0], [[7.0, 0.0, 0.0], 100.0]]
LISTS = "SELECT this[0], this[1] FROM points AS plane"


def lists(ss: ss2sql.Session, arguments: str, engine: Any) -> Any:
    return ss.run(f"{LISTS}({arguments});", engine=engine, points=POINTS).value


def test_a_plane_adds_up_what_lies_in_each_cell(engine: Any) -> None:
    ss = ss2sql.connect()
    grid = lists(ss, "'XY', [0, 0], [10, 4, 0.1]", engine)
    wanted = np.zeros((4, 10))
    wanted[0, 0] = 5.0  # two of them in the first cell
    wanted[1, 9] = 5.0  # rows are the second axis; what lies at x = 7 is outside
    assert isinstance(grid, Grid)
    assert np.array_equal(grid, wanted)
    assert grid.origin == (0.0, 0.0)
    assert grid.cell == 0.1
    assert grid.extent == pytest.approx((0.0, 1.0, 0.0, 0.4))
    assert grid.index(0.95, 0.15) == (1, 9)
    assert grid.index(7.0, 0.0) is None
    xs, ys = grid.centres()
    assert (xs[9], ys[1]) == pytest.approx((0.95, 0.15))


@pytest.mark.parametrize(("plane", "row"), [("XY", 0), ("xz", 3), ("YZ", 3)])
def test_planes(plane: str, row: int, engine: Any) -> None:
    with ss2sql.connect() as ss:
        grid = ss.run(
            f"SELECT this, 1 FROM [[0.5, 0.7, 3.5]] AS plane('{plane}', [0, 0], [1, 4, 1.0]);", engine=engine
        ).value
    assert np.flatnonzero(grid).tolist() == [row]


def test_the_sum_of_a_plane_is_that_of_the_values(client: Any, engine: Any) -> None:
    world = scenes.chaos(seed=4, bodies=40, client=client)
    masses = [client.getDynamicsInfo(body, -1)[0] for body in world.names]
    for plane in ("XY", "XZ", "YZ"):
        script = f"SELECT mass FROM space WHERE hasBody(this) AS plane('{plane}', [-5, -5], [100, 100, 0.1]);"
        assert ask(world, script, engine).sum() == pytest.approx(sum(masses))


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
        assert grid == pytest.approx(blurred(plain, 3))


def test_the_place_is_a_list_an_element_or_that_of_the_source(scene: Scene, engine: Any) -> None:
    scene.add("ball", Sphere(0.1), (1.5, 2.5, 0.0), GREY, 7.0)
    for columns in ("mass", "pos, mass", "obj, mass", "name, this, mass", "position(this), mass"):
        grid = ask(scene, f"SELECT {columns} FROM space AS plane('XY', [0, 0], [4, 4, 1]);", engine)
        assert grid[2, 1] == grid.sum() == 7.0
    moved = ask(scene, "SELECT pos + [], mass FROM space AS plane('XZ', [0, 0], [4, 4, 1]);", engine)
    assert moved[0, 1] == 7.0


def test_the_columns_that_a_representation_asks_for_stay_hidden(scene: Scene, engine: Any) -> None:
    scene.add("ball", Sphere(0.1), (1.5, 2.5, 0.0), GREY, 7.0)
    with ss2sql.connect() as ss:
        ss.attach("space", scene)
        result = ss.run("SELECT mass FROM space AS plane('XY', [0, 0], [4, 4, 1]);", engine=engine)
        assert result.columns == ("mass",)
        assert list(result) == [(7.0,)]


def test_a_blur_is_a_gaussian(engine: Any) -> None:
    with ss2sql.connect() as ss:
        grid = ss.run("SELECT this, 8 FROM [[10.5, 20.5]] AS plane('XY', [0, 0], [30, 40, 1], 2);", engine=engine).value
    assert grid.sum() == pytest.approx(8.0)  # the borders are more than 3 x 2 cells away
    assert np.unravel_index(grid.argmax(), grid.shape) == (20, 10)
    for x, y in ((1, 0), (0, 2), (3, 4)):
        assert grid[20 + y, 10 + x] / grid[20, 10] == pytest.approx(np.exp(-(x * x + y * y) / (2 * 2**2)))
    assert grid[20 + 7, 10] == 0.0
    assert np.array_equal(blurred(np.eye(3), 0), np.eye(3))


def test_a_blur_loses_what_leaves_the_grid() -> None:
    cells = np.zeros((5, 5))
    cells[0, 0] = 1.0
    kept = np.exp(-0.5 * (np.arange(0, 4) / 1.0) ** 2).sum() / np.exp(-0.5 * (np.arange(-3, 4) / 1.0) ** 2).sum()
    assert blurred(cells, 1).sum() == pytest.approx(kept**2)
    assert blurred(np.ones((2, 2)), 9.0).shape == (2, 2)  # a kernel larger than the grid


def test_no_rows_are_a_plane_of_zeros(scene: Scene, engine: Any) -> None:
    grid = ask(scene, "SELECT mass FROM space AS plane('XY', [-1, -1], [3, 2, 0.5], 1);", engine)
    assert grid.shape == (2, 3)
    assert not grid.any()


def test_none_counts_nothing(engine: Any) -> None:
    with ss2sql.connect() as ss:
        script = "SELECT [0.5, 0.5], this FROM [None, 2, True] AS plane('XY', [0, 0], [1, 1, 1]);"
        assert ss.run(script, engine=engine).value.tolist() == [[3.0]]


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


@pytest.mark.parametrize(
    ("columns", "arguments", "words"),
    [
        ("mass", "'XW', [0, 0], [4, 4, 1]", "needs a plane XY, XZ or YZ, not 'XW'"),
        ("mass", "7, [0, 0], [4, 4, 1]", "needs a plane XY, XZ or YZ, not 7"),
        ("mass", "'XY', 5, [4, 4, 1]", "the lower corner, a list of 2 numbers, not 5"),
        ("mass", "'XY', [0, '1'], [4, 4, 1]", "the lower corner, a number, not '1'"),
        ("mass", "'XY', [0, 0], [4, 4]", "width, height and resolution, a list of 3 numbers"),
        ("mass", "'XY', [0, 0], [0.5, 4, 0.1]", "0.5 m are 5 cells of 0.1 m"),
        ("mass", "'XY', [0, 0], [4, 4, 0]", "the edge of a cell, a number above 0, not 0"),
        ("mass", "'XY', [0, 0], [4, 4, 1], -1", "a blur of at least 0 cells"),
        ("mass", "'XY', [0, 0], [9999, 9999, 1]", "9999 x 9999 cells"),
        ("mass", "'XY', [0, 0]", "AS plane(plane, start, size, [blur])"),
        ("name", "'XY', [0, 0], [4, 4, 1]", "cannot add up 'ball', the 'name' of row 1"),
        ("velocity", "'XY', [0, 0], [4, 4, 1]", "cannot add up [0.0, 0.0, 0.0]"),
        ("[1], mass", "'XY', [0, 0], [4, 4, 1]", "needs a place [x, y] or [x, y, z] in row 1, not [1]"),
        ("position(this), mass", "'XZ', [0, 0], [4, 4, 1]", "needs a place [x, y, z] in row 1"),
    ],
)
def test_wrong_planes(scene: Scene, columns: str, arguments: str, words: str) -> None:
    scene.add("ball", Sphere(0.1), (0.5, 0.5, 0.0), GREY, 7.0)
    assert words in refused(scene, f"SELECT {columns} FROM space AS plane({arguments});")


def test_rows_that_are_nowhere() -> None:
    with ss2sql.connect() as ss, pytest.raises(ss2sql.RepresentationError, match="does not know where row 1 is"):
        ss.run("SELECT this FROM [1, 2] AS plane('XY', [0, 0], [1, 1, 1]);")


def test_grids_can_be_pickled_and_lose_their_place_when_they_are_cut() -> None:
    grid = Grid(np.arange(6.0).reshape(2, 3), (1, 2), 0.5)
    again = pickle.loads(pickle.dumps(grid))
    assert np.array_equal(again, grid)
    assert (again.origin, again.cell) == ((1.0, 2.0), 0.5)
    assert not hasattr(grid[1:], "origin")
    assert not hasattr(grid * 2, "origin")
    assert grid.sum() == 15.0


def test_the_columns_stay_hidden_when_a_run_is_cut_off(scene: Scene, engine: Any) -> None:
    scene.add("ball", Sphere(0.1), (1.5, 2.5, 0.0), GREY, 7.0)
    script = "SELECT a.mass FROM a = space, b = range(9999), c = range(9999) AS plane('XY', [0, 0], [4, 4, 1]);"
    with ss2sql.connect() as ss:
        ss.attach("space", scene)
        with pytest.raises(ss2sql.Timeout) as caught:
            ss.run(script, engine=engine, timeout=0.2)
    assert caught.value.partial is not None
    assert caught.value.partial.columns == ("mass",)
    assert set(caught.value.partial) <= {(7.0,)}
