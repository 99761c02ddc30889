"""Measures the problems in problems/ and writes out/bench.json; compare.py makes table, plot and page of it.

    python benchmarks/run.py                                  # what `make bench` runs
    python benchmarks/run.py --problem hanoi-default --contender database,native,python
    python benchmarks/run.py --problem 'grid-*' --size 100 --repeat 9 --clock cpu
    python benchmarks/run.py --list

Every (problem, size, contender) runs in a process of its own: preparations, one run to warm up, then the median of
`--repeat` runs, of fewer (one, if need be) where they take longer than `--budget` seconds. The answers of all
contenders of a problem have to agree. Whatever gave no time says why: its library is missing, the engine refuses the
script, it ran out of time, it failed, or its answer is another one.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from fnmatch import fnmatch
from importlib.metadata import version
from pathlib import Path
from typing import Any

import apsw
import click
from compare import OUT, Record, line
from problems import PROBLEMS, Problem
from problems.base import BASE, COMPILING, CONTENDERS
from rich.console import Console

HERE = Path(__file__).parent


def chosen(pattern: str | None) -> list[Problem]:
    """The problems with these names or patterns, separated by commas; a prefix will do."""
    if pattern is None:
        return list(PROBLEMS.values())
    found: dict[str, Problem] = {}
    for word in pattern.split(","):
        exact = {name: problem for name, problem in PROBLEMS.items() if fnmatch(name, word)}
        some = exact or {name: problem for name, problem in PROBLEMS.items() if name.startswith(word)}
        if not some:
            raise click.UsageError(f"there is no problem {word!r}; --list shows all")
        found |= some
    return list(found.values())


def measured(problem: Problem, size: int, contender: str, repeat: int, budget: float, limit: float) -> Record:
    """The record of a process that measures one contender."""
    command = [sys.executable, str(HERE / "worker.py"), problem.name, str(size), contender, str(repeat), str(budget)]
    record = {"problem": problem.name, "size": size, "contender": contender}
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=False)
    except subprocess.TimeoutExpired:
        return record | {"status": "timeout", "reason": f"took more than {limit:g} s"}
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"ended with {done.returncode}"])[-1]
        return record | {"status": "failed", "reason": last}
    return dict(json.loads(done.stdout.splitlines()[-1]))


def judge(records: list[Record]) -> None:
    """Marks the records of one problem and size whose answer is not that of the base, or of most where it has none."""
    answers = [record["answer"] for record in records if record["status"] == "ok"]
    if not answers:
        return
    base = next((r["answer"] for r in records if r["contender"] == BASE and r["status"] == "ok"), None)
    right = base if base is not None else max(answers, key=answers.count)
    for record in records:
        if record["status"] == "ok" and record["answer"] != right:
            record |= {"status": "differs", "reason": f"{record['answer']} and not {right}"}


def machine() -> dict[str, Any]:
    """The machine in general terms."""
    return {
        "cpu": cpu_model(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "python": platform.python_version(),
        "sqlite": apsw.sqlite_lib_version(),
        "ss2sql": version("ss2sql"),
    }


def cpu_model() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for text in info.read_text("utf-8", errors="replace").splitlines():
            if text.startswith("model name"):
                return text.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def hopeless(earlier: Sequence[Record], size: int, growth: float, limit: float) -> str | None:
    """Why a size is not tried: at a smaller one the contender shows that it would run out of time.

    `growth` is how many times longer the base took than at that size. In doubt it is tried: not even one run would fit.
    """
    if not earlier:
        return None
    last = earlier[-1]
    if last["status"] in ("timeout", "skipped"):
        return f"not tried: out of time at {last['size']:,}"
    first = last.get("first", 0.0)
    if size > last["size"] and first * growth > limit:
        return f"not tried: {first:.1f} s at {last['size']:,}"
    return None


class Session:
    """The records of one run, and how they are made and shown."""

    def __init__(self, repeat: int, budget: float, limit: float, clock: str) -> None:
        self.repeat, self.budget, self.limit, self.clock = repeat, budget, limit, clock
        self.records: list[Record] = []
        self.console = Console(highlight=False)

    def measure(self, problem: Problem, size: int, contenders: Sequence[str]) -> None:
        """Measures, judges and shows the contenders of one problem and size; the base first."""
        growth, found = 1.0, {}
        for name in sorted(contenders, key=lambda name: name != BASE):
            found[name] = self.record(problem, size, name, growth)
            if name == BASE:
                growth = self.growth(found[name])
        group = [found[name] for name in contenders]
        judge(group)
        self.records += group
        for record in group:
            self.console.print(line(record, group, self.records, self.clock), soft_wrap=True)

    def record(self, problem: Problem, size: int, contender: str, growth: float) -> Record:
        if reason := hopeless(self.earlier(problem.name, contender), size, growth, self.limit):
            record = {"problem": problem.name, "size": size, "contender": contender}
            return record | {"status": "skipped", "reason": reason}
        return measured(problem, size, contender, self.repeat, self.budget, self.limit)

    def earlier(self, problem: str, contender: str) -> list[Record]:
        return [r for r in self.records if (r["problem"], r["contender"]) == (problem, contender)]

    def growth(self, base: Record) -> float:
        """How many times longer the base took than at the size before; in doubt as many as the size grew."""
        before = self.earlier(base["problem"], BASE)
        if not before:
            return 1.0
        if "seconds" in base and "seconds" in before[-1]:
            return float(base["seconds"] / before[-1]["seconds"])
        return float(base["size"] / before[-1]["size"])

    def write(self, file: Path, took: float, update: bool) -> None:
        """Writes the records, with `update` into what the file holds."""
        file.parent.mkdir(parents=True, exist_ok=True)
        records = merged(json.loads(file.read_text("utf-8"))["records"], self.records) if update else self.records
        text = {"machine": machine(), "took": round(took), "records": records}
        file.write_text(json.dumps(text, indent=1) + "\n", encoding="utf-8")
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        processor = used.ru_utime + used.ru_stime
        self.console.print(f"written to {file.name}; all took {took:.0f} s, {processor:.0f} s of them computing")


def merged(old: Sequence[Record], new: Sequence[Record]) -> list[Record]:
    """All records in the order of the table, the new ones in the place of old ones."""
    problems, contenders = list(PROBLEMS), [*CONTENDERS, COMPILING]

    def place(record: Record) -> tuple[int, int, int]:
        return problems.index(record["problem"]), record["size"], contenders.index(record["contender"])

    found = {place(record): record for record in (*old, *new) if record["problem"] in PROBLEMS}
    return [found[key] for key in sorted(found)]


def show_problems(problems: Sequence[Problem]) -> None:
    console = Console(highlight=False)
    for problem in problems:
        console.print(f"[bold]{problem.name}[/]: {problem.about}", soft_wrap=True)
        sizes = ", ".join(f"{size:,}" for size in problem.sizes)
        larger = ", ".join(f"{size:,}" for size in problem.full)
        console.print(f"  {problem.size_is}: {sizes}{f' (--full: {larger})' if larger else ''}", soft_wrap=True)
        console.print(f"  {', '.join(problem.contenders)}; compared: {problem.compared}", soft_wrap=True)


@click.command(help="Measures the problems in problems/ and writes out/bench.json.")
@click.option("--problem", help="names, prefixes or patterns, separated by commas")
@click.option("--contender", help="names, separated by commas")
@click.option("--size", help="sizes in place of the usual ones, separated by commas")
@click.option("--repeat", default=5, show_default=True, help="runs of which the median counts")
@click.option("--budget", default=1.0, show_default=True, help="seconds after which there are no more runs")
@click.option("--limit", default=30.0, show_default=True, help="seconds for one process")
@click.option("--clock", type=click.Choice(["wall", "cpu"]), default="wall", help="of the ratios shown while it runs")
@click.option("--full", is_flag=True, help="the larger sizes too")
@click.option(
    "--json", "out", type=click.Path(path_type=Path), help="where to write; out/bench.json if all is measured"
)
@click.option("--update", is_flag=True, help="puts what was measured in the place of what the file says of it")
@click.option("--list", "only_list", is_flag=True, help="shows the problems and measures nothing")
def main(
    problem: str | None,
    contender: str | None,
    size: str | None,
    repeat: int,
    budget: float,
    limit: float,
    clock: str,
    full: bool,
    out: Path | None,
    update: bool,
    only_list: bool,
) -> None:
    problems = chosen(problem)
    names = None if contender is None else contender.split(",")
    if unknown := set(names or ()) - {*CONTENDERS, COMPILING}:
        raise click.UsageError(f"there is no contender {unknown.pop()!r}; they are {', '.join(CONTENDERS)}")
    if only_list:
        show_problems(problems)
        return
    started = time.perf_counter()
    session = Session(repeat, budget, limit, clock)
    for item in problems:
        for number in [int(text) for text in size.split(",")] if size else (*item.sizes, *(item.full if full else ())):
            session.measure(item, number, [name for name in item.contenders if names is None or name in names])
    everything = problem is None and names is None and size is None
    if update or everything or out:
        session.write(out or OUT, time.perf_counter() - started, update)


if __name__ == "__main__":
    main()
