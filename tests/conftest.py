"""The option `--golden`, which writes the expectations of tests/cases anew."""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--golden", action="store_true", help="write the expectations of tests/cases instead of comparing")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With `--golden` nothing runs but the test that writes."""
    if config.getoption("--golden"):
        others = [item for item in items if getattr(item, "originalname", "") != "test_answer"]
        config.hook.pytest_deselected(items=others)
        items[:] = [item for item in items if item not in others]
