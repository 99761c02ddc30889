"""Which functions other processes can have: those that are the same there as here.

A process that starts afresh imports the user's modules, it shares no memory. So a function has to be found by its name
in a module or in a file of functions, and to depend on nothing but its arguments. A script that is run with `python
script.py` is such a file only where it says what it does when it is run, `if __name__ == "__main__":`; all else in it
would be done once more by each process.
"""

from __future__ import annotations

import ast
import pickle
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

from ss2sql.errors import WorkersWarning
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.runtime.graph_cache.function_fingerprint import fingerprint_function
from ss2sql.runtime.run.run_state import Stats

_PACKAGE = str(Path(__file__).parents[2])
_TOP = "write it at the top of a module"


@dataclass(frozen=True, slots=True)
class TransferableFunction:
    """A function as other processes get it: where it is, and what it must consist of there."""

    place: tuple[Any, ...]
    fingerprint: str


@dataclass(frozen=True, slots=True)
class LocalFunction:
    """Why other processes cannot have a function, and what could be done."""

    reason: str
    cure: str = ""


def describe_transfer(entry: UserFunction) -> TransferableFunction | LocalFunction:
    """A function for other processes, or why they cannot have it."""
    if entry.of_world:
        return LocalFunction("belongs to a world, which is in this process only")
    if entry.vectorized:
        return LocalFunction("takes arrays, so it is called for many rows at once already")
    if entry.volatility != "immutable":
        cure = "declare it immutable if it depends on nothing but its arguments"
        return LocalFunction(f"is {entry.volatility}: it may depend on what only this process knows", cure)
    place = _find_function_place(entry.function)
    if isinstance(place, LocalFunction):
        return place
    return TransferableFunction(place, fingerprint_function(entry.function, strict=False))


def _find_function_place(function: Callable[..., Any]) -> tuple[Any, ...] | LocalFunction:
    if type(function) is FunctionType:
        name = function.__qualname__
        if "<lambda>" in name:
            return LocalFunction("is a lambda", f"{_TOP} with def")
        if "<locals>" in name:
            return LocalFunction("is defined inside of another function", _TOP)
        if function.__module__ in ("__main__", "<run_path>"):
            return _find_in_file(function, name)
    try:
        pickled = pickle.dumps(function, 5)
    except Exception as error:
        return LocalFunction(f"cannot be pickled: {error}", _TOP)
    if b"__main__" in pickled:
        return LocalFunction(
            "consists of what is defined where Python was started", "write that in a module and import it"
        )
    if type(function) is FunctionType:
        return "module", function.__module__, function.__qualname__
    return "pickled", pickled


def _find_in_file(function: FunctionType, name: str) -> tuple[str, ...] | LocalFunction:
    """A function of the script that runs, or of a file of functions that was given on the command line."""
    found = function.__globals__.get(name.partition(".")[0])
    for part in name.split(".")[1:]:
        found = getattr(found, part, None)
    if found is not function:
        return LocalFunction(f"is no longer what is called '{name}' there", _TOP)
    main = sys.modules.get("__main__")
    if function.__module__ == "__main__" and getattr(main, "__spec__", None) is not None:
        return "module", main.__spec__.name, name  # type: ignore[union-attr]
    path = function.__globals__.get("__file__")
    if path is None or not Path(path).is_file():
        return LocalFunction(
            "is defined in a notebook or a shell, which no other process can import", "write it in a module"
        )
    if function.__module__ == "__main__" and not _has_main_guard(Path(path)):
        cure = 'write `if __name__ == "__main__":` before what is run, or the function in a module of its own'
        return LocalFunction(f"is defined in {Path(path).name}, which does its work whenever it is imported", cure)
    return "file", str(Path(path).resolve()), name


def _has_main_guard(path: Path) -> bool:
    """Whether a script asks for `__name__` at its top."""
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return False
    tests = [node.test for node in tree.body if isinstance(node, ast.If)]
    return any(isinstance(node, ast.Name) and node.id == "__name__" for test in tests for node in ast.walk(test))


# --- why not -------------------------------------------------------------------------------------------


def warn_once(stats: Stats, reason: str, cure: str = "") -> None:
    """Warns with a `WorkersWarning` at the place in the user's code that started the run, and notes the same."""
    text = f"workers: {reason}; {cure}" if cure else f"workers: {reason}"
    if text not in stats.notes:
        stats.notes.append(text)
        warnings.warn(text, WorkersWarning, stacklevel=_count_package_frames())


def _count_package_frames() -> int:
    """The number of frames up to the first one that is not of ss2sql, nor of code that it has made."""
    frame, number = sys._getframe(1), 1
    while frame.f_back is not None and frame.f_code.co_filename.startswith((_PACKAGE, "<")):
        frame, number = frame.f_back, number + 1
    return number
