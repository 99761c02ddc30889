"""A hint shows the right form in the user's own names, and this form runs: it is read from the error and run."""

from __future__ import annotations

import ast
import re

import pytest
from cases.data import Body
from golden import each_row

import ss2sql

STAFF = (
    "CREATE TABLE staff(id INTEGER PRIMARY KEY, name TEXT, boss INTEGER, age INTEGER);"
    "INSERT INTO staff VALUES (1, 'Ann', NULL, 40), (2, 'Bob', 1, 37), (3, 'Cy', 2, 36)"
)


def session() -> ss2sql.Session:
    ss = ss2sql.connect()
    ss.host.connection.execute(STAFF)
    ss.attach("pairs", [[0, 1], [1, 2]])
    ss.set("m", {"A": 1})
    ss.set("k", 2)
    ss.set("body", Body("anvil", 80.0))
    ss.attach("bodies", [Body("anvil", 80.0)])
    return ss


def form_of(error: ss2sql.Error) -> str:
    """What the first hint says to write."""
    found = re.match(
        r"write (.*?)(?: to compare| to join strings| to name .*| for .*|, s\.x .*| to choose .*)?\Z", error.hints[0]
    )
    assert found is not None, error.hints
    return found[1]


@each_row("errors/hints", "marked", "value")
def test_the_form_in_the_hint_runs(marked: str, value: str) -> None:
    before, wrong, behind = re.split("[«»]", marked)
    with session() as ss:
        with pytest.raises(ss2sql.Error) as caught:
            ss.run(before + wrong + behind)
        form = form_of(caught.value)
        if form.startswith("; in front of "):
            form = f"; {wrong}"
        elif form.endswith(", right after CONNECT BY"):
            form = f"CONNECT BY {form.removesuffix(' right after CONNECT BY')} PRIOR id == boss"
        assert ss.eval(before + form + behind) == ast.literal_eval(value)
