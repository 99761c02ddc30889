"""What `stats.generated` and `max_steps` count: steps, and nothing that a clause looks at beside."""

from __future__ import annotations

import random
from typing import Any

import pytest

import ss2sql

LISTS = ["range(40)", "many", "same", "[1, 2]", "range(20)", "[2, 1]"]
VARIABLES = "many = range(40); same = [1, 2]; "


def generated(ss: ss2sql.Session, script: str, engine: Any) -> int:
    return ss.run(VARIABLES + script, engine=engine).stats.generated


def drawn(dice: random.Random) -> str:
    """A search that ends, with one to three lists right of IN."""
    sources = dice.choice(["[1, 2]", "same", "a = [1, 2], b = same", "a = same, b = same", "a = range(1, 3), b = [3]"])
    step = "this" if "a =" not in sources else "a.this * b.this"  # a source that nobody asks for may stay unread
    parts = [f"x + {step} {dice.choice(['IN', 'NOT IN'])} {dice.choice(LISTS)}" for _ in range(dice.randint(1, 3))]
    where = f" WHERE {parts.pop()}" if len(parts) > 1 else ""
    order = dice.choice(["", "BREADTH FIRST ", "UNIQUE ", "NO CYCLE ", "COST 1 "])
    stop = f"x > {dice.randint(3, 5)} OR {' OR '.join(parts)}"
    return f"SELECT {step}, x FROM {sources}{where} START WITH x = 0 CONNECT BY {order}x = x + {step} STOP WITH {stop}"


@pytest.mark.parametrize("seed", range(60))
def test_elements_of_lists_right_of_in_are_no_steps(seed: int) -> None:
    script = drawn(random.Random(seed))
    with ss2sql.connect() as ss:
        assert generated(ss, script, "database") == generated(ss, script, "native"), script


def test_max_steps_counts_them_neither() -> None:
    script = "SELECT this FROM [1, 2] START WITH x = 0 CONNECT BY x = x + this STOP WITH x + this NOT IN range({most})"
    with ss2sql.connect(max_steps=100) as ss:
        for engine in ("database", "native"):
            result = ss.run(script.format(most=6), engine=engine)
            assert result.stats.generated == 40
            with pytest.raises(ss2sql.OutOfSteps):
                ss.run(script.format(most=40), engine=engine)
