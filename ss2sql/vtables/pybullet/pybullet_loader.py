"""PyBullet on demand: importing this module does not import it, so that ss2sql starts quickly and works without it."""

from __future__ import annotations

import os
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any

from ss2sql.errors import SessionError
from ss2sql.extras import install_line


def require_sim_package(name: str) -> ModuleType:
    """A package of the extra `sim`. Raises the error with the install command."""
    try:
        return import_module(name)
    except ImportError as reason:
        raise SessionError(
            "S003",
            f"scenes need the package {name.partition('.')[0]}, which is not installed",
            hints=(install_line("sim"),),
        ) from reason


@cache
def import_pybullet() -> Any:
    return require_sim_package("pybullet")


@cache
def _make_client_type() -> Any:
    bullet = import_pybullet()
    base: Any = require_sim_package("pybullet_utils.bullet_client").BulletClient

    class Client(base):  # type: ignore[misc]
        """A BulletClient without a window.

        It connects itself, because BulletClient passes options to Bullet, which then writes `argv[0]=`
        to the standard output.
        """

        def __init__(self) -> None:
            self._shapes: dict[int, int] = {}
            self._pid = os.getpid()
            self._client = bullet.connect(bullet.DIRECT)

    return Client


def start_simulation() -> Any:
    """A new simulation without a window, a `pybullet_utils.bullet_client.BulletClient`."""
    return _make_client_type()()
