"""Results: the value, the rows behind it, paths, SQL, status and counts; and how a result is shown."""

from __future__ import annotations

import io
from typing import Any

import pytest
from listings import MOVES, move
from rich.console import Console
from sessions import both

import ss2sql
from ss2sql.runtime.paths import Paths

TREE = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1"
# A step with n == 1 stops and is no goal, so its paths have one step more: here they are goals.
GOALS = "SELECT this FROM [1, 2] WHERE n < 2 START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1"


# --- the value -----------------------------------------------------------------------------------------


@both
@pytest.mark.parametrize(
    ("clause", "value"),
    [
        ("", [{"a": 1, "b": 10.0}, {"a": 2, "b": True}]),
        ("AS dict", [{"a": 1, "b": 10.0}, {"a": 2, "b": True}]),
        ("AS list", [1, 10.0, 2, True]),
        ("AS rows", [(1, 10.0), (2, True)]),
        ("AS value", 1),
        ("AS val", 1),
        ("AS VALUE", 1),
        ("AS set", {1, 10.0, 2}),
        ("AS void", None),
        ("WHERE a > 5 AS value", None),
        ("WHERE a > 5 AS list", []),
        ("GROUP BY a AS list", {1: [1, 10.0], 2: [2, True]}),
        ("GROUP BY a > 1, 'x' AS value", {(False, "x"): 1, (True, "x"): 2}),
        ("GROUP BY [a] AS rows", {(1,): [(1, 10.0)], (2,): [(2, True)]}),
    ],
)
def test_representations(ss: ss2sql.Session, engine: Any, clause: str, value: Any) -> None:
    ss.attach("t", [{"a": 1, "b": 10.0}, {"a": 2, "b": True}])
    result = ss.run(f"SELECT a, b FROM t {clause};", engine=engine)
    assert repr(result.value) == repr(value) or (isinstance(value, set) and result.value == value)
    assert type(result.value) is type(value)


@both
@pytest.mark.parametrize(
    ("form", "path"),
    [("dict", [{"this": 1}, {"this": 2}]), ("list", [1, 2]), ("rows", [(1,), (2,)]), ("value", 1), ("set", {1, 2})],
)
def test_the_value_of_a_search_is_a_list_with_one_value_for_each_path(
    ss: ss2sql.Session, engine: Any, form: str, path: Any
) -> None:
    result = ss.run(f"{GOALS} AS {form};", engine=engine)
    assert len(result.value) == 6  # 1, 1-1, 1-2, 2, 2-1, 2-2
    assert result.value[2] == path
    assert ss.run(f"{GOALS} AS void;", engine=engine).value is None


@both
def test_groups_of_paths_see_the_last_step(ss: ss2sql.Session, engine: Any) -> None:
    result = ss.run(f"{GOALS} GROUP BY [this] AS list;", engine=engine)
    assert result.value == {(1,): [[1], [1, 1], [2, 1]], (2,): [[1, 2], [2], [2, 2]]}
    assert [len(path) for path in result.paths] == [1, 2, 2, 1, 2, 2]


@both
def test_representations_of_the_user(ss: ss2sql.Session, engine: Any) -> None:
    @ss.representation("Grid")
    def grid(table, scale, offset=0):
        assert [dict(zip(table.columns, row, strict=True)) for row in table] == table.dicts()
        return len(table), table.columns, [value * scale + offset for row in table.rows for value in row]

    assert ss.run("SELECT this FROM [1, 2] AS grid(10);", engine=engine).value == (2, ("this",), [10, 20])
    script = "SELECT this FROM [1, 2] GROUP BY this > 1 AS GRID(2 + 3, offset = 1);"
    assert ss.run(script, engine=engine).value == {False: (1, ("this",), [6]), True: (1, ("this",), [11])}
    assert ss.run(f"{TREE} AS grid(1);", engine=engine).value == [(1, ("this",), [1]), (1, ("this",), [2])]
    for script, code in (("AS grid;", "V001"), ("AS grid(1, 2, 3);", "V001"), ("AS grid(1, of = 3);", "V001"),
                         ("AS gird(1);", "R006"), ("AS list(1);", "V001")):  # fmt: skip
        with pytest.raises(ss2sql.Error) as caught:
            ss.run(f"SELECT this FROM [1] {script}", engine=engine)
        assert caught.value.code == code
        assert caught.value.span is not None


