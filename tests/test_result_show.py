"""How results look: never too long, never too wide, paths as paths, and harmless in HTML; graphs and plots of them."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import matplotlib
import networkx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import pyplot
from random_values import VALUES
from rich.cells import cell_len

import ss2sql

matplotlib.use("Agg")


@pytest.fixture(scope="module")
def ss() -> Iterator[ss2sql.Session]:
    with ss2sql.connect() as session:
        yield session


@pytest.fixture(autouse=True)
def _no_figures() -> Iterator[None]:
    yield
    pyplot.close("all")


def data_lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("│")]


WALK = "SELECT {} FROM [1, 2] WHERE n >= {} START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n >= {};"


# --- text ----------------------------------------------------------------------------------------------


@given(rows=st.lists(st.lists(VALUES, min_size=1, max_size=30), min_size=1, max_size=25))
def test_no_table_is_long_or_wide(ss: ss2sql.Session, rows: list[list[Any]]) -> None:
    ss.attach("t", [{f"c{index}": value for index, value in enumerate(row)} for row in rows])
    result = ss.run("SELECT * FROM t;")
    lines = repr(result).splitlines()
    assert len(data_lines(repr(result))) == min(20, len(result))
    assert len(lines) == min(20, len(result)) + 5
    assert max(map(cell_len, lines)) <= 120
    assert result._repr_html_().count("<tr>") == min(20, len(result)) + 1


def test_columns_without_room_are_left_out(ss: ss2sql.Session) -> None:
    ss.attach("t", [{f"column{index}": index for index in range(40)}])
    result = ss.run("SELECT * FROM t;")
    heading = repr(result).splitlines()[1]
    shown = len(re.findall(r"column\d+", heading))
    assert "column0 " in heading
    assert "column39 " in heading
    assert f"{shown} of 40 columns shown" in repr(result)


def test_paths_are_lines(ss: ss2sql.Session) -> None:
    lines = data_lines(repr(ss.run(WALK.format("this", 3, 3))))
    assert [line.strip("│ ").split(" │ ")[1].strip() for line in lines[:2]] == ["1 → 1 → 1", "1 → 1 → 2"]
    assert len(lines) == 8
    assert "(1, 1) → (2, 2)" in repr(ss.run(WALK.format("this, n", 2, 2)))


def test_a_long_path_keeps_its_ends(ss: ss2sql.Session) -> None:
    result = ss.run("SELECT n FROM [1] WHERE n == 500 START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 500;")
    (line,) = data_lines(repr(result))
    kept = re.fullmatch(r"│ +1 │ 1 → 2 → .* → … (\d+) more … → .* → 499 → 500 *│", line)
    assert kept
    assert int(kept[1]) + line.count("→") == 500


def test_steps_that_fit_as_rows_only_are_rows(ss: ss2sql.Session) -> None:
    result = ss.run(WALK.format("n, to(str('" + "x" * 50 + "'), s)", 3, 3), maximum=1)
    assert result.columns == ("path", "step", "n", "s")
    assert [line.split("│")[2].strip() for line in data_lines(repr(result))] == ["1", "2", "3"]


def test_html_is_only_text(ss: ss2sql.Session) -> None:
    ss.attach("t", ["<script>alert('x')</script>", "a & b", 'quote"'])
    shown = ss.run("SELECT to(this, '<b>') FROM t;")._repr_html_()
    assert "<script>" not in shown
    assert "<b>" not in shown
    assert "mathjax_ignore" in shown  # dollars are no formula
    for value in ("<b>", "<script>alert('x')</script>", "a & b", 'quote"'):
        assert html.escape(value) in shown
    assert "1 → 1" in ss.run(WALK.format("this", 2, 2))._repr_html_()


# --- graphs --------------------------------------------------------------------------------------------


def test_edges_replay_the_paths(ss: ss2sql.Session) -> None:
    result = ss.run(WALK.format("this, n", 2, 4))
    graph = result.graph()
    steps = [pair for path in result.paths for pair in pairwise(path)]
    assert set(graph.edges) == set(steps)
    assert {edge: steps.count(edge) for edge in steps} == networkx.get_edge_attributes(graph, "paths")
    assert {node for node, start in graph.nodes(data="start") if start} == {path[0] for path in result.paths}
    assert {node for node, goal in graph.nodes(data="goal") if goal} == {path[-1] for path in result.paths}
    assert all(data["step"] == data["row"][1] for _, data in graph.nodes(data=True))


@pytest.mark.parametrize(
    ("values", "nodes"),
    [
        ([None], [type(None)]),
        ([[1, [2]]], [(1, (2,))]),
        ([{"a": [1]}], [frozenset({("a", (1,))})]),
        ([1, 1.0, True], [1]),
    ],
)
def test_nodes_are_values(ss: ss2sql.Session, values: list[Any], nodes: list[Any]) -> None:
    ss.attach("t", values)
    result = ss.run("SELECT this FROM t WHERE True START WITH n = 1 CONNECT BY n = n STOP WITH True;")
    assert list(result.graph()) == nodes


def test_objects_without_a_hash_are_nodes_that_show_their_text(ss: ss2sql.Session) -> None:
    class Box:
        __hash__ = None  # type: ignore[assignment]

        def __repr__(self) -> str:
            return "a box"

    boxes = [Box(), Box()]
    ss.attach("t", boxes)
    result = ss.run("SELECT this FROM t WHERE True START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 2;")
    graph = result.graph()
    assert list(map(str, graph)) == ["a box", "a box"]
    assert [graph.nodes[node]["row"] for node in graph] == [(boxes[0],), (boxes[1],)]
    assert sorted(paths for _, _, paths in graph.edges(data="paths")) == [1, 1, 1, 1]


def test_a_graph_needs_a_search(ss: ss2sql.Session) -> None:
    with pytest.raises(ss2sql.RepresentationError, match="V001"):
        ss.run("SELECT this FROM [1];").graph()


# --- plots ---------------------------------------------------------------------------------------------

GRID = """SELECT [n, this] FROM [1, 2] WHERE n == 3 START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 3;"""


def test_paths_are_lines_of_a_plot(ss: ss2sql.Session) -> None:
    result = ss.run(GRID)
    ax = result.plot()
    drawn = {tuple(map(tuple, line.get_xydata().tolist())) for line in ax.lines}
    assert len(ax.lines) == 8
    assert drawn == {tuple((float(x), float(y)) for ((x, y),) in path) for path in result.paths}
    assert ax.get_title() == "8 paths of 3 steps"
    assert len(result.plot(most=3).lines) == 3
    _, own = pyplot.subplots()
    assert result.plot(own, title="mine") is own
    assert own.get_title() == "mine"
    assert len(ss.run(WALK.format("this, n", 3, 3)).plot().lines) == 8


def test_other_pictures_of_a_search(ss: ss2sql.Session) -> None:
    puzzle = ss.run(WALK.format("str(this)", 2, 3))
    assert puzzle.plot().get_title() == f"2 rows on {len(puzzle.paths)} paths"
    bars = puzzle.plot(kind="lengths").patches
    assert [bar.get_height() for bar in bars] == [4, 8]


@pytest.mark.parametrize(
    ("query", "lines", "patches", "clouds", "images"),
    [
        ("SELECT this, len(this) FROM ['a', 'bcd', 'ef'];", 0, 3, 0, 0),
        ("SELECT this, this * this FROM range(5);", 1, 0, 0, 0),
        ("SELECT this FROM [3, 1, None];", 1, 0, 0, 0),
        ("SELECT this[0], this[1] FROM [[2, 1], [1, 1]];", 0, 0, 1, 0),
        ("SELECT this FROM [[2, 1], [1, 1]];", 0, 0, 1, 0),
        ("SELECT [0.5, 0.5], this FROM [3] AS plane('XY', [0, 0], [2, 1, 1]);", 0, 0, 0, 1),
    ],
)
def test_pictures_of_flat_results(
    ss: ss2sql.Session, query: str, lines: int, patches: int, clouds: int, images: int
) -> None:
    ax = ss.run(query).plot()
    assert (len(ax.lines), len(ax.patches), len(ax.collections), len(ax.images)) == (lines, patches, clouds, images)
    assert ax.get_title()
    ax.figure.canvas.draw()


@pytest.mark.parametrize(
    ("query", "kind"),
    [("SELECT this FROM ['a'];", "auto"), ("SELECT this FROM [];", "auto"), ("7;", "heat"),
     ("SELECT this FROM [1];", "paths"),
     (WALK.format("this", 9, 3), "auto"), (WALK.format("this", 3, 3), "paths"), (GRID, "bars"), (GRID, "cake")],
)  # fmt: skip
def test_what_cannot_be_drawn(ss: ss2sql.Session, query: str, kind: str) -> None:
    with pytest.raises(ss2sql.RepresentationError) as caught:
        ss.run(query).plot(kind=kind)
    assert caught.value.code == "V001"
    assert caught.value.hints
