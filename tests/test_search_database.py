"""Searches on the database: what they call, how they fail, which forms of a value they know, how paths are read."""

from __future__ import annotations

import gc
import itertools
import tracemalloc
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from reference import Reference

import ss2sql
from ss2sql.runtime.pool import Pool

both = pytest.mark.parametrize("engine", ["database", "native"])
ENGINES: tuple[Any, ...] = ("database", "native")
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


# --- other forms of a value ----------------------------------------------------------------------------

FORMS: dict[str, Callable[[int, int], Any]] = {
    "the same": lambda a, b: [a, b],
    "floats": lambda a, b: [float(a), b],
    "all floats": lambda a, b: [float(a), float(b)],
    "bools": lambda a, b: [True if a == 1 else a, b],
    "tuples": lambda a, b: (a, b),
    "arrays": lambda a, b: np.array([a, b]),
    "float arrays": lambda a, b: np.array([a, b], dtype=float),
    "scalars": lambda a, b: [np.int64(a), np.float32(b)],
    "mixed": lambda a, b: [a, b] if b else (float(a), b),
}
forms = pytest.mark.parametrize("form", list(FORMS))


def in_form(form: str) -> ss2sql.Session:
    """A session whose function `go` counts steps and notes the last element."""
    session = ss2sql.connect()
    session.function("go", lambda at, move: FORMS[form](int(at[0]) + 1, move), volatility="immutable")
    session.set("goal", [1, 2])
    session.set("far", [3, 2])
    return session


@both
@pytest.mark.parametrize("option", ["", "BREADTH FIRST", "COST 1", "NO CYCLE", "BREADTH FIRST MAXIMUM 20"])
@forms
def test_a_goal_is_found_in_any_form(form: str, option: str, engine: Any) -> None:
    session = in_form(form)
    script = """SELECT at, this FROM [0, 1, 2] WHERE go(at, this) == {goal} START WITH at = [0, 0], level = 1
        CONNECT BY {option} at = go(at, this), level = level + 1 STOP WITH level == 3;"""
    for goal in ("far", "[3, 2]", "[3.0, 2]"):
        paths = session.run(script.format(goal=goal, option=option), engine=engine).paths
        assert [[row[1] for row in path] for path in paths] == [[a, b, 2] for a in range(3) for b in range(3)]
    paths = session.run(script.format(goal="goal", option=option), engine=engine).paths
    assert [[row[1] for row in path] for path in paths] == [[2]]


@both
@pytest.mark.parametrize("option", ["", "BREADTH FIRST", "COST 1", "NO CYCLE"])
@forms
def test_a_stop_is_found_in_any_form(form: str, option: str, engine: Any) -> None:
    script = """SELECT this FROM [0, 2, 1] START WITH at = [0, 0], level = 1
        CONNECT BY {option} at = go(at, this), level = level + 1
        STOP WITH go(at, this) == {goal} OR level == 3 OR at == [1, 1];"""
    if option == "NO CYCLE":
        script = script.replace("SELECT this", "SELECT this, level")
    for goal in ("goal", "[1, 2]", "[1, 2.0]"):
        # What has gone on when level is 3 stops without a goal; so does the step with 2 at the start, and what is
        # behind a step with 1.
        wanted = {(0,), (1,)} | {(0, move) for move in (0, 2, 1)}
        result = in_form(form).run(script.format(goal=goal, option=option), engine=engine)
        assert {tuple(row[0] for row in path) for path in result.paths} == wanted
        assert len(result.paths) == len(wanted)


@both
@forms
def test_another_form_is_no_reason_to_call_again(form: str, engine: Any) -> None:
    """The statement is run again when one turns up, with the calls that were made."""
    seen: list[tuple[Any, ...]] = []

    def go(at: list[int], move: int) -> Any:
        seen.append((repr(at), move))
        return FORMS[form](int(at[0]) + 1, move)

    session = ss2sql.connect()
    session.function("go", go, volatility="immutable")
    result = session.run(
        """SELECT this FROM [0, 1, 2] WHERE go(at, this) == [3, 2] START WITH at = [0, 0], level = 1
        CONNECT BY at = go(at, this), level = level + 1 STOP WITH level == 3;""",
        engine=engine,
    )
    assert len(result.paths) == 9
    assert len(seen) == len(set(seen)) == result.stats.calls["go"]


