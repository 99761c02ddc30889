"""Traced runs: their events against textbook loops, the same values; pictures; the page, in a headless Chromium."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from heapq import heappop, heappush
from pathlib import Path
from random import Random

import browser
import pytest
from agreement import is_allowed, outcome, reference_outcome, session_for
from click.testing import CliRunner
from programs.drawn import amount
from programs.scripts import DECISIONS, program
from sessions import code_of

import ss2sql
from ss2sql.cli import main

ROADS = [("A", "B", 4), ("A", "C", 1), ("C", "B", 2), ("B", "A", 4), ("B", "D", 5), ("C", "D", 8), ("D", "E", 1)]
LEFT = {"A": 6, "B": 5, "C": 6, "D": 1, "E": 0}
SEARCH = """SELECT dst FROM roads WHERE dst == "E" START WITH town = "A"
CONNECT BY {}, src == town, town = dst AS list;"""
GRID = """SELECT next(at) AS place FROM [[1, 0], [0, 1], [-1, 0], [0, -1]] WHERE next(at) == [5, 5]
START WITH at = [0, 2] CONNECT BY UNIQUE BY at MAXIMUM 1 COST 1 {},
at[0] + this[0] IN range(6) AND at[1] + this[1] IN range(6) AND NOT [at[0] + this[0], at[1] + this[1]] IN walls,
at = [at[0] + this[0], at[1] + this[1]];"""
ESTIMATE = "HEURISTIC abs(5 - next(at)[0]) + abs(5 - next(at)[1])"
Told = list[tuple[str, str, int]]


@pytest.fixture(scope="module")
def ss() -> Iterator[ss2sql.Session]:
    with ss2sql.connect() as session:
        session.set("roads", [{"src": src, "dst": dst, "km": km, "left": LEFT[dst]} for src, dst, km in ROADS])
        session.set("walls", [[3, y] for y in range(1, 6)])
        yield session


def told(result: ss2sql.Result) -> Told:
    """The events as the tests write them: what happened, in which town, at which total or depth."""
    return [(event, (state or {"town": row["dst"]})["town"], depth if g is None else g)
            for _, _, depth, event, state, row, g, _ in result.trace]  # fmt: skip


def best_first(costly: bool, estimated: bool) -> Told:
    """Uniform cost, A* or, where nothing is costly, greedy best-first, over the states reached."""
    events: Told = [("generated", "A", 0)]
    queue: list[tuple[int, int, int, bool, int, str]] = [(0, 0, 0, True, 0, "A")]
    best, number = {"A": 0}, 0
    while queue:
        _, _, _, expands, g, town = heappop(queue)
        if costly and best[town] < g:
            events.append(("repeated", town, g))
            continue
        events.append(("expanded" if expands else "goal", town, g))
        for src, dst, km in ROADS if expands else ():
            if src != town:
                continue
            total = g + km if costly else g + 1
            if dst in best and (not costly or best[dst] <= total):
                events.append(("repeated", dst, total))
                continue
            events.append(("generated", dst, total))
            best[dst], number, h = total, number + 1, LEFT[dst] if estimated else 0
            if dst == "E" and costly:
                heappush(queue, (total, 0, number, False, total, dst))
            elif dst == "E":
                events.append(("goal", dst, total))
            heappush(queue, ((total if costly else 0) + h, h, number, True, total, dst))
    return events


@pytest.mark.parametrize(("option", "loop"), [
    ("BREADTH FIRST", (False, False)), ("HEURISTIC left", (False, True)), ("COST km", (True, False)),
    ("COST km HEURISTIC left", (True, True)),
])  # fmt: skip
def test_events_are_those_of_the_textbook(ss: ss2sql.Session, option: str, loop: tuple[bool, bool]) -> None:
    script = SEARCH.format(f"UNIQUE BY town {option}")
    result = ss.run(script, trace=1000)
    # A repeated step has no state; its total is that of the loop where it was in the frontier.
    assert [event[:2] for event in told(result)] == [event[:2] for event in best_first(*loop)]
    kept = [event for event in told(result) if event[0] != "repeated"]
    assert kept == [event for event in best_first(*loop) if event[0] != "repeated"]
    assert result.value == ss.run(script).value
    for engine in ("database", "native"):
        assert list(ss.run(script, engine, trace=1000).trace) == list(result.trace)


@pytest.mark.parametrize(("option", "expected"), [
    ("NO CYCLE BY town", "A x B x repeated A D x E ! x C x B x repeated A D x E ! x D x E ! x"),
    ("UNIQUE BY town DEPTH FIRST", "A x B x repeated A D x E ! x C x repeated B repeated D"),
    ("UNIQUE BY town PROBABILITY 1 / km", "A x B C x B D x repeated A repeated D repeated B x E ! x"),
    ("MEMORIZE 3 BY town", "A x B C x repeated A D x repeated B repeated D x E !"),
])  # fmt: skip
def test_events_depth_first_and_of_a_graph(ss: ss2sql.Session, option: str, expected: str) -> None:
    result = ss.run(SEARCH.format(option), trace=1000)
    words = {"generated": "", "expanded": "x", "goal": "!"}
    shown = [words[event] or town if event in words else f"{event} {town}" for event, town, _ in told(result)]
    assert " ".join(shown) == expected
    assert result.value == ss.run(SEARCH.format(option)).value
    assert "natively" in result.notes[0]


def test_a_trace_changes_no_value() -> None:
    searched = 0
    for seed in range(amount(1 / 2)):
        case = program(Random(f"watched {seed}").randbytes(DECISIONS))
        with session_for(case) as ss:
            found, _ = outcome(ss, case.script, trace=10_000)
        if found is not None and found.error != "S002":
            searched += 1
            assert is_allowed(found, reference_outcome(case), "native"), case
    assert searched > 0


def test_a_trace_keeps_so_many_events_and_says_so(ss: ss2sql.Session) -> None:
    script = SEARCH.format("UNIQUE COST km")
    whole, cut = ss.run(script, trace=1000), ss.run(script, trace=5)
    assert list(cut.trace) == list(whole.trace)[:5]
    assert (whole.trace.status, cut.trace.status) == ("complete", "maximum")
    assert cut.value == whole.value
    assert f"the first 5 of {len(whole.trace)} events; trace={len(whole.trace)} holds all" in cut.notes[1]
    assert whole.trace.value[1] == {"n": 0, "parent": None, "depth": 0, "event": "expanded", "state": {"town": "A"},
                                    "row": None, "g": 0, "h": None}  # fmt: skip
    assert ss.compile(script).run(trace=5).trace.value == cut.trace.value
    with pytest.raises(ss2sql.Timeout) as caught:
        ss.run("SELECT this FROM [1] START WITH n = 0 CONNECT BY n = n + this", timeout=0.2, trace=10)
    assert caught.value.partial is not None
    assert len(caught.value.partial.trace) == 10


def test_a_stopped_step_has_the_row_that_nobody_notices(ss: ss2sql.Session) -> None:
    script = """SELECT {} AS c FROM [1, 2] WHERE n + this == 2 START WITH n = 0
        CONNECT BY n = n + this STOP WITH n + this > 1"""
    for column, rows in (("this", [{"c": 1}, {"c": 2}, {"c": 2}]), ("[5][n + this - 2]", [{"c": 5}, None, {"c": 5}])):
        result = ss.run(script.format(column), trace=100)  # this one fails, where nobody asked for it
        assert [event[5] for event in result.trace if event[3] == "stopped"] == rows


def test_errors_name_the_cure(ss: ss2sql.Session) -> None:
    plain = ss.run(SEARCH.format("UNIQUE BY town"))
    for wrong in (lambda: plain.trace, lambda: plain.animate(), lambda: plain.plot(kind="search")):
        with pytest.raises(ss2sql.RepresentationError, match=r"trace=1000"):
            wrong()
    with pytest.raises(ss2sql.SessionError, match=r"does not end with one(.|\n)*CONNECT BY"):
        ss.run("1 + 1", trace=10)
    assert code_of(ss.run, "1", trace=0) == "S002"
    assert code_of(ss.run(SEARCH.format("UNIQUE BY town"), trace=9).animate, "/nowhere/at/all.html") == "S002"


# --- pictures ------------------------------------------------------------------------------------------


def test_pictures_number_what_was_expanded(ss: ss2sql.Session) -> None:
    pytest.importorskip("matplotlib").use("agg")
    pytest.importorskip("networkx")
    result = ss.run(GRID.format(ESTIMATE), trace=1000)
    expanded = [event for event in result.trace if event[3] == "expanded"]
    ax = result.plot(kind="search")
    places = {text.get_text(): list(map(round, text.xy)) for text in ax.texts}
    assert places == {str(number): event[4]["at"] for number, event in enumerate(expanded, 1)}
    tree = ss.run(SEARCH.format("UNIQUE COST km"), trace=1000).plot(kind="search", title="T")
    assert tree.get_title() == "T"
    assert {"1", "2", "3", "4", "B", "C", "D"} <= {text.get_text() for text in tree.texts}


# --- the page ------------------------------------------------------------------------------------------


def counts(tab: browser.Tab) -> list[dict[str, int]]:
    """The counters of each search on the page."""
    return tab.value("""[...document.querySelectorAll("section")].map((box) => Object.fromEntries(
        [...box.querySelectorAll("[data-count]")].map((b) => [b.dataset.count, +b.textContent.replace(",", "")])))""")


@pytest.fixture(scope="module")
def tab() -> Iterator[browser.Tab]:
    if browser.PROGRAM is None:
        pytest.skip(browser.MISSING)
    with browser.tab() as opened:
        yield opened


def test_the_page_is_played_by_keys(ss: ss2sql.Session, tab: browser.Tab, tmp_path: Path) -> None:
    star, uniform = ss.run(GRID.format(ESTIMATE), trace=1000), ss.run(GRID.format(""), trace=1000)
    star.animate(tmp_path / "grid.html", uniform, title="two <strategies>")
    tab.open(tmp_path / "grid.html")
    assert tab.value("document.title") == "two <strategies>"
    assert tab.value("[...document.querySelectorAll('h2')].map((h) => h.textContent)") == [
        "A*, UNIQUE", "uniform cost, UNIQUE"]  # fmt: skip

    def expected(events: int) -> list[tuple[int, int]]:
        return [tuple(sum(event[3] == word for event in list(one.trace)[:events]) for word in ("generated", "expanded"))
                for one in (star, uniform)]  # type: ignore[misc]  # fmt: skip

    def shown() -> list[tuple[int, int]]:
        return [(one["generated"], one["expanded"]) for one in counts(tab)]

    end = len(uniform.trace)
    assert end > len(star.trace)
    for key, to in [("ArrowRight", 1), ("shift ArrowRight", 11), ("ArrowLeft", 10), ("End", end), ("ArrowRight", end),
                    ("shift ArrowLeft", end - 10), ("Home", 0), ("ArrowLeft", 0)]:  # fmt: skip
        tab.press(key.removeprefix("shift "), shift=key.startswith("shift"))
        assert (key, shown()) == (key, expected(to))
    tab.press("ArrowDown")
    assert expected(2) == shown() == [(1, 1), (1, 1)]
    tab.press("ArrowRight")
    marked = "[...document.querySelectorAll('mark')].map((mark) => mark.textContent)"
    assert tab.value(marked)[0] == "SELECT next(at) AS place"
    speed = tab.value("document.getElementById('speed').textContent")
    for key in "+++++":
        tab.press(key)
    assert tab.value("document.getElementById('speed').textContent") != speed
    tab.press("v")  # the tree in place of the map
    tab.press("f")
    tab.press(" ")
    tab.value("new Promise((done) => { const look = () => t === end ? done() : setTimeout(look, 20); look(); })")
    assert shown() == expected(end)
    assert "play" in tab.value("document.getElementById('play').textContent")
    assert tab.value("document.querySelector('canvas').getAttribute('aria-label')").startswith("tree of the search")
    assert tab.errors == []
    assert all(url.startswith(("file:", "about:")) for url in tab.requests)


def test_ten_thousand_events_are_a_small_page_that_is_there_at_once(tab: browser.Tab, tmp_path: Path) -> None:
    script = """SELECT n + this AS n, '</script><script>window.broken = 1</script>' AS text FROM [1, 3, 7, 2000]
        WHERE n + this == 0 START WITH n = 1 CONNECT BY UNIQUE n = n + this STOP WITH n > 20000"""
    with ss2sql.connect() as ss:
        result = ss.run(script, trace=10_000)
    result.animate(tmp_path / "large.html")
    assert len(result.trace) == 10_000
    assert (tmp_path / "large.html").stat().st_size < 2e6
    tab.open(tmp_path / "large.html", "#end")
    (found,) = counts(tab)
    assert found["generated"] + found["expanded"] + found["repeated"] + found["stopped"] == 10_000
    assert tab.value("window.broken") is None
    assert 0 < tab.seconds() < 1


def test_notebooks_and_the_command_line_have_the_page(ss: ss2sql.Session, tmp_path: Path) -> None:
    page = ss.run(SEARCH.format("UNIQUE COST km"), trace=1000).animate()
    inside = html.unescape(re.findall(r'srcdoc="(.*?)" style', page._repr_html_(), re.DOTALL)[0])
    assert inside == page.html
    assert not re.search(r"https?://", page.html)
    script = tmp_path / "walk.ss"
    script.write_text("SELECT this FROM [1, 2] START WITH n = 1 CONNECT BY n = n + this STOP WITH n > 2;", "utf-8")
    answer = CliRunner().invoke(main, ["play", str(script), "--beside", str(script), "--trace", "7"])
    assert answer.exit_code == 0
    assert f"written to {script.with_suffix('.html')}: 7 and 7 events" in answer.output.replace("\n", "")
    assert script.with_suffix(".html").read_text("utf-8").count('"codes"') == 2
    bad = CliRunner().invoke(main, ["play", "-e", "1", "-o", str(tmp_path / "x.html")])
    assert (bad.exit_code, "CONNECT BY" in bad.output) == (1, True)
