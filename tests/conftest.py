"""The option `--golden`, which writes the expectations of tests/cases anew."""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--golden", action="store_true", help="write the expectations of tests/cases instead of comparing")