def test_what_is_no_value_is_given_once() -> None:
    """The failed call may have been made too early; it is not made again to see whether it was."""
    seen: list[int] = []

    def bad(n: int) -> Any:
        seen.append(n)
        return float("nan") if n == 2 else n

    script = """SELECT this, n FROM [0, 1, 2] WHERE bad(this) == 1 AND n == 2 START WITH n = 1
        CONNECT BY {} n = n + 1 STOP WITH n == 2;"""
    for option in ("", "BREADTH FIRST", "COST 1", "MAXIMUM 1"):
        seen.clear()
        session = ss2sql.connect()
        session.function("bad", bad, volatility="immutable")
        # Depth first the first path with a goal is 0, 1; no step has 2 before.
        if option == "MAXIMUM 1":
            result = session.run(script.format(option), engine="database")
            assert result.paths == [[(0, 1), (1, 2)]]
        else:
            with pytest.raises(ss2sql.ExecutionError) as caught:
                session.run(script.format(option), engine="database")
            assert caught.value.code == "X004"
        assert len(seen) == len(set(seen)), option


@both
@pytest.mark.parametrize("order", ["", "DEPTH FIRST", "COST 1", "PROBABILITY 0.5"])
@forms
def test_rows_are_the_same_in_any_form(form: str, order: str, engine: Any) -> None:
    """Some steps give their row as ints and some in another form; equal rows are one."""
    session = ss2sql.connect()
    given = lambda at, move: FORMS["the same" if move % 2 else form]((int(at[0]) + move) % 3, 1)  # noqa: E731
    session.function("go", given, volatility="immutable")
    script = """SELECT go(at, this) FROM [1, 2, 4] START WITH at = [0, 1]
        CONNECT BY {order} {guard} at = go(at, this);"""
    paths = session.run(script.format(order=order, guard="UNIQUE"), engine=engine).paths
    assert sorted([*path[-1][0]] for path in paths) == [[0, 1], [1, 1], [2, 1]]
    # The next remainder is any one not on the path: elements 1 and 4 lead to the same one, 2 to the other.
    paths = session.run(script.format(order=order, guard="NO CYCLE"), engine=engine).paths
    wanted = sorted(
        [sum(chosen[:length]) % 3 for length in range(1, len(chosen) + 1)]
        for count in (1, 2, 3)
        for chosen in itertools.product([1, 2, 4], repeat=count)
        if len({sum(chosen[:length]) % 3 for length in range(1, count + 1)}) == count
    )
    assert sorted([int(row[0][0]) for row in path] for path in paths) == wanted


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


# --- paths ---------------------------------------------------------------------------------------------

STOPPED = "STOP WITH level == 4"
TREE = """SELECT level, this FROM [1, 2] {where} START WITH level = 1 CONNECT BY {option} level = level + 1 {stop}"""


def all_paths(where: Callable[[int, int], bool], deepest: int = 3) -> list[list[tuple[int, int]]]:
    """The tree depth first: the paths whose last step is a goal."""

    def below(path: list[tuple[int, int]]) -> Iterator[list[tuple[int, int]]]:
        for move in (1, 2):
            longer = [*path, (len(path) + 1, move)]
            if where(*longer[-1]):
                yield longer
            if len(longer) < deepest:
                yield from below(longer)

    return list(below([]))


KINDS: dict[str, tuple[str, Callable[[int, int], bool]]] = {
    "all": ("", lambda level, move: True),
    "some": ("WHERE level + this > 3", lambda level, move: level + move > 3),
    "deep": ("WHERE level == 3", lambda level, move: level == 3),
    "none": ("WHERE level == 9", lambda level, move: False),
}


def check_lazy(paths: Any, wanted: list[Any]) -> None:
    assert len(paths) == len(wanted)
    assert [paths[position] for position in reversed(range(len(wanted)))] == wanted[::-1]
    assert [paths[-position] for position in range(1, len(wanted) + 1)] == wanted[::-1]
    for part in (slice(None), slice(1, -1), slice(None, None, -1), slice(2, None, 3), slice(-3, None), slice(5, 2)):
        assert paths[part] == wanted[part]
    with pytest.raises(IndexError):
        paths[len(wanted)]
    first, second = iter(paths), iter(paths)
    assert list(itertools.zip_longest(first, second)) == [(path, path) for path in wanted]
    for read in paths:  # a path is the reader's own
        read.clear()
    assert list(paths) == wanted


