"""Dates, times and the time between them: Python's own objects, which have an order, differences and parts."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from typing import Any

from ss2sql.language.conversion import format_value
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.operations.operation import Operation, check_integer, check_number, declare, misuse

OBJECT = Type(Kind.OBJECT)


def _make_time(name: str, kind: Callable[..., Any], numbers: list[Any]) -> Any:
    """A date or a time from its parts."""
    if len(numbers) < 3:
        raise misuse(f"{name} of {format_value(numbers[0])}", f"{name}(2024, 5, 31) takes a year, a month and a day")
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
    raise misuse(f"{name} of {format_value(first)}", f"{name}('2024-05-31') or {name}(2024, 5, 31)")


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
            raise misuse(f"{name} works on {what}, not on {format_value(time)}", hint)
        found = getattr(time, name)
        return int(found() if callable(found) else found)

    read.__name__ = name
    return declare(
        name, 1, read, lambda types: Type(Kind.INT, low, high), True, call=f"{name}(x)", about=about, example=example
    )


_DATES, _TIMES = (datetime.date,), (datetime.datetime, datetime.time)

OPERATIONS = (
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
