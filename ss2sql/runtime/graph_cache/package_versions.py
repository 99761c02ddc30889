"""Whose a module is: Python's, that of an installed package, or the user's own."""

from __future__ import annotations

import platform
import site
import sys
import sysconfig
from functools import cache
from hashlib import sha256
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path


def find_package_version(module: str | None) -> str | None:
    """The name and the version of what a module belongs to; None where it is the user's own, which may change."""
    return None if module is None else _find_package_version(module.partition(".")[0])


@cache
def _find_package_version(package: str) -> str | None:
    if package == "__main__":
        return None
    if package in sys.stdlib_module_names:
        return f"Python {platform.python_version()}"
    if package == "ss2sql":  # wherever it lies
        return f"ss2sql {_find_version(package)}"
    file = _find_package_file(package)
    if file is None:
        return None
    installed = any(file.is_relative_to(folder) for folder in _list_package_folders())
    version = _find_version(package) if installed else None
    if version is not None:
        return f"{package} {version}"
    if installed or file.suffix != ".py":  # compiled, or installed without a version
        return f"{package} {sha256(file.read_bytes()).hexdigest()}"
    return None


def _find_package_file(package: str) -> Path | None:
    """The file of a package; None where it has none."""
    file = getattr(sys.modules.get(package), "__file__", None)
    if file is None:
        try:
            spec = find_spec(package)
        except (ImportError, ValueError):
            return None
        file = None if spec is None else spec.origin
    path = None if file is None else Path(file)
    return path.resolve() if path is not None and path.is_file() else None


def _find_version(package: str) -> str | None:
    version = getattr(sys.modules.get(package), "__version__", None)
    if isinstance(version, str):
        return version
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _list_package_folders() -> list[Path]:
    """Where packages are installed."""
    paths = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib"), *site.getsitepackages()}
    user = site.getusersitepackages()
    return [Path(path).resolve() for path in (*paths, user)]
