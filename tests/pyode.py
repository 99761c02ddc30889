"""Finds ODE's module for tests: Debian's python3-pyode puts it where only Debian's own Python looks."""

from __future__ import annotations

import importlib
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

DEBIAN = Path("/usr/lib/python3/dist-packages")


def load(folder: Path) -> Any | None:
    """The module `ode`, or None. Debian's extension is linked into a folder of its own, for nothing else from there
    may be imported: its packages belong to another Python."""
    if (known := _imported()) is not None:
        return known
    found = [path for suffix in EXTENSION_SUFFIXES if (path := DEBIAN / f"ode{suffix}").exists()]
    if not found:
        return None
    (folder / found[0].name).symlink_to(found[0])
    sys.path.insert(0, str(folder))
    try:
        importlib.invalidate_caches()
        return _imported()
    finally:
        sys.path.remove(str(folder))


def _imported() -> Any | None:
    try:
        module = importlib.import_module("ode")
    except ImportError:
        return None
    if not hasattr(module, "GeomSphere"):  # another package of this name, which integrates equations
        del sys.modules["ode"]
        return None
    return module
