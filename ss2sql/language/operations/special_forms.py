"""Functions whose value the session binds, and constructs that are written as calls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ss2sql.language.kinds import ANY, Kind, Type
from ss2sql.language.operations.operation import Operation, Types, declare


def _declare_form(
    name: str, arity: int | tuple[int, int | None], result: Type | Callable[[Types], Type], **others: Any
) -> Operation:
    return declare(name, arity, None, result, True, volatility="volatile", **others)


OPERATIONS = (
    _declare_form(
        "print", (1, None), lambda types: types[-1], call="print(a, b, ...)",
        about="prints its arguments and has the value of the last", example="print('n is', 1 + 1)",
    ),
    _declare_form(
        "help", (0, 1), ANY, call="help() or help('name')", example="help('len')",
        about="what functions there are, or what one does: help('len')",
    ),
    _declare_form(
        "var", (0, 1), ANY, call="var() or var('name')", example="[n = 3, var('n')]",
        about="the script's variables, or the value of one: var('x')",
    ),
    _declare_form("clear", 0, ANY, call="clear()", about="forgets the script's variables", example="[n = 3, clear()]"),
    _declare_form(
        "getTime", 0, Type(Kind.INT | Kind.FLOAT), call="getTime()", example="",
        about="the time of temporal variables, in seconds",
    ),
    _declare_form(
        "eval", 1, ANY, call="eval(text)", example="eval('1 + 1')",
        about="runs a text as a script, in sight of the current row",
    ),
    _declare_form(
        "to", 2, lambda types: types[0], call="to(expr, name)", about="to(expr, name) names a column",
        example="SELECT to(this * 2, double) FROM [1, 2] AS dict",
    ),
)  # fmt: skip
