"""Mutation testing: which small changes of the lowering and of the resolver does no test see?

`python tests/mutants.py` draws MUTANTS of them by seed, and prints those that live on and a line of figures. It runs
the tests of `make test` in PROCESSES processes, to learn which of them reach which line; files of tests that are as
they were keep what was learned of them (out/reached). Then it goes over the mutants: for each a fork of this process
puts the changed function in place and runs tests that reach the line, quick ones first, until one fails that passes in
a fork without it.
A mutant that lives on needs a test, or a row in mutants_justified.toml that says why no test can see it. More than
LIVING in a hundred that `make test` lets live fail.
"""

from __future__ import annotations

import gc
import hashlib
import json
import math
import os
import resource
import select
import signal
import subprocess
import sys
import time
import tomllib
from argparse import ArgumentParser, Namespace
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import _lru_cache_wrapper
from importlib import import_module
from itertools import zip_longest
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, TextIO

import mutants_made
import pytest
from mutants_made import Mutant, Site
from reached import FOLDER, Reached, known, stale, written_off

TESTS_FOLDER = Path(__file__).parent
PACKAGE = TESTS_FOLDER.parent / "ss2sql"
JUSTIFIED = TESTS_FOLDER / "mutants_justified.toml"
LIVED_BEFORE = FOLDER.parent / "mutants_that_lived.txt"
KILLERS = FOLDER.parent / "mutant_killers.json"  # how many mutants each test has killed
# The lowering, and the stage that resolves.
MUTATED = (
    "lowering/**/*.py",
    *(f"frontend/resolve/{n}.py" for n in ("resolver", "query_clauses", "from_clause", "grouping", "search_clauses")),
)
# What a fork cannot run; what runs in processes of its own, so that it would not see the mutant; and what presses
# Ctrl-C, which may find coverage holding a lock.
ELSEWHERE = (
    *("spark/", "notebook", "workers", "interrupts", "test_shell.py", "faults", "crashes"),
    *("determinism", "package"),
)

MUTANTS = 300
SECONDS = 8.0
"""Of a processor: what the tests of one mutant take together without it, cheap ones of every file in turn."""

PATIENCE = 15
"""How many times as long those are tried that live, by all tests that reach them: scripts of tests/cases first."""

SCRIPTS = ("tests/test_sheets.py", "tests/test_cases.py")

MEMORY = 4 << 30
"""More than it has now a fork may not take. What all tests have loaded is 5 GB of addresses by itself."""

LIVING = 5
PROCESSES = 2

Places = dict[tuple[str, Site], list[FunctionType]]
KILLED, LIVED, SLOW = "killed", "lived", "timed out"
PASSED = "all passed"


