"""The calls that a block of states needs, made by other processes before the states are expanded.

The step function is run ahead over the states of a block, with notes (runtime/search/step_contract.py): a call of the
user's that is not remembered is not made, but sent to the processes, and remembered with what it gives. Then the steps
that needed it are taken again. In the end the states are expanded as ever; so the paths, their order and the errors are
those of one process, whatever the processes do. A call that raises elsewhere is made once more, here.

To hand a call to another process and to take back its result costs 10 to 15 us.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import suppress
from marshal import dumps, loads
from pickle import loads as unpickle
from time import perf_counter
from typing import Any

from ss2sql.errors import ExecutionError, Stopped
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.language.plan_traversal import list_plan_functions
from ss2sql.language.values import State, convert_value
from ss2sql.runtime.parallel.process_pool import (
    Answer,
    LocalFunction,
    ProcessDiedError,
    ProcessPool,
    TransferableFunction,
    describe_transfer,
    warn_once,
)
from ss2sql.runtime.parallel.worker_process import NO_VALUE
from ss2sql.runtime.run.calls import report_memo_counts
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.search.search_run import SearchRun
from ss2sql.runtime.search.step_contract import Notes, Pair

BLOCK = 256  # states
SAMPLES = 3  # calls that are made here, to see what they cost
LONG = 0.01  # seconds of a call that is sample enough by itself
CHEAP = 50e-6  # seconds of a call below which it stays here
START = 0.05  # seconds of work before processes are started, which takes longer if the user's modules are large
PATIENCE = 0.0  # seconds that this process waits for those that start; until they are ready it makes the calls itself
LEAST = 0.001  # seconds of work for each worker that are worth a round of messages
BATCH = 0.01  # seconds of work for one message
LOOK = 0.02  # seconds between two looks at whether the run has to end


class PendingError(BaseException):
    """A result is not known yet."""


@dataclass(slots=True)
class TimedCalls:
    """A function of the user in one run, and what its calls have cost here and elsewhere.

    `sent` is what other processes get, or why they cannot have it.
    """

    name: str
    sent: TransferableFunction | LocalFunction
    calls: int = 0
    seconds: float = 0.0

    @property
    def cost(self) -> float:
        """Seconds of one call."""
        return self.seconds / max(self.calls, 1)

    @property
    def is_known(self) -> bool:
        """Whether enough calls were made to say what one costs."""
        return self.calls >= SAMPLES or self.seconds >= LONG

    @property
    def may_be_shared(self) -> bool:
        """Whether other processes get calls of it, or it is too early to say."""
        return isinstance(self.sent, TransferableFunction) and (self.cost >= CHEAP or not self.is_known)

    @property
    def is_shared(self) -> bool:
        return self.may_be_shared and self.is_known

    def note_time(self, calls: int, seconds: float) -> None:
        self.calls += calls
        self.seconds += seconds


class BlockCalls:
    """The steps from one state, taken as far as the results of calls are known. They do not count."""

    counted = 0

    def __init__(self, notes: Notes, at: int, state: State) -> None:
        self.notes, self.at, self.state = notes, at, state
        self.open: list[Pair] | None = notes.pairs[at]

    def get_known_pairs(self) -> list[Pair] | None:
        return self.open

    def begin_state(self, items: list[Any]) -> list[Pair]:
        self.open = self.notes.pairs[self.at] = self.notes.pair_elements(items)
        return self.open

    def evaluate_open_steps(self, seen: Container[Hashable]) -> bool:
        """Takes the steps that are open; gives whether some of them still wait for a result.

        Where a step fails, the search ends.
        """
        waiting = list[Pair]()
        while True:
            for note, _ in self.open or ():
                note[-1] = False
            try:
                for _ in self.notes.noted.expand(self.state, seen, self):
                    pass
                break
            except PendingError:
                evaluated = sum(note[-1] for note, _ in self.open or ())
                if not evaluated or self.open is None:  # the elements wait, or what all steps share
                    return True
                waiting.append(self.open[evaluated - 1])
                self.open = self.open[evaluated:]
            except Stopped:
                raise
            except Exception:
                return False
        self.open = waiting
        return bool(waiting)


class CallPrefetcher:
    """Makes calls of one run in other processes; says what hinders it."""

    def __init__(
        self, run: Run, workers: int, processes: ProcessPool, planned: Mapping[str, UserFunction], remembers: bool
    ) -> None:
        self.run = run
        self.workers = workers
        self.processes = processes
        self.planned = planned
        self.remembers = remembers
        self.searched: set[int] = set()  # searches with MEMORIZE
        self.functions: dict[str, TimedCalls] = {}  # that these call, or the run
        self.noting = False
        self.waiting: dict[str, list[bytes]] = {}  # calls by functions, as marshal bytes of arguments
        self.wanted: set[tuple[str, bytes]] = set()  # of a block

    def make_timed_call(self, entry: UserFunction, real: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """A call as it is made where it is not remembered: `real`, unless it is one for other processes."""
        timed = self._get_timed(entry)

        def call_timed(arguments: Any) -> Any:
            if self.noting and timed.is_shared:
                self._request(entry.name, tuple(arguments))
                raise PendingError
            started = perf_counter()
            result = real(arguments)
            timed.note_time(1, perf_counter() - started)
            return result

        return call_timed

    def _request(self, name: str, arguments: tuple[Any, ...]) -> None:
        """Has a call wait that is not wanted in this block yet; one with objects is made here."""
        try:
            key = dumps(arguments, 2)
        except ValueError:
            return
        if (name, key) not in self.wanted:
            self.wanted.add((name, key))
            self.waiting.setdefault(name, []).append(key)

    def _get_timed(self, entry: UserFunction) -> TimedCalls:
        if entry.name not in self.functions:
            self.functions[entry.name] = TimedCalls(entry.name, describe_transfer(entry))
        return self.functions[entry.name]

    def _keep_local(self, timed: TimedCalls, kept: LocalFunction) -> None:
        timed.sent = kept
        warn_once(self.run.stats, f"'{timed.name}' is called in this process only: it {kept.reason}", kept.cure)

    def begin_search(self, search_run: SearchRun) -> None:
        """Takes note of a search, and says what stays in this process."""
        if search_run.query.id in self.searched:
            return
        self.searched.add(search_run.query.id)
        if search_run.noted is None:
            cure = "declare functions immutable that are, and assign nothing inside of the search"
            warn_once(self.run.stats, "the search calls a function that is volatile, or assigns a variable", cure)
            return
        for function in list_plan_functions(search_run.query):
            if not function.builtin:
                timed = self._get_timed(self.planned[function.name])
                if isinstance(timed.sent, LocalFunction):
                    self._keep_local(timed, timed.sent)

    def refuse_search(self, search_run: SearchRun) -> None:
        """Says that a search stays in this process, as its graph is not one of whole rows from a single start."""
        self.searched.add(search_run.query.id)
        reason = "no effect on a search with a condition in CONNECT BY or START WITH, a key after BY, EACH, or a trace"
        warn_once(self.run.stats, reason, "end paths by STOP WITH in place of a condition, and let rows be the states")

    def report_idle(self) -> None:
        """Says why there was nothing to do, if so."""
        stats = self.run.stats
        report_memo_counts(self.run)
        if not self.searched:
            warn_once(stats, "no effect: only searches with MEMORIZE have levels")
        elif not self.remembers:
            warn_once(stats, "no effect: calls are not remembered", "leave 'memo' out of connect(disable=...)")
        elif not self.functions and not any(note.startswith("workers: ") for note in stats.notes):
            warn_once(stats, "no effect: the search calls no Python function")
        else:
            for timed in self.functions.values():
                if isinstance(timed.sent, TransferableFunction) and timed.calls and not timed.is_shared:
                    stats.notes.append(f"workers: a call of '{timed.name}' is too short to be made by another process")

    # --- blocks of states ------------------------------------------------------------------------------

    def prefetch_blocks(self, level: Sequence[State], notes: Notes, seen: Container[Hashable]) -> Iterator[State]:
        """The states of a level; before they come out their calls are made, block by block.

        `seen` are the rows that are known.
        """
        for place in range(0, len(level), BLOCK):
            block = level[place : place + BLOCK]
            if self.remembers and any(timed.may_be_shared for timed in self.functions.values()):
                self._prefetch_calls([BlockCalls(notes, at, state) for at, state in enumerate(block, place)], seen)
            yield from block

    def _prefetch_calls(self, ahead: list[BlockCalls], seen: Container[Hashable]) -> None:
        self.noting = True
        try:
            while (ahead := [one for one in ahead if one.evaluate_open_steps(seen)]) and self._can_send():
                self._send_and_await()
        except BaseException:  # a timeout, Ctrl-C, a process that died: nobody waits for the answers any more
            self.processes.end_processes()
            raise
        finally:
            self.noting = False
            self.waiting.clear()
            self.wanted.clear()

    def _can_send(self) -> bool:
        """Whether the calls that wait are worth messages, and there are processes; they are started when it is."""
        work = sum(len(calls) * self.functions[name].cost for name, calls in self.waiting.items())
        done = sum(timed.seconds for timed in self.functions.values() if timed.is_shared)
        started = self.processes.processes or work + done >= START
        if not self.waiting or work < LEAST * self.workers or not started:
            return False
        sent = [timed.sent for timed in self.functions.values() if isinstance(timed.sent, TransferableFunction)]
        try:
            self.processes.start_processes(self.workers, sent)
        except OSError as error:
            for timed in self.functions.values():
                timed.sent = LocalFunction("")
            warn_once(self.run.stats, f"no other process can be started: {error}")
            return False
        return self.processes.are_ready(PATIENCE)

    def _send_and_await(self) -> None:
        """Has the processes make the calls that wait. Raises ExecutionError X013 where a process has died."""
        sent = dict[Future[Answer], tuple[TimedCalls, list[bytes]]]()
        for name, calls in self.waiting.items():
            timed = self.functions[name]
            assert isinstance(timed.sent, TransferableFunction)
            rounds = max(1, round(len(calls) * timed.cost / (BATCH * self.workers)))
            for number in range(parts := min(len(calls), self.workers * rounds)):  # in equal parts
                part = calls[number::parts]
                sent[self.processes.submit_calls(timed.sent, part)] = timed, part
        self.waiting = {}
        while sent:
            self.run.check()
            for answer in wait(sent, LOOK, FIRST_COMPLETED).done:
                self._take_answer(*sent.pop(answer), answer)

    def _take_answer(self, timed: TimedCalls, calls: list[bytes], answer: Future[Answer]) -> None:
        """Remembers calls; one that gives no value of the language is made once more, here."""
        name = timed.name
        try:
            results, seconds, refused = answer.result()
        except ProcessDiedError as error:
            hints = (
                f"'{name}' ends its process or needs more memory than there is; workers=1 calls it in this one",
                "the session works on, with new workers",
            )
            raise ExecutionError("X013", f"a worker {error} while it called '{name}'", hints=hints) from None
        if refused:
            cure = "what a module is made of must not change while it is used"
            self._keep_local(timed, LocalFunction(refused, cure))
        if NO_VALUE in results:
            self._keep_local(timed, LocalFunction("returns objects, which would be others in another process"))
        timed.note_time(len(results), seconds)
        memory: Any = self.run.callables[name]
        for arguments, result in zip(calls, results, strict=False):
            if result:
                with suppress(ExecutionError):
                    memory.adopt(loads(arguments), convert_value(unpickle(result), f"the function '{name}'"))
                    self.run.stats.calls[name] += 1
