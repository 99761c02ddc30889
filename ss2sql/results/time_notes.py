"""Notes on times of data frames, which are texts: a comparison with a time in another spelling finds nothing."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime, time
from typing import Any, NamedTuple

from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.plan_traversal import MIRRORED, walk, write_in_script
from ss2sql.vtables.frames import Frame

_TIME = re.compile(r"\d{4}-\d\d-\d\d(T\d\d:\d\d:\d\d(\.\d+)?(\+00:00)?)?")


class TimeComparison(NamedTuple):
    """A comparison of a column of a data frame with what may be a text; `function` has the column on its left."""

    function: str
    text: plan.Expr
    shown: str
    frame: str
    column: str


def find_time_comparisons(query: plan.Query) -> Iterator[TimeComparison]:
    """The comparisons that may be of a time in another spelling than that of the column."""
    nodes = list(walk(query))
    sources = {node.id: node for node in nodes if isinstance(node, (plan.ValueSource, plan.QuerySource))}
    for node in nodes:
        match node:
            case plan.Call(function=plan.Function(name=name, builtin=True), arguments=(left, right)) if (
                name in ("eq", "ne", "in", "not_in") or name in MIRRORED
            ):
                for function, column, text in ((name, left, right), (MIRRORED.get(name, name), right, left)):
                    origin = _find_frame_column(column, sources)
                    if origin is not None:
                        yield TimeComparison(function, text, write_in_script(column), *origin)


def _find_frame_column(
    expr: plan.Expr, sources: Mapping[int, plan.ValueSource | plan.QuerySource]
) -> tuple[str, str] | None:
    """The data frame and its column that an expression reads."""
    while isinstance(expr, plan.Column) and expr.type.may_be(Kind.STR):
        source, name = sources.get(expr.source), expr.name
        if isinstance(source, plan.ValueSource):
            value = source.value
            return (value.name, name) if isinstance(value, plan.Variable) and value.frame else None
        columns = source.query.columns if source is not None else ()
        inner = next((output.expr for output in columns if output.name == name), None)
        if inner is None:
            return None
        expr = inner
    return None


def explain_times(comparisons: Sequence[TimeComparison], get_source: Callable[[str], Any]) -> Iterator[str]:
    """That a time in another spelling than the column's compares as a text, and how the column spells it."""
    for function, expr, shown, frame, column in comparisons:
        wanted = [text for text in _read_texts(expr, get_source) if _read_time(text) is not None]
        source = get_source(frame) if wanted else None
        values = source.columns[column].values if isinstance(source, Frame) and column in source.columns else ()
        like = next((value for value in values if value is not None), None)
        if not isinstance(like, str) or not _TIME.fullmatch(like):
            continue
        for text in wanted:
            spelled = _spell_time(text, like)
            # A shorter text that begins the time has the same order from there on.
            same = spelled.startswith(text) and function in ("ge", "lt")
            if spelled != text and not same:
                yield f"{shown} is a text such as '{like}', and is compared as one; for {text!r} write {spelled!r}"


def _read_texts(expr: plan.Expr, get_source: Callable[[str], Any]) -> list[str]:
    """The texts that are known of the other side, or of the list that it is."""
    if isinstance(expr, plan.MakeList):
        return [text for item in expr.items for text in _read_texts(item, get_source)]
    value = (
        get_source(expr.name)
        if isinstance(expr, plan.Variable)
        else expr.value
        if isinstance(expr, plan.Constant)
        else None
    )
    return [text for text in (value if isinstance(value, list) else [value]) if isinstance(text, str)]


def _read_time(text: str) -> datetime | None:
    """The time that a text is in a spelling of ISO 8601; None for any other, and for parts of a microsecond."""
    try:
        return None if re.search(r"\.\d{6}\d*[1-9]", text) else datetime.fromisoformat(text)
    except ValueError:
        return None


def _spell_time(text: str, like: str) -> str:
    """A time as a column spells it, or the text itself where it is no time that the column could hold."""
    when, zone = _read_time(text), like.endswith("+00:00")
    if when is None or (when.tzinfo is not None and not zone):
        return text
    if zone:
        when = when.replace(tzinfo=UTC) if when.tzinfo is None else when.astimezone(UTC)
    if "T" in like:
        return when.isoformat()
    return text if when.time() != time() else when.date().isoformat()
