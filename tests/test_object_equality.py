"""Objects equal objects only, whatever their own `==` says of numbers and strings; see language.md, Values."""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from typing import Any

import pytest

import ss2sql


class Same:
    """It calls itself equal to what it holds, and to others that hold the same."""

    def __init__(self, held: Any) -> None:
        self.held = held

    def __eq__(self, other: object) -> bool:
        return bool(self.held == (other.held if isinstance(other, Same) else other))

    def __hash__(self) -> int:
        return hash(self.held)

    def __repr__(self) -> str:
        return f"Same({self.held!r})"


PAIRS = [(Same(1), 1), (Same("a"), "a"), (Same(True), True), (Same(None), None), (Decimal(1), 1), (Fraction(1, 2), 0.5)]


@pytest.fixture(params=PAIRS, ids=repr)
def pair(request: pytest.FixtureRequest, ss: ss2sql.Session) -> tuple[Any, Any]:
    """An object and a value that it calls equal; a list, a function, a dict and columns that hold them."""
    thing, plain = request.param
    assert thing == plain
    ss.attach("both", [thing, plain])
    ss.attach("one", [thing])
    ss.attach("other", [plain])
    ss.attach("rows", [{"k": thing, "n": 1}, {"k": plain, "n": 2}])
    ss.function("give", lambda: thing, volatility="immutable")
    ss.set("plain", plain)
    return thing, plain


FALSE = [
    *("one[0] == other[0]", "other[0] == one[0]", "one == other", "[one] == [other]", "one[0] == plain"),
    *("give() == plain", "one[0] IN other", "other[0] IN one", "give() IN [plain]"),
]
COUNTS = {  # scripts and the number of rows, of which there would be fewer or more if the two were equal
    "SELECT a.this FROM a = one, b = other WHERE a.this == b.this AS list": 0,
    "SELECT a.n FROM a = rows, b = rows WHERE a.k == b.k AS list": 2,
    "SELECT this FROM both WHERE this == plain AS list": 1,
    "SELECT n FROM rows WHERE k == plain AS list": 1,
    "SELECT n FROM rows WHERE k IN [plain] AS list": 1,
    "SELECT this FROM both GROUP BY this AS list": 2,
    "uniq(both);": 2,
    "SELECT this FROM both START WITH n = 0 CONNECT BY UNIQUE n = 1 STOP WITH n > 0 AS list": 2,
    "SELECT this FROM both START WITH n = 0 CONNECT BY BREADTH FIRST NO CYCLE n = n + 1 STOP WITH n > 1 AS list": 4,
    "SELECT this FROM both START WITH n = 0 CONNECT BY MEMORIZE 2 n = n + 1 AS list": 4,
}


@pytest.mark.parametrize("script", [*(f"SELECT 1 FROM [1] WHERE {one} AS list" for one in FALSE), *COUNTS, *FALSE])
def test_objects_equal_no_plain_values(ss: ss2sql.Session, pair: tuple[Any, Any], engine: Any, script: str) -> None:
    try:
        found = ss.run(script, engine=engine).value
        assert found is False if script in FALSE else len(found) == COUNTS.get(script, 0)
    except ss2sql.UnsupportedError:
        assert engine == "database"


def test_objects_keep_their_own_equality_among_each_other(ss: ss2sql.Session, engine: Any) -> None:
    things = [Same(1), Same(1), Decimal("1.0"), Decimal(1), Same(2)]
    ss.attach("things", things)
    assert ss.run("SELECT a.this FROM a = things, b = things WHERE a.this == b.this AS list", engine=engine).value == [
        a for a in things for b in things if a == b
    ]
    assert ss.run("SELECT this FROM things AS list", engine=engine).value[2] is things[2]
