"""What the tests of the resolver share: two small tables, the errors of a script, and its plan."""

from __future__ import annotations

import pytest

import ss2sql
from ss2sql import plan

engines = pytest.mark.parametrize("engine", ["auto", "native"])


@pytest.fixture(name="ss")
def fixture_tables(ss: ss2sql.Session) -> ss2sql.Session:
    """A session with the tables t and u, which share a column."""
    ss.attach("t", [{"a": 1, "b": 2}, {"a": 3, "b": 4}])
    ss.attach("u", [{"b": 20, "c": 30}])
    return ss


def errors(ss: ss2sql.Session, script: str) -> list[tuple[str, str]]:
    """The codes of all errors of a script with the texts that they point at."""
    with pytest.raises(ss2sql.ResolveError) as caught:
        ss.run(script)
    assert caught.value is caught.value.errors[0]
    found = []
    for error in caught.value.errors:
        assert error.span is not None
        assert error.hints, error
        found.append((error.code, error.span.text))
    return found


def message(ss: ss2sql.Session, script: str) -> str:
    with pytest.raises(ss2sql.ResolveError) as caught:
        ss.run(script)
    return str(caught.value)


def query_of(ss: ss2sql.Session, script: str, number: int = -1) -> plan.Query:
    expr = ss.compile(script).plan.statements[number].expr
    if isinstance(expr, plan.Assign):
        expr = expr.value
    assert isinstance(expr, plan.Subquery)
    return expr.query
