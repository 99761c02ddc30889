"""Paths of a search: read in any way, lazily, and given back with their result."""

from __future__ import annotations

import gc
import itertools
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from sessions import both

import ss2sql
from ss2sql.runtime.pool import Pool

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


# --- memory --------------------------------------------------------------------------------------------

LISTS = """SELECT at FROM [0, 1] START WITH at = [], level = 1 CONNECT BY {option} at = at + [this], level = level + 1
    STOP WITH level == 8;"""


def pools() -> int:
    gc.collect()
    return sum(isinstance(known, Pool) for known in gc.get_objects())


@both
@pytest.mark.usefixtures("little_heap")
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
