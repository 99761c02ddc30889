"""The scripts of tests/cases: answers, plans and SQL, on every engine. `--golden` writes the expectations anew."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import golden
import pytest
from cases import needs
from golden import Case, Outcome
from reference import Reference
from replay import Replay, search_of
from test_errors import FROM_PYTHON

import ss2sql
from ss2sql.errors import CODES, Source
from ss2sql.frontend.parser import parse

CASES = golden.cases()
ANSWER = ("printed", "status", "value", "error")
COMPILED = ("plan", "sql")
# The reference evaluator does not know these, or would need minutes.
UNKNOWN_TO_REFERENCE = (
    *("hanoi/", "worlds/", "map/"),
    *("queries/dataclasses", "expressions/help", "expressions/var-and-clear"),
)
MANY_ARGUMENTS = ("expressions/assignments", "expressions/functions-of-")


@cache
def outcome(case: Case, engine: str = "auto") -> Outcome:
    return golden.run(case, engine)


def every(cases: list[Case]) -> Any:
    return pytest.mark.parametrize("case", cases, ids=lambda case: case.name)


# --- what a case says ----------------------------------------------------------------------------------


@every(CASES)
def test_answer(case: Case, request: pytest.FixtureRequest) -> None:
    found = outcome(case)
    assert found.usable
    if request.config.getoption("--golden"):
        case.path.write_text(golden.text(case, found.sections), encoding="utf-8")
    else:
        assert shown(found.sections, ANSWER) == shown(case.expected, ANSWER)


@every(CASES)
def test_plan_and_sql(case: Case) -> None:
    assert shown(outcome(case).sections, COMPILED) == shown(case.expected, COMPILED)


def shown(sections: Any, names: tuple[str, ...]) -> str:
    return "".join(f"--- {name}\n{sections[name]}\n" for name in names if sections.get(name))


# --- engines, replay, reference ------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["database", "native"])
@every(CASES)
def test_engines_agree(case: Case, engine: str) -> None:
    found = outcome(case, engine)
    assert found.usable
    if engine == "native" or not isinstance(found.error, ss2sql.UnsupportedError):
        assert found.verdict == outcome(case).verdict


@every([case for case in CASES if "CONNECT BY" in case.script and "value" in case.expected])
def test_paths_replay(case: Case) -> None:
    result = outcome(case).result
    script = parse(Source(case.script))
    query = search_of(script)
    if result is None or query is None:
        return
    if "tick" in case.needs:
        return  # its rows are others at every call
    replay = Replay(Reference(**needs.for_reference(case.needs)), script, query)
    assert all(replay.leads_to_a_goal(path) for path in result.paths)


@every([case for case in CASES if "value" in case.expected and not case.name.startswith(UNKNOWN_TO_REFERENCE)])
def test_reference_agrees(case: Case) -> None:
    if needs.REPRESENTATIONS.keys() & set(case.needs) or case.name.startswith(MANY_ARGUMENTS):
        return
    reference = Reference(**needs.for_reference(case.needs))
    assert golden.written(reference.run(case.script)) == case.expected["value"]
    assert "\n".join(reference.printed) == case.expected.get("printed", "")


# --- errors --------------------------------------------------------------------------------------------


@every([case for case in CASES if "error" in case.expected])
def test_errors_name_place_reason_and_cure(case: Case) -> None:
    error = outcome(case).error
    assert error is not None
    if not isinstance(error, ss2sql.Error):
        assert "called at <script>:" in error.__notes__[0]
        return
    for one in error.errors:
        assert one.span is not None
        assert 0 <= one.span.start <= one.span.end <= len(one.span.source.text)
        assert one.hints
        assert not one.message.endswith(".")


def test_every_code_has_a_case() -> None:
    errors = "\n".join(case.expected.get("error", "") for case in CASES)
    codes = set(re.findall(r"^error\[(\w{4})\]", errors, re.MULTILINE))
    assert codes | FROM_PYTHON.keys() == CODES.keys()
    assert not codes & FROM_PYTHON.keys()


def test_there_are_many_cases() -> None:
    assert len(CASES) >= 100
    assert len([case for case in CASES if "error" in case.expected]) >= 45
    assert len({case.title for case in CASES}) == len(CASES)
