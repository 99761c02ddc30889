"""Results: the value, the rows behind it, paths, SQL, status and counts; and how a result is shown."""

from __future__ import annotations

import ast
import copy
import html
import io
import pickle
import re
from typing import Any

import pytest
from golden import each_row
from hypothesis import given
from hypothesis import strategies as st
from programs.drawn import FEWEST, drawn
from random_values import VALUES
from rich.cells import cell_len
from rich.console import Console
from sessions import ENGINES

import ss2sql
from ss2sql.runtime.run.search_paths import SearchPaths

TREE = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1"
# A step with n == 1 stops and is no goal, so its paths have one step more: here they are goals.
GOALS = "SELECT this FROM [1, 2] WHERE n < 2 START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1"
WALK = "SELECT {} FROM [1, 2] WHERE n >= {} START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n >= {};"


@pytest.mark.parametrize("copy_result", [lambda result: pickle.loads(pickle.dumps(result)), copy.deepcopy, copy.copy])
@pytest.mark.parametrize("script", [f"{TREE};", f"{GOALS} AS list;", "SELECT this, [this] AS l FROM [1, 2];", "[1];",
                                    "SELECT this AS n, count(*) FROM [1, 1] GROUP BY n AS rows;"])  # fmt: skip
def test_copies_have_what_was_found(ss: ss2sql.Session, engine: Any, script: str, copy_result: Any) -> None:
    result = ss.run(script, engine=engine)
    copied = copy_result(result)
    for name in ("value", "columns", "paths", "status", "engine", "stats", "notes", "sql"):
        assert getattr(copied, name) == getattr(result, name), name
    assert copied.sql.parameters == result.sql.parameters
    assert list(copied) == list(result)
    assert repr(copied) == repr(result)
    assert copied.df().dtypes.equals(result.df().dtypes)
    assert "the run: complete" in str(copied.explain())


@pytest.mark.parametrize("copy_result", [lambda result: result, lambda result: pickle.loads(pickle.dumps(result))])
def test_rows_are_read_by_place_and_by_name(ss: ss2sql.Session, engine: Any, copy_result: Any) -> None:
    ss.set("xs", [{"a": 1, "b": "x"}, {"a": 2.5, "b": None}])
    result = copy_result(ss.run("SELECT a, b, [a] AS count FROM xs AS list;", engine=engine))
    assert (result[0], result[-1].a, result[1]["b"], result[0]["count"]) == ((1, "x", [1]), 2.5, None, [1])
    assert result[1:] == result.fetchall()[1:] == [(2.5, None, [2.5])]
    assert pickle.loads(pickle.dumps(result[0])).b == copy.copy(result[0])["b"] == "x"
    assert result.to_dicts() == [{"a": 1, "b": "x", "count": [1]}, {"a": 2.5, "b": None, "count": [2.5]}]
    assert result.types == ("int or float", "none or str", "list of int or float")
    with pytest.raises(AttributeError, match="no column 'c'; the columns are a, b, count"):
        _ = result[0].c
    with pytest.raises(KeyError, match="no column 'c'"):
        result[0]["c"]
    for where, number in (("a == 0", 0), ("a > 0", 2)):
        with pytest.raises(ss2sql.RepresentationError, match=f"one row, and there are {number}"):
            ss.run(f"SELECT a FROM xs WHERE {where};", engine=engine).one()
    assert ss.run("SELECT count(*) AS n FROM xs;", engine=engine).one().n == 2
    steps = ss.run(f"{GOALS};", engine=engine)
    assert steps[:3] == list(steps)[:3]
    assert steps[0].step == 1
    assert steps.types[:2] == ("int", "int")
    assert ss.run("[1];").one() == ([1],)


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
        with pytest.raises(ss2sql.Error, match=code) as caught:
            ss.run(f"SELECT this FROM [1] {script}", engine=engine)
        assert caught.value.span is not None


