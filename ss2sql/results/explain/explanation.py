"""The value of `explain()`: a text that is also data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ss2sql.results.explain.collector import collect_facts
from ss2sql.results.explain.explanation_text import format_explanation
from ss2sql.results.explain.findings import ScriptFacts
from ss2sql.results.explain.outline import OutlinedStatement

if TYPE_CHECKING:
    from ss2sql.results.result import Result


class Explanation(str):
    """The text of an explanation; `as_dict` has the same as data."""

    facts: ScriptFacts

    def __new__(cls, facts: ScriptFacts) -> Explanation:
        self = super().__new__(cls, format_explanation(facts))
        self.facts = facts
        return self

    def __repr__(self) -> str:
        """The text itself: what a shell or a notebook shows of it."""
        return str(self)

    def as_dict(self) -> dict[str, Any]:
        """Everything that the text says, and SQLite's own words, as dicts, lists, numbers, texts and None."""
        made: dict[str, Any] = _convert_tuples(asdict(self.facts))
        return made


def _convert_tuples(value: Any) -> Any:
    """The value with lists in place of tuples."""
    if isinstance(value, dict):
        return {key: _convert_tuples(item) for key, item in value.items()}
    return list(map(_convert_tuples, value)) if isinstance(value, tuple) else value


def explain_run(
    outlined: Sequence[OutlinedStatement],
    result: Result | None = None,
    missing: Sequence[str] = (),
    levels: bool = False,
) -> Explanation:
    """For every statement and query the engine and the reason, the plan, and the facts of the run."""
    return Explanation(collect_facts(outlined, result, missing, levels))
