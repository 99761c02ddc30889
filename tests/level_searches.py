"""What tests of searches by levels share: some searches, random ones, and that they end as they do natively."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from agreement import exact, session_for
from golden import FOLDER
from hypothesis import given, seed
from hypothesis import strategies as st
from programs import ProgramCase, programs
from programs.drawn import drawn
from sessions import code_of
from test_sheets import Row, load, shown, wanted

import ss2sql
from ss2sql.bench.runs import compile_raced_statement
from ss2sql.errors import Source
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse

ROADS = {1: [2, 3], 2: [1, 3, 4], 3: [2, 4, 1.0], 4: [1, 5], 5: [True, 4, 2]}
FORMS = (
    "SELECT x.this, n FROM x = near(n) WHERE x.this IN [4, 1] START WITH n = 1 CONNECT BY {} n = x.this",
    "SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY {} n = x.this STOP WITH n == 4 ORDER BY n DESC LIMIT 7",
    "SELECT x.this FROM x = near(n) START WITH n = 1, m = [1] CONNECT BY {} n = x.this, m = m + [n]"
    " STOP WITH len(m) > 4 GROUP BY n AS list",
    "SELECT x.this FROM x = (SELECT this FROM near(n) WHERE this < 5 AS list) START WITH n = 1"
    " CONNECT BY {} n = x.this AS rows",
    "SELECT n FROM moves START WITH n = 1 CONNECT BY {} n = n + 1 STOP WITH n > 2",  # reads no element
)
SHORT = "SELECT n + this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = n + this STOP WITH n > 2 AS list;"
BY_LENGTH = ("BREADTH FIRST", "UNIQUE", "BREADTH FIRST NO CYCLE")


# --- one search ----------------------------------------------------------------------------------------


def agree(ss: ss2sql.Session, script: str, **options: Any) -> ss2sql.Result:
    """The result of a search in the tables of the session's engine, which is that of the native search."""
    found = ss.run(script, **options)
    wanted = ss.run(script, **{**options, "engine": "native"})
    assert found.engine in ("duckdb", "spark")
    assert exact(found.value) == exact(wanted.value)
    assert (found.status, found.columns, list(found)) == (wanted.status, wanted.columns, list(wanted))
    return found


def ended(ss: ss2sql.Session, script: str, **options: Any) -> tuple[Any, ...]:
    """What a search comes to: its value, or its error with what it says of the place."""
    try:
        result = ss.run(script, timeout=60, **options)
        return ("value", exact(result.value), result.status)
    except ss2sql.Error as error:
        return (error.code, error.span, str(error))
    except Exception as error:
        return (type(error).__name__, str(error), *getattr(error, "__notes__", ()))


def fails_alike(ss: ss2sql.Session, script: str) -> bool:
    """Whether a search fails as it does natively. It may fail in a step of a level that the native one does not take,
    or elsewhere in the level; what it finds is the same.
    """
    found, wanted = ended(ss, script), ended(ss, script, engine="native")
    assert found == wanted or (found[0] != "value" and not found[0].startswith("U"))
    return found == wanted


def by_sheet(ss: ss2sql.Session, name: str) -> Iterator[tuple[Row, ss2sql.Result]]:
    """The rows of a sheet that are queries, with results by the session's engine, which has to be another database."""
    for row in load(FOLDER / f"{name}.sheet").rows:
        if row.expected.startswith("error "):
            assert f"error {code_of(ss.run, row.script)}" == row.expected, row
            continue
        result = ss.run(row.script)
        assert shown(result.value) == wanted(row), row
        if row.script.startswith("SELECT"):
            assert result.engine in ("duckdb", "spark"), row
            yield row, result


def may_fail(ss: ss2sql.Session, options: str, bad: int, least: int = 4) -> str:
    """A search by roads between four places, whose goals are those from `least` on, and which fails at some steps."""

    def fail(n: int, level: int) -> bool:
        if (n * 3 + level) % 7 == bad:
            raise ValueError(n)
        return n >= least

    ss.function("fail", fail, volatility="immutable")
    ss.set("roads", [[0], [2, 3], [1, 3, 4], [2, 4], [1, 2]])
    return (
        "SELECT x.this FROM x = roads[n] WHERE fail(x.this, level) START WITH n = 1, level = 0"
        f" CONNECT BY {options} n = x.this, level = level + 1"
    )


# --- random programs -----------------------------------------------------------------------------------


def outcome(case: ProgramCase, statement: ast.Query, engine: Any, timeout: float, own: Any) -> Any:
    """The value, or the error; None where the engine refuses the search, or takes too long."""
    with session_for(case) as ss, contextlib.redirect_stdout(io.StringIO()):
        ss.host.session = own
        try:
            return exact(compile_raced_statement(ss, statement, engine).run(timeout=timeout).value)
        except (ss2sql.UnsupportedError, ss2sql.Timeout):
            return None
        except ss2sql.Error as error:
            return error.code
        except Exception as error:
            return type(error).__name__


