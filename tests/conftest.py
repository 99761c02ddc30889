"""Fixtures for all tests, which a file of tests may furnish; and `--golden`, which writes tests/cases anew."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from interrupting import as_usual
from sessions import ENGINES, STAFF, write

import ss2sql

# `make test` draws the same each time; with more programs, as in `make test-slow`, each run draws others.
# A busy machine is no error of the code under test.
settings.register_profile("ss2sql", deadline=None, derandomize="SS2SQL_PROGRAMS" not in os.environ)
settings.load_profile("ss2sql")

# Of these tests, which take long, `make test` runs the first of so many cases, and `make test-slow` the others.
SAMPLED = {
    "test_a_built_in_function_asks_every_few_thousand_values": 12,
    "test_the_paths_are_those_of_brute_force_whenever_care_begins": 8,
    "test_rows_come_in_the_order_of_the_table_whatever_its_indexes": 3, "test_random_queries": 4,
    "test_a_function_that_fails_is_called_once_and_fails_no_search_that_has_a_value": 3,
    "test_shows_its_scripts_with_sql_and_rows": 5, "test_a_query_inside_means_the_same_in_every_clause": 3,
    "test_streams_that_are_closed_full_or_endless": 3, "test_errors_have_no_traceback": 7,
    "test_a_timeout_ends_the_building_of_a_value": 3, "test_a_timeout_ends_every_kind_of_run": 3,
    "test_a_view_without_an_end": 3, "test_columns_of_tables_are_left_to_python_where_it_matters": 3,
    "test_random_searches": 2, "test_programs_with_parts_of_others": 2, "test_it_ends_when_it_has_to": 2,
    "test_what_grows_is_refused": 2, "test_names_of_the_notebook": 5,
    "test_paths_and_calls_are_those_that_the_language_asks_for": 3, "test_queries_give_what_loops_give": 3,
    "test_the_wheel_without_extras": 3, "test_engines_give_the_value": 36,
    "test_engines_give_the_value_of_columns_of_tables": 24, "test_engines_give_the_value_of_constants": 24,
    "test_duckdb_gives_the_value": 24, "test_engines_aggregate_alike": 3,
    "test_engines_aggregate_columns_of_tables_alike": 2, "test_paths_may_be_read_in_any_way": 2,
    "test_equal_values_are_the_same_in_any_form": 3, "test_steps_are_bounded": 2,
    "test_random_queries_give_what_copies_give": 3, "test_types_of_several_values_cover_the_value": 3,
    "test_whatever_the_points_are": 3, "test_whatever_the_index_and_the_list_are": 3,
    "test_cells_come_in_order_whatever_index_finds_them": 2, "test_random_queries_one_after_the_other": 2,
    "test_max_memory_bounds_the_value": 2,
}  # fmt: skip


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
    from ss2sql.vtables.pybullet.client import start_bullet

    made = start_bullet()
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


@pytest.fixture(scope="module", autouse=True)
def little_heap() -> None:
    """The collector looks at what a file's tests make, and not at 10,000 tests, which takes it 3 s each time."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> None:
    """All calls are worth other processes."""
    from ss2sql.runtime.parallel import block_calls

    values = {"SAMPLES": 0, "CHEAP": 0.0, "LEAST": 0.0, "START": 0.0, "PATIENCE": 30.0}
    for name, value in values.items():
        monkeypatch.setattr(block_calls, name, value)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--golden", action="store_true", help="write the expectations of tests/cases instead of comparing")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With `--golden` nothing runs but the test that writes; what `SAMPLED` leaves out is slow."""
    if config.getoption("--golden"):
        others = [item for item in items if getattr(item, "originalname", "") != "test_case"]
        config.hook.pytest_deselected(items=others)
        items[:] = [item for item in items if item not in others]
    cases: dict[tuple[Path, str], list[pytest.Item]] = {}
    for item in items:
        name = item.name.partition("[")[0]
        if name in SAMPLED and item.get_closest_marker("slow") is None:
            cases.setdefault((item.path, name), []).append(item)
    for (_, name), several in cases.items():
        for number, item in enumerate(sorted(several, key=lambda item: item.nodeid)):  # the same in every order
            if number % SAMPLED[name]:
                item.add_marker(pytest.mark.slow)
