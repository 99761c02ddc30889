"""What a worker process does: it gets functions, calls them, and gives back what they return, over its pipes.

It is started as a script of its own, so that nothing of ss2sql is imported that the user's modules do not import. A
thread of its own reads, so that the process ends at once when the one that started it is gone, however that ended.
"""

from __future__ import annotations

import functools
import importlib
import io
import marshal
import os
import pickle
import queue
import runpy
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import redirect_stdout
from types import CodeType, FunctionType, MethodType
from typing import Any, BinaryIO

NO_VALUE = b""  # in place of a result that consists of objects, which would be others in another process

# What a result may consist of: what no longer has an identity in another process. NumPy's kinds come on top.
_PLAIN = frozenset({int, float, str, bool, type(None), list, tuple, dict, set, frozenset})


def main() -> None:
    """Answers messages until there are no more."""
    given, answers = _pipes()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes of a terminal; the first one decides
    messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(given, messages), daemon=True).start()
    functions: dict[int, Any] = {}
    while True:
        kind, *rest = messages.get()
        if kind == "begin":
            sys.path[:], folder, limit = rest
            _go_to(folder)
            sys.setrecursionlimit(limit)
            answer: Any = "ready"
        elif kind == "learn":
            number, place, expected = rest
            answer = None
            try:
                with redirect_stdout(io.StringIO()):
                    functions[number] = found = function_at(place)
                answer = None if fingerprint(found) == pickle.loads(expected) else "is another one in a fresh process"
            except BaseException as error:  # whatever the user's module does: it is no reason to die
                answer = f"cannot be found by a fresh process: {type(error).__name__}: {error}"
        else:
            number, calls = rest
            answer = called(functions[number], calls)
        pickle.dump(answer, answers)
        answers.flush()


def _pipes() -> tuple[BinaryIO, BinaryIO]:
    """The pipes of this process, taken away from functions that read or print."""
    given, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return given, answers


def _read(given: BinaryIO, messages: queue.SimpleQueue[Any]) -> None:
    try:
        while True:
            messages.put(pickle.load(given))
    finally:
        os._exit(0)


def _go_to(folder: str) -> None:
    if os.path.isdir(folder):
        os.chdir(folder)


def called(function: Any, calls: list[bytes]) -> tuple[list[bytes | None], float]:
    """The results of calls, and the seconds that all took. None stands for a call that has raised.

    Each result is pickled at once, for a function may change what it has returned later on.
    """
    answers: list[bytes | None] = []
    started = time.perf_counter()
    for arguments in calls:
        try:
            answers.append(pickled(function(*marshal.loads(arguments))))
        except BaseException:  # the call is made again where the script runs, and raises there
            answers.append(None)
    return answers, time.perf_counter() - started


def pickled(result: Any) -> bytes:
    """What a function has returned, as it travels."""
    return pickle.dumps(result, 5) if is_plain(result) else NO_VALUE


def is_plain(value: Any) -> bool:
    """Whether a value consists of numbers, strings and the like, in lists, dicts and arrays."""
    kind = type(value)
    if kind not in _PLAIN:
        return kind.__module__ == "numpy" and getattr(value, "dtype", None) != "object"
    if kind is dict:
        return all(map(is_plain, value)) and all(map(is_plain, value.values()))
    return kind not in (list, tuple, set, frozenset) or all(map(is_plain, value))


# --- functions, in both processes ----------------------------------------------------------------------


@functools.cache
def _names_in(path: str) -> dict[str, Any]:
    return runpy.run_path(path, run_name="<worker>")


def function_at(place: tuple[str, ...]) -> Any:
    """The function that is in a module, in a file that is no module, or pickled."""
    match place:
        case "module", module, name:
            found: Any = importlib.import_module(module)
        case "file", path, name:
            first, _, name = name.partition(".")
            found = _names_in(path)[first]
        case _, pickled:
            return pickle.loads(pickled)  # type: ignore[arg-type]
    for part in filter(None, name.split(".")):
        found = getattr(found, part)
    return found


def fingerprint(function: Any) -> list[Any]:
    """What a function consists of: its code, and the values and functions beside it that it mentions.

    So a module that was changed after it was imported, on the disk or by other code, is noticed.
    """
    found: list[Any] = []
    seen: set[int] = set()
    waiting = [function]
    while waiting:
        body = _python_function(waiting.pop())
        if body is None or id(body) in seen:
            continue
        seen.add(id(body))
        names = sorted(set(_names(body.__code__)))
        values = [(name, body.__globals__[name]) for name in names if name in body.__globals__]
        plain = [(name, _recorded(value)) for name, value in values if is_plain(value)]
        found.append((body.__qualname__, _code(body.__code__), _recorded(body.__defaults__), plain))
        waiting += [
            value
            for _, value in values
            if type(value) is FunctionType and value.__module__ not in sys.stdlib_module_names
        ]
    return found


def _recorded(value: Any) -> Any:
    """A plain value in a form that `==` compares; nothing for others."""
    kind = type(value)
    if not is_plain(value):
        return None
    return kind.__name__, pickle.dumps(value) if kind is float or kind.__module__ == "numpy" else value


def _python_function(value: Any) -> FunctionType | None:
    if isinstance(value, functools.partial):
        return _python_function(value.func)
    if isinstance(value, MethodType):
        return _python_function(value.__func__)
    if type(value) is FunctionType:
        return value
    body = getattr(type(value), "__call__", None)  # noqa: B004 - its code is wanted
    return body if type(body) is FunctionType else None


def _code(code: CodeType) -> tuple[Any, ...]:
    constants = [_code(part) if isinstance(part, CodeType) else (type(part).__name__, part) for part in code.co_consts]
    return code.co_code, code.co_names, code.co_varnames, tuple(constants)


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _names(part)


if __name__ == "__main__":
    main()
