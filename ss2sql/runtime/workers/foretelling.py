"""The calls that a level of a search needs, made by other processes before the level is expanded.

Before the states of a block are expanded, the clauses of their steps are tried, one by one: a call of the user's whose
result is not known is not made, but noted. Processes make the calls that were noted, and what depended on them is tried
again. Then the states are expanded as ever, with the results at hand; so the paths, their order and the errors are
those of one process, whatever the processes do. A call that raises elsewhere is made once more, here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from marshal import dumps
from marshal import loads as marshalled
from pickle import loads
from queue import Empty, SimpleQueue
from time import perf_counter
from typing import Any

from ss2sql import plan
from ss2sql.errors import Stopped
from ss2sql.runtime.frozen import State
from ss2sql.runtime.functions import UserFunction
from ss2sql.runtime.memorize.hunt import Hunt
from ss2sql.runtime.native.calls import Result, checked_call, settle_calls
from ss2sql.runtime.run import Run
from ss2sql.runtime.workers.ahead import Ahead, Elements, PendingError
from ss2sql.runtime.workers.child import NO_VALUE, pickled
from ss2sql.runtime.workers.notes import tell
from ss2sql.runtime.workers.processes import Answer, Processes, Task, died
from ss2sql.runtime.workers.sending import Kept, Sent, sent
from ss2sql.runtime.workers.timing import BATCH, FEWEST, LEAST, MOST, START, Timed
from ss2sql.walk import functions

LOOK = 0.02  # seconds between two looks at whether the run has to end
UNSHARED = 64  # states of a block in which nothing is foretold


class Foreteller:
    """Makes calls of one run in other processes; `tell` what hinders it."""

    def __init__(
        self, run: Run, workers: int, processes: Processes, planned: Mapping[str, UserFunction], remembers: bool
    ) -> None:
        self.run = run
        self.workers = workers
        self.processes = processes
        self.planned = planned
        self.remembers = remembers
        self.searches: list[plan.Query] = []  # those with MEMORIZE
        self.asked: dict[str, Timed] = {}  # the functions that these call
        self.functions: dict[str, Timed] = {}
        self.noting = False
        self.noted: set[tuple[str, bytes]] = set()
        self.results: dict[tuple[str, bytes], bytes | None] = {}
        self.answers: SimpleQueue[Answer] = SimpleQueue()
        self.outstanding = 0
        self.names: dict[int, str] = {}

    # --- calls -----------------------------------------------------------------------------------------

    def call_of(self, entry: UserFunction, real: Callable[[Any], Result]) -> Callable[[Any], Result]:
        """A call as generated code makes it where it is not remembered: `real`, or what another process gave."""
        timed = self._timed(entry)
        name, calls, results = entry.name, self.run.stats.calls, self.results
        as_result = checked_call(replace(entry, function=loads), self.run)

        def call(arguments: Any) -> Result:
            given = tuple(arguments)
            if self.noting or results:
                key = _key(name, given)
                found = results.get(key)
                if found:
                    calls[name] -= 1  # it was counted when it came
                    return as_result((found,))
                if self.noting and (key is None or key in results or timed.is_shared):
                    if key is not None and key not in results:
                        self._note(timed, key)
                    raise PendingError
            started = perf_counter()
            try:
                result = real(given)
            except Stopped:
                raise
            except Exception:
                calls[name] -= self.noting  # it will be made again
                raise
            timed.add(1, perf_counter() - started)
            return result

        return call

    def _timed(self, entry: UserFunction) -> Timed:
        if entry.name not in self.functions:
            found = sent(entry)
            self.functions[entry.name] = Timed(entry.name, entry.function, found)
        return self.functions[entry.name]

    def _keep(self, timed: Timed, kept: Kept) -> None:
        """Other processes cannot have a function."""
        timed.sent = kept
        tell(self.run.stats, f"'{timed.name}' is called in this process only: it {kept.reason}", kept.cure)

    # --- blocks of states ------------------------------------------------------------------------------

    def blocks(
        self, hunt: Hunt, level: list[State], seen: Container[Hashable], elements: Elements | None
    ) -> Iterator[State]:
        """The states of a level; before they come out their calls are made, block by block.

        `seen` are the rows that are known, `elements` gives those of a state where not all are asked for.
        """
        self._begin(hunt)
        if hunt.pieces is None or not self.remembers:
            yield from level
            return
        place = 0
        while place < len(level):
            ahead = Ahead(hunt, seen, elements)
            settle_calls(self.run)
            remembered, calls = Counter(self.run.stats.remembered), Counter(self.run.stats.calls)
            if any(timed.may_be_shared for timed in self.functions.values()):
                self._foretell(ahead, level[place : place + MOST])
            else:
                ahead.size = min(UNSHARED, len(level) - place)
            settle_calls(self.run)
            self.run.stats.remembered.clear()
            self.run.stats.remembered.update(remembered)
            calls = self.run.stats.calls - calls
            yield from level[place : place + ahead.size]
            settle_calls(self.run)
            # What was called beforehand counts as remembered when it is asked for. The first time it should not.
            self.run.stats.remembered -= calls
            self.results.clear()
            place += ahead.size

    def _begin(self, hunt: Hunt) -> None:
        """Takes note of a search, and says what stays in this process."""
        if any(hunt.query is query for query in self.searches):
            return
        self.searches.append(hunt.query)
        if hunt.pieces is None:
            cure = "declare functions immutable that are, and assign nothing inside of the search"
            tell(self.run.stats, "the search calls a function that is volatile, or assigns a variable", cure)
            return
        for function in functions(hunt.query):
            if not function.builtin and function.name not in self.asked:
                timed = self.asked[function.name] = self._timed(self.planned[function.name])
                if isinstance(timed.sent, Kept):
                    self._keep(timed, timed.sent)

    def _foretell(self, ahead: Ahead, states: Sequence[State]) -> None:
        """Makes the calls of the first states; `ahead` knows how many these are."""
        try:
            with ahead.uncounted():
                self._rounds(ahead, states)
        except BaseException:  # a timeout, Ctrl-C, a process that died: nobody waits for the answers any more
            self.processes.end()
            raise

    def _rounds(self, ahead: Ahead, states: Sequence[State]) -> None:
        self.noting = True
        try:
            for state in states:
                ahead.add(state)
                if len(self.noted) >= MOST:
                    break
                self._hand_over(False)
            while self._hand_over(True):
                self._wait()
                ahead.again()
        finally:
            self.noting = False
            self.noted.clear()
            for timed in self.functions.values():
                timed.waiting.clear()

    def close(self) -> None:
        """Says why there was nothing to do, if so."""
        stats = self.run.stats
        if not self.searches:
            tell(stats, "no effect: only searches with MEMORIZE have levels")
        elif not self.remembers:
            tell(stats, "no effect: calls are not remembered", "leave 'memo' out of connect(disable=...)")
        elif not self.asked and not any(note.startswith("workers: ") for note in stats.notes):
            tell(stats, "no effect: the search calls no Python function")
        for timed in self.asked.values():
            if isinstance(timed.sent, Sent) and timed.calls and not timed.is_shared:
                stats.notes.append(f"workers: a call of '{timed.name}' is too short to be made by another process")

    # --- messages --------------------------------------------------------------------------------------

    def _note(self, timed: Timed, key: tuple[str, bytes]) -> None:
        if key not in self.noted:
            self.noted.add(key)
            timed.waiting.append(key[1])

    def _hand_over(self, all_of_them: bool) -> bool:
        """Gives calls that wait to the processes, where that is worth it. Gives whether answers are to come."""
        waiting = [timed for timed in self.functions.values() if timed.waiting]
        work = sum(timed.work for timed in waiting)
        calls = sum(len(timed.waiting) for timed in waiting)
        enough = work >= LEAST * self.workers and calls >= FEWEST
        if not all_of_them and (calls < 4 * self.workers or work < 4 * BATCH * self.workers):
            return False
        if (enough or self.outstanding) and self._may_start(work):
            for timed in waiting:
                number = self._number(timed)
                for batch in timed.batches(self.workers):
                    self.processes.add(Task(number, batch, self.answers))
                    self.outstanding += 1
        return self.outstanding > 0

    def _may_start(self, work: float) -> bool:
        """Whether processes run, or are worth being started for what has been to do until now."""
        done = sum(timed.seconds for timed in self.functions.values() if timed.is_shared)
        if not self.processes.started and work + done < START:
            return False
        for timed in self.functions.values():
            if timed.may_be_shared:
                self._number(timed)  # so that they learn it before they are ready
        try:
            self.processes.start(self.workers)
        except OSError as error:
            for timed in self.asked.values():
                timed.sent = Kept("")
            tell(self.run.stats, f"no other process can be started: {error}")
            return False
        return True

    def _number(self, timed: Timed) -> int:
        """The number of a function in tasks."""
        assert isinstance(timed.sent, Sent)
        number = self.processes.number(timed.sent)
        self.names[number] = timed.name
        return number

    def _wait(self) -> None:
        """Waits for all answers; raises ExecutionError X013 where a process has died."""
        while self.outstanding:
            self.run.check()
            answer = self._own_answer()
            try:
                answer = answer or self.answers.get(timeout=LOOK)
            except Empty:
                continue
            self.outstanding -= 1
            self._take(answer)

    def _own_answer(self) -> Answer | None:
        """What becomes of a task that this process does, as long as the others are not ready."""
        task = None if self.processes.ready else self.processes.take_back(self.answers)
        if task is None:
            return None
        function = self.functions[self.names[task.number]].function
        results: list[bytes | None] = []
        started = perf_counter()
        for arguments in task.calls:
            self.run.check()
            try:
                results.append(pickled(function(*marshalled(arguments))))
            except Exception:
                results.append(None)
        return Answer(task, results, perf_counter() - started)

    def _take(self, answer: Answer) -> None:
        task = answer.task
        timed = self.functions[self.names[task.number]]
        if answer.died and not answer.ended:
            raise died(answer, timed.name)
        if answer.refused:
            self._keep(timed, Kept(answer.refused, "what a module is made of must not change while it is used"))
        if NO_VALUE in answer.results:
            self._keep(timed, Kept("returns objects, which would be others in another process"))
        timed.add(len(answer.results), answer.seconds)
        self.run.stats.calls[timed.name] += sum(map(bool, answer.results))
        for arguments, result in zip(task.calls, answer.results, strict=False):
            self.results[timed.name, arguments] = result


def _key(name: str, arguments: tuple[Any, ...]) -> Any:
    """What tells a call from others; None where there are objects among the arguments."""
    try:
        return name, dumps(arguments, 2)
    except ValueError:
        return None
