"""Data files of the package, also where the package lies in a zip file."""

from __future__ import annotations

import atexit
from contextlib import ExitStack
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path


@cache
def find_package_file(package: str, name: str) -> Path:
    """The path of a data file; out of a zip file it is unpacked for the lifetime of this process."""
    unpacked = ExitStack()
    atexit.register(unpacked.close)
    return unpacked.enter_context(as_file(files(package) / name))
