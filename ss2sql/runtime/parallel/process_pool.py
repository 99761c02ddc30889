"""Worker processes of a session: started when they are first needed, ended with it, and started anew after an end.

A process that starts afresh imports the user's modules, it shares no memory. So a function has to be found by its name
in a module or in a file of functions, and to depend on nothing but its arguments. A script that is run with `python
script.py` is such a file only where it says what it does when it is run, `if __name__ == "__main__":`; all else in it
would be done once more by each process.

A thread here hands a message to a process that is idle and waits for the answer, so waiting works the same on every
system. The pipes to a process are held by nobody else: it ends itself when this process is gone, also when that
was killed, which workers of `concurrent.futures` do not notice.
"""

from __future__ import annotations

import ast
import os
import pickle
import subprocess
import sys
import warnings
import weakref
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from types import FunctionType
from typing import Any, TypeAlias

from ss2sql.errors import WorkersWarning
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.package_data import find_package_file
from ss2sql.runtime.graph_cache.function_fingerprint import NotCacheable, fingerprint_function
from ss2sql.runtime.parallel import IN_WORKER
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
    place = _locate_worker_function(entry.function)
    if isinstance(place, LocalFunction):
        return place
    try:
        return TransferableFunction(place, fingerprint_function(entry.function))
    except NotCacheable as reason:
        return LocalFunction(str(reason), "have it read nothing but plain data")


def _locate_worker_function(function: Callable[..., Any]) -> tuple[Any, ...] | LocalFunction:
    if type(function) is FunctionType:
        if "<" in function.__qualname__:
            return LocalFunction("has no name in a module", "write it at the top of one with def")
        if function.__module__ in ("__main__", "<run_path>"):
            return _locate_in_worker_file(function)
    try:
        pickled = pickle.dumps(function, 5)
    except Exception as error:
        return LocalFunction(f"cannot be pickled: {error}", _TOP)
    if b"__main__" in pickled:
        return LocalFunction(
            "consists of what is defined where Python was started", "write that in a module and import it"
        )
    return ("pickled", pickled)


def _locate_in_worker_file(function: FunctionType) -> tuple[str, ...] | LocalFunction:
    """A function of the script that runs, or of a file of functions that was given on the command line."""
    name, spec = function.__qualname__, getattr(sys.modules.get("__main__"), "__spec__", None)
    if function.__module__ == "__main__" and spec is not None:
        return "module", spec.name, name
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


class ProcessDiedError(Exception):
    """How a process has ended while a call was made there."""


Answer: TypeAlias = tuple[list[bytes | None], float, str]  # results, see call_in_worker; seconds; why it has none


class ProcessPool:
    """The worker processes of one session."""

    def __init__(self) -> None:
        self.processes: list[subprocess.Popen[bytes]] = []
        self._idle: SimpleQueue[subprocess.Popen[bytes]] = SimpleQueue()
        self._threads = ThreadPoolExecutor(1)
        self._started: list[Future[Answer]] = []  # the first message to each
        self._kill: Callable[[], object] = int

    def are_ready(self, patience: float) -> bool:
        """Whether one of them waits for work already, or does after so many seconds."""
        return bool(wait(self._started, patience, FIRST_COMPLETED).done)

    def start_processes(self, number: int, functions: Sequence[TransferableFunction]) -> None:
        """Sees to it that there are so many processes; new ones load these functions first."""
        if len(self.processes) == number:
            return
        self.end_processes()
        self._idle, self._threads = SimpleQueue(), ThreadPoolExecutor(number, "ss2sql worker")
        self.processes = [_start_process() for _ in range(number)]
        self._kill = weakref.finalize(self, _kill_processes, self.processes, self._threads, os.getpid())
        for process in self.processes:
            self._idle.put(process)
        self._started = [self.submit_calls(function, []) for _ in self.processes for function in functions]

    def submit_calls(self, function: TransferableFunction, calls: list[bytes]) -> Future[Answer]:
        """Has a process make calls of a function; the answer raises ProcessDiedError where it has ended."""
        return self._threads.submit(_make_calls, self._idle, (function.place, function.fingerprint, calls))

    def end_processes(self) -> None:
        """Ends the processes at once, whatever they do; nobody waits for their answers any more."""
        self._kill()
        self.processes = []


def _kill_processes(processes: Sequence[subprocess.Popen[bytes]], threads: ThreadPoolExecutor, parent: int) -> None:
    if os.getpid() != parent:  # a copy of the process that started them, made by `fork`
        return
    for process in processes:
        process.kill()
    threads.shutdown(cancel_futures=True)
    for process in processes:
        process.wait()
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            with suppress(OSError):  # there was something left to write
                pipe.close()


def _make_calls(idle: SimpleQueue[subprocess.Popen[bytes]], message: Any) -> Answer:
    """Hands a message to a process and waits for its answer; in a thread of its own."""
    process = idle.get()
    assert process.stdout is not None
    try:
        _send_message(process, message)
        answer: Answer = pickle.load(process.stdout)
    except (EOFError, OSError, ValueError, pickle.UnpicklingError):
        code = process.wait()
        ending = f"was killed by signal {-code}" if code < 0 else f"has ended with exit code {code}"
        raise ProcessDiedError(ending) from None
    finally:
        idle.put(process)
    return answer


def _start_process() -> subprocess.Popen[bytes]:
    flags = subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined]  # -O, -W, -X: as here
    process = subprocess.Popen(
        [sys.executable, *flags, str(find_package_file("ss2sql.runtime.parallel", "worker_process.py"))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, IN_WORKER: "1"},
        start_new_session=True,  # Ctrl-C in a terminal is not for it, not even before it can say so
    )
    fingerprint = str(find_package_file("ss2sql.runtime.graph_cache", "function_fingerprint.py"))
    _send_message(process, (list(sys.path), os.getcwd(), sys.getrecursionlimit(), fingerprint))
    return process


def _send_message(process: subprocess.Popen[bytes], message: Any) -> None:
    assert process.stdin is not None
    with suppress(OSError):  # it has ended, which whoever waits for an answer notices
        pickle.dump(message, process.stdin, 5)
        process.stdin.flush()
