"""Searches on the database: which functions they call, where those fail, and which rows repeat."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from reference import Reference
from sessions import ENGINES, both

import ss2sql

ORDERS = ["", "DEPTH FIRST", "BREADTH FIRST", "COST weigh(node, this)", "PROBABILITY 1 / weigh(node, this)"]
GUARDS = ["", "NO CYCLE", "UNIQUE"]
MOVES = [1, 2, 3]


class BoomError(Exception):
    """What a function of the user raises."""


class Machine:
    """States 0 to 6 and moves 1 to 3, as immutable functions that note their calls and may fail for some arguments."""

    def __init__(self, bomb: tuple[Any, ...] = ()) -> None:
        self.bomb = bomb
        self.seen: list[tuple[Any, ...]] = []

    def noted(self, *call: Any) -> None:
        self.seen.append(call)
        if call == self.bomb:
            raise BoomError(call)

    def succ(self, node: int, move: int) -> int:
        self.noted("succ", node, move)
        return (3 * node + move) % 7

    def weigh(self, node: int, move: int) -> int:
        self.noted("weigh", node, move)
        return 1 + node % 2 + move // 3

    def ways(self, node: int) -> list[int]:
        self.noted("ways", node)
        return MOVES[: 1 + node % 3]

    @property
    def functions(self) -> dict[str, Callable[..., Any]]:
        return {"succ": self.succ, "weigh": self.weigh, "ways": self.ways}

    def session(self) -> ss2sql.Session:
        session = ss2sql.connect()
        for name, function in self.functions.items():
            session.function(name, function, volatility="immutable")
        return session.set("moves", MOVES) or session

    def reference(self) -> Reference:
        return Reference(self.functions, {"moves": MOVES}, {}, dict.fromkeys(self.functions, "immutable"))


SEARCHES = {
    "goal and stop": """SELECT node, this FROM moves WHERE succ(node, this) == 5
        START WITH node = 0, level = 1 CONNECT BY {options} node = succ(node, this), level = level + 1
        STOP WITH level == 3 OR succ(node, this) == 0 AS rows;""",
    "stop": """SELECT succ(node, this) FROM moves
        START WITH node = 0, level = 1 CONNECT BY {options} node = succ(node, this), level = level + 1
        STOP WITH succ(node, this) == 2 OR level == 4 AS rows;""",
    "source": """SELECT this, succ(node, this) FROM ways(node) WHERE node != 1
        START WITH node = 1, level = 1 CONNECT BY {options} node = succ(node, this), level = level + 1
        STOP WITH level == 4 AS rows;""",
    "goal": """SELECT succ(node, this) FROM moves WHERE succ(succ(node, this), 1) > 3 AND this != 2
        START WITH node = 2, level = 1 CONNECT BY {options} node = succ(node, this), level = level + 1
        STOP WITH level > 3 AND succ(node, 1) > -1 AS rows;""",
}
searches = pytest.mark.parametrize("search", list(SEARCHES))


# --- calls ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("maximum", ["", "MAXIMUM 1", "MAXIMUM 3"])
@pytest.mark.parametrize("guard", GUARDS)
@pytest.mark.parametrize("order", ORDERS)
@searches
def test_a_function_is_called_once_for_the_arguments_that_the_language_asks_for(
    search: str, order: str, guard: str, maximum: str
) -> None:
    """The reference calls a function at every occurrence, in written order; of these the distinct calls are made."""
    script = SEARCHES[search].format(options=f"{order} {guard} {maximum}")
    machine = Machine()
    wanted = machine.reference().run(script)
    asked = set(machine.seen)
    for engine in ENGINES:
        machine.seen.clear()
        with machine.session() as session:
            result = session.run(script, engine=engine)
        assert result.engine == engine
        assert result.value == wanted
        assert len(machine.seen) == len(set(machine.seen)), engine
        assert set(machine.seen) == asked, engine
        assert sum(result.stats.calls.values()) == len(asked)
        for name in ("succ", "weigh", "ways"):
            assert result.stats.calls[name] == sum(call[0] == name for call in asked)


@pytest.mark.parametrize(("order", "asked"), [("DEPTH FIRST", False), ("BREADTH FIRST", True), ("COST 1", False)])
def test_only_breadth_first_a_step_asks_whether_there_are_enough_results(order: str, asked: bool) -> None:
    """In the other orders a result is one when it is taken, and nothing comes after the last."""
    script = f"SELECT n FROM moves START WITH n = 1 CONNECT BY {order} MAXIMUM 2 n = succ(n, this) STOP WITH n > 5"
    with Machine().session() as session:
        result = session.run(script, engine="database")
        assert result.paths == session.run(script, engine="native").paths
    assert ("go_on()" in result.sql) is asked


@pytest.mark.parametrize("option", ["", "NO CYCLE", "UNIQUE", "BREADTH FIRST", "COST 1"])
@pytest.mark.parametrize("where", ["", "WHERE inner(n) > 0 AND this != 2"])
def test_a_function_may_run_another_search_in_the_middle_of_one(option: str, where: str) -> None:
    session = ss2sql.connect()
    inner = "SELECT k, this FROM [1, 2] WHERE k < 3 START WITH k = 1 CONNECT BY {} k = k + 1 STOP WITH k == 4 AS list;"
    count = {"": 6, "NO CYCLE": 6, "UNIQUE": 4, "BREADTH FIRST": 6, "COST 1": 6}
    depth = 0

    def run_inner(n: int) -> int:
        nonlocal depth
        depth += 1
        if depth < 3:
            session.run("SELECT inner(this) FROM [7] START WITH m = 1 CONNECT BY UNIQUE m = 2;", engine="database")
        depth -= 1
        for kind, number in count.items():
            assert len(session.run(inner.format(kind), engine="database").paths) == number
        return len(session.run(inner.format(option), engine="database").paths) + n - n

    session.function("inner", run_inner, volatility="immutable")
    session.function("plain", lambda n: count[option], volatility="immutable")
    text = f"""SELECT n, this, inner(n) FROM [1, 2, 3] {where} START WITH n = 1
        CONNECT BY {option} n = n + 1 STOP WITH n == 3 OR inner(this) < 0;"""
    wanted = session.run(text.replace("inner", "plain"), engine="native")
    result = session.run(text, engine="database")
    assert result.paths == wanted.paths
    assert result.paths
    assert (result.stats.generated, result.stats.expanded, result.stats.pruned) == (
        wanted.stats.generated,
        wanted.stats.expanded,
        wanted.stats.pruned,
    )


# --- errors --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("maximum", ["", "MAXIMUM 1", "MAXIMUM 3"])
@pytest.mark.parametrize("guard", GUARDS)
@pytest.mark.parametrize("order", ORDERS)
@searches
def test_a_function_fails_the_search_only_where_the_written_order_reaches_it(
    search: str, order: str, guard: str, maximum: str
) -> None:
    script = SEARCHES[search].format(options=f"{order} {guard} {maximum}")
    machine = Machine()
    machine.reference().run(SEARCHES[search].format(options=f"{order} {guard}"))
    # Of the calls of the whole search the one in the middle and the last two: each fails once.
    calls = list(dict.fromkeys(machine.seen))
    sound = machine.reference().run(script)
    with machine.session() as session:
        query = session.compile(script)
        for bomb in dict.fromkeys([calls[len(calls) // 2], *calls[-2:]]):
            try:
                wanted = Machine(bomb).reference().run(script)
            except BoomError:
                wanted = None
            machine.bomb = bomb
            machine.seen.clear()
            if wanted is not None:
                assert query.run(engine="database").value == wanted, bomb
            else:
                with pytest.raises(BoomError) as caught:
                    query.run(engine="database")
                assert caught.value.args == (bomb,)
                (note,) = caught.value.__notes__
                assert bomb[0] in note
                assert "<script>:" in note
            assert len(machine.seen) == len(set(machine.seen)), bomb
            machine.bomb = ()
            assert query.run(engine="database").value == sound


# --- a row that repeats within one expansion -----------------------------------------------------------


@both
@pytest.mark.parametrize(
    "order", ["", "BREADTH FIRST", "DEPTH FIRST", "COST 1", "PROBABILITY 0.5", "COST 1 HEURISTIC 0"]
)
def test_a_row_of_the_state_or_of_an_earlier_source_is_reached_once(order: str, engine: Any) -> None:
    session = ss2sql.connect()

    def ends(select: str, clauses: str, stop: str = "") -> list[list[Any]]:
        script = f"SELECT {select} FROM a = [1, 2], b = [1, 2, 3] {clauses} {stop};".format(f"{order} UNIQUE")
        return [[row[0] for row in path] for path in session.run(script, engine=engine).paths]

    start = "START WITH n = 0 CONNECT BY {}"
    assert sorted(path[-1] for path in ends("a.this", f"{start} n = n + 1")) == [1, 2]
    # The state is the row: its first step reaches it, and goes on to the state 1, whose first step does not leave it.
    assert ends("n", f"{start} n = a.this") == [[0], [0, 1]]
    assert ends("n", f"{start} n = b.this") == [[0], [0, 1]]
    # A step that stops without being a goal reaches nothing, so the next one reaches the row: b = 2 leads to 2.
    assert ends("n", f"{start} n = b.this", "STOP WITH b.this == 1") == [[0], [0, 2]]
    # A goal that stops reaches its row, and nobody goes on from it.
    assert ends("n", f"WHERE True {start} n = b.this", "STOP WITH b.this == 1") == [[0]]
    assert ends("1", f"WHERE b.this == 3 {start} n = b.this") == []


def test_a_long_chain_that_fails_is_lowered_once_more() -> None:
    """What failed is made again as a careful statement, and it is as deep as the first."""
    chain = "far(a.this)" + " / 2" * 150
    script = f"SELECT {chain} FROM a = near(n) START WITH n = 1 CONNECT BY n = a.this AS list;"
    with ss2sql.connect() as ss:
        ss.function("near", lambda n: [n + 1], volatility="immutable")
        ss.function("far", lambda n: 9 // (3 - n), volatility="immutable")
        with pytest.raises(ZeroDivisionError):
            ss.run(script, engine="database")
