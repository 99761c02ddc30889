"""Limits that count: the steps that searches try, and the characters that a script prints (`Limits`)."""

from __future__ import annotations

import random
from itertools import product
from typing import Any

import pytest
from command_lines import bad, call, good
from sessions import ENGINES

import ss2sql
from ss2sql.runtime.python import query_execution
from ss2sql.runtime.run.value_sizes import MIN_REMEMBERED_LIMIT

# Each ends, and its steps are counted on both engines.
SEARCHES = {
    "depth first": "SELECT n FROM [1, 2] START WITH n = 0 CONNECT BY n = n + this STOP WITH n >= 9",
    "breadth first": "SELECT n FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST n = n + this STOP WITH n >= 9",
    "unique": "SELECT n % 50 FROM range(70) WHERE n == 3 START WITH n = 0 CONNECT BY UNIQUE n = (n + this) % 50",
    "no cycle": "SELECT n FROM [1, 2, 3] START WITH n = 0 CONNECT BY NO CYCLE n = (n + this) % 5",
    "cost": "SELECT n, this FROM [3, 1, 2] START WITH n = 0 CONNECT BY COST this n = n + this STOP WITH n >= 8",
    "two lists": "SELECT n FROM a = [1, 2], b = [0, 1, 2] START WITH n = 0 CONNECT BY n = n + a.this STOP WITH n >= 5",
    "inner": "SELECT (SELECT n FROM [1, 2] START WITH n = 0 CONNECT BY n = n + this STOP WITH n >= a.this AS list) "
    "FROM a = [3, 4, 5]",
}
ENDLESS = {
    "depth first": "SELECT n FROM [1, 2] START WITH n = 0 CONNECT BY n = n + this",
    "nothing found": "SELECT n FROM [1, 2] WHERE n < 0 START WITH n = 1 CONNECT BY UNIQUE n = n + this",
    "one list, long": "SELECT n FROM range(10^6) WHERE n < 0 START WITH n = 1 CONNECT BY BREADTH FIRST n = n + this",
    "memorize": "SELECT n FROM [1, 2] WHERE n < 0 START WITH n = 1 CONNECT BY MEMORIZE n = n + this",
}


def out_of_steps(session: ss2sql.Session, script: str, **options: Any) -> ss2sql.OutOfSteps:
    with pytest.raises(ss2sql.OutOfSteps) as stopped:
        session.run(script, **options)
    return stopped.value


# A search inside of a query runs natively.
BOTH = [(engine, name) for engine in ENGINES for name in SEARCHES if (engine, name) != ("database", "inner")]
UNENDED = [(engine, name) for engine in ENGINES for name in ENDLESS if (engine, name) != ("database", "memorize")]


@pytest.mark.parametrize(("engine", "name"), BOTH)
@pytest.mark.parametrize("turns", [1, 128])
def test_whether_a_search_has_too_many_steps_is_a_matter_of_their_number(
    monkeypatch: pytest.MonkeyPatch, engine: Any, name: str, turns: int
) -> None:
    """Not of the moments at which somebody looks."""
    monkeypatch.setattr(query_execution, "MAX_TURNS", turns)
    with ss2sql.connect() as free:
        expected = free.run(SEARCHES[name], engine=engine)
    steps = expected.stats.generated
    assert steps > 10
    with ss2sql.connect(max_steps=steps) as enough:
        assert enough.run(SEARCHES[name], engine=engine).value == expected.value
    with ss2sql.connect(max_steps=steps - 1) as short:
        error = out_of_steps(short, SEARCHES[name], engine=engine)
        assert (error.code, error.partial.status) == ("T004", "steps")
        assert short.eval("1 + 1") == 2


@pytest.mark.parametrize(("engine", "name"), UNENDED)
def test_a_search_without_end_has_one(engine: Any, name: str) -> None:
    """Soon after the limit: SQLite is asked every 10,000 of its steps, the native search every 128 of its own."""
    with ss2sql.connect(max_steps=1000, timeout=60) as session:
        error = out_of_steps(session, ENDLESS[name], engine=engine)
        limit = 20_000 if engine == "database" else 1000 + 3 * 128
        assert name == "one list, long" or 1000 < error.partial.stats.generated < limit
        assert error.span is not None


def test_what_was_found_until_then_is_kept(engine: Any) -> None:
    with ss2sql.connect(max_steps=500) as session:
        partial = out_of_steps(session, ENDLESS["depth first"], engine=engine).partial
        assert partial.paths[:2] == [[(0,)], [(0,), (1,)]]


@pytest.mark.parametrize("steps", [500, 501])
def test_elements_that_were_not_tried_do_not_count(steps: int) -> None:
    """A native search takes its elements by blocks, and leaves the last one at its goal."""
    script = "SELECT this FROM l WHERE this == 500 START WITH n = 0 CONNECT BY BREADTH FIRST MAXIMUM 1 n = n + 1"
    with ss2sql.connect(max_steps=steps) as session:
        session.set("l", list(range(100_000)))
        if steps == 501:
            assert session.run(script, engine="native").paths == [[(500,)]]
        else:
            out_of_steps(session, script, engine="native")


@pytest.mark.parametrize(
    "clauses", ["src == town, town = dst", "abs(src - town) < 1, town = dst", "town = dst STOP WITH src != town"]
)
def test_elements_that_make_no_step_do_not_count(engine: Any, clauses: str) -> None:
    """Whether an index skips them or not: each state of this chain has one step."""
    with ss2sql.connect(max_steps=100) as session:
        session.set("roads", [{"src": n, "dst": n + 1} for n in range(50)])
        search = f"SELECT LAST dst FROM roads START WITH town = 0 CONNECT BY {clauses} AS list"
        result = session.run(search, engine=engine)
        assert (result.value, result.stats.generated) == (list(range(1, 51)), 50)


