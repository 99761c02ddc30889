"""The line of progress: when it appears, what it says, and that it goes away."""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import Any

import pytest
from sessions import Clock

import ss2sql
from ss2sql.language.rows import Rows
from ss2sql.runtime.run.run_state import GraphLevel, ResultSink, Run
from ss2sql.runtime.search.search_run import RowGraph
from ss2sql.session import compiled_script, progress_line
from ss2sql.session.progress_line import Progress

SEARCH = "SELECT n FROM [1] WHERE n == 4 START WITH n = 1 CONNECT BY MEMORIZE 5 n = n + 1;"


class Terminal(io.StringIO):
    """A stream that is a terminal, and what stands in its line in the end."""

    def isatty(self) -> bool:
        return True

    @property
    def line(self) -> str:
        line: list[str] = []
        place = 0
        for character in self.getvalue():
            if character == "\r":
                place = 0
            else:
                line[place : place + 1] = [character]
                place += 1
        return "".join(line).rstrip()


def run_of(**stats: Any) -> Run:
    run = Run(None)  # type: ignore[arg-type]
    for name, value in stats.items():
        setattr(run.stats, name, value)
    return run


def line_of(run: Run, width: int = 80) -> tuple[Progress, Clock, Terminal]:
    clock, terminal = Clock(5.0), Terminal()
    return Progress(run, terminal, clock, lambda: width), clock, terminal


def test_it_appears_is_written_ten_times_a_second_and_goes_away() -> None:
    run = run_of(generated=1200)
    line, clock, terminal = line_of(run)
    written = []
    for tenth in range(40):  # a look every 1/20 s, until 2 s have gone
        clock.now = 5.0 + tenth / 20
        line.show_line()
        written.append(terminal.getvalue().count("\r"))
    assert written[:20] == [0] * 20
    assert written[20] == 1
    assert written[-1] in (10, 11)  # by the rounding of floats
    run = run_of(generated=123456789)
    line, clock, terminal = line_of(run, 30)
    line.remove_line()
    assert terminal.getvalue() == ""  # nothing was shown
    clock.now += 10
    line.show_line()
    assert terminal.line == "10 s | 123,456,789 steps, 12,345,678/s"[:29]
    run.stats.generated = 1
    clock.now += 90
    line.show_line()
    assert terminal.line == "100 s | 1 step, 0/s"
    line.remove_line()
    assert terminal.line == ""
    assert terminal.getvalue().endswith("\r")
    assert "\x1b" not in terminal.getvalue()  # no colours


def said(run: Run, seconds: float) -> str:
    return line_of(run)[0].describe_progress(seconds)


def test_what_it_says_also_of_a_native_search() -> None:
    run = run_of(generated=3000, levels=[GraphLevel(3, 4), GraphLevel(1, 5)])
    run.graph = RowGraph(run.check, None)
    run.graph.rows += [(number,) for number in range(7)]
    run.sink = ResultSink(Rows(("n",), None, []), "native")
    assert said(run, 1.5) == "2 s | 2 levels of MEMORIZE | 7 rows | 3,000 steps, 2,000/s | 0 results"
    run = run_of()
    run.sink = ResultSink(Rows(("n",), [(1,)] * 3000), "database")
    assert said(run, 2.0) == "2 s | 3,000 results, 1,500/s"
    run.sink = ResultSink(Rows(("n",), [(1,)]), "database")
    assert said(run, 2.0) == "2 s | 1 result, 0/s"


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Standard error as a terminal, on which lines appear at once."""
    terminal = Terminal()
    monkeypatch.setattr(compiled_script, "sys", SimpleNamespace(stderr=terminal))
    monkeypatch.setattr(progress_line, "FIRST_SECONDS", 0.0)
    monkeypatch.setattr(progress_line, "REPEAT_SECONDS", 0.0)
    monkeypatch.delenv("TERM", raising=False)
    return terminal


def shown(script: str = SEARCH, engine: Any = "native", **options: Any) -> None:
    with ss2sql.connect(**options) as ss:
        ss.run(script, engine=engine)


@pytest.mark.parametrize(
    "script",
    [
        "SELECT n + this FROM range(3) WHERE n == -1 "
        "START WITH n = 1 CONNECT BY UNIQUE n = n + this STOP WITH n > 4000;",
        "SELECT a.this FROM a = range(300), b = range(300) WHERE a.this + b.this < 0;",
    ],
    ids=["search", "product"],
)
def test_of_both_engines(terminal: Terminal, engine: str, script: str) -> None:
    shown(script, engine)
    text = terminal.getvalue()
    assert "0 results" in text
    assert ("step" in text) == ("UNIQUE" in script)
    assert terminal.line == ""


def test_it_goes_away_when_a_run_ends_or_fails(terminal: Terminal) -> None:
    shown()
    assert " of MEMORIZE | " in terminal.getvalue()
    assert terminal.line == ""
    with pytest.raises(ss2sql.ExecutionError):
        shown("SELECT 1 / (this - 4000) FROM range(5000);")
    assert "s | " in terminal.getvalue().rpartition("MEMORIZE")[2]
    assert terminal.line == ""


def test_auto_needs_a_terminal(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "dumb")
    shown()
    shown(progress=False)
    monkeypatch.delenv("TERM")
    shown(progress=False)
    assert terminal.getvalue() == ""
    file = io.StringIO()
    monkeypatch.setattr(compiled_script, "sys", SimpleNamespace(stderr=file))
    shown()
    assert file.getvalue() == ""
    shown(progress=True)
    assert "MEMORIZE" in file.getvalue()
    monkeypatch.setattr(compiled_script, "sys", SimpleNamespace(stderr=None))  # as under pythonw
    shown(progress=True)


def test_a_run_inside_of_another_shows_no_line_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(compiled_script, "make_progress", lambda run, wanted: asked.append(run))
    with ss2sql.connect() as ss:
        ss.function("inner", lambda n: ss.run(SEARCH).value and n, volatility="volatile")
        ss.run("SELECT inner(this) FROM [1, 2];")
    assert len(asked) == 1


@pytest.mark.parametrize("wrong", ["yes", "", None, 1, 0])
def test_other_values_are_refused(wrong: Any) -> None:
    with pytest.raises(ss2sql.SessionError, match='progress is "auto", True or False, not'):
        ss2sql.connect(progress=wrong)