@both
def test_a_type_error_inside_of_a_representation_is_its_own(ss: ss2sql.Session, engine: Any) -> None:
    ss.representation("broken")(lambda table: 1 + "a")  # type: ignore[operator]
    with pytest.raises(TypeError, match="unsupported operand"):
        ss.run("SELECT this FROM [1] AS broken;", engine=engine)


@both
def test_what_the_user_made_goes_on_in_the_script(ss: ss2sql.Session, engine: Any) -> None:
    class Map:
        __hash__ = None  # type: ignore[assignment]

    made = Map()
    ss.representation("map")(lambda table: made)
    ss.function("is_map", lambda x: x is made)
    assert ss.run("m = SELECT this FROM [1] AS map; is_map(m);", engine=engine).value is True
    assert ss.run("m = SELECT this FROM [1] AS map;", engine=engine).value is made
    assert ss.get("m") is made


def test_a_representation_gets_values_of_its_own(ss: ss2sql.Session) -> None:
    items = [[1], [2]]
    ss.attach("items", items)

    @ss.representation("spoiled")
    def spoiled(table, extra):
        for (row,) in table:
            row.append(9)
        extra.append(9)
        return [row for (row,) in table] + [extra]

    assert ss.eval("x = [5]; SELECT this FROM items AS spoiled(x);") == [[1, 9], [2, 9], [5, 9]]
    assert (items, ss.get("x")) == ([[1], [2]], [5])


@both
def test_a_set_needs_values_with_a_hash(ss: ss2sql.Session, engine: Any) -> None:
    assert ss.run("SELECT this FROM [[1, [2]], [1.0, [2]], 'a'] AS set;", engine=engine).value == {(1, (2,)), "a"}
    ss.attach("dicts", [{"a": 1}])
    with pytest.raises(ss2sql.RepresentationError, match=r"\{'a': 1\} cannot be an element of a set") as caught:
        ss.run("SELECT this FROM dicts AS set;", engine=engine)
    assert caught.value.code == "V001"


@both
def test_the_value_is_the_callers_own(ss: ss2sql.Session, engine: Any) -> None:
    query = ss.compile("SELECT this FROM [[1], [2]] AS list;")
    first = query.run(engine=engine)
    first.value[0].append("spoiled")
    next(iter(first))[0].append("spoiled")
    assert query.run(engine=engine).value == [[1], [2]]
    assert list(first) == [([1],), ([2],)]
    search = ss.run("SELECT [this] FROM [1, 2] START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 1;", engine=engine)
    search.paths[0][0][0].append("spoiled")
    assert search.paths[0] == [([1],)]


# --- rows and paths ------------------------------------------------------------------------------------


@both
def test_rows_of_a_query(ss: ss2sql.Session, engine: Any) -> None:
    result = ss.run("SELECT this, this * 2, to(this, 'x y') FROM [1, 2.5] AS value;", engine=engine)
    assert result.value == 1
    assert result.columns == ("this", "this * 2", "x y")
    assert list(result) == [(1, 2, 1), (2.5, 5.0, 2.5)]
    assert (len(result), result.paths) == (2, [])


@both
def test_rows_of_a_search(ss: ss2sql.Session, engine: Any) -> None:
    result = ss.run(GOALS + ";", engine=engine)
    assert result.columns == ("path", "step", "this")
    assert list(result)[:5] == [(1, 1, 1), (2, 1, 1), (2, 2, 1), (3, 1, 1), (3, 2, 2)]
    assert len(result) == len(list(result)) == 10
    assert result.paths == [[(1,)], [(1,), (1,)], [(1,), (2,)], [(2,)], [(2,), (1,)], [(2,), (2,)]]


