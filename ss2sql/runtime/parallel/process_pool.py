"""Worker processes of a session: started when they are first needed, ended with it, and started anew after an end.

Each has a thread here that hands it one message after the other and waits for the answer, so waiting works the same on
every system. The pipes to a process are held by nobody else: it ends itself when this process is gone, also when that
was killed, which workers of `concurrent.futures` do not notice.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
import weakref
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import field
from queue import Empty, SimpleQueue
from typing import Any, TypeAlias

from ss2sql.fast_dataclasses import dataclass
from ss2sql.package_data import find_file
from ss2sql.runtime.parallel import IN_WORKER
from ss2sql.runtime.parallel.transferable_functions import TransferableFunction


@dataclass(frozen=True, slots=True)
class Task:
    """Calls of one function, which has a `name` here; its answer goes to `answers`."""

    name: str
    function: TransferableFunction
    calls: list[bytes]
    answers: SimpleQueue[Answer]


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a task: a result for each call, None for those that have to be made again; the seconds they took.

    `refused` says why the process does not have the function, `died` how the process ended.
    """

    task: Task
    results: list[bytes | None] = field(default_factory=list)
    seconds: float = 0.0
    refused: str = ""
    died: str = ""
    ended: bool = False


Tasks: TypeAlias = SimpleQueue[Task | None]


class ProcessPool:
    """The worker processes of one session."""

    def __init__(self) -> None:
        self._crew: _Crew | None = None
        self._at_the_end: weakref.finalize[[], ProcessPool] | None = None

    @property
    def started(self) -> bool:
        return self._crew is not None

    def are_ready(self, patience: float) -> bool:
        """Whether one of them waits for work already, or does after so many seconds."""
        return self._crew is not None and self._crew.ready.wait(patience)

    def start_processes(self, number: int, functions: Sequence[TransferableFunction]) -> None:
        """Sees to it that there are so many processes; new ones have these functions before they are ready."""
        if self._crew is not None and self._crew.size != number:
            self.end_processes()
        if self._crew is None:
            self._crew = _Crew(functions, number)
            self._at_the_end = weakref.finalize(self, self._crew.kill_processes)

    def add_task(self, task: Task) -> None:
        assert self._crew is not None
        self._crew.tasks.put(task)

    def end_processes(self) -> None:
        """Ends the processes at once, whatever they do; waiting tasks are answered as `ended`."""
        self._crew = None
        if self._at_the_end is not None:
            self._at_the_end()


class _Crew:
    """Processes that share a queue of tasks, and the threads that serve them."""

    def __init__(self, functions: Sequence[TransferableFunction], size: int) -> None:
        self.size = size
        self.parent = os.getpid()
        self.tasks: Tasks = SimpleQueue()
        self.ready, self.over = threading.Event(), threading.Event()
        self.processes = [_start_process() for _ in range(size)]
        for process in self.processes:
            arguments = (process, functions, self.tasks, self.ready, self.over)
            threading.Thread(target=_serve_process, args=arguments, name="ss2sql worker", daemon=True).start()

    def kill_processes(self) -> None:
        if os.getpid() != self.parent:  # a copy of the process that started them, made by `fork`
            return
        self.over.set()
        with suppress(Empty):
            while True:
                task = self.tasks.get_nowait()
                if task is not None:
                    task.answers.put(Answer(task, ended=True))
        for process in self.processes:
            process.kill()
            self.tasks.put(None)
        for process in self.processes:
            process.wait()


def _start_process() -> subprocess.Popen[bytes]:
    flags = subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined]  # -O, -W, -X: as here
    process = subprocess.Popen(
        [sys.executable, *flags, str(find_file("ss2sql.runtime.parallel", "worker_process.py"))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, IN_WORKER: "1"},
        start_new_session=True,  # Ctrl-C in a terminal is not for it, not even before it can say so
    )
    fingerprint = str(find_file("ss2sql.runtime.graph_cache", "function_fingerprint.py"))
    _send_message(process, (list(sys.path), os.getcwd(), sys.getrecursionlimit(), fingerprint))
    return process


def _send_message(process: subprocess.Popen[bytes], message: Any) -> None:
    assert process.stdin is not None
    with suppress(OSError):  # it has ended, which whoever waits for an answer notices
        pickle.dump(message, process.stdin, 5)
        process.stdin.flush()


def _serve_process(
    process: subprocess.Popen[bytes],
    functions: Sequence[TransferableFunction],
    tasks: Tasks,
    ready: threading.Event,
    over: threading.Event,
) -> None:
    """Hands tasks to a process until it ends; a thread of its own."""
    assert process.stdin is not None
    assert process.stdout is not None
    with suppress(EOFError, OSError, pickle.UnpicklingError):  # the first task will notice
        for function in functions:
            _send_message(process, (function.place, function.fingerprint, []))
            pickle.load(process.stdout)
    ready.set()
    while (task := tasks.get()) is not None:
        try:
            _send_message(process, (task.function.place, task.function.fingerprint, task.calls))
            task.answers.put(Answer(task, *pickle.load(process.stdout)))
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            task.answers.put(Answer(task, died=_describe_process_end(process), ended=over.is_set()))
            break
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):  # there was something left to write
            pipe.close()


def _describe_process_end(process: subprocess.Popen[bytes]) -> str:
    code = process.wait()
    return f"was killed by signal {-code}" if code < 0 else f"has ended with exit code {code}"
