"""The scripts of tests/cases, on SQLite, natively and in DuckDB. `--golden` writes the expectations anew."""

from __future__ import annotations

import re
from collections.abc import Iterator

import golden
import pytest
from cases import needs
from golden import Case, Outcome
from reference import Reference
from replay import Replay, search_of
from test_errors import FROM_PYTHON

import ss2sql
from ss2sql.errors import CODES, Source
from ss2sql.frontend.syntax.parser import parse
from ss2sql.runtime.external import level_steps

CASES = golden.cases()
# The reference evaluator does not know these, or would need minutes.
UNKNOWN_TO_REFERENCE = (
    *("hanoi/", "worlds/", "map/"),
    *("queries/dataclasses", "expressions/help", "expressions/var-and-clear"),
)
# What SQL fails in though the answer does not need it; with the engine `auto` Python has the value.
GIVE_UP = (
    *("groups/order-by-a-sum", "groups/regress-having-spares-a-sum", "groups/spared-sum"),
    *("search/regress-a-later-element-fails", "search/regress-stop-where-a-source-is-empty"),
)
MANY_ARGUMENTS = ("expressions/assignments", "expressions/functions-of-")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(case: Case, request: pytest.FixtureRequest) -> None:
    """What a script gives is what its file says, and what everybody else says."""
    found = golden.run(case)
    if request.config.getoption("--golden"):
        case.path.write_text(golden.text(case, found.sections), encoding="utf-8")
        return
    for name in golden.SECTIONS:
        if name in case.expected or name not in golden.COMPILED:
            assert found.sections[name] == case.expected.get(name, ""), name
    assert found.usable
    assert list(wrong_in(found.error)) == []
    native = golden.run(case, "native")
    assert native.usable
    assert native.verdict == found.verdict or (native.error is not None and found.error is None)
    other = golden.run(case, "database")
    assert other.usable
    if case.name in GIVE_UP:
        assert other.error is not None
    elif found.error is None and not isinstance(other.error, ss2sql.UnsupportedError):
        assert other.verdict == found.verdict
    if "value" in case.expected:
        assert_replays(case, found)
        assert_reference_agrees(case)


def test_duckdb_runs_a_script_as_all_do_or_refuses_it(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("duckdb")
    monkeypatch.setattr(level_steps, "MAX_STATES", 0)  # it does all levels, also small ones
    done = 0
    for case in CASES:
        found = golden.run(case, "duckdb")
        assert found.usable, case.name
        if isinstance(found.error, ss2sql.UnsupportedError) or "error" in case.expected:
            continue
        for name in ("printed", "status", "value"):
            assert found.sections[name] == case.expected.get(name, ""), (case.name, name)
        assert found.result is not None
        done += found.result.engine == "duckdb"
    assert done >= 50


def wrong_in(error: BaseException | None) -> Iterator[str]:
    """What an error lacks: each has its place, a cure, and no full stop; the user's own say where they were called."""
    if error is not None and not isinstance(error, ss2sql.Error):
        yield from () if "called at <script>:" in error.__notes__[0] else ["place"]
        return
    for one in error.errors if error is not None else ():
        if one.span is None or not 0 <= one.span.start <= one.span.end <= len(one.span.source.text):
            yield f"{one.message}: place"
        if not one.hints or not all(one.hints):
            yield f"{one.message}: cure"
        if one.message.endswith("."):
            yield f"{one.message}: full stop"


def assert_replays(case: Case, found: Outcome) -> None:
    """Every path of a search leads from its start to a goal."""
    script = parse(Source(case.script))
    query = search_of(script)
    if found.result is None or query is None or "tick" in case.needs:  # the rows of `tick` are others at every call
        return
    replay = Replay(Reference(**needs.for_reference(case.needs)), script, query)
    assert all(replay.leads_to_a_goal(path) for path in found.result.paths)


def assert_reference_agrees(case: Case) -> None:
    if needs.REPRESENTATIONS.keys() & set(case.needs) or case.name.startswith((*UNKNOWN_TO_REFERENCE, *MANY_ARGUMENTS)):
        return
    reference = Reference(**needs.for_reference(case.needs))
    assert golden.written(reference.run(case.script)) == case.expected["value"]
    assert "\n".join(reference.printed) == case.expected.get("printed", "")


def test_every_code_has_a_case() -> None:
    errors = "\n".join(case.expected.get("error", "") for case in CASES)
    codes = set(re.findall(r"^error\[(\w{4})\]", errors, re.MULTILINE))
    assert codes | FROM_PYTHON.keys() == CODES.keys()
    assert not codes & FROM_PYTHON.keys()
