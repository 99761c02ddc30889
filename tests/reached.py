"""Which tests reach which line of the package, learned as they run in several processes and kept from run to run.

`pytest -p reached` writes for each file of tests what it reaches, and what it was then; `known` reads it, with lines
as they are in the package now.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections import defaultdict
from collections.abc import Container, Iterable
from difflib import SequenceMatcher
from functools import _lru_cache_wrapper, cache
from pathlib import Path

import coverage
import pytest

TESTS_FOLDER = Path(__file__).parent
PACKAGE = TESTS_FOLDER.parent / "ss2sql"
FOLDER = TESTS_FOLDER.parent / "out" / "reached"
READING = ("golden", "cases", "wrong_scripts", "samples(", "by_sheet")

Reached = dict[str, dict[int, list[str]]]


class Learning:
    """What pytest does besides: the tests of each file are measured in a file of their own."""

    def __init__(self) -> None:
        self.file: Path | None = None
        self.measure = coverage.Coverage(None, config_file=False)
        self.seconds: dict[str, float] = defaultdict(float)
        (FOLDER / "texts").mkdir(parents=True, exist_ok=True)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> object:
        if item.path != self.file:
            self.finish()
            self.file = item.path
            data = place(item.path, "coverage")
            data.unlink(missing_ok=True)
            self.measure = coverage.Coverage(data, config_file=False, source=[str(PACKAGE)])
            self.measure.start()
        self.measure.switch_context(item.nodeid)
        forget_in(item)  # else what another test has found would count as its own
        begun = time.process_time()
        done = yield
        self.seconds[item.nodeid] += time.process_time() - begun
        return done

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.seconds[report.nodeid] = math.inf

    def pytest_sessionfinish(self) -> None:
        self.finish()

    def finish(self) -> None:
        """Writes what is learned of a file."""
        if self.file is None:
            return
        self.measure.stop()
        self.measure.save()
        texts = {}
        for name in self.measure.get_data().measured_files():
            text = Path(name).read_text(encoding="utf-8")
            texts[str(Path(name).relative_to(PACKAGE))] = digest(text)
            (FOLDER / "texts" / digest(text)).write_text(text, encoding="utf-8")
        write(self.file, self.seconds, texts)
        self.seconds.clear()


def pytest_configure(config: pytest.Config) -> None:
    if hasattr(config, "workerinput"):
        config.pluginmanager.register(Learning())


def write(file: Path, seconds: dict[str, float], texts: dict[str, str]) -> None:
    """Notes a file of tests as it is now: how long each of its tests takes, and the texts that they reach."""
    row = {"of": digest(read_with_data(file)), "seconds": seconds, "texts": texts, "package": str(PACKAGE)}
    place(file, "json").write_text(json.dumps(row), encoding="utf-8")


def stale(files: Iterable[str], anew: bool = False) -> list[str]:
    """The files of tests of which nothing is known, or that are not what they were."""
    return [file for file in files if anew or not is_known(Path(file))]


def is_known(file: Path) -> bool:
    row = place(file, "json")
    return row.exists() and json.loads(row.read_text(encoding="utf-8"))["of"] == digest(read_with_data(file))


def read_with_data(file: Path) -> str:
    """The text of a file of tests, and that of all in `cases` where it reads something there."""
    text = file.read_text(encoding="utf-8")
    return text + read_cases() if any(word in text for word in READING) else text


@cache
def read_cases() -> str:
    files = [path for path in (TESTS_FOLDER / "cases").rglob("*.*") if path.suffix != ".pyc"]
    return "".join(path.read_text(encoding="utf-8") for path in sorted(files))


def written_off(files: Iterable[str]) -> list[str]:
    """Files that have run and of which nothing was learned, as where all tests are slow; they are known from now on."""
    found = stale(files)
    for file in found:
        write(Path(file), {}, {})
    return found


def known(files: Iterable[str], tests: Container[str]) -> tuple[Reached, dict[str, float]]:
    """Which of these tests reach the lines of files of the package, and how long each takes."""
    reached: Reached = {file: defaultdict(list) for file in files}
    seconds: dict[str, float] = {}
    for path in FOLDER.glob("*.json"):
        row = json.loads(path.read_text(encoding="utf-8"))
        seconds |= row["seconds"]
        data = coverage.CoverageData(str(path.with_suffix(".coverage")))
        data.read()
        for file in reached.keys() & row["texts"].keys():
            # Of a folder that was copied, what it reached keeps the names that it had.
            contexts = data.contexts_by_lineno(str(Path(row.get("package", PACKAGE)) / file))
            for line, then in enumerate(lines_then(file, row["texts"][file]), 1):
                reached[file][line] += [test for test in contexts.get(then, ()) if test in tests and test in seconds]
    return reached, seconds


@cache
def lines_then(file: str, then: str) -> list[int]:
    """For each line of a file of the package, its line in an earlier text; for a new line, that of the line before."""
    now = (PACKAGE / file).read_text(encoding="utf-8")
    if digest(now) == then:
        return [*range(1, len(now.splitlines()) + 1)]
    before = (FOLDER / "texts" / then).read_text(encoding="utf-8")
    matcher = SequenceMatcher(None, before.splitlines(), now.splitlines(), autojunk=False)
    lines, last = [], 1
    places = {to + at: of + at for of, to, size in matcher.get_matching_blocks() for at in range(size)}
    for line in range(len(now.splitlines())):
        last = places.get(line, last - 1) + 1
        lines.append(last)
    return lines


def place(file: Path, ending: str) -> Path:
    """Where it is written what a file of tests reaches."""
    return FOLDER / f"{'.'.join(file.relative_to(TESTS_FOLDER).with_suffix('').parts)}.{ending}"


def digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def forget_in(item: pytest.Item) -> None:
    """Empties the caches of functions in the file of a test."""
    for one in vars(getattr(item, "module", item)).values():
        if isinstance(one, _lru_cache_wrapper):
            one.cache_clear()