def test_steps_are_counted_over_all_statements_and_anew_in_each_run(engine: Any) -> None:
    search = SEARCHES["depth first"]
    with ss2sql.connect() as free:
        steps = free.run(search, engine=engine).stats.generated
    with ss2sql.connect(max_steps=2 * steps - 1) as session:
        for _ in range(3):
            session.run(search, engine=engine)
        out_of_steps(session, f"{search} AS list; {search} AS list;", engine=engine)


def test_steps_of_runs_inside_of_a_run_count(engine: Any) -> None:
    inner = "SELECT n FROM [1] START WITH n = 0 CONNECT BY n = n + this STOP WITH n == 9 AS list"  # ten steps
    outer = "SELECT inside(this) FROM range(5) AS list"
    for limit, fits in ((50, True), (49, False)):
        with ss2sql.connect(max_steps=limit) as session:
            session.function("inside", lambda x: len(session.run(inner, engine=engine).value), volatility="volatile")
            if fits:
                assert session.run(outer, engine="native").value == [9] * 5
            else:
                out_of_steps(session, outer, engine="native")


PRINTS = "SELECT print(this, 'x') FROM range(5) AS list"  # "0 x\n" and four more: 20 characters


@pytest.mark.parametrize("engine", ["auto", "native"])
def test_output_is_bounded(capsys: pytest.CaptureFixture[str], engine: Any) -> None:
    with ss2sql.connect(max_output=20) as session:
        for _ in range(2):  # it is counted anew in each run
            assert session.run(PRINTS, engine=engine).value == ["x"] * 5
    assert capsys.readouterr().out == "".join(f"{n} x\n" for n in range(5)) * 2
    with ss2sql.connect(max_output=19) as session:
        with pytest.raises(ss2sql.ExecutionError) as raised:
            session.run(PRINTS, engine=engine)
        assert (raised.value.code, raised.value.span and raised.value.span.text) == ("X015", "print(this, 'x')")
        assert capsys.readouterr().out == "0 x\n1 x\n2 x\n3 x\n"
        assert session.eval("print('again')") == "again"


@pytest.mark.parametrize("script", ["SELECT say(this) FROM range(9)", "eval('print(0); print(1); print(2)')"])
def test_output_of_what_runs_inside_counts(capsys: pytest.CaptureFixture[str], script: str) -> None:
    """A run inside of a run, and a text given to `eval`."""
    with ss2sql.connect(max_output=5) as session:
        session.function("say", lambda x: session.eval(f"print({x})"), volatility="volatile")
        with pytest.raises(ss2sql.ExecutionError, match="X015"):
            session.run(script)
    assert capsys.readouterr().out == "0\n1\n"


@pytest.mark.parametrize(
    ("name", "value"),
    [*product(("max_steps", "max_output"), (-1, 1.5, "10", True)),
     *product(("max_size",), (MIN_REMEMBERED_LIMIT - 1, 10**9 + 1, None, "1"))],
)  # fmt: skip
def test_limits_are_whole_numbers(name: str, value: Any) -> None:
    with pytest.raises(ss2sql.SessionError, match=f"{name} is a whole number of at least 0, not|max_size"):
        ss2sql.connect(**{name: value})


def test_limits_on_the_command_line() -> None:
    answer = call("run", "-e", ENDLESS["depth first"], "--max-steps", "500", "--show", "1")
    assert answer.exit_code == 1
    assert answer.stdout.rstrip().endswith(", steps")  # what was found
    assert "error[T004]" in answer.stderr
    assert "or raise max_steps" in answer.stderr
    assert "2 paths" in good("run", "-e", "SELECT 1 FROM [1, 2] START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 1",
                             "--max-steps", "6")  # fmt: skip
    message = bad(1, "run", "-e", PRINTS, "--max-output", "8")
    assert "error[X015]" in message
    assert message.rstrip().endswith("or raise max_output")


# --- what is a step: nothing that a clause looks at beside ----------------------------------------------


LISTS = ["range(40)", "many", "same", "[1, 2]", "range(20)", "[2, 1]"]
VARIABLES = "many = range(40); same = [1, 2]; "


def generated(ss: ss2sql.Session, script: str, engine: Any) -> int:
    return ss.run(VARIABLES + script, engine=engine).stats.generated


def drawn(dice: random.Random) -> str:
    """A search that ends, with one to three lists right of IN."""
    sources = dice.choice(["[1, 2]", "same", "a = [1, 2], b = same", "a = same, b = same", "a = range(1, 3), b = [3]"])
    step = "this" if "a =" not in sources else "a.this * b.this"  # a source that nobody asks for may stay unread
    parts = [f"x + {step} {dice.choice(['IN', 'NOT IN'])} {dice.choice(LISTS)}" for _ in range(dice.randint(1, 3))]
    where = f" WHERE {parts.pop()}" if len(parts) > 1 else ""
    order = dice.choice(["", "BREADTH FIRST ", "UNIQUE ", "NO CYCLE ", "COST 1 "])
    stop = f"x > {dice.randint(3, 5)} OR {' OR '.join(parts)}"
    return f"SELECT {step}, x FROM {sources}{where} START WITH x = 0 CONNECT BY {order}x = x + {step} STOP WITH {stop}"


@pytest.mark.parametrize("seed", range(60))
def test_elements_of_lists_right_of_in_are_no_steps(seed: int) -> None:
    script = drawn(random.Random(seed))
    with ss2sql.connect() as ss:
        assert generated(ss, script, "database") == generated(ss, script, "native"), script
