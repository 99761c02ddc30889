"""The step function of a search: inlined into its loop or called by it, with and without memory; frozen values."""

from __future__ import annotations

import ast
from typing import Any

import pytest
from listings import move

import ss2sql
from ss2sql.language.values import FrozenShapes, freeze_any, freeze_flat, freeze_nested, thaw_value
from ss2sql.runtime.python import search_compiler
from ss2sql.runtime.python.ast_builder import copy_tree

ORDERS = ["", "BREADTH FIRST", "DEPTH FIRST", "COST w", "PROBABILITY w / 4", "COST w HEURISTIC IF(dst == 2; 3; 0)"]
REPEATS = ["", "NO CYCLE", "UNIQUE", "MEMORIZE 4"]
EDGES = [
    {"src": src, "dst": dst, "w": w}
    for src, dst, w in zip(
        [0, 0, 1, 2, 2, 1, 3, 3, 0], [1, 2, 2, 0, 3, 3, 1, 3, 1], [1, 3, 1, 2, 1, 3, 0, 2, 2], strict=True
    )
]
SEARCHES = {
    "table": "SELECT dst FROM edges WHERE src == node AND dst != 1 START WITH node = 0, level = 1 CONNECT BY {}"
    " node = dst, level = level + 1 STOP WITH src != node OR level == 4",
    "lookup": "SELECT dst, w FROM (SELECT * FROM edges WHERE src == node) START WITH node = 0, level = 1 CONNECT BY {}"
    " node = dst, level = level + 1 STOP WITH level == 4 OR dst == 3",
    "two sources": "SELECT dst, twice.this FROM edges, twice = [0, 1] WHERE dst > 1 START WITH node = 0, level = 1"
    " CONNECT BY {} node = dst, level = level + 1 STOP WITH src != node OR level == 3",
    "function": "SELECT add(node, [dst]) FROM edges WHERE dst == 3 START WITH node = [0] CONNECT BY {}"
    " node = add(node, [dst]) STOP WITH len(node) > 3",
    "conditions": "SELECT dst FROM edges, twice = [1, 0] WHERE dst > 1 START WITH EACH node IN [0, 1, 0], level = 1"
    " CONNECT BY {} node = dst, level = level + 1, src == node AND level < 4 ORDER SIBLINGS BY w, twice.this",
    "last": "SELECT dst FROM edges START WITH node = 0, level = 1 CONNECT BY {} node = dst, level = level + 1"
    " STOP WITH src != node OR level == 3 ORDER BY w, dst",
}


def add(one: list[int], other: list[int]) -> list[int]:
    return one + other


def outcome(script: str, disable: list[str]) -> Any:
    with ss2sql.connect(disable=disable) as session:
        session.function(add)
        session.set("edges", EDGES)
        try:
            result = session.run(script, engine="native")
        except ss2sql.ResolveError:
            return None  # MEMORIZE with an order that it has not
        stats = result.stats
        return repr(result.value), stats.generated, stats.expanded, stats.pruned, stats.calls


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("repeats", REPEATS)
@pytest.mark.parametrize("search", SEARCHES)
def test_the_loop_with_the_function_put_in_does_what_the_loop_does(
    search: str, repeats: str, order: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = f"{SEARCHES[search].format(f'{order} {repeats}')} AS list;"
    inlined = outcome(script, [])
    without_memory = outcome(script, ["memo"])
    monkeypatch.setattr(search_compiler, "INLINE_STEPS", False)
    assert outcome(script, []) == inlined
    other = outcome(script, ["memo"])
    assert other == without_memory
    assert (other is None) == (inlined is None)
    if inlined is not None:
        assert other[:3] == inlined[:3]


# --- steps that are remembered -------------------------------------------------------------------------


def test_a_step_to_a_row_on_the_path_may_fail() -> None:
    """Steps are evaluated once for a state, whatever is on the path: more than the search asks for."""
    asked = []

    def differ(node: int, other: int) -> bool:
        asked.append((node, other))
        if node == other:
            raise ValueError
        return True

    script = """SELECT this FROM [1, 2, 3] WHERE differ(node, this) START WITH node = 0
        CONNECT BY NO CYCLE {} node = this AS list;"""
    with ss2sql.connect() as session:
        session.function("differ", differ, volatility="immutable")
        result = session.run(script.format(""), engine="native")
        assert result.value == session.run(script.format("DEPTH FIRST"), engine="native").value
    assert len(result.value) == 3 + 6 + 6
    assert (1, 1) in asked
    assert len(asked) == 2 * len(set(asked))  # one for each run: failures are remembered, too


# --- values --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [1, "a", None, [], [1, 2.0], [[1], []], [[1], 2], {"a": [1]}, [{"a": 1}], [[[1]]]])
def test_frozen_values_come_back_as_they_were(value: Any) -> None:
    for freezer in (freeze_any, freeze_flat, freeze_nested):
        assert repr(thaw_value(freezer(value))) == repr(value)
        hash(freezer(value))


@pytest.mark.parametrize("freezer", [freeze_any, freeze_flat, freeze_nested])
def test_frozen_values_are_equal_where_values_are(freezer: Any) -> None:
    values: list[Any] = [
        1, 1.0, True, [1], [1.0], [[1]], [[True]], {"a": 1}, {"a": 1.0}, [{"a": 1}], [], [[]], "", None,
    ]  # fmt: skip
    for one in values:
        for other in values:
            assert (freezer(one) == freezer(other)) is (one == other), (one, other)


def test_the_rows_of_paths_are_thawed_where_they_are_frozen() -> None:
    thawing = FrozenShapes(("flat",), ("flat",)).make_row_thaw()
    assert thawing is not None
    assert thawing([((1, 2),), ((3, 4),)]) == (([1, 2],), ([3, 4],))
    assert FrozenShapes(("flat",), ("scalar",)).make_row_thaw() is None


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


def test_what_is_no_value_is_refused_where_the_function_is_called() -> None:
    for start in ("[1]", "[[1]]", "1"):
        with ss2sql.connect() as session:
            session.function("step", lambda state, move: float("nan"), volatility="immutable")
            script = f"SELECT step(s, this) FROM [1] START WITH s = {start} CONNECT BY UNIQUE s = step(s, this);"
            with pytest.raises(ss2sql.ExecutionError, match="the function 'step' returned NaN") as caught:
                session.run(script, engine="native")
            assert caught.value.span is not None
            assert caught.value.span.text == "step(s, this)"


def test_a_call_is_made_once_for_each_state_and_element() -> None:
    calls = []

    def noted(element: list[int], tower: list[list[int]]) -> Any:
        calls.append((element, [list(place) for place in tower]))
        return move(element, tower)

    with ss2sql.connect() as session:
        session.function("noted", noted, volatility="immutable")
        result = session.run(
            """SELECT noted(this, tower) FROM [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]
            WHERE [[], [], [2, 1]] == noted(this, tower) START WITH tower = [[2, 1], [], []]
            CONNECT BY UNIQUE tower = noted(this, tower) STOP WITH [] == noted(this, tower)""",
            engine="native",
        )
    assert len(result.paths[0]) == 3
    assert len({repr(call) for call in calls}) == len(calls) == result.stats.calls["noted"]


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
