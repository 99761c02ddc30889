"""What a step can say of its path: section 6 of the language page, each function as the page defines it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

from ss2sql.frontend.syntax import ast

from .sight import Frame
from .values import Failure, contains

if TYPE_CHECKING:
    from .evaluator import Reference

ARGUMENTS = {"level": (0,), "prior": (1,), "root": (1,), "path": (1, 2), "next": (1,), "cycle": (1,), "leaf": (0,)}


def is_path_function(ref: Reference, node: Any) -> bool:
    return isinstance(node, ast.Call) and node.function in ARGUMENTS and node.function not in ref.functions


def asks(ref: Reference, node: Any) -> bool:
    """Whether an expression asks for the path of the search that it belongs to."""
    return is_path_function(ref, node) or any(asks(ref, part) for part in _parts(node))


def _parts(node: Any) -> Iterator[Any]:
    values = node if isinstance(node, tuple) else [getattr(node, part.name) for part in fields(node) if part.compare]
    for value in values:
        search = isinstance(value, ast.Query) and value.searches
        if (is_dataclass(value) or isinstance(value, tuple)) and not search:
            yield value


def value(ref: Reference, call: ast.Call, frame: Frame | None) -> Any:
    """The value of `level() prior(e) root(e) path(e) next(e) cycle(e) leaf()` in a step."""
    step = next((level for level in frame.outwards() if level.search is not None), None) if frame else None
    if step is None:
        raise Failure("R014", call.function)
    if len(call.arguments) not in ARGUMENTS[call.function]:
        raise Failure("R005", call.function)
    search, before = step.search, step.before
    if call.function == "level":
        return len(before) + 1
    if call.function == "leaf":
        stop = search.query.stop
        if stop is not None and ref.evaluate(stop, step):
            return True
        return not any(True for _ in search.made(search.connected(step), (*before, step), False))
    expr = call.arguments[0]
    match call.function:
        case "prior":
            return ref.evaluate(expr, before[-1]) if before else None
        case "root":
            return ref.evaluate(expr, before[0] if before else step)
        case "next":
            return ref.evaluate(expr, _after(step))
        case "cycle":
            values = [ref.evaluate(expr, one) for one in before]
            if search.reads_elements(expr):
                return contains(ref.evaluate(expr, step), values)
            return contains(ref.evaluate(expr, _after(step)), [*values, ref.evaluate(expr, step)])
    values = [ref.evaluate(expr, one) for one in (*before, step)]
    if len(call.arguments) == 1:
        return values
    between = ref.evaluate(call.arguments[1], step)
    if not isinstance(between, str):
        raise Failure("X007", "path")
    return between.join(map(str, values))


def _after(step: Frame) -> Frame:
    """The step with the state after it."""
    return replace(step, state=step.search.connected(step), before=(*step.before, step))
