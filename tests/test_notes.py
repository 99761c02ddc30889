"""Notes on results: why a search may have found too little, with a cure that works."""

import json
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import pytest
from click.testing import CliRunner
from golden import each_row
from sessions import write

import ss2sql
from ss2sql.cli import main
from ss2sql.shell.shell import Shell

ROADS = [["A", "B"], ["B", "C"], ["C", "D"], ["B", "A"], ["A", "C"], ["X", "D"]]
WALK = (
    'FROM roads WHERE {goal} START WITH town = "A", goal = "D" CONNECT BY {option} town = dst STOP WITH {stop} AS list'
)
COUNT = "SELECT n FROM [1, 2] WHERE n > 9 START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 3 AS list"


@pytest.fixture(scope="module")
def session() -> Iterator[ss2sql.Session]:
    with ss2sql.connect() as ss:
        ss.set("pairs", ROADS)
        ss.run("roads = SELECT to(this[0], src), to(this[1], dst) FROM pairs;")
        yield ss


def walk(columns: str, goal: str, option: str = "UNIQUE", stop: str = "src != town") -> str:
    return f"SELECT {columns} {WALK.format(goal=goal, option=option, stop=stop)}"


@pytest.mark.parametrize("engine", ["native", "auto"])
@pytest.mark.parametrize(
    "option", ["UNIQUE", "NO CYCLE", "MEMORIZE", "DEPTH FIRST UNIQUE", "COST 1 UNIQUE", "MEMORIZE 3"]
)
@pytest.mark.parametrize(
    ("columns", "goal", "stop", "clauses", "names"),
    [
        ("dst", "dst == goal", "src != town", "STOP WITH reads", "src and town"),
        ("dst, src", "dst == goal", "src != town", "STOP WITH reads", "town"),
        ("src, dst, town", "dst == goal", "src != town", "", ""),
        ("dst", "dst == goal AND src == town", "src != town", "", ""),
        ("dst", "dst == goal AND NOT town != src", "NOT (src == town) OR dst == goal", "", ""),
        ("dst", "town == goal", "src != town", "STOP WITH and WHERE read", "src and town"),
        ("dst", "town == goal AND src == town", "src != town", "WHERE reads", "town"),
        ("src", "dst == goal AND src == town", "src != town", "WHERE and CONNECT BY read", "dst"),
    ],
)
def test_state_that_rows_do_not_tell(session, engine, option, columns, goal, stop, clauses, names) -> None:
    result = session.run(walk(columns, goal, option, stop), engine=engine)
    word = next(word for word in ("UNIQUE", "NO CYCLE", "MEMORIZE") if word in option)
    if not names:
        assert result.notes == ()
        return
    (note,) = result.notes
    assert note.startswith(f"{word} compares rows, and {clauses} {names}, which SELECT does not name")
    missing = names.replace(" and ", ", ")
    assert session.run(walk(f"{columns}, {missing}", goal, option, stop), engine=engine).notes == ()  # the cure


STAMPS = ["2024-01-01", "2024-01-02"]


def make_frames() -> dict[str, object]:
    """Times in data frames of several makers, one with a zone."""
    pandas, polars, pyarrow = map(pytest.importorskip, ("pandas", "polars", "pyarrow"))
    stamps = [datetime.fromisoformat(text) for text in STAMPS]
    return {
        "pandas": pandas.DataFrame({"t": pandas.to_datetime(STAMPS), "v": [1, 2]}),
        "polars": polars.DataFrame({"t": stamps, "v": [1, 2]}),
        "arrow": pyarrow.table({"t": pyarrow.array(stamps, pyarrow.timestamp("ms", "UTC")), "v": [1, 2]}),
    }


@pytest.mark.parametrize("engine", ["native", "database"])
@pytest.mark.parametrize("maker", ["pandas", "polars", "arrow"])
@pytest.mark.parametrize(
    ("condition", "written", "value"),
    [
        ("t == '{}'", "2024-01-01 00:00:00", [1]),
        ("t <= '{}'", "2024-01-01", [1]),
        ("t < '{}'", "2024-01-01 12:00", [1]),
        ("'{}' < t", "2024-01-01 12:00", [2]),
        ("t NOT IN ['x', '{}']", "2024-01-01T00:00", [2]),
        ("t BETWEEN '{}' AND 'z'", "2024-01-01 12:00", [2]),
        ("t == when", "2024-01-01 00:00:00", [1]),
        ("a.t == '{}'", "2024-01-01T00:00:00.000", [1]),
        ("t >= '{}'", "2024-01-02", None),
        ("t < '{}'", "2024-01-02", None),
        ("t == '{}'", "noon", None),
        ("v == '{}'", "2024-01-02", None),
    ],
)
def test_times_of_frames_in_another_spelling(engine, maker, condition, written, value) -> None:
    with ss2sql.connect() as ss:
        ss.attach("f", make_frames()[maker])
        source = "a = (SELECT t, v FROM f)" if "a." in condition else "f"

        def ask(text: str) -> ss2sql.Result:
            script = f"SELECT v FROM {source} WHERE {condition.format(text)} AS list;"
            return ss.run(script, engine=engine, **({"when": text} if "when" in condition else {}))

        notes = [note for note in ask(written).notes if "is a text such as" in note]
        if value is None:
            assert notes == []
            return
        note = next(note for note in notes if repr(written) in note)
        cured = ask(note.rpartition("write ")[2].strip("'"))
        assert cured.value == value
        assert cured.notes == ()


