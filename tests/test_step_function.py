"""What steps of a search give: frozen values, and what a function gives is made a value."""

from __future__ import annotations

import ast
from typing import Any

import pytest

import ss2sql
from ss2sql.runtime.python.located_code import copy_tree


def test_a_list_that_contains_itself_is_refused_at_once() -> None:
    """marshal would write it for ever."""
    endless: list[Any] = []
    endless += [endless, endless]
    for start in ("[1]", "[[1], [2]]"):
        with ss2sql.connect() as session:
            session.function("step", lambda state, move: endless, volatility="immutable")
            script = f"SELECT step(s, this) FROM [1] START WITH s = {start} CONNECT BY UNIQUE s = step(s, this);"
            with pytest.raises(ss2sql.ExecutionError, match="the function 'step'"):
                session.run(script, engine="native", timeout=20)


@pytest.mark.parametrize("given", [[1, 2**40], [1.5, 2], [True, 1], ["a"], (1, 2), 7, [[1]], {"a": [1]}, None])
def test_what_a_function_gives_is_made_a_value(given: Any) -> None:
    """Whatever START WITH has let expect."""
    with ss2sql.connect() as session:
        session.function("step", lambda state, move: given, volatility="immutable")
        script = "SELECT step(s, this) FROM [1] START WITH s = [1] CONNECT BY UNIQUE s = step(s, this) AS list;"
        value = list(given) if isinstance(given, tuple) else given
        assert repr(session.run(script, engine="native").value) == repr([[value]])
        assert repr(session.run(script, engine="database").value) == repr([[value]])


def test_what_is_no_value_is_refused_where_the_function_is_called(engine: Any) -> None:
    for start in ("[1]", "[[1]]", "1"):
        with ss2sql.connect() as session:
            session.function("step", lambda state, move: float("nan"), volatility="immutable")
            script = f"SELECT step(s, this) FROM [1] START WITH s = {start} CONNECT BY UNIQUE s = step(s, this);"
            with pytest.raises(ss2sql.ExecutionError, match=r"X004.*the function 'step' returned NaN") as caught:
                session.run(script, engine=engine)
            assert caught.value.span is not None
            assert caught.value.span.text == "step(s, this)"


def test_what_others_note_in_syntax_trees_is_no_part_of_them() -> None:
    """Who shows tracebacks notes the parents of nodes; all trees of a process share their `Load`."""
    load = ast.parse("a").body[0].value.ctx  # type: ignore[attr-defined]
    load.parent = ast.parse("b").body[0].value  # type: ignore[attr-defined]
    try:
        copy = copy_tree(ast.parse("c + 1"))
    finally:
        del load.parent
    assert ast.unparse(copy) == "c + 1"
    assert not hasattr(copy.body[0].value.left.ctx, "parent")  # type: ignore[attr-defined]
