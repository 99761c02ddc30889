"""Running a compiled script: its statements one after the other, and what becomes of them in the end."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Cancelled, Stopped
from ss2sql.runtime.compiled import CompiledStatement, Engine, Query, script_sql
from ss2sql.runtime.explain import outline
from ss2sql.runtime.opening import check_bound, check_engine
from ss2sql.runtime.progress import progress_of
from ss2sql.runtime.result import Answer, Result
from ss2sql.runtime.run import Run, Stats
from ss2sql.runtime.values import fresh, normalise
from ss2sql.runtime.workers import IN_WORKER

if TYPE_CHECKING:
    from ss2sql.runtime.host import SessionHost
    from ss2sql.runtime.workers.foretelling import Foreteller


@dataclass(frozen=True, slots=True)
class Options:
    """What may be said of one run, see `Session.run`."""

    engine: Engine | None
    timeout: float | None
    maximum: int | None
    workers: int
    max_rows: int | None
    progress: str | bool

    def check(self) -> None:
        """Raises SessionError S002 for what makes no sense."""
        if self.engine is not None:
            check_engine(self.engine)
        check_bound("maximum", self.maximum, 1)
        check_bound("workers", self.workers, 1)
        check_bound("max_rows", self.max_rows, 0)


def execute(
    host: SessionHost, query: Query, options: Options, variables: Mapping[str, Any], compile_seconds: float
) -> Result:
    """Runs a compiled script and gives the result of its last statement."""
    options.check()
    run = Run(host, Stats(), _deadline(host, options.timeout), max_rows=options.max_rows)
    run.arguments = {name: normalise(value, f"the variable '{name}'") for name, value in variables.items()}
    run.stats.seconds["compile"] = compile_seconds
    started = time.perf_counter()
    statements = query.statements(options.engine, run.arguments)
    run.stats.seconds["lower"] = time.perf_counter() - started
    run.foreteller = _foreteller(host, run, options.workers)
    run.progress = None if host.runs else progress_of(run, options.progress)  # one inside of another shows none
    host.runs.append(run)
    started = time.perf_counter()
    try:
        value = _last_value(host, run, statements, options.maximum)
    except Stopped as stopped:
        stopped.partial = _partial(run, "timeout" if stopped.code == "T001" else "cancelled")
        raise
    except KeyboardInterrupt:
        cancelled = Cancelled("T002", "the run was interrupted")
        cancelled.partial = _partial(run, "cancelled")
        raise cancelled from None
    finally:
        host.runs.remove(run)
        run.graph = None
        if run.progress is not None:
            run.progress.end()
        run.stats.seconds["run"] = time.perf_counter() - started
    if run.foreteller is not None:
        run.foreteller.close()
    return _result(run, statements, value)


def _last_value(host: SessionHost, run: Run, statements: Sequence[CompiledStatement], maximum: int | None) -> Any:
    value: Any = None
    for statement in statements:
        run.maximum = maximum if statement is statements[-1] else None
        run.answer = run.graph = None
        host.forget_stable(run)
        value = statement.value(run)
    return value


def _result(run: Run, statements: Sequence[CompiledStatement], value: Any) -> Result:
    answer = run.answer if statements[-1].is_query else None
    engines = [compiled.engine for statement in statements for compiled in statement.queries]
    used = answer.engine if answer is not None else (engines[-1] if engines else "native")
    return Result(
        None if answer is not None else fresh(value),
        used,
        answer.status if answer is not None else "complete",
        run.stats,
        script_sql(statements, run),
        answer,
        outline(statements),
    )


def _foreteller(host: SessionHost, run: Run, workers: int) -> Foreteller | None:
    """What has calls made by other processes, where more than one is wanted. They themselves start no others."""
    if workers == 1 or IN_WORKER in os.environ:
        return None
    from ss2sql.runtime.workers.foretelling import Foreteller
    from ss2sql.runtime.workers.processes import Processes

    if host.processes is None:
        host.processes = Processes()
    return Foreteller(run, workers, host.processes, host.planned, host.memo_limit > 0)


def _deadline(host: SessionHost, seconds: float | None) -> float | None:
    """When a run that starts now has to end; one inside of another run ends with that at the latest."""
    times = [run.deadline for run in host.runs]
    times.append(None if seconds is None else time.monotonic() + seconds)
    return min((moment for moment in times if moment is not None), default=None)


def _partial(run: Run, status: str) -> Result | None:
    if run.sink is None:
        return None
    rows, engine = run.sink
    answer = Answer(rows.shown(), None, engine, status)  # type: ignore[arg-type]
    return Result(None, engine, answer.status, run.stats, script_sql([]), answer)
