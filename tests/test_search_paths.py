"""Paths of a search: read in any way, lazily, and given back with their result."""

from __future__ import annotations

import gc
import itertools
import weakref
from typing import Any

import pytest
from reference import Reference

import ss2sql
from ss2sql.runtime.sqlite.interning import Interning

TREE = """SELECT level, this FROM [1, 2] {where} START WITH level = 1
    CONNECT BY {option} level = level + 1 STOP WITH level == 4"""
# Which steps are goals, and how many of the paths and of the rows.
GOALS = {
    "all": ("", 14, 6),
    "some": ("WHERE level < 4 AND level + this > 3", 10, 3),
    "deep": ("WHERE level == 3", 8, 2),
    "none": ("WHERE level == 9", 0, 0),
}
ENDINGS = [
    *["ORDER BY this DESC, level AS rows", "ORDER BY this DESC, level LIMIT 3 AS rows", "LIMIT 2 AS rows", "AS list"],
    *["ORDER BY level DESC AS list", "GROUP BY this AS rows", "AS dict"],
]


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


@pytest.mark.parametrize("option", ["", "BREADTH FIRST", "COST 1", "BREADTH FIRST NO CYCLE", "PROBABILITY 0.5 UNIQUE"])
@pytest.mark.parametrize("kind", list(GOALS))
def test_paths_may_be_read_in_any_way(ss: ss2sql.Session, kind: str, option: str, engine: Any) -> None:
    goal, paths, rows = GOALS[kind]
    text = TREE.format(where=goal, option=option)
    wanted = Reference().run(f"{text} AS rows")
    assert len(wanted) == (rows if "UNIQUE" in option else paths)
    result = ss.run(f"{text};", engine=engine)
    for _ in range(2):
        assert result.paths == wanted
        assert list(result) == [
            (number, step, *row) for number, path in enumerate(wanted, 1) for step, row in enumerate(path, 1)
        ]
        assert len(result) == sum(map(len, wanted))
    assert result.answer is not None
    if engine == "database":
        check_lazy(result.answer.rows.paths, wanted)
    for ending in ENDINGS:
        value, expected = ss.run(f"{text} {ending};", engine=engine).value, Reference().run(f"{text} {ending}")
        assert value == expected, ending
        assert list(value) == list(expected), ending


# --- memory --------------------------------------------------------------------------------------------

LISTS = """SELECT at FROM [0, 1] START WITH at = [], level = 1 CONNECT BY {option} at = at + [this], level = level + 1
    STOP WITH level == 8;"""


def pools() -> int:
    gc.collect()
    return sum(isinstance(known, Interning) for known in gc.get_objects())


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


def test_the_collector_pauses_while_a_value_is_made_but_for_what_the_user_makes(ss: ss2sql.Session) -> None:
    collections: list[str] = []
    mine: list[bool] = []
    ss.representation("mine")(lambda rows: mine.append(gc.isenabled()))
    result = ss.run("SELECT this FROM range(9000) START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 1 AS list;")
    gc.callbacks.append(lambda phase, info: collections.append(phase))
    assert len(result.value) == 9000
    gc.callbacks.pop()
    assert collections.count("start") <= 1  # when all is made
    assert ss.run("SELECT 1 FROM [0] AS mine;").value is None
    assert (mine, gc.isenabled()) == ([True], True)