@both
def test_rows_of_groups(ss: ss2sql.Session, engine: Any) -> None:
    result = ss.run("SELECT this % 2, count(*) FROM [1, 2, 3] GROUP BY this % 2;", engine=engine)
    assert (result.columns, list(result)) == (("this % 2", "count"), [(1, 2), (0, 1)])
    partition = ss.run("SELECT this FROM [1, 2, 3] GROUP BY this % 2;", engine=engine)
    assert list(partition) == [(1,), (2,), (3,)]


@pytest.mark.parametrize("script", ["1 + 1;", "[1, 2];", "'text';", "x = None;", "len(SELECT this FROM [1, 2]);"])
def test_any_other_value_is_a_table_of_one(ss: ss2sql.Session, script: str) -> None:
    result = ss.run(script)
    assert result.columns == ("value",)
    assert list(result) == [(result.value,)]
    assert (len(result), result.paths, result.status) == (1, [], "complete")


@both
def test_an_assigned_query_has_its_rows(ss: ss2sql.Session, engine: Any) -> None:
    result = ss.run("x = SELECT this FROM [1, 2] AS list;", engine=engine)
    assert (result.value, list(result), result.engine) == ([1, 2], [(1,), (2,)], engine)


@both
def test_names_of_columns(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("t", [{"a": 1}])
    ss.function("mass", lambda row: 7)
    script = "SELECT a, t.a, a, this, t.this, mass, mass(this), a  +  1, to(a, b), 'x' FROM t;"
    names = ("a", "a_2", "a_3", "this", "t", "mass", "mass_2", "a  +  1", "b", "'x'")
    assert ss.run(script, engine=engine).columns == names
    assert ss.run("SELECT * FROM t, n = [5, 6];", engine=engine).columns == ("a", "n")
    labels = "name = 'c'; SELECT to(a, name + '1'), to(a, name + '1') FROM t;"
    assert ss.run(labels, engine="auto" if engine == "database" else engine).columns == ("c1", "c1_2")


# --- status and counts ---------------------------------------------------------------------------------


@both
def test_the_status_says_whether_maximum_ended_the_search(ss: ss2sql.Session, engine: Any) -> None:
    assert ss.run(GOALS + ";", engine=engine).status == "complete"
    for maximum, status in ((1, "maximum"), (6, "maximum"), (7, "complete")):
        script = GOALS.replace("BY n", f"BY MAXIMUM {maximum} n") + ";"
        result = ss.run(script, engine=engine)
        assert (len(result.paths), result.status) == (min(maximum, 6), status)
        assert result.paths == ss.run(GOALS + ";", engine=engine).paths[:maximum]
    assert ss.run("SELECT this FROM [1, 2] LIMIT 1;", engine=engine).status == "complete"


HANOI = """SELECT this{columns} FROM moves WHERE [[], [], [3, 2, 1]] == move(this, tower)
START WITH tower = [[3, 2, 1], [], []], level = 1
CONNECT BY {option} tower = move(this, tower), level = level + 1
STOP WITH level == {last} OR [] == move(this, tower);"""


def hanoi(ss: ss2sql.Session, engine: Any, option: str = "", columns: str = "", last: int = 7) -> ss2sql.Result:
    ss.attach("moves", MOVES)
    ss.function("move", move)
    return ss.run(HANOI.format(option=option, columns=columns, last=last), engine=engine)


def test_the_default_search_of_hanoi_generates_3462_steps(ss: ss2sql.Session) -> None:
    counts = set()
    for engine in ("database", "native"):
        result = hanoi(ss, engine)
        assert len(result.paths) == 1
        stats = result.stats
        counts.add((stats.generated, stats.expanded, stats.pruned, stats.calls["move"]))
        assert {"compile", "lower", "run"} <= set(stats.seconds)
    # Every step that goes on has six children, as has the start, and every tower is moved in six ways.
    ((generated, expanded, pruned, calls),) = counts
    assert generated == 3462 == 6 * (expanded + 1)
    assert pruned == 0
    assert calls % 6 == 0


@pytest.mark.parametrize(
    "option", ["", "BREADTH FIRST", "NO CYCLE", "UNIQUE", "DEPTH FIRST UNIQUE", "BREADTH FIRST NO CYCLE"]
)
def test_both_engines_count_the_same_in_complete_searches(ss: ss2sql.Session, option: str) -> None:
    one, other = (hanoi(ss, engine, option, ", tower", 9) for engine in ("database", "native"))
    assert one.paths == other.paths
    assert one.stats.generated == other.stats.generated == 6 * (one.stats.expanded + 1)
    assert one.stats.expanded == other.stats.expanded
    assert one.stats.pruned == other.stats.pruned
    assert one.stats.calls == other.stats.calls
    assert (one.stats.pruned > 0) == ("NO CYCLE" in option or "UNIQUE" in option)


# --- SQL -----------------------------------------------------------------------------------------------


def test_sql_holds_the_parameters_of_the_run(ss: ss2sql.Session) -> None:
    result = ss.run("x = 1; SELECT this FROM [1, 2] WHERE this == x AS list; x = 5;")
    assert [dict(text.parameters) for text in result.sql.statements] == [{}, {"p1": [1, 2], "x": 1}, {}]
    assert result.sql.parameters == {"p1": [1, 2], "x": 1}
    query = ss.compile("SELECT this FROM [1, 2] WHERE this == y AS list;")
    assert dict(query.sql.parameters) == {"p1": [1, 2]}
    assert query.run(y=2).sql.parameters == {"p1": [1, 2], "y": 2}
    assert query.sql == query.run(y=2.0).sql == str(query.sql)


def test_showing_the_sql_evaluates_nothing(ss: ss2sql.Session) -> None:
    seen: list[int] = []

    @ss.function(volatility="immutable")
    def start():
        seen.append(1)
        return 0

    script = "SELECT this FROM [1] START WITH n = start() CONNECT BY n = n + 1 STOP WITH n == start() + 1;"
    result = ss.run(script, engine="database")
    assert result.sql.parameters == {"p1": [1], "n": 0}
    calls = len(seen)
    assert calls == result.stats.calls["start"]
    assert ss.compile(script).sql == result.sql
    assert len(seen) == calls
    result = ss.run("IF(False; (SELECT this FROM [1] START WITH n = 1 / 0 CONNECT BY n = n)); 7;")
    assert result.value == 7
    assert "WITH RECURSIVE" in result.sql.statements[0]


def test_sql_says_why_there_is_none(ss: ss2sql.Session) -> None:
    result = ss.run("x = 1; SELECT this FROM [1]; SELECT eval(this) FROM ['1'];")
    assert [str(text) for text in result.sql.statements[::2]] == [
        "-- no query: x = 1",
        "-- no SQL: eval reads its text when it runs, so it runs natively",
    ]
    assert ss.run("SELECT this FROM [1];", engine="native").sql == "-- no SQL: engine='native' was asked for"
    several = ss.run("[SELECT this FROM [1] AS list, SELECT this FROM [2] AS list];").sql
    assert len(several.statements) == 2
    assert all(text.startswith("SELECT") for text in several.statements)


# --- how a result is shown -----------------------------------------------------------------------------


def shown(result: ss2sql.Result, **options: Any) -> str:
    console = Console(width=100, file=io.StringIO(), record=True, color_system=None)
    result.show(console=console, **options)
    return console.export_text()


def data_lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("│")]