def options(written: str) -> tuple[ast.Option, ...]:
    """Options of CONNECT BY."""
    query = parse(Source(f"SELECT this FROM [1] START WITH n = 1 CONNECT BY {written} n = 1;")).statements[0]
    assert isinstance(query, ast.Query)
    return query.options


def search_of(script: str) -> ast.Query | None:
    """The search of a script that has nothing else."""
    statements = parse(Source(script)).statements
    query = statements[0]
    return query if len(statements) == 1 and isinstance(query, ast.Query) and query.connect else None


def bounded(query: ast.Query) -> tuple[ast.Option, ...]:
    """Its MAXIMUM."""
    return tuple(option for option in query.options if option.keyword == "MAXIMUM")


def by_length(query: ast.Query) -> list[ast.Query]:
    """A search by every strategy that goes by length."""
    return [replace(query, options=(*bounded(query), *options(words))) for words in BY_LENGTH]


def one_by_length(query: ast.Query) -> list[ast.Query]:
    """One of them, by the length of the search, so that it is the same every time; it ends."""
    made = by_length(query)
    one = made[len(query.span.text) % len(made)]
    return [one if bounded(query) else replace(one, options=(*one.options, *options("MAXIMUM 9")))]


def compare(
    variants: Callable[[ast.Query], Sequence[ast.Query]],
    engine: str,
    own: Any,
    number: int,
    examples: int,
    most: int | None = None,
) -> int:
    """Compares an engine with the native one on variants of searches of random programs, drawn by a `number`.

    It ends after so many `examples`, or after `most` that were compared; says how many were. Searches that the native
    engine does not end soon are left out, and those that the engine refuses.
    """
    compared = 0

    @seed(number)
    @drawn(examples, shrunk=False)
    @given(programs())
    def run(case: ProgramCase) -> None:
        nonlocal compared
        query = search_of(case.script)
        for statement in [] if query is None or compared == most else variants(query):
            wanted = outcome(case, statement, "native", 0.2, own)
            found = None if wanted is None else outcome(case, statement, engine, 60, own)
            if found is not None:
                compared += 1
                assert found == wanted, statement.options

    run()
    return compared


# --- random steps that can be SQL --------------------------------------------------------------------------

MOVES = [
    {"by": 1, "word": "a", "far": False},
    {"by": -2, "word": "", "far": True},
    {"by": 3, "word": "bü", "far": True},
]
STATES = {"n": "0", "t": "'x'", "b": "False", "l": "[1]"}

INTS = ("n", "m.by", "1", "-3", "7")
TEXTS = ("t", "m.word", "'x'", "''", "'äb'")

# Expressions of ints stay within bounds by a remainder.
NUMBERS = (
    *("(({} + {}) % 9)", "(({} - {}) % -7)", "(({} * {}) % 5)", "abs({} % 11)", "(-({} % 6))", "min({} % 8, {} % 8)"),
    "IF({} < {}; {} % 4; 2)",
)
TRUTHS = ("{} < {}", "{} != {}", "{} IN [1, 3, -1]", "(m.far XOR {} > 1)", "({} == 2 OR NOT {} == 3)")


def filled(form: str, inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.builds(form.format, *[inner] * form.count("{}"))


def expressions() -> st.SearchStrategy[dict[str, str]]:
    """Expressions by kind."""
    words = st.sampled_from(TEXTS)
    number = st.recursive(
        st.sampled_from(INTS),
        lambda inner: st.one_of(filled("len({})", words), *(filled(form, inner) for form in NUMBERS)),
        max_leaves=4,
    )
    text = st.one_of(filled("({} + {})[0:3]", words), filled("({} + {})[1:4]", words), words)
    truth = st.one_of(
        *(filled(form, number) for form in TRUTHS),
        *(filled(form, text) for form in ("{} == {}", "{} <= {}", "{} NOT IN {}")),
        st.sampled_from(["m.far", "b", "n", "t", "l == [1]", "NOT (b AND m.far)"]),
    )
    return st.fixed_dictionaries({"int": number, "text": text, "truth": truth, "where": truth, "stop": truth})


def script_of(parts: dict[str, str], strategy: str, shown: set[str], grouped: bool, ends: int = 2) -> str:
    """A search with these expressions, whose paths stop after so many steps and one."""
    outputs = {"n": f"({parts['int']}) % 13", "t": parts["text"], "b": f"({parts['truth']}) AND True"}
    outputs["l"] = "[m.by % 3]"
    return (
        f"SELECT {', '.join(outputs[name] for name in sorted(shown))} FROM m = moves WHERE {parts['where']} START WITH "
        + ", ".join(f"{name} = {value}" for name, value in STATES.items())
        + ", depth = 0"
        + f" CONNECT BY {strategy} MAXIMUM 40 "
        + ", ".join(f"{name} = {value}" for name, value in outputs.items())
        + f", depth = IF(depth < 9; depth + 1; 9) STOP WITH depth > {ends} OR {parts['stop']}"
        + (" GROUP BY m.by % 2" if grouped else "")
        + " AS list"
    )