@pytest.mark.parametrize("engine", ["native", "database"])
@pytest.mark.parametrize(
    ("query", "value"),
    [
        ("v FROM f WHERE t == when", [1]),
        ("v FROM f WHERE when != t", [2]),
        ("v FROM f WHERE t == datetime('2024-01-01')", [1]),
        ("v FROM f WHERE t IN [when]", [1]),
        ("v FROM f WHERE t NOT IN (SELECT at FROM ev)", [2]),
        ("v FROM f JOIN ev ON f.t == ev.at", [1]),
    ],
)
def test_a_text_never_equals_a_time(engine, query, value) -> None:
    with ss2sql.connect() as ss:
        ss.attach("f", make_frames()["pandas"])
        day = datetime(2024, 1, 1)
        ss.set("ev", [{"at": day}])
        given = {"when": day} if "when" in query else {}
        (note,) = ss.run(f"SELECT {query} AS list;", engine=engine, **given).notes
        cure = note.rpartition("for a time write ")[2]
        start = query.partition(" ON " if " ON " in query else " WHERE ")
        cured = ss.run(f"SELECT {start[0]}{start[1]}{cure} AS list;", engine=engine, **given)
        assert (cured.value, cured.notes) == (value, ())


def test_an_element_of_a_world_never_equals_a_text_or_number(client) -> None:
    hall = ss2sql.scenes.hall(seed=0, client=client)
    with ss2sql.connect() as ss:
        ss.attach("space", hall)
        for query, cure in (
            ("name FROM space WHERE this == 'YouBot'", "write this.name == 'YouBot'"),
            ("name FROM space WHERE obj IN ['YouBot']", "write obj.name IN ['YouBot']"),
            ("a.id FROM space.contacts WHERE 'YouBot' == a", "write 'YouBot' == a.name"),
            ("l.name FROM b = space JOIN l = space.links ON l.body == b.this", "write l.body == b.this.id"),
            ("l.name FROM l = space.links WHERE l.body == 'YouBot'", "write space.name(l.body) == 'YouBot'"),
            ("idB FROM space.contacts WHERE idA IN ['YouBot']", "write space.name(idA) IN ['YouBot']"),
            ("b.mass FROM b = space WHERE 'YouBot' == b.id", "write 'YouBot' == b.name"),
        ):
            (note,) = ss.run(f"SELECT {query} AS list;").notes
            assert note.endswith(cure)
            start = query.partition(" ON " if " ON " in query else " WHERE ")
            cured = ss.run(f"SELECT {start[0]}{start[1]}{cure.removeprefix('write ')} AS list;")
            assert cured.notes == ()
        assert ss.run("SELECT a.name FROM a = space, b = space WHERE a.this == b.obj;").notes == ()
        assert ss.eval("SELECT count(*) FROM l = space.links WHERE space.name(l.body) == 'YouBot' AS value;") > 1


@pytest.mark.parametrize("engine", ["native", "auto"])
@each_row("search/bounds", "script", "told")
def test_bounds_that_end_every_path(session, engine, script, told) -> None:
    begins = [] if told == "no note" else told.split(" | ")
    notes = session.run(script, engine=engine).notes
    assert len(notes) == len(begins)
    assert all(map(str.startswith, notes, begins)), notes


def test_notes_of_queries_in_other_places(session) -> None:
    inner = walk("dst", "dst == goal")
    for script in (f"x = {inner}; 1;", f"len({inner});", f"SELECT ({inner}) FROM [1] AS list"):
        assert len(session.run(script).notes) == 1
    assert session.run("1;").notes == ()
    query = session.compile(inner)
    assert query.run().notes == query.run().notes != ()


