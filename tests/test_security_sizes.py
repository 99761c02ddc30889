"""What a script makes is bounded: how large one value is, how many rows, how much memory in all, see
runtime/run/value_sizes.py.

Each script grows what it makes at every step; without a limit it takes all memory, or the value that it gives takes for
ever to look at.
"""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import apsw
import pytest
from reference import Failure, Reference, values

import ss2sql
from ss2sql.runtime.representations import shape
from ss2sql.runtime.run import run_state
from ss2sql.runtime.run.value_sizes import CELL_SIZE, MIN_REMEMBERED_LIMIT, SMALL_LENGTH, ValueSizes
from ss2sql.session import compiled_script

STEPS = 40  # doublings

SHARED = "".join(f"{name} = [1]; " + f"{name} = [{name}, {name}]; " * STEPS for name in "lm")  # before somebody looks
# By what grows: text, lists that share their parts, and results of queries.
GROWING = {
    "text by statements": "t = 'ab'; " + "t = t + t; " * STEPS + "len(t)",
    "text of unknown kind": "t = [1, 'ab']; " + "t = [1, t[1] + t[1]]; " * STEPS + "len(t)",
    "text row by row": f"t = 'ab'; SELECT len(t = t + t) FROM range({STEPS}) AS list",
    "text in a search": "SELECT n FROM [1] WHERE len(t) < 0 START WITH t = 'ab', n = 0 "
    f"CONNECT BY t = t + t, n = n + 1 STOP WITH n == {STEPS}",
    "text in nested queries": "SELECT len(x) FROM " + "(SELECT to(x + x, x) FROM " * STEPS
    + "(SELECT to('ab' + str(this), x) FROM [1])" + ")" * STEPS,
    "text of lists": "t = 'ab'; " + "t = str([t, t]); " * STEPS + "len(t)",
    "text that is not ASCII": "t = 'é'; " + "t = t + t; " * STEPS + "len(t)",
    "lists by statements": "l = [1]; " + "l = [l, l]; " * STEPS + "len(l)",
    "lists row by row": f"l = [1]; SELECT len(l = [l, l]) FROM range({STEPS}) AS list",
    "lists in a search": "SELECT n FROM [1] WHERE n < 0 START WITH l = [1], n = 0 "
    f"CONNECT BY l = [l, l], n = n + 1 STOP WITH n == {STEPS}",
    "lists as keys": "SELECT l FROM [1] WHERE n < 0 START WITH l = [1], n = 0 "
    f"CONNECT BY UNIQUE l = [l, l], n = n + 1 STOP WITH n == {STEPS}",
    "lists in nested queries": "SELECT len(x) FROM " + "(SELECT to([x, x], x) FROM " * STEPS
    + "(SELECT to([this, 'a'], x) FROM [1])" + ")" * STEPS,
    "lists that are added": "l = [1]; " + "l = l + l; " * STEPS + "len(l)",
    "lists that are added, of lists": "l = [[1]]; " + "l = l + l; " * STEPS + "len(l)",
    "lists that are zipped": "l = [1, 2]; " + "l = zip(l, l) + zip(l, l); " * STEPS + "len(l)",
    "rows of queries": "l = [1, 2]; " + "l = (SELECT l FROM [1, 2] AS list); " * STEPS + "len(l)",
    "dicts of queries": "l = [1, 2]; " + "l = (SELECT l, to(l, m) FROM range(8)); " * 8 + "len(l)",
    "an inner query": "SELECT uniq((SELECT a.this + x.this FROM a = range(200), b = range(200) AS list)) FROM x = [1]",
    "numbers": "len(range(10 ^ 5))",
    **{f"lists that share, {form}": SHARED + form for form in (
        "print(l)", "l == m", "str(l)", "sorted([l, m])", "l IN [m]", "uniq([l, m])")},
    "numbers in turn": "SELECT len(range(10 ^ this)) FROM [1, 5] AS list",
}  # fmt: skip


@pytest.fixture(params=["auto", "native"])
def engine(request: pytest.FixtureRequest) -> Any:
    return request.param


@pytest.fixture
def small() -> Iterator[ss2sql.Session]:
    with ss2sql.connect(max_size=MIN_REMEMBERED_LIMIT, progress=False) as session:
        yield session


def refused(session: ss2sql.Session, script: str, engine: Any = "auto", **options: Any) -> str:
    """The code of the error with which the script ends; in SQLite where it may run there and nothing else is said."""
    if engine == "auto":
        with suppress(ss2sql.Error):
            session.compile(script, engine="database").statements()
            engine = "database"
    with pytest.raises(ss2sql.Error) as error:
        session.run(script, engine, **options).value  # noqa: B018 - a result is made when it is read
    assert session.eval("1 + 1") == 2
    return error.value.code


