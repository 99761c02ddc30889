"""Steps as SQL in Spark: the same paths as natively, without a Python process."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, seed
from programs.drawn import PROGRAMS, drawn
from test_levels_typed import MOVES, expressions, script_of

import ss2sql
from spark.same import agree
from ss2sql.runtime.levels.spark_steps import Steps

COUNT = max(6, PROGRAMS // 160)
STRATEGIES = ("UNIQUE", "BREADTH FIRST NO CYCLE", "BREADTH FIRST")


@pytest.fixture
def no_python(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Steps) -> None:
        raise AssertionError("sent to Python")

    monkeypatch.setattr(Steps, "load", refuse)


@pytest.mark.usefixtures("no_python")
def test_random_steps(spark: Any) -> None:
    @seed(89)
    @drawn(COUNT, shrunk=False)
    @given(expressions())
    def run(parts: dict[str, str]) -> None:
        number = len(str(parts))
        script = script_of(parts, STRATEGIES[number % 3], set("ntbl"[number % 4 :]), grouped=False, ends=1)
        with ss2sql.connect(engine="spark", session=spark) as ss:
            ss.set("moves", MOVES)
            agree(ss, script)

    run()


@pytest.mark.usefixtures("no_python")
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_values_of_variables_elements_and_the_start(ss: ss2sql.Session, strategy: str) -> None:
    """Variables are bound, lists too; ORDER BY asks for the elements and the state of the last step."""
    ss.set("goals", [3, 5])
    ss.set("wanted", "it's")
    ss.set("moves", MOVES)
    agree(
        ss,
        'SELECT n + m.by, t FROM m = moves WHERE n + m.by IN goals AND wanted == t START WITH n = 0, t = "it\'s"'
        f" CONNECT BY {strategy} MAXIMUM 9 n = n + m.by STOP WITH abs(n) > 4 ORDER BY m.by, n DESC;",
    )


@pytest.mark.usefixtures("no_python")
def test_numbers_beyond_32_bits(ss: ss2sql.Session) -> None:
    """Places are steps times 2^24, so the 200th step has one that a small integer of Spark cannot hold."""
    agree(
        ss, "SELECT n + this FROM range(300) START WITH n = 0 CONNECT BY UNIQUE n = n + this STOP WITH n > 0 AS list;"
    )


def test_what_is_left_to_python_says_why(ss: ss2sql.Session) -> None:
    result = ss.run("SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY UNIQUE n = x.this AS list;")
    assert "in Python: what stands in FROM depends on the state" in str(result.explain())