def test_a_table_is_never_longer_than_twenty_rows(ss: ss2sql.Session) -> None:
    result = ss.run("SELECT this FROM range(1000);")
    assert repr(result) == shown(result).rstrip()
    assert len(data_lines(repr(result))) == 20
    assert repr(result).splitlines()[-1] == "1000 rows, the first 20 shown, database"
    assert len(data_lines(shown(result, max_rows=3))) == 3
    assert shown(result, max_rows=0).splitlines()[-1] == "1000 rows, the first 0 shown, database"
    assert len(data_lines(shown(result, max_rows=2000))) == 1000
    paths = ss.run("SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1;", maximum=30)
    assert len(data_lines(repr(paths))) == 20
    assert repr(paths).splitlines()[-1] == "30 paths, 465 rows, the first 20 paths shown, database, maximum"


@pytest.mark.parametrize(
    ("script", "caption"),
    [("SELECT this FROM [1];", "1 row, database"), ("SELECT this FROM [];", "0 rows, database"),
     ("7;", "1 row, native"),
     (TREE + ";", "2 paths, 2 rows, database"), ("SELECT eval(this) FROM ['1', '2'];", "2 rows, native")],
)  # fmt: skip
def test_captions(ss: ss2sql.Session, script: str, caption: str) -> None:
    assert repr(ss.run(script)).splitlines()[-1] == caption