def test_what_the_user_made_goes_on_in_the_script(ss: ss2sql.Session, engine: Any) -> None:
    class Map:
        __hash__ = None  # type: ignore[assignment]

    made = Map()
    ss.representation("map")(lambda table: made)
    ss.function("is_map", lambda x: x is made)
    assert ss.run("m = SELECT this FROM [1] AS map; is_map(m);", engine=engine).value is True
    assert ss.run("m = SELECT this FROM [1] AS map;", engine=engine).value is ss.get("m") is made
    ss.representation("broken")(lambda table: 1 + "a")  # type: ignore[operator]
    with pytest.raises(TypeError, match="unsupported operand"):  # it is the function's own
        ss.run("SELECT this FROM [1] AS broken;", engine=engine)


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


@each_row("queries/rows-of-results", "script", "told")
def test_rows_of_a_query(ss: ss2sql.Session, engine: Any, script: str, told: str) -> None:
    value, columns, rows = ast.literal_eval(told)
    result = ss.run(script, engine=engine)
    assert (result.value, result.columns, list(result), result.engine) == (value, columns, rows, engine)
    assert (len(result), result.paths) == (len(rows), [])


@pytest.mark.parametrize("script", ["1 + 1;", "[1, 2];", "'text';", "x = None;", "len(SELECT this FROM [1, 2]);"])
def test_any_other_value_is_a_table_of_one(ss: ss2sql.Session, script: str) -> None:
    result = ss.run(script)
    assert (result.columns, list(result)) == (("value",), [(result.value,)])
    assert (len(result), result.paths, result.status) == (1, [], "complete")


def test_names_of_columns(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("t", [{"a": 1}])
    ss.function("mass", lambda row: 7)
    script = "SELECT a, t.a, a, this, t.this, mass, mass(this), a  +  1, to(a, b), 'x' FROM t;"
    names = ("a", "a_2", "a_3", "this", "t", "mass", "mass_2", "a  +  1", "b", "'x'")
    assert ss.run(script, engine=engine).columns == names
    assert ss.run("SELECT * FROM t, n = [5, 6];", engine=engine).columns == ("a", "n")
    labels = "name = 'c'; SELECT to(a, name + '1'), to(a, name + '1') FROM t;"
    assert ss.run(labels, engine="auto" if engine == "database" else engine).columns == ("c1", "c1_2")


def test_the_status_says_whether_maximum_ended_the_search(ss: ss2sql.Session, engine: Any) -> None:
    assert ss.run(GOALS + ";", engine=engine).status == "complete"
    for maximum, status in ((1, "maximum"), (6, "maximum"), (7, "complete")):
        script = GOALS.replace("BY n", f"BY MAXIMUM {maximum} n") + ";"
        result = ss.run(script, engine=engine)
        assert (len(result.paths), result.status) == (min(maximum, 6), status)
        assert result.paths == ss.run(GOALS + ";", engine=engine).paths[:maximum]
    assert ss.run("SELECT this FROM [1, 2] LIMIT 1;", engine=engine).status == "complete"


def test_sql_holds_the_parameters_of_the_run_or_says_why_there_is_none(ss: ss2sql.Session) -> None:
    result = ss.run("x = 1; SELECT this FROM [1, 2] WHERE this == x AS list; x = 5;")
    assert [dict(text.parameters) for text in result.sql.statements] == [{}, {"p1": [1, 2], "x": 1}, {}]
    assert result.sql.parameters == {"p1": [1, 2], "x": 1}
    query = ss.compile("SELECT this FROM [1, 2] WHERE this == y AS list;")
    assert dict(query.sql.parameters) == {"p1": [1, 2]}
    assert query.run(y=2).sql.parameters == {"p1": [1, 2], "y": 2}
    assert query.sql == query.run(y=2.0).sql == str(query.sql)
    result = ss.run("x = 1; SELECT this FROM [1]; SELECT eval(this) FROM ['1'];")
    assert [str(text) for text in result.sql.statements[::2]] == [
        "-- no query: x = 1",
        "-- no SQL: eval reads its text when it runs, so it runs natively",
    ]
    in_sqlite, natively = (ss.run("SELECT this FROM [1];", engine=engine).sql for engine in ENGINES)
    assert natively == in_sqlite  # which is what SQLite would run
    several = ss.run("[SELECT this FROM [1] AS list, SELECT this FROM [2] AS list];").sql
    assert len(several.statements) == 2
    assert all(text.startswith("SELECT") for text in several.statements)


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


def shown(result: ss2sql.Result, **options: Any) -> str:
    console = Console(width=100, file=io.StringIO(), record=True, color_system=None)
    result.show(console=console, **options)
    return console.export_text()


def data_lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("│")]


