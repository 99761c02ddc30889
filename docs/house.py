"""The house of ss2sql/ARCHITECTURE.md: every room with its files, from their docstrings, in the order of `ORDER`."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from writing import first

import ss2sql

PACKAGE = Path(ss2sql.__path__[0])
SHIPPED = {
    ".lark": "the grammar",
    ".json": "data that ships with the package",
    ".html": "a template",
    ".urdf": "a robot",
}


def house() -> str:
    """A section for each folder: what its docstring begins with, and a line for each file."""
    folders = sorted(
        {path.parent for path in PACKAGE.rglob("*.py")}, key=lambda folder: folder.relative_to(PACKAGE).parts
    )
    return "\n\n".join(map(_section, sorted(folders)))


def _section(folder: Path) -> str:
    name = "/".join(("ss2sql", *folder.relative_to(PACKAGE).parts))
    about = _docstring(folder / "__init__.py")
    lines = [f"- `{path.name}`: {_line(path)}" for path in _ordered(folder, about)]
    return "\n".join([f"### `{name}/`", "", first(about), "", *lines])


def _ordered(folder: Path, about: str) -> list[Path]:
    """The files of a folder in the order in which its docstring names them, then the others by name."""

    def place(path: Path) -> tuple[int, str]:
        found = re.search(rf"\b{path.stem}\b", about.partition("\n\n")[2])
        return (found.start() if found else len(about)), path.name

    return sorted(_files(folder), key=place)


def _files(folder: Path) -> Iterator[Path]:
    for path in folder.iterdir():
        if (path.suffix == ".py" and path.name != "__init__.py") or path.suffix in SHIPPED:
            yield path


def _line(path: Path) -> str:
    return first(_docstring(path)).rstrip(".:") if path.suffix == ".py" else SHIPPED[path.suffix]


def _docstring(path: Path) -> str:
    return ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