def test_values_are_shown_as_they_are_written(ss: ss2sql.Session, capsys: pytest.CaptureFixture[str]) -> None:
    ss.attach("t", [["a", 1.0, True], "plain [bold]text[/bold]", "two\nlines", "\x1b[31mred", None, "x" * 5000])
    result = ss.run("SELECT to(this, 'na[b]me') FROM t;")
    result.show()
    printed = capsys.readouterr().out
    assert "\x1b[31m" not in printed
    for words in ("['a', 1.0, True]", "plain [bold]text[/bold]", r"'two\nlines'", r"'\x1b[31mred'", "None", "na[b]me"):
        assert words in printed
    assert printed.count("x") < 300
    assert result.value[5]["na[b]me"] == "x" * 5000


def test_the_partial_result_of_a_timeout_is_shown_like_any_other(ss: ss2sql.Session) -> None:
    with pytest.raises(ss2sql.Timeout) as caught:
        ss.run("SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1;", timeout=0.02)
    partial = caught.value.partial
    assert len(data_lines(repr(partial))) == 20
    assert repr(partial).endswith("the first 20 paths shown, database, timeout")
    assert partial.sql == ""


@pytest.mark.parametrize("tail", ["", "WHERE this > 1 ", "WHERE n + this == 5 "])
@pytest.mark.parametrize(
    "options", ["", "BREADTH FIRST ", "UNIQUE ", "NO CYCLE ", "COST this ", "COST this UNIQUE ", "MAXIMUM 3 "]
)
@pytest.mark.parametrize("end", ["", " ORDER BY this LIMIT 4", " GROUP BY this"])
def test_lengths_of_paths_are_known_without_the_paths(tail: str, options: str, end: str) -> None:
    search = f"START WITH n = 0 CONNECT BY {options}n = n + this STOP WITH n + this > 4"
    script = f"SELECT this, n FROM [1, 2, 3] {tail}{search}{end};"
    with ss2sql.connect() as ss:
        result = ss.run(script, engine="database")
        found = result.answer.rows.paths
        assert isinstance(found, Paths)
        assert list(found.lengths()) == list(map(len, result.paths))
        assert len(result) == sum(map(len, result.paths))


def test_rows_are_counted_without_walking_the_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    """The step that stops is none of them: 9,999 paths of 1 to 9,999 rows."""
    script = "SELECT n FROM [1] START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 10000 AS void;"
    with ss2sql.connect() as ss:
        result = ss.run(script, engine="database")
        monkeypatch.setattr(Paths, "__iter__", None)
        assert len(result) == 9_999 * 10_000 // 2