class Mutating:
    """What pytest runs instead of its tests: those of each mutant in a fork."""

    def __init__(self, given: Namespace, out: TextIO) -> None:
        self.given = given
        self.out = out
        self.seconds: dict[str, float] = defaultdict(float)
        self.passes: dict[str, bool] = {}  # whether a test passes in a fork: threads, as those of Polars, are not there
        self.lived: list[Mutant] = []
        self.counts: Counter[str] = Counter()
        self.caches: list[_lru_cache_wrapper[object]] = []

    # --- pytest ----------------------------------------------------------------------------------------

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        drawn = self.draw()
        print(f"{len(drawn)} mutants, {len(session.items)} tests", file=self.out, flush=True)
        started = time.monotonic()
        items = {item.nodeid: item for item in session.items}
        reached, usual = known(sorted({mutant.file for mutant in drawn}), items)
        self.seconds.update(usual)
        places = functions()
        # Those of others hold what a fork must not let go of, such as the threads of a database.
        caches = [one for one in gc.get_objects() if isinstance(one, _lru_cache_wrapper)]
        self.caches = [one for one in caches if str(one.__module__).startswith("ss2sql")]
        gc.freeze()
        strength = Counter(json.loads(KILLERS.read_text("utf-8")) if KILLERS.exists() else {})
        killers = strength.copy()

        def judge(mutant: Mutant) -> tuple[str, str, int]:
            verdict, killer, tests = self.judged(mutant, items, reached, strength, places)
            strength[killer] += 1
            return verdict, killer, tests

        for number, (mutant, (verdict, killer, tests)) in enumerate(in_parallel(drawn, judge), 1):
            self.counts[verdict] += 1
            killers[killer] += verdict == KILLED
            if verdict == LIVED:
                self.lived.append(mutant)
            if verdict != KILLED or killer == "crash" or self.given.verbose:
                place = f"ss2sql/{mutant.file}:{mutant.line}"
                print(f"{verdict}: {mutant.name}  [{place}, {tests} tests] {killer}", file=self.out, flush=True)
            if not number % 10:
                seconds, lived = time.monotonic() - started, self.counts[LIVED]
                print(f"-- {number} of {len(drawn)} in {seconds:.0f} s, {lived} live on", file=self.out, flush=True)
        KILLERS.write_text(json.dumps(dict(killers.most_common())), encoding="utf-8")
        LIVED_BEFORE.write_text("".join(f"{mutant.name}\n" for mutant in self.lived), encoding="utf-8")
        taken = time.monotonic() - started
        print(
            f"score: {len(drawn)} mutants, {self.counts[KILLED]} killed, {self.counts[SLOW]} timed out, "
            f"{self.counts[LIVED]} survived make test; {taken:.0f} seconds (seed {self.given.seed})",
            file=self.out,
        )
        return True

    # --- choosing --------------------------------------------------------------------------------------

    def draw(self) -> list[Mutant]:
        """The mutants of this seed, by the hash of their names: an edit elsewhere does not draw others."""
        known, found = justified(), every()
        gone = known.keys() - {one.name for one in found}
        assert not gone, f"the code has changed: look at these again in {JUSTIFIED.name}: {gone}"
        among = [one for one in found if one.name not in known and self.given.only in one.name]
        if self.given.lived:
            before = LIVED_BEFORE.read_text(encoding="utf-8").splitlines()
            return [one for one in among if one.name in before]
        chosen = sorted(among, key=lambda one: hashlib.sha256(f"{self.given.seed} {one.name}".encode()).digest())
        return sorted(chosen[: self.given.mutants], key=lambda one: (one.file, one.number))

    def chosen(self, reached: Reached, mutant: Mutant, strength: Counter[str]) -> tuple[list[str], list[str]]:
        """Tests that reach a mutant: those that have killed others, and cheap ones of every file in turn; then all.

        All come with SCRIPTS first, then in the order of how many they have killed, then the cheapest first.
        """
        lines = reached[mutant.file]
        # Constants are folded into their statement, which may begin some lines above.
        near = [line for line in range(mutant.begin, mutant.line + 1) if lines.get(line)]
        tests = sorted(lines[near[-1]], key=lambda one: (self.seconds[one], one)) if near else []
        by_file: dict[str, list[str]] = defaultdict(list)
        for test in sorted(tests, key=lambda one: -strength[one]):
            by_file[test.partition("::")[0]].append(test)
        turns = [test for turn in zip_longest(*by_file.values()) for test in turn if test]
        return turns, sorted(tests, key=lambda one: (not one.startswith(SCRIPTS), -strength[one]))

    def within(self, tests: Sequence[str], seconds: float) -> Iterator[str]:
        """The first of some tests, as many as take so long together."""
        for test in tests:
            if self.seconds[test] <= seconds:
                seconds -= self.seconds[test]
                yield test

    # --- one mutant ------------------------------------------------------------------------------------

    def judged(
        self, mutant: Mutant, items: dict[str, pytest.Item], reached: Reached, strength: Counter[str], places: Places
    ) -> tuple[str, str, int]:
        """What becomes of a mutant, the test that kills it, and the number of tests that were tried.

        One that lives is tried with many more tests: 12 of 15 that had lived on a loaded machine did not.
        """
        tried: dict[str, None] = {}
        verdict, killer = LIVED, ""
        seconds = self.given.seconds
        for tests, most in zip(self.chosen(reached, mutant, strength), (seconds, PATIENCE * seconds), strict=True):
            if verdict != LIVED:
                break
            names = [one for one in self.within(tests, most) if one in items and one not in tried]
            tried.update(dict.fromkeys(names))
            verdict, killer = self.verdict(mutant, [items[one] for one in names], places)
        return verdict, killer, len(tried)

    def verdict(self, mutant: Mutant, tests: Sequence[pytest.Item], places: Places) -> tuple[str, str]:
        """What becomes of a mutant, and the test that kills it."""
        site, code = mutants_made.mutated(PACKAGE / mutant.file, mutant)

        def tried(some: Sequence[pytest.Item]) -> tuple[str, bool]:
            def run(begin: Callable[[str], object]) -> None:
                for function in places[str(PACKAGE / mutant.file), site]:
                    function.__code__ = code
                for cache in self.caches:  # what is kept in them was found without the mutant
                    cache.cache_clear()
                run_until_one_fails(some, begin)

            return forked(run, 10 + 4 * sum(self.seconds[one.nodeid] for one in some))

        left = list(tests)
        while True:
            left = [one for one in left if self.passes.get(one.nodeid, True)]
            last, _ = tried(left)
            if last == PASSED:
                return LIVED, ""
            if not last:
                return KILLED, "crash"
            number, test = next((at, one) for at, one in enumerate(left) if one.nodeid == last)
            # A test may fail for what those before it have left, too.
            alone, ended = tried([test])
            if alone != PASSED and self.passes_here(test):
                return (KILLED if ended else SLOW), last
            left = left[number + 1 :]

    def passes_here(self, test: pytest.Item) -> bool:
        """Whether a test passes in a fork without a mutant."""
        if test.nodeid not in self.passes:
            allowed = 10 + 4 * self.seconds.get(test.nodeid, 0)
            last, _ = forked(lambda begin: run_until_one_fails([test], begin), allowed)
            self.passes[test.nodeid] = last == PASSED
            if last != PASSED:
                print(f"fails without a mutant, too: {test.nodeid}", file=self.out, flush=True)
        return self.passes[test.nodeid]