@pytest.mark.parametrize(
    ("script", "caption"),
    [("SELECT this FROM [1];", "1 row, native"), ("SELECT this FROM [];", "0 rows, native"),
     ("SELECT [0.5, 0.5], 3 FROM [1] AS plane('XY', [0, -1], [4, 4, 0.5]);",
      "1 row, native; a map of 4 x 4 cells from [0, -1] to [2, 1], values 0.0 to 3.0"),
     ("7;", "1 row, native"), (TREE + ";", "2 paths, 2 rows, database"),
     ("SELECT eval(this) FROM ['1', '2'];", "2 rows, native"),
     ("SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY MAXIMUM 30 n = n + 1;",
      "30 paths, 465 rows, the first 20 paths shown, database, maximum")],
)  # fmt: skip
def test_captions(ss: ss2sql.Session, script: str, caption: str) -> None:
    result = ss.run(script)
    assert repr(result).splitlines()[-1] == caption
    assert len(data_lines(repr(result))) == min(20, len(result))


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


@pytest.mark.parametrize("tail", ["", "WHERE this > 1 ", "WHERE n + this == 5 "])
@pytest.mark.parametrize(
    "options", ["", "BREADTH FIRST ", "UNIQUE ", "NO CYCLE ", "COST this ", "COST this UNIQUE ", "MAXIMUM 3 "]
)
@pytest.mark.parametrize("end", ["", " ORDER BY this LIMIT 4", " GROUP BY this"])
def test_rows_are_counted_without_the_paths(monkeypatch: pytest.MonkeyPatch, tail: str, options: str, end: str) -> None:
    search = f"START WITH n = 0 CONNECT BY {options}n = n + this STOP WITH n + this > 4"
    script = f"SELECT this, n FROM [1, 2, 3] {tail}{search}{end};"
    with ss2sql.connect() as ss:
        result = ss.run(script, engine="database")
        monkeypatch.setattr(SearchPaths, "__iter__", None)
        count = len(result)
        monkeypatch.undo()
        assert count == sum(map(len, result.paths))


@pytest.mark.drawn
@drawn(FEWEST)
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


def test_paths_are_lines_that_keep_their_ends(ss: ss2sql.Session) -> None:
    lines = data_lines(repr(ss.run(WALK.format("this", 3, 3))))
    assert [line.strip("│ ").split(" │ ")[1].strip() for line in lines[:2]] == ["1 → 1 → 1", "1 → 1 → 2"]
    assert len(lines) == 8
    assert "(1, 1) → (2, 2)" in repr(ss.run(WALK.format("this, n", 2, 2)))
    # steps that fit as rows only are rows
    result = ss.run(WALK.format("n, to(str('" + "x" * 50 + "'), s)", 3, 3), maximum=1)
    assert result.columns == ("path", "step", "n", "s")
    assert [line.split("│")[2].strip() for line in data_lines(repr(result))] == ["1", "2", "3"]
    result = ss.run("SELECT n FROM [1] WHERE n == 500 START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 500;")
    (line,) = data_lines(repr(result))
    kept = re.fullmatch(r"│ +1 │ 1 → 2 → .* → … (\d+) more … → .* → 499 → 500 *│", line)
    assert kept
    assert int(kept[1]) + line.count("→") == 500


def test_html_is_only_text(ss: ss2sql.Session) -> None:
    ss.attach("t", ["<script>alert('x')</script>", "a & b", 'quote"'])
    shown = ss.run("SELECT to(this, '<b>') FROM t;")._repr_html_()
    assert "<script>" not in shown
    assert "<b>" not in shown
    assert "mathjax_ignore" in shown  # dollars are no formula
    for value in ("<b>", "<script>alert('x')</script>", "a & b", 'quote"'):
        assert html.escape(value) in shown
    assert "1 → 1" in ss.run(WALK.format("this", 2, 2))._repr_html_()
