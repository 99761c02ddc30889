"""Spark in short: a search and a query of its own engine give what they give natively. The other files are slow."""

from __future__ import annotations

from level_searches import FORMS, agree

import ss2sql


def test_a_search_and_a_query(ss: ss2sql.Session) -> None:
    agree(ss, FORMS[1].format("UNIQUE"))
    flat = "SELECT this * 2 FROM range(5) WHERE this > 1 AS list;"
    assert ss.run(flat).value == ss.run(flat, engine="native").value == [4, 6, 8]