def in_parallel(mutants: Sequence[Mutant], judge: Callable[[Mutant], tuple[Any, ...]]) -> Iterator[tuple[Mutant, Any]]:
    """Each mutant with what is judged of it, in PROCESSES forks of this process, as they are done."""
    pipes = []
    for number in range(PROCESSES):
        reading, writing = os.pipe()
        if not os.fork():
            with os.fdopen(writing, "w") as pipe:
                for at in range(number, len(mutants), PROCESSES):
                    print(json.dumps([at, judge(mutants[at])]), file=pipe, flush=True)
            os._exit(0)
        os.close(writing)
        pipes.append(os.fdopen(reading))
    while pipes:
        for pipe in select.select(pipes, [], [])[0]:
            if line := pipe.readline():
                at, judged = json.loads(line)
                yield mutants[at], judged
            else:
                pipes.remove(pipe)
                pipe.close()
                os.wait()


def forked(action: Callable[[Callable[[str], object]], None], seconds: float) -> tuple[str, bool]:
    """The last line that an action says in a fork of this process, and whether it ended within seconds of a processor.

    Ten times as long by the clock is too long, too.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.setpgid(0, 0)
        most = virtual_size() + MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds), math.ceil(seconds) + 5))
        try:
            action(lambda line: os.write(writing, f"{line}\n".encode()))
        finally:
            os._exit(0)  # whatever is raised: the code after this is the parent's
    os.close(writing)
    last, ended = heard(reading, 10 * seconds)
    os.close(reading)
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return last, ended and not (os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU)


def heard(reading: int, seconds: float) -> tuple[str, bool]:
    """The last line that a fork writes, and whether it ended in time."""
    text, deadline = b"", time.monotonic() + seconds
    while select.select([reading], [], [], max(deadline - time.monotonic(), 0))[0]:
        read = os.read(reading, 1 << 16)
        text = (text + read)[-1 << 16 :]
        if not read or text.endswith(f"\n{PASSED}\n".encode()):
            return last_line(text), True
    return last_line(text), False


def last_line(text: bytes) -> str:
    return text.decode().rstrip("\n").rpartition("\n")[2]


def virtual_size() -> int:
    """The addresses of this process, in bytes."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()


