"""Every order, repeats and MAXIMUM of a search: its paths, the functions that it calls, and where these fail it."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest
from programs.drawn import amount
from reference import Reference
from sessions import ENGINES

import ss2sql

GUARDS = ["", "NO CYCLE", "UNIQUE"]
ORDERS = [
    *["", "DEPTH FIRST", "BREADTH FIRST", "COST weigh(node, this)", "PROBABILITY 1 / weigh(node, this)"],
    "COST weigh(node, this) HEURISTIC weigh(this, 3)",
]
MAXIMUMS = ["", "MAXIMUM 1", "MAXIMUM 3"]
MOVES = [1, 2, 3]
COUNT = amount(1 / 10)


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


CONNECT = "level = 1 CONNECT BY {options} node = succ(node, this), level = level + 1 STOP WITH"
SEARCHES = {
    "goal and stop": f"SELECT node, this FROM moves WHERE succ(node, this) == 5 START WITH node = 0, {CONNECT}"
    " level == 3 OR succ(node, this) == 0 AS rows;",
    "stop": f"SELECT succ(node, this) FROM moves START WITH node = 0, {CONNECT}"
    " succ(node, this) == 2 OR level == 4 AS rows;",
    "source": f"SELECT this, succ(node, this) FROM ways(node) WHERE node != 1 START WITH node = 1, {CONNECT}"
    " level == 4 AS rows;",
    "goal": "SELECT succ(node, this) FROM moves WHERE succ(succ(node, this), 1) > 3 AND this != 2"
    f" START WITH node = 2, {CONNECT} level > 3 AND succ(node, 1) > -1 AS rows;",
}
in_every_way = pytest.mark.parametrize(
    ("search", "order", "guard"),
    [
        pytest.param(*way, marks=[pytest.mark.slow] if way[0] == "goal" and "NO CYCLE" in way else [])
        for way in itertools.product(SEARCHES, ORDERS, GUARDS)
    ],
)


# --- paths and calls -----------------------------------------------------------------------------------


@in_every_way
def test_paths_and_calls_are_those_that_the_language_asks_for(search: str, order: str, guard: str) -> None:
    """The reference calls a function at every occurrence, in written order; of these the distinct calls are made.

    Where MAXIMUM ends a search, SQL may have tried all steps from a state; depth first it tries those from each state
    before it goes on from the first, so with the engine `auto` such a search runs natively. Python evaluates the
    steps of a state with NO CYCLE once, whatever is on the path, and does not ask what steps cost that cannot be better
    than known ones.
    """
    everything: set[tuple[Any, ...]] = set()
    machine = Machine()
    machine.reference().run(SEARCHES[search].format(options=order))
    unguarded = set(machine.seen)
    for maximum in MAXIMUMS:
        deep = order == "DEPTH FIRST" or (not order and guard != "UNIQUE")
        script = SEARCHES[search].format(options=f"{order} {guard} {maximum}")
        machine = Machine()
        judge = machine.reference()
        wanted = judge.run(script)
        asked = set(machine.seen)
        everything |= asked
        found = []
        for engine in (*ENGINES, "auto"):
            machine.seen.clear()
            with machine.session() as session:
                result = session.run(script, engine=engine)
            assert (
                result.engine == ("native" if engine == "auto" and deep and maximum else "database")
                or engine == "native"
            )
            assert repr(result.value) == repr(wanted)
            assert len(machine.seen) == len(set(machine.seen)), engine
            assert result.stats.calls == Counter(call[0] for call in machine.seen)
            if result.engine == "native":
                more, less = set(machine.seen) - asked, asked - set(machine.seen)
                assert not more or (guard == "NO CYCLE" and more <= unguarded)
                assert not less or (guard == "UNIQUE" and "weigh" in order and {call[0] for call in less} == {"weigh"})
            else:
                weighted = "weigh" in order
                allowed = everything if deep else asked if weighted or not maximum else with_siblings(asked)
                assert set(machine.seen) <= allowed
                assert {call for call in asked if "HEURISTIC" not in order} <= set(machine.seen)
            if not maximum or engine == "native":  # SQLite looks at all steps of a state at once
                assert result.stats.generated == judge.steps
            counted = (result.stats.expanded, result.stats.pruned) if not maximum or "weigh" in order else None
            found.append((result.status, counted))
        assert found[0] == found[1] == found[2] or (deep and guard == "UNIQUE")


def with_siblings(asked: set[tuple[Any, ...]]) -> set[tuple[Any, ...]]:
    """The calls, and those of all steps from the states that they stepped from."""
    machine = Machine()
    nodes = {node for function, node, *_ in asked if function == "succ"}
    for node, move in itertools.product(nodes, MOVES):
        machine.succ(machine.succ(node, move), 1)
    return asked | set(machine.seen)


@pytest.mark.parametrize("option", ["", "NO CYCLE", "UNIQUE", "BREADTH FIRST", "COST 1"])
@pytest.mark.parametrize("where", ["", "WHERE inner(n) > 0 AND this != 2"])
def test_a_function_may_run_another_search_in_the_middle_of_one(
    ss: ss2sql.Session, option: str, where: str, engine: Any
) -> None:
    inner = "SELECT k, this FROM [1, 2] WHERE k < 3 START WITH k = 1 CONNECT BY {} k = k + 1 STOP WITH k == 4 AS list;"
    count = {"": 6, "NO CYCLE": 6, "UNIQUE": 4, "BREADTH FIRST": 6, "COST 1": 6}
    depth = 0

    def run_inner(n: int) -> int:
        nonlocal depth
        depth += 1
        if depth < 3:
            ss.run("SELECT inner(this) FROM [7] START WITH m = 1 CONNECT BY UNIQUE m = 2;", engine=engine)
        depth -= 1
        for kind, number in count.items():
            assert len(ss.run(inner.format(kind), engine=engine).paths) == number
        return len(ss.run(inner.format(option), engine=engine).paths) + n - n

    ss.function("inner", run_inner, volatility="immutable")
    ss.function("plain", lambda n: count[option], volatility="immutable")
    text = f"""SELECT n, this, inner(n) FROM [1, 2, 3] {where} START WITH n = 1
        CONNECT BY {option} n = n + 1 STOP WITH n == 3 OR inner(this) < 0;"""
    wanted = ss.run(text.replace("inner", "plain"), engine="native")
    result = ss.run(text, engine=engine)
    assert result.paths == wanted.paths
    assert result.paths
    for name in ("generated", "expanded", "pruned"):
        assert getattr(result.stats, name) == getattr(wanted.stats, name), name


# --- errors --------------------------------------------------------------------------------------------


@in_every_way
def test_a_function_that_fails_is_called_once_and_fails_no_search_that_has_a_value(
    search: str, order: str, guard: str
) -> None:
    """Also where SQL gives up and Python begins anew: calls that failed are remembered, too."""
    machine = Machine()
    machine.reference().run(SEARCHES[search].format(options=f"{order} {guard}"))
    # Of the calls of the whole search the one in the middle and the last two: each fails once.
    calls = list(dict.fromkeys(machine.seen))
    bombs = dict.fromkeys([calls[len(calls) // 2], *calls[-2:]])
    for maximum in MAXIMUMS:
        script = SEARCHES[search].format(options=f"{order} {guard} {maximum}")
        sound = machine.reference().run(script)
        for bomb in bombs:
            with machine.session() as session:
                query = session.compile(script)
                try:
                    wanted = Machine(bomb).reference().run(script)
                except BoomError:
                    wanted = None
                machine.bomb = bomb
                machine.seen.clear()
                if wanted is not None:
                    assert query.run().value == wanted, bomb
                elif guard == "UNIQUE" and bomb[0] == "weigh":  # which Python need not ask
                    with suppress(BoomError):
                        assert query.run().value == sound, bomb
                else:
                    with pytest.raises(BoomError) as caught:
                        query.run()
                    assert caught.value.args == (bomb,)
                    (note,) = caught.value.__notes__
                    assert bomb[0] in note
                    assert "<script>:" in note
                assert len(machine.seen) == len(set(machine.seen)), bomb
                machine.bomb = ()
                assert query.run().value == sound


# --- rows that repeat ----------------------------------------------------------------------------------


def test_every_edge_is_looked_at_once(ss: ss2sql.Session, engine: Any) -> None:
    edges = [(0, 1), (0, 2), (1, 3), (2, 3), (3, 0), (3, 4), (4, 4), (2, 4), (2, 3)]
    ss.host.connection.execute("CREATE TABLE edges(src, dst)")
    ss.host.connection.executemany("INSERT INTO edges VALUES (?, ?)", edges)
    search = "START WITH node = 0 CONNECT BY UNIQUE node = dst AS list"
    result = ss.run(f"SELECT dst FROM (SELECT * FROM edges WHERE src == node) {search};", engine=engine)
    # The edges of 0 are walked from the start and from the row 0; those of 1, 2, 3 and 4 once.
    assert result.stats.generated == 2 + 9
    assert result.stats.expanded == 1 + len(result.value) == 6
    assert result.stats.pruned == 11 - 5


@pytest.mark.parametrize(
    ("start", "connect", "counts"),
    [
        ("n = 0", "n = n + 1 STOP WITH n >= 1", (6, 3, 0)),
        ("n = 0", "level() <= 3, n = n + 1", (14, 15, 0)),
        ("n = 0", "level() <= 2, n = n + 1 STOP WITH this == 2", (4, 3, 0)),
        ("n = 0, this > 1", "n < 4, n = n + 1", (15, 16, 0)),
        ("EACH n IN [0, 1]", "n < 4, n = n + 1", (44, 46, 0)),
        ("EACH n IN [0, 1]", "UNIQUE BY n, n < 4, n = n + this", (8, 6, 4)),
        ("EACH n IN [0, 1], this > 1", "COST 1 UNIQUE BY n, n < 4, n = n + this", (6, 6, 2)),
    ],
)
def test_steps_that_meet_the_condition_and_states_with_the_starts_are_counted(
    ss: ss2sql.Session, engine: Any, start: str, connect: str, counts: tuple[int, int, int]
) -> None:
    """By hand: a state of these trees has two steps, in those with `this > 1` the start has one."""
    stats = ss.run(f"SELECT this FROM [1, 2] START WITH {start} CONNECT BY {connect}", engine=engine).stats
    assert (stats.generated, stats.expanded, stats.pruned) == counts
