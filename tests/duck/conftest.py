"""Sessions that ask DuckDB."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

import ss2sql


@pytest.fixture
def own() -> Iterator[Any]:
    """A connection of the user's."""
    duckdb = pytest.importorskip("duckdb")
    with duckdb.connect(config={"threads": 1}) as connection:
        yield connection


@pytest.fixture
def ss(own: Any) -> Iterator[ss2sql.Session]:
    with ss2sql.connect(engine="duckdb", session=own) as session:
        yield session