@pytest.mark.parametrize("what", GROWING)
def test_what_grows_is_refused(small: ss2sql.Session, what: str, engine: Any) -> None:
    assert refused(small, GROWING[what], engine=engine) == "X014"


@pytest.mark.parametrize("what", [name for name in GROWING if name != "an inner query"])  # which takes it seconds
def test_the_reference_refuses_it_too(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(values, "MOST", 2**14)
    with pytest.raises(Failure) as failure:
        Reference().run(GROWING[what])
    assert failure.value.code == "X014"


def test_the_result_of_a_script_is_a_value(small: ss2sql.Session, engine: Any) -> None:
    """Rows may share what is in them; their value has copies."""
    small.set("l", [0] * 10_000)
    script = "SELECT l FROM [1, 2, 3, 4] AS list"
    assert refused(small, script, engine=engine) == "X014"
    assert len(small.run(script.replace(", 4", ""), engine=engine).value) == 3


@pytest.mark.parametrize("unit", ["a", "é", "€"])
def test_a_text_has_so_many_bytes_and_no_more(small: ss2sql.Session, engine: Any, unit: str) -> None:
    most = MIN_REMEMBERED_LIMIT // len(unit.encode())
    small.set("t", unit * (most - 1))
    script = "SELECT len(t + this) FROM ['a', 'aaaaaaaa'] WHERE len(this) == {} AS value"
    assert small.run(script.format(1), engine=engine).value == most
    assert refused(small, script.format(8), engine=engine) == "X014"


def test_a_list_has_so_many_bytes_and_no_more(small: ss2sql.Session, engine: Any) -> None:
    most = MIN_REMEMBERED_LIMIT // CELL_SIZE
    small.set("l", [0] * (most - 3))
    script = "SELECT len(uniq([l, this])) FROM [1, 'a'] WHERE this == {} AS value"
    assert small.run(script.format(1), engine=engine).value == 2
    small.set("l", [0] * (most - 2))
    assert small.run(script.format(1), engine=engine).value == 2
    assert refused(small, script.format("'a'"), engine=engine) == "X014"


def test_few_values_have_room(small: ss2sql.Session, engine: Any) -> None:
    small.set("t", "a" * (MIN_REMEMBERED_LIMIT - 1))
    script = "SELECT len(uniq([t, [t, this, {}]])) FROM [1, 'a'] AS list"
    assert small.run(script.format("t, t"), engine=engine).value == [2, 2]
    assert refused(small, script.format(", ".join("t" * SMALL_LENGTH)), engine=engine) == "X014"


def test_a_value_of_python_may_be_larger(small: ss2sql.Session, engine: Any) -> None:
    small.set("l", [[0] * 1000] * 1000)
    script = "SELECT len(l), l[0][0], len(this) FROM l LIMIT 1 AS list"
    assert small.run(script, engine=engine).value == [1000, 0, 1000]
    assert refused(small, "SELECT len(uniq([l, this])) FROM [1]", engine=engine) == "X014"


@pytest.mark.parametrize(
    "more",
    [
        *("".join(f"{name}{i} = var(); " for i in range(STEPS)) for name in "mq"),
        "v{1000.0} = [1, 2]; " + "v{1000.0} = v{}; " * STEPS,
    ],
    ids=["m", "q", "temporal"],
)
def test_all_variables_together_are_a_value(small: ss2sql.Session, more: str) -> None:
    assert refused(small, "l = [1, 2]; " + more) == "X014"
    assert small.eval("var('l')") == [1, 2]


# --- depth -------------------------------------------------------------------------------------------------

LOOKS = (
    "l == m", "l", "len(str(l))", "print(l)", "sorted([l, m])", "l IN [m]", "uniq([l, m])", "l < m", "v{1.0} = l; v{}",
    "SELECT count(1) FROM [l, m] GROUP BY this", "SELECT this FROM [l, m] ORDER BY this",
)  # fmt: skip


def nested(levels: int) -> str:
    """Two lists that are nested so deep, each as `l = [[[1]]]`, and equal."""
    return f"l = [1.5]; m = [1.5]; SELECT len(l = [l]), len(m = [m]) FROM range({levels - 1}) AS void; "


def test_deep_values_are_refused_where_they_are_made(small: ss2sql.Session, engine: Any) -> None:
    assert refused(small, nested(501), engine=engine) == "X004"
    assert refused(small, "SELECT n FROM [1] WHERE n < 0 START WITH l = [1], n = 0 "
                   "CONNECT BY l = [l], n = n + 1 STOP WITH n == 3000", engine=engine) == "X004"  # fmt: skip


@pytest.mark.parametrize("look", LOOKS)
def test_deep_values_that_are_allowed_can_be_looked_at(
    tmp_path: Path, look: str, engine: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    with ss2sql.connect(tmp_path / "deep.db") as session:
        result = session.run(nested(490) + look, engine=engine)
        assert repr(result)
        assert result.value is not None


# --- rows --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["list", "dict", "rows", "set", "void"])
def test_max_rows_bounds_queries_inside_of_others(engine: Any, form: str) -> None:
    """One that takes its turn row by row is not finished first: of 10^12 rows it would never be."""
    script = "SELECT [(SELECT a.this + x.this FROM a = range(10 ^ 6), b = range(10 ^ {}) AS {})] FROM x = [1] AS void"
    with ss2sql.connect(timeout=60.0) as session:
        assert refused(session, script.format(6, form), engine=engine, max_rows=1000) == "X010"
        small = script.replace("10 ^ 6", "30").format(0, form)
        session.run(small, engine=engine, max_rows=30)
        assert refused(session, small, engine=engine, max_rows=29) == "X010"
        source = "SELECT x FROM (SELECT to(this, x) FROM range(100)) WHERE x == 7"
        assert len(session.run(source, engine=engine, max_rows=1)) == 1


def test_the_first_value_of_many_rows_is_not_the_size_of_all(small: ss2sql.Session, engine: Any) -> None:
    script = "SELECT (SELECT [this, x.this] FROM range(20000) AS value) FROM x = [1, 2] AS list"
    assert small.run(script, engine=engine).value == [[0, 1], [0, 2]]


# --- memory of a run ---------------------------------------------------------------------------------------

SEARCH = "SELECT n FROM [1, 2] WHERE n % 1000 == 0 START WITH n = 1 CONNECT BY {} n = n + this"


@pytest.mark.parametrize("engine", ["database", "native"])
@pytest.mark.parametrize("options", ["BREADTH FIRST", "UNIQUE", "COST 1"])
def test_max_memory_ends_a_run_that_grows(monkeypatch: pytest.MonkeyPatch, engine: Any, options: str) -> None:
    """Each look at the memory finds a megabyte more."""
    looks = iter(range(10**9))
    monkeypatch.setattr(run_state, "LOOK_SECONDS", 0.0)
    for module in (run_state, compiled_script):
        monkeypatch.setattr(module, "measure_memory", lambda: next(looks) * 2**20)
    with ss2sql.connect(max_memory=20 * 2**20) as session:
        with pytest.raises(ss2sql.OutOfMemory) as stopped:
            session.run(SEARCH.format(options), engine=engine)
        assert stopped.value.code == "T003"
        assert stopped.value.partial.status == "memory"
        assert session.eval("1 + 1") == 2
    assert 20 < next(looks) < 100


@pytest.mark.skipif(run_state.measure_memory() is None, reason="the system does not say how much memory a process has")
def test_memory_in_use_is_that_of_the_process() -> None:
    """Of a process that does nothing else: this one may be large, and give back something at the same time."""
    code = """if True:
        from ss2sql.runtime.run.run_state import measure_memory
        before = measure_memory()
        kept = bytearray(100_000_000)
        print(measure_memory() - before, len(kept))"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    more, kept = map(int, done.stdout.split())
    assert 90_000_000 < more < 200_000_000
    assert kept == 100_000_000


def test_a_run_inside_of_another_has_no_more_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int | None] = []
    used = iter(range(10**6, 10**9, 10**6))
    for module in (run_state, compiled_script):
        monkeypatch.setattr(module, "measure_memory", lambda: next(used))
    with ss2sql.connect(max_memory=10**9) as session:

        def inner(x: int) -> int:
            session.eval("noted(1)")
            return x

        session.function("noted", lambda x: seen.append(session.host.runs[-1].bounds.ceiling), volatility="volatile")
        session.function("inner", inner, volatility="volatile")
        session.run("noted(1); inner(1)")
    assert len(set(seen)) == 1


def test_max_memory_needs_a_system_that_knows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    from ss2sql.runtime.run import run_state

    monkeypatch.setattr(run_state, "measure_memory", lambda: None)
    with pytest.raises(ss2sql.SessionError):
        ss2sql.connect(max_memory=10**9)
    ss2sql.connect().close()


# --- no memory at all --------------------------------------------------------------------------------------


def test_where_python_has_no_memory_the_run_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(rows: Any) -> Any:
        # The frame that raises it has to be one of ss2sql, as where its code joins two texts.
        exec("raise MemoryError", {"__name__": "ss2sql.language.values"})

    search = "SELECT [n, [this]] FROM [1] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 3"
    with ss2sql.connect() as session:
        result = session.run(f"{search} AS list")  # whose paths are made when they are read
        with monkeypatch.context() as patch:
            patch.setattr(shape, "copy_for_python", full)
            assert refused(session, f"SELECT len(({search} GROUP BY n AS list)) FROM [1]", engine="native") == "T003"
            with pytest.raises(ss2sql.OutOfMemory):
                result.value  # noqa: B018
        assert result.value[0] == [[0, [1]]]


@pytest.mark.parametrize("engine", ["database", "native"])
def test_what_a_function_of_the_user_raises_stays_its_own(engine: Any) -> None:
    def greedy(x: int) -> int:
        raise MemoryError("mine")

    with ss2sql.connect() as session:
        session.function("greedy", greedy)
        with pytest.raises(MemoryError, match="mine"):
            session.run("SELECT greedy(this) FROM [1]", engine=engine)
        assert session.eval("1 + 1") == 2


def test_where_sqlite_has_no_memory_the_run_ends() -> None:
    with ss2sql.connect() as session:
        before = apsw.hard_heap_limit(apsw.memory_used() + 4_000_000)
        try:
            script = "SELECT a.this FROM a = range(3000), b = range(1000) ORDER BY a.this * b.this + b.this DESC"
            assert refused(session, script, engine="database") == "T003"
        finally:
            apsw.hard_heap_limit(before)


FULL = """
import resource, ss2sql
ss = ss2sql.connect()
ss.eval("SELECT this FROM [1, 2] ORDER BY this")
size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + 200_000_000,) * 2)
for script in ("t = 'ab'; " + "t = t + t; " * 28 + "len(t)", "[range(10 ^ 7), range(10 ^ 7)]"):
    try:
        print(ss.run(script).value)
    except ss2sql.OutOfMemory as error:
        print(error.code, ss.eval("1 + 1"))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the limit is one of Linux")
