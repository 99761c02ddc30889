"""Functions of any value, and of dates and times; constructs that are written as calls; the path of a step."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from typing import Any

from ss2sql.language.cancellation import iterate_checked
from ss2sql.language.conversion import format_value
from ss2sql.language.kinds import ANY, BOOL, NONE, STR, UNENCODABLE, Kind, Opaque, Type, Types, unite
from ss2sql.language.operations.lists import are_not_lists
from ss2sql.language.operations.operation import (
    Form,
    Operation,
    check_integer,
    check_list,
    check_number,
    declare,
    have_one_sql_class,
    misuse,
    remove_none_kind,
    suggest_kind,
)
from ss2sql.language.values import get_truth


def _compute_coalesce(*values: Any) -> Any:
    return next((value for value in values if value is not None), None)


def _infer_coalesce(types: Types) -> Type:
    """The type of `coalesce`: arguments after one that is never None are ignored."""
    found: list[Type] = []
    for kind in types:
        found.append(remove_none_kind(kind) if kind.may_be(Kind.NONE) else kind)
        if not kind.may_be(Kind.NONE):
            return unite(found)
    return unite((*found, NONE))


def _in_sql(types: Types) -> bool:
    """Whether all arguments are of one class in SQL; a bool is none: a flag alone, a handle beside None."""
    return have_one_sql_class(types) and not any(kind.may_be(Kind.BOOL) for kind in types)


def _any_true(values: Any) -> bool:
    return any(map(get_truth, iterate_checked(check_list("any", values))))


def _all_true(values: Any) -> bool:
    return all(map(get_truth, iterate_checked(check_list("all", values))))


def _compute_type_name(value: Any) -> str:
    value = value.object if isinstance(value, Opaque) else value
    return "None" if value is None else type(value).__name__


GENERIC = (
    declare(
        "coalesce", (1, None), _compute_coalesce, _infer_coalesce, False, call="coalesce(a, b, ...)",
        about="the first argument that is not None", example="coalesce(None, 0, 1)",
        sqlite=(Form("coalesce({0}, {1})", lambda types: len(types) == 2 and _in_sql(types)),),
        python=(
            Form("{0}", lambda types: not types[0].may_be(Kind.NONE)),
            Form("{0} if {0} is not None else {1}", lambda types: len(types) == 2 and types[0].may_be(Kind.NONE)),
        ),
    ),
    declare(
        "any", 1, _any_true, BOOL, are_not_lists, call="any(list)", about="whether an element of the list is true",
        example="[any([0, 2]), any([])]",
    ),
    declare(
        "all", 1, _all_true, BOOL, are_not_lists, call="all(list)", about="whether all elements of the list are true",
        example="[all([0, 2]), all([])]",
    ),
    declare(
        "type", 1, _compute_type_name, STR, False, call="type(x)", about="the name of a value's type",
        example="[type(1.5), type('a'), type(None)]",
    ),
)  # fmt: skip


# --- functions whose value the session binds, and constructs that are written as calls
def _declare_form(
    name: str, arity: int | tuple[int, int | None], result: Type | Callable[[Types], Type], **others: Any
) -> Operation:
    return declare(name, arity, None, result, True, volatility="volatile", **others)


SPECIAL_FORMS = (
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
        "times", 1, ANY, call="times(v{})", example="[v{5.0} = 1, len(times(v{}))]",
        about="when the values of v{}, v{-2.0} or v{22.2} were stored, in seconds of getTime()",
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


# --- the path of a step as a linked list, for `path(e)` and `cycle(e)`, see frontend/resolve/search_clauses.py
# The names of these operations have blanks, so scripts cannot call them.
class PathCell:
    """The value of an expression in a step, linked to its values in the steps before."""

    __slots__ = ("before", "value")

    def __init__(self, before: PathCell | None, value: Any) -> None:
        self.before = before
        self.value = value


def list_path(cell: PathCell | None) -> list[Any]:
    """The values of the expression in each step, from the first on."""
    found: list[Any] = []
    while cell is not None:
        found.append(cell.value)
        cell = cell.before
    return found[::-1]


def join_path(cell: PathCell | None, between: Any) -> str:
    """The same values joined to one string."""
    if type(between) is not str:
        raise misuse(
            f"path puts a text between values, not {format_value(between)}",
            'write a text between two values: path(x, "/")',
        )
    return between.join(map(str, list_path(cell)))


LINKED_PATHS = (
    declare(
        "path cell", 2, PathCell, Type(Kind.OBJECT), False,
        call="path(x)", about="a step of path(x)", example="",
    ),
    declare(
        "path values", 1, list_path, Type(Kind.LIST), False,
        call="path(x)", about="what x was on the path", example="",
    ),
    declare(
        "path text", 2, join_path, UNENCODABLE, True,
        call='path(x, "/")', about="what x was on the path, as a text", example="", grows=True,
    ),
)  # fmt: skip


# --- dates, times and the time between them: Python's own objects, which have an order, differences and parts
OBJECT = Type(Kind.OBJECT)


def _make_time(name: str, kind: Callable[..., Any], numbers: list[Any]) -> Any:
    """A date or a time from its parts."""
    if len(numbers) < 3:
        hint = f"{name}(2024, 5, 31) takes a year, a month and a day, {name}('2024-05-31') a text in quotes"
        raise misuse(f"{name} of {format_value(numbers[0])}", hint)
    try:
        return kind(*(check_integer(name, part) for part in numbers))
    except (ValueError, OverflowError) as error:
        raise misuse(f"{name}({', '.join(map(format_value, numbers))}): {error}", f"{name}(2024, 5, 31)") from None


def _parse_time(name: str, kind: Any, text: str) -> Any:
    try:
        return kind.fromisoformat(text)
    except ValueError:
        example = "2024-05-31" if name == "date" else "2024-05-31 12:30"
        raise misuse(f"{name} cannot read {format_value(text)}", f"{name}('{example}')") from None


def _make_day(name: str, kind: type, convert: Callable[[Any], Any], first: Any, parts: tuple[Any, ...]) -> Any:
    """A date or a time from its parts, from a text, or by `convert` from another date or time."""
    if parts or type(first) in (int, bool):
        return _make_time(name, kind, [first, *parts])
    if isinstance(first, datetime.date):
        return convert(first)
    if type(first) is str:
        return _parse_time(name, kind, first)
    hint = suggest_kind(first, f"{name}('2024-05-31') or {name}(2024, 5, 31)")
    raise misuse(f"{name} of {format_value(first)}", hint)


def _make_date(first: Any, *parts: Any) -> Any:
    return _make_day("date", datetime.date, lambda day: datetime.date(day.year, day.month, day.day), first, parts)


def _make_datetime(first: Any, *parts: Any) -> Any:
    def convert(day: Any) -> Any:
        return day if isinstance(day, datetime.datetime) else datetime.datetime.combine(day, datetime.time())

    return _make_day("datetime", datetime.datetime, convert, first, parts)


def _make_timedelta(days: Any, seconds: Any = 0) -> Any:
    try:
        return datetime.timedelta(check_number("timedelta", days), check_number("timedelta", seconds))
    except OverflowError:
        raise misuse(f"timedelta of {format_value(days)} days", "at most 999999999 days") from None


def _make_time_part(name: str, kinds: tuple[type, ...], low: int, high: int, about: str, example: str) -> Operation:
    """The row of a function that gives a part of a date or time."""
    what = "dates" if datetime.date in kinds else "times"

    def read(time: Any) -> int:
        if not isinstance(time, kinds):
            hint = "date(...) and datetime(...) make one of a string" if what == "dates" else "datetime(...) makes one"
            raise misuse(f"{name} works on {what}, not on {format_value(time)}", suggest_kind(time, hint))
        found = getattr(time, name)
        return int(found() if callable(found) else found)

    read.__name__ = name
    return declare(
        name, 1, read, lambda types: Type(Kind.INT, low, high), True, call=f"{name}(x)", about=about, example=example
    )


_DATES, _TIMES = (datetime.date,), (datetime.datetime, datetime.time)

DATES = (
    declare(
        "date", (1, 3), _make_date, OBJECT, True, call="date(text) or date(year, month, day)",
        about="a day, of a text or of numbers, or that of a time", example="str(date('2024-05-31') + timedelta(1))",
    ),
    declare(
        "datetime", (1, 6), _make_datetime, OBJECT, True,
        call="datetime(text) or datetime(year, month, day, hour, minute, second)",
        about="a day and a time of day", example="str(datetime('2024-05-31 12:30'))",
    ),
    declare(
        "timedelta", (1, 2), _make_timedelta, OBJECT, True, call="timedelta(days) or timedelta(days, seconds)",
        about="the time between two", example="(date('2024-05-31') - date('2024-05-01')) / timedelta(1)",
    ),
    declare(
        "now", 0, datetime.datetime.now, OBJECT, False, volatility="stable", call="now()", example="",
        about="the time at which the query began, of the computer's clock",
    ),
    _make_time_part("year", _DATES, 1, 9999, "the year", "year(date('2024-05-31'))"),
    _make_time_part("month", _DATES, 1, 12, "the month, from 1", "month(date('2024-05-31'))"),
    _make_time_part("day", _DATES, 1, 31, "the day of the month, from 1", "day(date('2024-05-31'))"),
    _make_time_part("weekday", _DATES, 0, 6, "the day of the week, Monday is 0", "weekday(date('2024-05-31'))"),
    _make_time_part("hour", _TIMES, 0, 23, "the hour", "hour(datetime('2024-05-31 12:30'))"),
    _make_time_part("minute", _TIMES, 0, 59, "the minute", "minute(datetime('2024-05-31 12:30'))"),
    _make_time_part("second", _TIMES, 0, 59, "the second", "second(datetime('2024-05-31 12:30'))"),
)  # fmt: skip

OPERATIONS = (*GENERIC, *DATES, *SPECIAL_FORMS, *LINKED_PATHS)
