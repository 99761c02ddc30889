"""Fixtures for all tests, which a file of tests may furnish; and `--golden`, which writes tests/cases anew."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from interrupting import as_usual
from sessions import ENGINES, STAFF, write

import ss2sql


@pytest.fixture
def ss() -> Iterator[ss2sql.Session]:
    """A session with nothing in it."""
    with ss2sql.connect() as session:
        yield session


@pytest.fixture(params=ENGINES)
def engine(request: pytest.FixtureRequest) -> Any:
    """Each engine in turn."""
    return request.param


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Where a database may be written."""
    return tmp_path / "data.db"


@pytest.fixture
def staff(file: Path) -> Path:
    """A database of four people."""
    write(file, STAFF)
    return file


@pytest.fixture(scope="module")
def simulation() -> Iterator[Any]:
    """PyBullet, once for a file of tests: each takes 29 MB that never come back."""
    from ss2sql.scenes.bullet import connect

    made = connect()
    yield made
    made.disconnect()


@pytest.fixture
def client(simulation: Any) -> Any:
    """PyBullet without bodies."""
    simulation.resetSimulation()
    return simulation


@pytest.fixture
def usual() -> Iterator[None]:
    """Ctrl-C is heard here, and by processes that are started."""
    with as_usual():
        yield


@pytest.fixture(scope="module")
def little_heap() -> Iterator[None]:
    """`gc.collect` looks at what the tests of a file make, and not at 16,000 tests, which takes it 3 s each time."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> None:
    """All calls are worth other processes."""
    from ss2sql.runtime.workers import foretelling, timing

    monkeypatch.setattr(timing, "SAMPLES", 0)
    monkeypatch.setattr(timing, "CHEAP", 0.0)
    monkeypatch.setattr(foretelling, "LEAST", 0.0)
    monkeypatch.setattr(foretelling, "FEWEST", 1)
    monkeypatch.setattr(foretelling, "START", 0.0)
    monkeypatch.setattr(foretelling.Foreteller, "_own_answer", lambda _: None)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--golden", action="store_true", help="write the expectations of tests/cases instead of comparing")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With `--golden` nothing runs but the test that writes."""
    if config.getoption("--golden"):
        others = [item for item in items if getattr(item, "originalname", "") != "test_case"]
        config.hook.pytest_deselected(items=others)
        items[:] = [item for item in items if item not in others]