def test_a_process_with_a_limit_gets_errors_of_ss2sql() -> None:
    """What docs/security.md says of the limits of the operating system."""
    done = subprocess.run([sys.executable, "-c", FULL], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n") == ["T003 2"] * 2 + [""]


# --- one step of a run may make many values ----------------------------------------------------------------


def queries_in_each_other(depth: int) -> str:
    """A value of 3^depth rows, which takes one row of the outermost query."""
    inner = "0"
    for _ in range(depth):
        inner = f"(SELECT {inner} FROM xs)"
    return f"xs = [1, 2, 3]; SELECT 1 FROM [{inner}] AS list;"


@pytest.mark.parametrize("depth", [8, 9, 12])
def test_one_step_makes_values_that_are_too_large(engine: Any, depth: int) -> None:
    """The statement goes on after the innermost of them; what happens then must not be what the user hears of."""
    with ss2sql.connect(max_size=300_000) as session:
        assert refused(session, queries_in_each_other(depth), engine=engine) == "X014"
        assert session.run("SELECT 1 FROM [1] AS list;", engine=engine).value == [1]


def test_one_step_that_makes_many_values_is_broken_off(engine: Any) -> None:
    """It would be one of 3^20 rows. Natively they share their values, so that it is made at once, and then measured."""
    with ss2sql.connect() as session:
        code, timeout = ("X014", 60.0) if engine == "native" else ("T001", 0.2)
        assert refused(session, queries_in_each_other(20), engine=engine, timeout=timeout) == code


class Watched(run_state.Run):
    """A run that a weak reference can tell of."""

    __slots__ = ("__weakref__",)


def test_a_run_is_free_at_its_end(monkeypatch: pytest.MonkeyPatch, engine: Any) -> None:
    """With all that it holds, and without the garbage collector, which would come when more has piled up."""
    made: list[weakref.ref[Watched]] = []

    def noted(*arguments: Any, **options: Any) -> Watched:
        one = Watched(*arguments, **options)
        made.append(weakref.ref(one))
        return one

    monkeypatch.setattr(compiled_script, "Run", noted)
    with ss2sql.connect() as session:
        gc.disable()
        try:
            session.run("SELECT this FROM range(1000) AS list", engine=engine)
            assert [one() for one in made] == [None]
        finally:
            gc.enable()


def test_lists_that_were_measured_are_not_walked_again() -> None:
    """A list of a million parts in a thousand others: to walk it each time would take a thousand times as long."""
    sizes = ValueSizes()
    big = sizes.check_value([[0] * 1000] * 1000)
    unknown, size, depth = sizes._find_unknown([big, [1]])
    assert unknown == [[1]]
    assert (size, depth) == (CELL_SIZE * (1000 + 1000 * 1000), 2)
    assert sizes._measure_value([[big, big]]) == (2 * size + 2 * CELL_SIZE, 3)