def test_notes_in_explanations(session) -> None:
    unknown = walk("dst", "dst == goal")
    for script in (unknown, COUNT):
        result = session.run(script)
        assert result.explain().as_dict()["run"]["notes"] == list(result.notes)
        assert result.notes[0] in str(result.explain())
    (statement,) = session.compile(unknown).explain().as_dict()["statements"]
    assert statement["queries"][0]["warnings"] == list(session.run(unknown).notes)


def test_where_notes_are_shown(session, capsys) -> None:
    result = session.run(COUNT)
    (note,) = result.notes
    assert f"note: {note}" in " ".join(repr(result).split())
    result.show()
    assert f"note: {note}" in " ".join(capsys.readouterr().out.split())
    assert f"note: {note}</small>" in result._repr_html_()


@pytest.mark.parametrize("form", ["table", "json", "csv"])
def test_notes_on_the_command_line(form: str) -> None:
    done = CliRunner().invoke(main, ["run", "-e", COUNT, "--format", form])
    assert done.exit_code == 0
    assert done.stderr.startswith("note: nothing was found before STOP WITH n == 3")
    assert "note" not in done.stdout
    done = CliRunner().invoke(main, ["run", "-e", COUNT, "--error-format", "json"])
    assert json.loads(done.stderr)["message"].startswith("nothing was found")


def test_notes_in_the_shell(session, capsys) -> None:
    shell = Shell(session)
    assert shell.run_text(f"{COUNT}; y = {COUNT};")
    assert capsys.readouterr().err.count("note: nothing was found before STOP WITH n == 3") == 2


def test_a_key_needs_no_note_and_a_condition_that_asks_for_the_step_before_may_need_a_beginning() -> None:
    with ss2sql.connect() as ss:
        ss.set("staff", [{"id": 1, "boss": 0}, {"id": 2, "boss": 1}])
        asked = ss.run("SELECT id FROM staff CONNECT BY PRIOR id == boss")
        assert asked.value == []
        assert [note.partition(",")[0] for note in asked.notes] == ["in first steps prior(id) is None"]
        begun = ss.run("SELECT LAST id FROM staff START WITH boss == 0 CONNECT BY PRIOR id == boss AS list")
        assert (begun.value, begun.notes) == ([1, 2], ())
        row = "SELECT id FROM staff START WITH n = 0, m = 0 CONNECT BY UNIQUE{}, boss == n, n = id, m = n + m"
        assert "UNIQUE compares rows" in ss.run(row.format("")).notes[0]
        assert ss.run(row.format(" BY (n, m)")).notes == ()


FAR = {"A": 7, "B": 5, "C": 7, "D": 0}
PAID = [["A", "B", 4], ["A", "C", 1], ["C", "B", 2], ["B", "D", 5], ["C", "D", 8]]


@pytest.mark.parametrize("option", ["", "UNIQUE", "NO CYCLE", "UNIQUE BY town", "MAXIMUM 1"])
def test_an_estimate_above_the_real_cost(session, engine, option) -> None:
    session.set("paid", PAID)
    script = (
        f"SELECT this[1] FROM paid WHERE this[1] == 'D' START WITH town = 'A' CONNECT BY {option}, COST this[2] "
        "HEURISTIC far[this[1]], this[0] == town, town = this[1] STOP WITH this[1] == 'D' AS list"
    ).replace("BY ,", "BY")
    right = session.run(script, engine=engine, far=FAR)
    wrong = session.run(script, engine=engine, far=FAR | {"C": 7.5})
    assert right.value[0] == wrong.value[0] == ["C", "B", "D"]
    assert right.notes == ()
    assert wrong.notes[0].startswith("HEURISTIC far[this[1]] was more than what remained")
    assert "note: HEURISTIC" in str(wrong)


@pytest.mark.parametrize("option", ["UNIQUE", "UNIQUE BY town"])
def test_a_cheaper_path_to_a_goal_that_was_given_out(session, engine, option) -> None:
    """UNIQUE gives D once, by A-D for 9; the search goes on and meets A-B-D for 7."""
    session.set("paid", [["A", "B", 3], ["B", "D", 4], ["A", "D", 9]])
    script = (
        f"SELECT LAST this[1] FROM paid WHERE this[1] == 'D' START WITH town = 'A' CONNECT BY COST this[2] "
        f"HEURISTIC far[this[1]] {option}, this[0] == town, town = this[1] AS list"
    )
    result = session.run(script, engine=engine, far=FAR | {"B": 50})
    assert result.value == ["D"]
    assert result.notes[0].startswith("HEURISTIC far[this[1]] was more than what remained")


