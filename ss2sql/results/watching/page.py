"""The page that plays a search in a browser: one HTML file that needs no network."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ss2sql.errors import SessionError
from ss2sql.package_data import find_file
from ss2sql.results.watching.animation_steps import TraceScene, format_traced_row, make_scene
from ss2sql.results.watching.search_trace import SearchTrace, get_trace

if TYPE_CHECKING:
    from ss2sql.results.result import Result

CODES = {"generated": "g", "expanded": "x", "repeated": "r", "stopped": "s", "goal": "!"}
TALL = 760  # pixels in a notebook


class Page:
    """A page that plays searches: `html` is its text. Notebooks show it."""

    def __init__(self, html: str) -> None:
        self.html = html

    def __repr__(self) -> str:
        return f"<the page of a search, {len(self.html.encode()) / 1e6:.1f} MB: animate(path) writes it>"

    def _repr_html_(self) -> str:
        frame = f'style="width: 100%; height: {TALL}px; border: 0" title="the page of a search"'
        return f'<iframe srcdoc="{escape(self.html)}" {frame}></iframe>'


def make_watching_page(results: Sequence[Result], title: str | None) -> Page:
    """The page of one search, or of several side by side."""
    traced = [get_trace(result, "animate()") for result in results]
    heading = title or " and ".join(dict.fromkeys(one.strategy for one in traced))
    data = json.dumps({"panels": list(map(_make_panel, traced))}, ensure_ascii=False, separators=(",", ":"))
    template = find_file("ss2sql.results.watching", "page.html").read_text("utf-8")
    named = template.replace("@TITLE@", escape(heading)).replace("@HEADING@", escape(title or ""))
    before, after = named.split("@DATA@")
    # Between the tags of a script "<" may begin the end of it.
    return Page(f"{before}{data.replace('<', chr(92) + 'u003c')}{after}")


def write_page(page: Page, path: str | Path) -> None:
    try:
        Path(path).write_text(page.html, encoding="utf-8")
    except OSError as error:
        raise SessionError("S002", f"{path} cannot be written: {error.strerror or error}") from error


def _make_panel(traced: SearchTrace) -> dict[str, Any]:
    """One search as columns of short texts and numbers: 10,000 events are less than 1 MB."""
    scene = make_scene(traced)
    steps, texts = scene.steps, dict[str, int]()
    rows = [texts.setdefault(format_traced_row(step.row), len(texts)) for step in steps]
    states = [texts.setdefault(format_traced_row(step.state, named=True), len(texts)) for step in steps]
    kept = "" if traced.is_whole else f", the first {len(traced.events):,} of {traced.total:,} events"
    return {
        "title": f"{traced.strategy}{kept}", "text": traced.script, "clauses": traced.clauses, "weight": traced.weight,
        "codes": "".join(CODES[event.event] for event in traced.events),
        "nodes": [event.n for event in traced.events],
        "parent": [-1 if step.parent is None else step.parent for step in steps],
        "depth": [step.depth for step in steps],
        "g": [_round_number(step.g) for step in steps], "h": [_round_number(step.h) for step in steps],
        "texts": list(texts), "row_text": rows, "state_text": states,
        "leaves": [int(step.event in ("repeated", "stopped")) for step in steps],
        **_make_map(scene),
    }  # fmt: skip


def _make_map(scene: TraceScene) -> dict[str, Any]:
    if not scene.is_map:
        return {"pitch": 0}
    columns = {name: [None if one is None else one[axis] for one in scene.places] for axis, name in enumerate("xy")}
    return {"pitch": scene.pitch, **columns}


def _round_number(value: Any) -> float | None:
    return None if value is None else float(f"{min(value, 1e300):.6g}")
