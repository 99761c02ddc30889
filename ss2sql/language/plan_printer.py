"""The plan as an indented tree, for people: `ss2sql sql --stage plan` and golden cases."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type

_HIDDEN = frozenset({"span", "place", "type", "scope", "literal", "reads", "tables", "tentative", "lateral"})


def format_plan(program: plan.Program) -> str:
    """A program as text: one node per line, its parts below it, each expression with its type."""
    lines: list[str] = []
    if program.parameters:
        lines.append(f"parameters {', '.join(program.parameters)}")
    for statement in program.statements:
        lines.extend(_format_plan_lines(statement.expr, 0))
    return "\n".join(lines) + "\n"


def format_type(kind: Type) -> str:
    """A type in a few words: `int 1..7`, `str or none`, `list of int`, `any`."""
    if kind.kinds == Kind.ANY:
        return "any"
    names = [(member.name or "").lower() for member in Kind if kind.may_be(member) and member.name in _SINGLE]
    text = " or ".join(names) or "nothing"
    if kind.item is not None and kind.kinds == Kind.LIST:
        text += f" of {format_type(kind.item)}"
    if kind.low is not None and kind.high is not None and kind.kinds != Kind.BOOL:
        text += f" {kind.low}..{kind.high}"
    return text


_SINGLE = frozenset({"NONE", "BOOL", "INT", "FLOAT", "STR", "LIST", "DICT", "OBJECT"})


def _format_plan_lines(node: Any, depth: int, role: str = "") -> Iterator[str]:
    """The line of a node, then those of its parts, each under the name of its field."""
    indent = "  " * depth
    yield f"{indent}{role + ': ' if role else ''}{_format_plan_node(node)}"
    for name, part in _list_parts(node):
        if isinstance(part, tuple) and len(part) == 2 and isinstance(part[0], str):
            yield from _format_plan_lines(part[1], depth + 1, f"{name} {part[0]}")
        else:
            yield from _format_plan_lines(part, depth + 1, name)


def _format_plan_node(node: Any) -> str:
    kind = getattr(node, "type", None)
    shown = f" [{format_type(kind)}]" if isinstance(kind, Type) and not isinstance(node, plan.Subquery) else ""
    match node:
        case plan.Constant(value=value):
            return f"constant {value!r}"
        case plan.Element(source=source):
            return f"this of source {source}{shown}"
        case plan.Column(source=source, name=name):
            return f"column {name} of source {source}{shown}"
        case plan.State(name=name):
            return f"state {name}{shown}"
        case plan.Call(function=function):
            return f"{function.name}(){'' if function.builtin else ' ' + function.volatility}{shown}"
        case (
            plan.TableSource(id=number, name=name)
            | plan.QuerySource(id=number, name=name)
            | plan.WorldSource(id=number, name=name)
        ):
            return f"{_name_node(node)} {number} {name}"
        case plan.ValueSource(id=number, name=name, element=element):
            return f"{_name_node(node)} {number} {name} [{format_type(element)}]"
        case plan.Query(id=number, representation=representation):
            return f"query {number} as {representation.name}"
        case plan.Search(order=order, repeats=repeats):
            return f"search {order}, rows {repeats}"
        case plan.Output(name=name):
            return f"column {name}"
        case plan.OrderKey(descending=descending):
            return "descending" if descending else "ascending"
        case plan.GroupKey(index=index):
            return f"group value {index + 1}{shown}"
        case plan.Aggregate(function=name):
            return f"aggregate {name}{shown}"
        case _:
            name = getattr(node, "name", "")
            return f"{_name_node(node)}{' ' + name if name else ''}{shown}"


_WORDS = {
    "ValueSource": "source",
    "TableSource": "table",
    "WorldSource": "world",
    "QuerySource": "query source",
    "MakeList": "list",
}


def _name_node(node: Any) -> str:
    name = type(node).__name__
    return _WORDS.get(name, name.lower())


def _list_parts(node: Any) -> Iterator[tuple[str, Any]]:
    """The parts of a node with the names of their fields; a tuple gives several."""
    if isinstance(node, plan.Constant):
        return
    for field in fields(node):
        value = getattr(node, field.name)
        if field.name in _HIDDEN or isinstance(value, (plan.Function, Type)):
            continue
        if field.name == "representation" and not value.arguments and not value.named:
            continue
        if isinstance(value, tuple):
            for item in value:
                if is_dataclass(item) or (isinstance(item, tuple) and len(item) == 2 and _is_named(item)):
                    yield field.name, item
        elif is_dataclass(value):
            yield field.name, value


def _is_named(pair: tuple[Any, Any]) -> bool:
    return isinstance(pair[0], str) and is_dataclass(pair[1]) and not isinstance(pair[1], Type)