def run_until_one_fails(tests: Sequence[pytest.Item], begin: Callable[[str], object]) -> None:
    """Runs tests until one fails; says which begins, and in the end that all passed."""
    failed: list[str] = []

    class Noted:
        @pytest.hookimpl
        def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
            if report.failed:
                failed.append(report.nodeid)

    noted = Noted()
    for item, following in zip_longest(tests, tests[1:]):
        begin(item.nodeid)
        item.config.pluginmanager.register(noted)
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        item.config.pluginmanager.unregister(noted)
        if failed:
            return
    begin(PASSED)


def functions() -> Places:
    """Every Python function that there is, those of all that is mutated among them, by file and place."""
    for path in mutated_files():
        import_module(".".join(["ss2sql", *path.relative_to(PACKAGE).with_suffix("").parts]))
    found: Places = defaultdict(list)
    gc.unfreeze()  # what tests have the collector pass over, too
    for one in gc.get_objects():
        if isinstance(one, FunctionType) and isinstance(one.__code__, CodeType):
            code = one.__code__
            found[code.co_filename, Site(code.co_qualname, code.co_firstlineno)].append(one)
    return found


def every() -> list[Mutant]:
    """All mutants of the files that are MUTATED."""
    return [one for path in mutated_files() for one in mutants_made.mutants(path, str(path.relative_to(PACKAGE)))]


def mutated_files() -> list[Path]:
    found = {pattern: list(PACKAGE.glob(pattern)) for pattern in MUTATED}
    assert all(found.values()), found
    return sorted({path for paths in found.values() for path in paths})


def justified() -> dict[str, str]:
    """The mutants that no test can see, each with the reason."""
    rows = tomllib.loads(JUSTIFIED.read_text(encoding="utf-8"))["mutant"]
    return {row["name"]: row["why"] for row in rows}


def main() -> int:
    parser = ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--mutants", type=int, default=MUTANTS, help="how many of them")
    parser.add_argument("--seed", default="1", help="which of them")
    parser.add_argument("--only", default="", help="of those whose name has this in it")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="tests of a mutant, in seconds")
    parser.add_argument("--anew", action="store_true", help="learns of every file of tests what it reaches")
    parser.add_argument("--lived", action="store_true", help="those that lived last time, instead")
    parser.add_argument("--verbose", action="store_true", help="says what killed each")
    given = parser.parse_args()
    with os.fdopen(os.dup(sys.stdout.fileno()), "w") as out:
        files = [str(path) for path in sorted(TESTS_FOLDER.rglob("test_*.py"))]
        files = [file for file in files if not any(word in file for word in ELSEWHERE)]
        options = ["-q", "--no-header", "--no-summary", "--timeout=0", "-p", "no:cacheprovider", "-p", "no:randomly"]
        options += ["-m", "not slow and not drawn"]
        if changed := stale(files, given.anew):
            print(f"learning what the tests of {len(changed)} files reach", file=out, flush=True)
            begun = time.monotonic()
            parallel = ["--timeout=120", "-n", str(PROCESSES), "--dist", "loadfile", "-p", "reached"]
            learning = [sys.executable, "-m", "pytest", *options, *parallel, *changed]
            path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}  # where `reached` is
            done = subprocess.run(learning, check=False, stdout=out, env=os.environ | path)
            if done.returncode not in (0, 1):  # tests may fail
                sys.exit("learning broke off; begin again, it goes on where it ended")
            print(f"learned in {time.monotonic() - begun:.0f} s", file=out, flush=True)
            for file in written_off(changed):
                print(f"nothing is known of the tests of {file}", file=out, flush=True)
        ended = pytest.main([*options, *files], plugins=[mutating := Mutating(given, out)])
    allowed = LIVING * sum(mutating.counts.values()) / 100
    return int(ended) or int(len(mutating.lived) > allowed)


if __name__ == "__main__":
    sys.exit(main())
