"""What tests of searches by levels share: some searches, and random programs by the orders and guards of a test."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from agreement import exact, session_for
from hypothesis import given, seed
from programs import ProgramCase, programs
from programs.drawn import drawn

import ss2sql
from ss2sql.errors import Source
from ss2sql.frontend import ast
from ss2sql.frontend.parser import parse
from ss2sql.race.timing import compiled

ROADS = {1: [2, 3], 2: [1, 3, 4], 3: [2, 4, 1.0], 4: [1, 5], 5: [True, 4, 2]}
FORMS = (
    "SELECT x.this, n FROM x = near(n) WHERE x.this IN [4, 1] START WITH n = 1 CONNECT BY {} n = x.this",
    "SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY {} n = x.this STOP WITH n == 4 ORDER BY n DESC LIMIT 7",
    "SELECT x.this FROM x = near(n) START WITH n = 1, m = [1] CONNECT BY {} n = x.this, m = m + [n]"
    " STOP WITH len(m) > 4 GROUP BY n AS list",
    "SELECT x.this FROM x = (SELECT this FROM near(n) WHERE this < 5 AS list) START WITH n = 1"
    " CONNECT BY {} n = x.this AS rows",
)
BY_LENGTH = ("BREADTH FIRST", "UNIQUE", "BREADTH FIRST NO CYCLE")


def outcome(case: ProgramCase, statement: ast.Query, engine: Any, timeout: float, own: Any) -> Any:
    """The value, or the error; None where the engine refuses the search, or takes too long."""
    with session_for(case, session=own) as ss, contextlib.redirect_stdout(io.StringIO()):
        try:
            return exact(compiled(ss, statement, engine).run(timeout=timeout).value)
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


def kept(query: ast.Query, *keywords: str) -> tuple[ast.Option, ...]:
    """The options with these keywords."""
    return tuple(option for option in query.options if option.keyword in keywords)


def by_length(query: ast.Query) -> list[ast.Query]:
    """A search by every strategy that goes by length."""
    return [replace(query, options=(*kept(query, "MAXIMUM"), *options(words))) for words in BY_LENGTH]


def compare_random(
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
