"""What a worker process does: it gets functions, calls them, and gives back what they return, over its pipes.

It is started as a script of its own, so that nothing of ss2sql is imported that the user's modules do not import. A
thread of its own reads, so that the process ends at once when the one that started it is gone, however that ended.
"""

from __future__ import annotations

import functools
import importlib
import io
import marshal
import operator
import os
import pickle
import queue
import runpy
import signal
import sys
import threading
import time
from contextlib import redirect_stdout
from types import SimpleNamespace
from typing import Any, BinaryIO

NO_VALUE = b""  # in place of a result that consists of objects, which would be others in another process

# What a result may consist of: what no longer has an identity in another process. NumPy's kinds come on top.
_PLAIN = frozenset({int, float, str, bool, type(None), list, tuple, dict, set, frozenset})


def answer_messages() -> None:
    """Answers messages until there are no more."""
    tasks, answers = _take_pipes()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes of a terminal; the first one decides
    messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_read_messages, args=(tasks, messages), daemon=True).start()
    sys.path[:], folder, limit, path = messages.get()
    if os.path.isdir(folder):
        os.chdir(folder)
    sys.setrecursionlimit(limit)
    fingerprint = runpy.run_path(path)["fingerprint_function"]
    functions: dict[Any, Any] = {}  # by places and fingerprints: a function, or why it cannot be had
    while True:
        place, expected, calls = messages.get()
        found = functions.get((place, expected))
        if found is None:
            try:
                with redirect_stdout(io.StringIO()):
                    found = load_worker_function(place)
                if fingerprint(found) != expected:
                    found = "is another one in a fresh process"
            except BaseException as error:  # whatever the user's module does: it is no reason to die
                found = f"cannot be found by a fresh process: {type(error).__name__}: {error}"
            functions[place, expected] = found
        pickle.dump(([], 0.0, found) if isinstance(found, str) else (*call_in_worker(found, calls), ""), answers)
        answers.flush()


def _take_pipes() -> tuple[BinaryIO, BinaryIO]:
    """The pipes of this process, taken away from functions that read or print."""
    tasks, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return tasks, answers


def _read_messages(tasks: BinaryIO, messages: queue.SimpleQueue[Any]) -> None:
    try:
        while True:
            messages.put(pickle.load(tasks))
    finally:
        os._exit(0)


def call_in_worker(function: Any, calls: list[bytes]) -> tuple[list[bytes | None], float]:
    """The results of calls, and the seconds that all took. None stands for a call that has raised.

    Each result is pickled at once, for a function may change what it has returned later on.
    """
    answers: list[bytes | None] = []
    started = time.perf_counter()
    for arguments in calls:
        try:
            result = function(*marshal.loads(arguments))
            answers.append(pickle.dumps(result, 5) if is_plain_worker_value(result) else NO_VALUE)
        except BaseException:  # the call is made again where the script runs, and raises there
            answers.append(None)
    return answers, time.perf_counter() - started


def is_plain_worker_value(value: Any) -> bool:
    """Whether a value consists of numbers, strings and the like, in lists, dicts and arrays."""
    kind = type(value)
    if kind not in _PLAIN:
        return kind.__module__ == "numpy" and getattr(value, "dtype", None) != "object"
    if kind is dict:
        return all(map(is_plain_worker_value, value)) and all(map(is_plain_worker_value, value.values()))
    return kind not in (list, tuple, set, frozenset) or all(map(is_plain_worker_value, value))


@functools.cache
def _run_worker_file(path: str) -> dict[str, Any]:
    return runpy.run_path(path, run_name="<worker>")


def load_worker_function(place: tuple[Any, ...]) -> Any:
    """The function that is in a module, in a file that is no module, or pickled."""
    match place:
        case "module", module, name:
            return operator.attrgetter(name)(importlib.import_module(module))
        case "file", path, name:
            return operator.attrgetter(name)(SimpleNamespace(**_run_worker_file(path)))
        case _, pickled:
            return pickle.loads(pickled)


if __name__ == "__main__":
    answer_messages()
