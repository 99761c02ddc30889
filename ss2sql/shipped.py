"""Files that are shipped with the package and are no code, also where the package lies in a zip file."""

from __future__ import annotations

import atexit
from contextlib import ExitStack
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path


@cache
def path_of(package: str, name: str) -> Path:
    """The path of a file, for programs that take no other; from a zip file it is unpacked until this process ends."""
    unpacked = ExitStack()
    atexit.register(unpacked.close)
    return unpacked.enter_context(as_file(files(package) / name))