@pytest.mark.parametrize(
    "query",
    ['SELECT "src" FROM roads', 'SELECT dst FROM roads WHERE "src" == \'A\'',
     'SELECT max("dst") FROM roads GROUP BY src',
     'SELECT dst FROM roads WHERE "src" BETWEEN \'A\' AND \'B\'', 'SELECT dst FROM roads WHERE "src" IN [\'A\', \'B\']',
     'SELECT count(*) FROM roads GROUP BY "src"', 'SELECT a.dst FROM a = roads JOIN b = roads ON "src" == b.dst',
     'SELECT this[0] FROM (SELECT "two words" FROM words AS rows) AS list'],
)  # fmt: skip
def test_a_column_in_quotes(session, query) -> None:
    session.set("words", [{"two words": 3}])
    (note,) = session.run(query).notes
    text, _, cure = note.partition(" is a text; for the column of this name write ")
    if " JOIN " in query:
        cure = f"a.{cure}"
    cured = session.run(query.replace(text, cure))
    assert cured.notes == ()
    assert cured.value != session.run(query).value


@pytest.mark.parametrize("name", ["roads", "order details"])
def test_a_table_in_quotes(name) -> None:
    with ss2sql.connect() as ss:
        ss.set("roads", [{"id": 7}])
        ss.host.connection.execute('CREATE TABLE "order details" (id); INSERT INTO "order details" VALUES (7)')
        (note,) = ss.run(f'SELECT * FROM "{name}"').notes
        text, _, cure = note.partition(" in FROM is a text; for the table write ")
        assert text == f"'{name}'"
        assert ss.run(f"SELECT id {cure} AS list").value == [7]
        assert ss.run("SELECT * FROM 'text'").notes == ()


@pytest.mark.parametrize("wrong", ["dst IN (src)", "dst NOT IN ( src )"])
def test_a_column_in_parentheses(session, engine, wrong) -> None:
    session.run("cities = SELECT to('Rome', src), to('Rom', dst) FROM [1]")
    query = "SELECT src FROM cities WHERE {} AS list"
    found = session.run(query.format(wrong), engine=engine)
    (note,) = found.notes
    assert note.startswith("IN (src) looks for a part of the text src")
    cured = session.run(query.format(note.partition("to compare write ")[2]), engine=engine)
    assert cured.notes == ()
    assert cured.value != found.value


@pytest.mark.parametrize(
    "query",
    ["SELECT src FROM roads WHERE dst IN src", "SELECT src FROM roads WHERE 'A' IN (src)",
     'SELECT "src" AS what, src FROM roads', "SELECT 'src', src FROM roads", 'SELECT dst FROM roads WHERE dst == "src"',
     'SELECT dst FROM roads WHERE "src" IN [dst]', 'SELECT "A", dst FROM roads', 'SELECT find("src", dst) FROM roads',
     "SELECT (SELECT i.this + src FROM i = ['a'] AS value) FROM roads",
     "SELECT (SELECT i.this FROM i = [1] WHERE this > 0 AND src == 'A' AS list) FROM roads",
     "SELECT i.this FROM i = [1] WHERE this == 1",
     *(f"SELECT dst FROM roads WHERE dst == '{goal}' START WITH town = '{start}' "
       "CONNECT BY UNIQUE BY town, src == town, town = dst" for goal, start in ("AZ", "QA"))],
)  # fmt: skip
def test_what_may_be_meant_has_no_note(session, query) -> None:
    told = " ".join(session.run(query).notes)
    assert not any(words in told for words in ("of this name", "inner query", "the state", "looks for"))


STEPS = "SELECT dst FROM roads WHERE {} START WITH town = 'B' CONNECT BY UNIQUE BY town, src == town, {} AS list"


@pytest.mark.parametrize("goal", ["town == 'D'", "'D' == town AND src != 'A'"])
def test_a_goal_that_asks_for_the_state_before_the_step(session, engine, goal) -> None:
    (note,) = session.run(STEPS.format(goal, "town = dst"), engine=engine).notes
    cure = note.partition("for that after it write ")[2]
    cured = session.run(STEPS.format(cure, "town = dst"), engine=engine)
    assert (cured.value, cured.notes) == ([["C", "D"]], ())


def test_steps_that_leave_the_state_as_it_was(session, engine) -> None:
    (note,) = session.run(STEPS.format("dst == 'D'", "town = src"), engine=engine).notes
    assert note == "town = src leaves town as it was, where src == town; assign where the step leads"


