"""The steps of a search are tried by other processes, which get what they need for that."""

from __future__ import annotations

import os
import threading
from collections import Counter
from collections.abc import Iterator
from marshal import dumps
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from sessions import code_of

import ss2sql
from spark.same import agree
from ss2sql.runtime.levels import executor, spark_steps
from ss2sql.runtime.levels.arrow import batch
from ss2sql.runtime.levels.level import TABLES
from ss2sql.runtime.levels.parcel import packed

LOCK = threading.Lock()


def test_each_step_is_tried_once(ss: ss2sql.Session, tmp_path: Path) -> None:
    """The function has a file with a line for each call, in whichever process."""
    calls = tmp_path / "calls"

    def noted(n: int, more: int) -> int:
        with calls.open("a") as file:
            file.write(f"{n} {more}\n")
        return min(n + more, 9)

    ss.function("noted", noted, volatility="immutable")
    script = "SELECT noted(n, this) FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = noted(n, this) AS list;"
    result = ss.run(script)
    assert sorted(path[-1] for path in result.value) == list(range(1, 10))
    edges = Counter(f"{n} {more}" for n in range(10) for more in (1, 2))
    assert Counter(calls.read_text().splitlines()) == edges
    assert result.stats.calls["noted"] == 20
    assert sum(level.steps + level.pruned for level in result.stats.levels) == 20


def test_a_task_that_is_broken_off_and_begun_anew(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the same process, as Spark does it where others lost what the task needs: what was called is remembered."""
    sent: list[bytes] = []
    monkeypatch.setattr(spark_steps, "packed", lambda hunt, trial: sent.append(packed(hunt, trial)) or sent[-1])
    monkeypatch.setattr(executor, "ROWS", 1)
    ss.function("twice", lambda n, more: int(f"{n}{more}"), volatility="immutable")
    ss.run("SELECT twice(n, this) FROM [0, 1] START WITH n = 1 CONNECT BY UNIQUE n = twice(n, this) STOP WITH n > 9;")

    def task() -> Iterator[Any]:
        states = batch("step BIGINT, state BLOB", [(1, 2), (dumps((5,)), dumps((7,)))])
        return executor.tried([states], "a run", SimpleNamespace(value=sent[0]), TABLES["tries"])

    made = next(broken := task())
    broken.close()
    *rows, account = task()
    assert rows[0].equals(made)
    told = executor.account(account.column("state")[0].as_py())
    assert (told["tried"], told["calls"], told["remembered"]) == (4, {"twice": 2}, {"twice": 2})
    told = executor.account([*task()][-1].column("state")[0].as_py())
    assert (told["tried"], told["calls"], told["remembered"]) == (4, {}, {"twice": 4})


def test_tables_variables_frames_and_nested_queries_are_sent(ss: ss2sql.Session) -> None:
    pandas = pytest.importorskip("pandas")
    ss.host.connection.execute("CREATE TABLE edges(src, dst); INSERT INTO edges VALUES (1, 2), (2, 3), (3, 4), (2, 1)")
    ss.set("closed", [4, {"a": 1}])
    ss.attach("weights", pandas.DataFrame({"node": [1, 2, 3], "more": [0.5, 1.5, 2.5]}))
    agree(
        ss,
        "SELECT e.dst, w.more FROM e = (SELECT dst FROM edges WHERE src == n), w = weights"
        " WHERE NOT (e.dst IN closed) START WITH n = 1 CONNECT BY UNIQUE n = e.dst STOP WITH w.node != n;",
    )


@pytest.mark.parametrize(
    ("function", "options", "reason"),
    [
        (lambda n: n + 1, {"volatility": "stable"}, "'step' is stable: it may depend on what only this process knows"),
        (lambda n, lock=LOCK: n + 1, {"volatility": "immutable"}, "'step' cannot be pickled"),
    ],
    ids=["stable", "lock"],
)
def test_functions_that_cannot_be_sent_are_refused_by_name(
    ss: ss2sql.Session, function: Any, options: Any, reason: str
) -> None:
    ss.function("step", function, **options)
    with pytest.raises(ss2sql.UnsupportedError, match=reason) as caught:
        ss.run("SELECT step(n) FROM [1] START WITH n = 1 CONNECT BY UNIQUE n = step(n) STOP WITH n > 3;")
    assert caught.value.code == "U001"
    assert caught.value.hints


def test_worlds_and_objects_are_refused(ss: ss2sql.Session) -> None:
    from cases.shelf import Shelf

    ss.attach("shelf", Shelf())
    with pytest.raises(ss2sql.UnsupportedError, match="a world is in this process only"):
        ss.run("SELECT s.weight FROM s = shelf START WITH n = 1 CONNECT BY UNIQUE n = s.weight;")
    ss.attach("things", [object()])
    script = "SELECT 1 FROM x = things START WITH n = None CONNECT BY BREADTH FIRST MAXIMUM 3 n = x.this;"
    assert code_of(ss.run, script) == "U001"
    ss.function("thing", lambda n: object(), volatility="immutable")
    with pytest.raises(ss2sql.UnsupportedError, match="a row or state has an object"):
        ss.run("SELECT n FROM [1] START WITH n = 1 CONNECT BY UNIQUE n = thing(n);")


@pytest.mark.parametrize("options", ["DEPTH FIRST", "HEURISTIC 0 COST 1"])
def test_other_orders_are_refused_by_name(ss: ss2sql.Session, options: str) -> None:
    with pytest.raises(ss2sql.UnsupportedError, match=f"{options.partition(' ')[0]}.*the tables of spark cannot do"):
        ss.run(f"SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY {options} n = x.this;")


def test_a_function_that_fails_on_executors_only(ss: ss2sql.Session) -> None:
    here = os.getpid()

    def fails_elsewhere(n: int) -> int:
        if os.getpid() != here:
            raise ValueError
        return n

    ss.function("fails_elsewhere", fails_elsewhere, volatility="immutable")
    with pytest.raises(ss2sql.ExecutionError, match="did not fail again"):
        ss.run("SELECT fails_elsewhere(n) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n + 1;")
