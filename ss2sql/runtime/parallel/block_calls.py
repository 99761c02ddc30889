"""The calls that a block of states needs, made by other processes before the states are expanded.

The step function is run ahead over the states of a block, with notes (runtime/search/step_contract.py): a call of the
user's that is not remembered is not made, but sent to the processes, and remembered with what it gives. Then the steps
that needed it are taken again. In the end the states are expanded as ever; so the paths, their order and the errors are
those of one process, whatever the processes do. A call that raises elsewhere is made once more, here.

To hand a call to another process and to take back its result costs 10 to 15 us.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Hashable, Iterator, Mapping, Sequence
from dataclasses import field
from marshal import dumps, loads
from pickle import loads as unpickle
from queue import Empty, SimpleQueue
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
    ProcessPool,
    Task,
    TransferableFunction,
    describe_transfer,
    warn_once,
)
from ss2sql.runtime.parallel.worker_process import NO_VALUE
from ss2sql.runtime.run.call_memo import Result, report_memo_counts
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
    """A function of the user in one run: what its calls have cost here and elsewhere, and which of them wait.

    `sent` is what other processes get, or why they cannot have it. Each call of a block is asked for once.
    """

    name: str
    sent: TransferableFunction | LocalFunction
    calls: int = 0
    seconds: float = 0.0
    waiting: list[bytes] = field(default_factory=list)
    asked: set[bytes] = field(default_factory=set)

    @property
    def cost(self) -> float:
        """Seconds of one call."""
        return self.seconds / self.calls if self.calls else 0.0

    @property
    def may_be_shared(self) -> bool:
        """Whether other processes get calls of it, or it is too early to say."""
        return isinstance(self.sent, TransferableFunction) and (self.cost >= CHEAP or not self.is_known)

    @property
    def is_known(self) -> bool:
        """Whether enough calls were made to say what one costs."""
        return self.calls >= SAMPLES or self.seconds >= LONG

    @property
    def is_shared(self) -> bool:
        return self.may_be_shared and self.is_known

    def note_time(self, calls: int, seconds: float) -> None:
        self.calls += calls
        self.seconds += seconds

    def ask(self, arguments: tuple[Any, ...]) -> None:
        """Has a call wait that no one has asked for; one with objects is made here."""
        try:
            key = dumps(arguments, 2)
        except ValueError:
            return
        if key not in self.asked:
            self.asked.add(key)
            self.waiting.append(key)

    def split_waiting(self, workers: int) -> list[list[bytes]]:
        """The calls that wait in equal parts, as many for each worker as make messages worth while."""
        calls, self.waiting = self.waiting, []
        parts = min(len(calls), workers * max(1, round(len(calls) * self.cost / (BATCH * workers))))
        return [calls[number::parts] for number in range(parts)]


class BlockCalls:
    """The steps from one state, taken as far as the results of calls are known. They do not count."""

    counted = 0

    def __init__(self, notes: Notes, at: int, state: State) -> None:
        self.notes, self.at, self.state = notes, at, state
        self.open: list[Pair] | None = notes.pairs[at]

    def get_known_pairs(self) -> list[Pair] | None:
        return self.open

    def begin_state(self, items: list[Any]) -> list[Pair]:
        self.open = self.notes.pairs[self.at] = self.notes.pair_elements(self.at, items)
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
        self.searches: set[int] = set()  # those with MEMORIZE
        self.searched: set[str] = set()  # the functions that these call
        self.functions: dict[str, TimedCalls] = {}
        self.noting = False
        self.answers: SimpleQueue[Answer] = SimpleQueue()

    # --- calls -----------------------------------------------------------------------------------------

    def make_timed_call(self, entry: UserFunction, real: Callable[[Any], Result]) -> Callable[[Any], Result]:
        """A call as it is made where it is not remembered: `real`, unless it is one for other processes."""
        timed = self._get_timed(entry)

        def call_timed(arguments: Any) -> Result:
            if self.noting and timed.is_shared:
                timed.ask(tuple(arguments))
                raise PendingError
            started = perf_counter()
            result = real(arguments)
            timed.note_time(1, perf_counter() - started)
            return result

        return call_timed

    def _get_timed(self, entry: UserFunction) -> TimedCalls:
        if entry.name not in self.functions:
            self.functions[entry.name] = TimedCalls(entry.name, describe_transfer(entry))
        return self.functions[entry.name]

    def _keep_local(self, timed: TimedCalls, kept: LocalFunction) -> None:
        timed.sent = kept
        warn_once(self.run.stats, f"'{timed.name}' is called in this process only: it {kept.reason}", kept.cure)

    # --- blocks of states ------------------------------------------------------------------------------

    def begin_search(self, search_run: SearchRun) -> None:
        """Takes note of a search, and says what stays in this process."""
        if search_run.query.id in self.searches:
            return
        self.searches.add(search_run.query.id)
        if search_run.noted is None:
            cure = "declare functions immutable that are, and assign nothing inside of the search"
            warn_once(self.run.stats, "the search calls a function that is volatile, or assigns a variable", cure)
            return
        for function in list_plan_functions(search_run.query):
            if not function.builtin and function.name not in self.searched:
                self.searched.add(function.name)
                timed = self._get_timed(self.planned[function.name])
                if isinstance(timed.sent, LocalFunction):
                    self._keep_local(timed, timed.sent)

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
            while ahead := [one for one in ahead if one.evaluate_open_steps(seen)]:
                sent = self._send_calls()
                if not sent:
                    break
                self._await_answers(sent)
        except BaseException:  # a timeout, Ctrl-C, a process that died: nobody waits for the answers any more
            self.processes.end_processes()
            raise
        finally:
            self.noting = False
            for timed in self.functions.values():
                timed.waiting.clear()
                timed.asked.clear()

    def report_idle(self) -> None:
        """Says why there was nothing to do, if so."""
        stats = self.run.stats
        report_memo_counts(self.run)
        if not self.searches:
            warn_once(stats, "no effect: only searches with MEMORIZE have levels")
        elif not self.remembers:
            warn_once(stats, "no effect: calls are not remembered", "leave 'memo' out of connect(disable=...)")
        elif not self.searched and not any(note.startswith("workers: ") for note in stats.notes):
            warn_once(stats, "no effect: the search calls no Python function")
        for timed in map(self.functions.__getitem__, sorted(self.searched)):
            if isinstance(timed.sent, TransferableFunction) and timed.calls and not timed.is_shared:
                stats.notes.append(f"workers: a call of '{timed.name}' is too short to be made by another process")

    # --- messages --------------------------------------------------------------------------------------

    def _send_calls(self) -> int:
        """Gives calls that wait to the processes, where that is worth it; gives the number of messages."""
        waiting = [timed for timed in self.functions.values() if timed.waiting]
        work = sum(len(timed.waiting) * timed.cost for timed in waiting)
        if not waiting or work < LEAST * self.workers or not self._can_start(work):
            return 0
        sent = 0
        for timed in waiting:
            assert isinstance(timed.sent, TransferableFunction)
            for batch in timed.split_waiting(self.workers):
                self.processes.add_task(Task(timed.name, timed.sent, batch, self.answers))
                sent += 1
        return sent

    def _can_start(self, work: float) -> bool:
        """Whether processes are ready; they are started when that is worth it for what has been to do until now."""
        done = sum(timed.seconds for timed in self.functions.values() if timed.is_shared)
        if not self.processes.started and work + done < START:
            return False
        sent = [timed.sent for timed in self.functions.values() if timed.may_be_shared]
        try:
            self.processes.start_processes(self.workers, [one for one in sent if isinstance(one, TransferableFunction)])
        except OSError as error:
            for timed in self.functions.values():
                timed.sent = LocalFunction("")
            warn_once(self.run.stats, f"no other process can be started: {error}")
            return False
        return self.processes.are_ready(PATIENCE)

    def _await_answers(self, sent: int) -> None:
        """Waits for so many answers; raises ExecutionError X013 where a process has died."""
        while sent:
            self.run.check()
            try:
                answer = self.answers.get(timeout=LOOK)
            except Empty:
                continue
            sent -= 1
            self._take_answer(answer)

    def _take_answer(self, answer: Answer) -> None:
        name, timed = answer.task.name, self.functions[answer.task.name]
        if answer.died:
            hints = (
                f"'{name}' ends its process or needs more memory than there is; workers=1 calls it in this one",
                "the session works on, with new workers",
            )
            raise ExecutionError("X013", f"a worker {answer.died} while it called '{name}'", hints=hints)
        if answer.refused:
            cure = "what a module is made of must not change while it is used"
            self._keep_local(timed, LocalFunction(answer.refused, cure))
        if NO_VALUE in answer.results:
            self._keep_local(timed, LocalFunction("returns objects, which would be others in another process"))
        timed.note_time(len(answer.results), answer.seconds)
        for arguments, result in zip(answer.task.calls, answer.results, strict=False):
            if result:
                self._remember(name, loads(arguments), unpickle(result))

    def _remember(self, name: str, arguments: tuple[Any, ...], result: Any) -> None:
        """Remembers a call that was made elsewhere; one that gives no value of the language is made once more, here."""
        try:
            value = convert_value(result, f"the function '{name}'")
        except ExecutionError:
            return
        self.run.stats.calls[name] += 1
        known: Any = self.run.callables[name]
        known.adopt(arguments, value)