@both
@pytest.mark.parametrize("option", ["", "BREADTH FIRST", "COST 1", "BREADTH FIRST NO CYCLE", "PROBABILITY 0.5 UNIQUE"])
@pytest.mark.parametrize("kind", list(KINDS))
def test_paths_may_be_read_in_any_way(kind: str, option: str, engine: Any) -> None:
    where, goal = KINDS[kind]
    wanted = all_paths(goal)
    if option:
        wanted.sort(key=len)
    if "UNIQUE" in option:
        firsts: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for path in sorted(all_paths(lambda level, move: True), key=len):
            firsts.setdefault(path[-1], path)
        # The first path to a row leads on from the first path to the row before it, which takes 1 all the time.
        wanted = [path for path in firsts.values() if goal(*path[-1])]
    session = ss2sql.connect()
    text = TREE.format(where=where, option=option, stop=STOPPED)
    # One step deeper nothing leaves a trace, for the step stops; where WHERE is asked it is no goal there.
    text = text.replace("WHERE ", "WHERE level < 4 AND ")
    result = session.run(f"{text};", engine=engine)
    for _ in range(2):
        assert result.paths == wanted
        assert list(result) == [
            (number, step, *row) for number, path in enumerate(wanted, 1) for step, row in enumerate(path, 1)
        ]
        assert len(result) == sum(map(len, wanted))
        assert result.value == [[{"level": level, "this": move} for level, move in path] for path in wanted]
    assert result.answer is not None
    if engine == "database":
        check_lazy(result.answer.rows.paths, wanted)

    def run(rest: str) -> Any:
        return session.run(f"{text} {rest};", engine=engine).value

    order = sorted(wanted, key=lambda path: (-path[-1][1], path[-1][0]))
    assert run("ORDER BY this DESC, level AS rows") == order
    assert run("ORDER BY this DESC, level LIMIT 3 AS rows") == order[:3]
    assert run("LIMIT 2 AS rows") == wanted[:2]
    assert run("AS list") == [[cell for row in path for cell in row] for path in wanted]
    assert run("ORDER BY level DESC AS list") == [
        [cell for row in path for cell in row] for path in sorted(wanted, key=lambda path: -path[-1][0])
    ]
    groups: dict[int, list[Any]] = {}
    for path in wanted:
        groups.setdefault(path[-1][1], []).append(path)
    assert run("GROUP BY this AS rows") == groups
    assert list(run("GROUP BY this AS rows")) == list(groups)


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


# --- memory --------------------------------------------------------------------------------------------

LISTS = """SELECT at FROM [0, 1] START WITH at = [], level = 1 CONNECT BY {option} at = at + [this], level = level + 1
    STOP WITH level == 8;"""


def pools() -> int:
    gc.collect()
    return sum(isinstance(known, Pool) for known in gc.get_objects())


@both
@pytest.mark.parametrize("option", ["", "BREADTH FIRST", "NO CYCLE", "COST 1"])
def test_what_a_search_kept_is_given_back_with_its_result(option: str, engine: Any) -> None:
    before = pools()
    session = ss2sql.connect()
    result = session.run(LISTS.format(option=option), engine=engine)
    assert len(result.paths) == 2**8 - 2
    kept = weakref.ref(result.answer.rows) if hasattr(type(result.answer.rows), "__weakref__") else None  # type: ignore[union-attr]
    assert pools() <= before + 1
    session.run("1;")
    del result
    assert pools() == before
    assert kept is None or kept() is None
    session.close()
    del session
    assert pools() == before


def test_searches_one_after_the_other_need_no_more_memory_than_one() -> None:
    session = ss2sql.connect()
    query = session.compile(
        "SELECT n FROM [1] WHERE n == 20000 START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 20000;"
    )

    def run() -> None:
        result = query.run(engine="database")
        assert result.stats.generated == 20_000
        assert len(result.paths[0]) == 20_000

    for _ in range(3):
        run()
    gc.collect()
    tracemalloc.start()
    try:
        run()
        gc.collect()
        first, most = tracemalloc.get_traced_memory()
        for _ in range(20):
            run()
        gc.collect()
        last, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert last - first < 0.05 * most  # of what one search takes