def test_this_of_an_inner_query(session, engine) -> None:
    queens = (
        "SELECT LAST path(this) FROM range(4) WHERE level() == 4 START WITH q = [] CONNECT BY this NOT IN q AND "
        "all(SELECT abs(q[i.this] - this) != len(q) - i.this FROM i = range(len(q)) AS list), q = q + [this] "
        "STOP WITH level() == 4 AS list"
    )
    found = session.run(queens, engine=engine)
    (note,) = found.notes
    assert note.startswith("this is i.this in the inner query; ")
    assert "FROM m = ..." in note
    cured = session.run(queens.replace("range(4)", "m = range(4)").replace("- this", "- m.this"), engine=engine)
    assert found.value == [[0, 1, 2, 3]]
    assert (cured.value, cured.notes) == ([[1, 3, 0, 2], [2, 0, 3, 1]], ())


@each_row("search/cures-of-timeouts", "query", "cure")
def test_a_timeout_names_what_the_search_lacks(session, query, cure) -> None:
    with pytest.raises(ss2sql.Timeout) as caught:
        session.run(f"SELECT this FROM [1, 2] WHERE n == -1 START WITH n = 0 {query}", timeout=0.2)
    assert caught.value.hints[0].startswith(f"raise the timeout, or {cure}")


def test_a_function_with_the_name_of_one_of_paths() -> None:
    with ss2sql.connect() as ss:
        ss.function("level", lambda: 7)
        result = ss.run("SELECT LAST level() FROM [1] START WITH n = 1 CONNECT BY MAXIMUM 1 n = n AS list")
    assert result.value == [7]
    assert result.notes == (
        "level is the function that was registered under this name; give it another name to ask for the path",
    )


def test_a_column_in_from_that_has_the_name_of_a_table(tmp_path: Path) -> None:
    write(
        tmp_path / "staff.db",
        "CREATE TABLE people(name, dept); INSERT INTO people VALUES ('Ann', 'x'), ('Bob', 'y');"
        "CREATE TABLE dept(code, city); INSERT INTO dept VALUES ('x', 'Rome'), ('y', 'Oslo');",
    )
    with ss2sql.connect(tmp_path / "staff.db") as ss:
        ss.attach("people_too", [{"name": "Ann", "teams": "x"}])
        ss.attach("teams", [{"code": "x"}, {"code": "y"}])
        counted = "{}SELECT (SELECT count(*) FROM {} AS value) AS n FROM {} AS list"
        for table, people, number in (("dept", "people", 2), ("teams", "people_too", 1)):
            found = ss.run(counted.format("", table, people))
            assert found.value == [1] * number
            (note,) = found.notes
            assert note.startswith(f"FROM {table} reads the column of this name; for the table write ")
            before, _, other = note.partition(" write ")[2].rpartition("FROM ")
            cured = ss.run(counted.format(before.removesuffix("before it, and "), other, people))
            assert (cured.value, cured.notes) == ([2] * number, ())
        with pytest.raises(ss2sql.Error, match=r"write FROM main\.dept"):
            ss.run("SELECT name FROM people, dept WHERE people.dept == dept.code")
        with pytest.raises(ss2sql.Error, match=r"write FROM main\.dept"):
            ss.run("SELECT name, city FROM people, dept")


def test_an_argument_that_nothing_reads_has_a_note(ss: ss2sql.Session) -> None:
    ss.set("emp", [{"sal": 1}])
    hidden = ss.run("SELECT sal FROM emp WHERE sal > sal AS list;", sal=3)
    assert hidden.notes == ("sal is the column of emp, not the argument sal=...; give that another name",)
    assert ss.run("SELECT sal FROM emp;", nope=3).notes == ("the script never reads the argument nope=...",)
    assert ss.run("SELECT sal FROM emp WHERE sal < m LIMIT n;", m=3, n=2).notes == ()
    assert ss.run("eval('k;');", k=3).notes == ()


@pytest.mark.parametrize("engine", ["native", "auto"])
@pytest.mark.parametrize("start", ["EACH town IN ['A', 'B', 'C', 'D']", "EACH o IN ['A', 'B', 'C', 'D'], town = o"])
def test_a_search_from_each_state_that_reaches_none(session, engine, start) -> None:
    script = "SELECT LAST dst FROM roads START WITH {} CONNECT BY UNIQUE BY {}, src == town, town = dst AS list"
    result = session.run(script.format(start, "town"), engine=engine)
    (note,) = result.notes
    assert result.value == []
    each, _, keys = note.rpartition("START WITH ")[2].partition(" and UNIQUE BY ")
    cured = session.run(script.format(each if "first_" in each else start, keys), engine=engine)
    assert sorted(cured.value) == sorted("BCD" + "ACD" + "D")  # the towns that can be reached from A, B and C
    assert cured.notes == ()
