"""Pictures of results, and graphs of searches: trees, paths over a map; marks that do not depend on colours."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta, timezone
from html import unescape
from io import StringIO
from itertools import pairwise
from typing import Any

import matplotlib
import networkx
import pytest
from matplotlib import pyplot
from matplotlib.dates import num2date

import ss2sql
from ss2sql.results.graph_plot import MOST_NODES, build_tree

matplotlib.use("Agg")

ROADS = [("Ulm", "Augsburg", 80), ("Ulm", "Stuttgart", 95), ("Augsburg", "Munich", 60), ("Stuttgart", "Munich", 190),
         ("Munich", "Passau", 190), ("Augsburg", "Passau", 240)]  # fmt: skip
SEARCH = """SELECT {} FROM (SELECT * FROM roads WHERE src == at) WHERE dst == 'Passau' START WITH at = 'Ulm'
CONNECT BY {} at = dst STOP WITH dst == 'Passau';"""
WALK = "SELECT {} FROM [1, 2] WHERE n >= {} START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n >= {};"
FLAT = "SELECT this FROM [1];"
GRID = "SELECT [n, this] FROM [1, 2] WHERE n == 3 START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 3;"
BINARY = "SELECT this FROM [0, 1] WHERE n == {0} START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == {0};"


@pytest.fixture(scope="module")
def ss() -> Iterator[ss2sql.Session]:
    with ss2sql.connect() as session:
        session.attach(
            "roads", [{"src": src, "dst": dst, "length": length, "p": 1 - length / 400} for src, dst, length in ROADS]
        )
        yield session


@pytest.fixture(autouse=True)
def _no_figures() -> Iterator[None]:
    yield
    pyplot.close("all")


def points(ax: Any) -> list[list[tuple[float, float]]]:
    """The lines with a name, by name."""
    named = sorted((line.get_label(), line) for line in ax.lines if not line.get_label().startswith("_"))
    return [[tuple(point) for point in line.get_xydata().tolist()] for _, line in named]


def test_paths_share_their_beginnings_in_a_tree_of_which_no_branches_cross(ss: ss2sql.Session) -> None:
    result = ss.run(BINARY.format(3))
    made, drawn = build_tree(networkx, result.paths, None)
    assert drawn == 8
    assert networkx.is_arborescence(made)
    assert len(made) == 1 + 2 + 4 + 8
    assert sum(goal for _, goal in made.nodes(data="goal")) == 8
    assert result.plot(kind="tree").get_title() == "the tree of 8 paths, 14 steps"
    result = ss.run(BINARY.format(10))  # of which as many as fit
    made, drawn = build_tree(networkx, result.paths, None)
    assert 1 < drawn < 1024
    assert len(made) <= MOST_NODES
    assert result.plot(kind="tree", most=2).get_title() == "the tree of the first 2 of 1024 paths, 11 steps"
    result = ss.run("SELECT this FROM [0] START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 4;")
    made, drawn = build_tree(networkx, result.paths, None)
    assert (len(made), drawn, [goal for _, goal in made.nodes(data="goal")]) == (4, 3, [False, True, True, True])
    result = ss.run(BINARY.format(4))
    ax = result.plot(kind="tree")
    places = ax.collections[0].get_offsets().tolist()
    assert len({tuple(place) for place in places}) == 31
    for layer in range(1, 6):
        heights = [y for x, y in places if x == layer]
        assert heights == sorted(heights, reverse=True)


def test_points_of_several_columns_stand_over_the_first(ss: ss2sql.Session) -> None:
    ss.set("samples", [{"t": 2, "a": 1, "b": 4}, {"t": 1, "a": 3, "b": None}, {"t": 3, "a": 2, "b": 5}])
    ax = ss.run("SELECT t, a, b FROM samples;").plot(kind="points")
    assert [(line.get_label(), line.get_linestyle(), list(line.get_xdata())) for line in ax.lines] == [
        ("a", "None", [2, 1, 3]), ("b", "None", [2, 1, 3]),
    ]  # fmt: skip
    assert ax.get_title() == "a, b by t"


MORNING = [datetime(2024, 1, 1, 8, minute) for minute in (0, 10, 30)]


@pytest.mark.parametrize(
    "spell",
    [lambda time: time, str, datetime.isoformat, lambda time: time.isoformat() + ".000000001",
     lambda time: f"{time.isoformat()}+00:00", lambda time: time.replace(tzinfo=timezone(timedelta(0)))],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["auto", "line", "points"])
def test_series_have_an_axis_of_time(ss: ss2sql.Session, spell: Callable[[datetime], Any], kind: str) -> None:
    ss.set("log", [{"x": x, "at": spell(time)} for x, time in enumerate(MORNING)])
    ax = ss.run("SELECT x, at FROM log;").plot(kind=kind)
    drawn = ax.collections[0].get_offsets() if kind == "points" else ax.lines[0].get_xydata()
    assert [(num2date(day).replace(tzinfo=None), x) for day, x in drawn] == list(zip(MORNING, range(3), strict=True))
    ax.figure.canvas.draw()
    assert "08:30" in [tick.get_text() for tick in ax.get_xticklabels()]
    assert ax.get_xlabel() == "at"


def test_times_that_make_no_line(ss: ss2sql.Session) -> None:
    ss.set("log", [{"at": time, "x": 1, "place": [1, 2]} for time in (MORNING[1], None, MORNING[0])])
    assert ss.run("SELECT at, x FROM log;").plot().get_title() == "2 points"
    ax = ss.run("SELECT at, place, x FROM log;").plot()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x of place", "y of place")
    assert ax.get_title() == "3 points, without x"
    assert ax.get_aspect() == 1
    labels = ss.run("SELECT at, x FROM log;").plot(kind="bars").get_yticklabels()
    assert [label.get_text() for label in labels] == ["2024-01-01T08:10:00", "None", "2024-01-01T08:00:00"]
    for select in ("at, x, x + 1", "at, place[0], str(x), x"):
        assert [line.get_linestyle() for line in ss.run(f"SELECT {select} FROM log;").plot().lines] == ["None", "None"]
    with pytest.raises(ss2sql.RepresentationError, match="as line") as caught:
        ss.run("SELECT at, x FROM log;").plot(kind="line")
    assert "ORDER BY" in caught.value.hints[0]
    ss.set("open", [{"begin": "0001-01-01", "x": 1}, {"begin": "9999-12-31", "x": 2}])
    ss.run("SELECT begin, x FROM open;").plot().figure.canvas.draw()


def test_groups_are_drawn_apart(ss: ss2sql.Session) -> None:
    rows = [("a", 1), ("b", 2), ("a", 5)]
    ss.set("log", [{"g": g, "x": x, "at": time} for (g, x), time in zip(rows, MORNING, strict=True)])
    ax = ss.run("SELECT x FROM log GROUP BY g;").plot()
    assert points(ax) == [[(1, 1), (2, 5)], [(1, 2)]]
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["a", "b"]
    assert ax.get_title() == "x by row, 2 groups"
    assert [len(line) for line in points(ss.run("SELECT at, x FROM log GROUP BY g;").plot())] == [2, 1]
    clouds = ss.run("SELECT [x, x] FROM log GROUP BY g;").plot().collections
    assert [cloud.get_offsets().tolist() for cloud in clouds] == [[[1, 1], [5, 5]], [[2, 2]]]
    for select, labels in (("x", ["a", "a", "b"]), ("str(x), x", ["a: 1", "a: 5", "b: 2"])):
        ax = ss.run(f"SELECT {select} FROM log GROUP BY g;").plot(kind="bars")
        assert [label.get_text() for label in ax.get_yticklabels()] == labels
        assert [bar.get_width() for bar in ax.patches] == [1, 5, 2]


def test_paths_over_a_map(ss: ss2sql.Session) -> None:
    ground = ss.run("SELECT [x.this, y.this], 1 FROM x = range(4), y = range(3) AS plane('XY', [0, 0], [4, 3, 1]);")
    ax = ground.plot()
    limits = ax.axis()
    walk = ss.run("SELECT [n, this] FROM [0, 1] WHERE n == 3 START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 3;")
    assert walk.plot(ax, most=3) is ax
    assert len(points(ax)) == 3
    assert (ax.axis(), ax.get_xlabel(), ax.get_ylabel()) == (limits, "x in m", "y in m")
    ax = ss.run("SELECT [0.5, 0.5, 0.5], 1 FROM [1] AS plane('yz', [0, 0], [2, 2, 1]);").plot()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("y in m", "z in m")


def test_first_and_last_steps_differ_in_more_than_colour(ss: ss2sql.Session) -> None:
    ax = ss.run(SEARCH.format("dst", "")).plot()
    nodes = ax.collections[0]
    assert len(set(nodes.get_linewidths())) == 2  # a ring around the first steps
    grey = {
        round(sum(w * c for w, c in zip((0.3, 0.59, 0.11), face[:3], strict=True)), 1)
        for face in nodes.get_facecolors()
    }
    assert len(grey) == 2  # goals are darker


def test_counts_have_no_fractions_and_texts_at_one_place_are_one(ss: ss2sql.Session) -> None:
    ax = ss.run("SELECT src, count(*) FROM roads GROUP BY src;").plot()
    ax.figure.canvas.draw()
    assert all(float(tick) == int(tick) for tick in ax.get_xticks())
    ax = ss.run("SELECT [1, this % 2], str(this) FROM range(4);").plot()
    assert sorted(text.get_text() for text in ax.texts) == ["0, 2", "1, 3"]


@pytest.mark.parametrize(
    "script",
    ["SELECT to(this, {0}), 1 FROM [{0}] AS rows;", "SELECT to(this, {0}), to(this, y) FROM [1, 2] AS rows;",
     "SELECT to(this, {0}), [this, 1], {0} FROM [1, 2] AS rows;",
     "SELECT this FROM [{0}] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n > 1;",
     "SELECT to(this, {0}), to(this, y) FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n > 1;"],
)  # fmt: skip
@pytest.mark.parametrize("text", ["$x^{$", pytest.param("from $5 to $10", marks=pytest.mark.slow)])
def test_dollars_are_no_formula(ss: ss2sql.Session, script: str, text: str) -> None:
    ax = ss.run(script.format(f'"{text}"')).plot()
    ax.figure.canvas.draw()
    with StringIO() as file:
        ax.figure.savefig(file, format="svg")
        shown = re.findall("<!-- (.*) -->", file.getvalue())
    assert unescape(text) in map(unescape, shown)


def test_edges_replay_the_paths(ss: ss2sql.Session) -> None:
    result = ss.run(WALK.format("this, n", 2, 4))
    graph = result.graph()
    steps = [pair for path in result.paths for pair in pairwise(path)]
    assert set(graph.edges) == set(steps)
    assert {edge: steps.count(edge) for edge in steps} == networkx.get_edge_attributes(graph, "paths")
    assert {node for node, start in graph.nodes(data="start") if start} == {path[0] for path in result.paths}
    assert {node for node, goal in graph.nodes(data="goal") if goal} == {path[-1] for path in result.paths}
    assert all(data["step"] == data["row"][1] for _, data in graph.nodes(data=True))


class Box:
    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return "a box"


@pytest.mark.parametrize(
    ("values", "nodes"),
    [([None], [type(None)]), ([[1, [2]]], [(1, (2,))]), ([{"a": [1]}], [frozenset({("a", (1,))})]),
     ([1, 1.0, True], [1]), ([Box(), Box()], ["a box"] * 2)],
    ids=["none", "list", "dict", "numbers", "objects"],
)  # fmt: skip
def test_nodes_are_values(ss: ss2sql.Session, values: list[Any], nodes: list[Any]) -> None:
    """Objects without a hash are nodes that show their text."""
    ss.attach("t", values)
    graph = ss.run("SELECT this FROM t WHERE True START WITH n = 1 CONNECT BY n = n STOP WITH True;").graph()
    if "a box" in nodes:
        assert [graph.nodes[node]["row"] for node in graph] == [(value,) for value in values]
    assert [str(node) if "box" in repr(node) else node for node in graph] == nodes


def test_pictures_of_a_search(ss: ss2sql.Session) -> None:
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
    puzzle = ss.run(WALK.format("str(this)", 2, 3))
    assert puzzle.plot().get_title() == f"2 rows on {len(puzzle.paths)} paths"
    bars = puzzle.plot(kind="lengths").patches
    assert [bar.get_height() for bar in bars] == [4, 8]


@pytest.mark.parametrize(
    ("query", "lines", "patches", "clouds", "images"),
    [("SELECT this, len(this) FROM ['a', 'bcd', 'ef'];", 0, 3, 0, 0),
     ("SELECT this, this * this FROM range(5);", 1, 0, 0, 0), ("SELECT this FROM [3, 1, None];", 1, 0, 0, 0),
     ("SELECT this[0], this[1] FROM [[2, 1], [1, 1]];", 0, 0, 1, 0), ("SELECT this FROM [[2, 1], [1, 1]];", 0, 0, 1, 0),
     ("SELECT [0.5, 0.5], this FROM [3] AS plane('XY', [0, 0], [2, 1, 1]);", 0, 0, 0, 1)],
)  # fmt: skip
def test_flat_pictures(ss: ss2sql.Session, query: str, lines: int, patches: int, clouds: int, images: int) -> None:
    ax = ss.run(query).plot()
    assert (len(ax.lines), len(ax.patches), len(ax.collections), len(ax.images)) == (lines, patches, clouds, images)
    assert ax.get_title()
    ax.figure.canvas.draw()


@pytest.mark.parametrize("own", [True, False])
@pytest.mark.parametrize(
    "values", [[65.24999999999999, 1 / 3] * 20, [-65.24999999999999, 3.0, 123456789.5], [7, 123456]]
)
def test_the_texts_of_bars_stay_apart_and_within_the_axes(ss: ss2sql.Session, values: list[Any], own: bool) -> None:
    rows = [{"name": f"body_{number}", "mass": value} for number, value in enumerate(values)]
    ax = ss.run("SELECT name, mass FROM rows;", rows=rows).plot(None if own else pyplot.subplots()[1])
    ax.figure.draw_without_rendering()
    assert [text.get_text() for text in ax.texts][:2] == [f"{value:.6g}" for value in values][:2]
    edge = ax.get_window_extent()
    for texts in (ax.texts, ax.get_yticklabels()):
        boxes = [text.get_window_extent() for text in texts]
        assert all(upper.y0 >= lower.y1 for upper, lower in pairwise(boxes))
        assert texts != ax.texts or all(edge.x0 <= box.x0 and box.x1 <= edge.x1 for box in boxes)
    ticks = [text.get_window_extent() for text in ax.get_xticklabels()]
    assert all(left.x1 < right.x0 for left, right in pairwise(ticks))


@pytest.mark.parametrize(
    ("query", "kind"),
    [("SELECT this FROM ['a'];", "auto"), ("SELECT this FROM [];", "auto"), ("7;", "heat"),
     *((FLAT, kind) for kind in ("paths", "graph", "tree", "lengths")),
     *((f"SELECT LAST {WALK.format('this', 9, 3)[7:]}", kind) for kind in ("paths", "graph")),
     (WALK.format("this", 9, 3), "auto"), (WALK.format("this", 3, 3), "paths"), (GRID, "bars"), (GRID, "cake")],
)  # fmt: skip
def test_what_cannot_be_drawn(ss: ss2sql.Session, query: str, kind: str) -> None:
    result = ss.run(query)
    with pytest.raises(ss2sql.RepresentationError, match="search" if query == FLAT else "V001") as caught:
        result.plot(kind=kind)
    assert caught.value.code == "V001"
    assert caught.value.hints
    if query == FLAT or "LAST" in query:
        with pytest.raises(ss2sql.RepresentationError, match="write SELECT without LAST"):
            result.graph()
