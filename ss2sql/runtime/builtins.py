"""The table of the built-in functions, the operators included: what is known of each beside what computes it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from ss2sql.kinds import ANY, Kind, Type
from ss2sql.plan import Volatility
from ss2sql.runtime import function_types as ft
from ss2sql.runtime import library, operators, ordering
from ss2sql.runtime import operator_types as ot


@dataclass(frozen=True, slots=True)
class Builtin:
    """What is known of a built-in function.

    `python` works on values of the language and raises ExecutionError without a span; it is None for the
    functions that the session binds. `result` gives the type of the result for the types of the arguments,
    `raises` whether a call with such arguments can fail: False is a promise. `text` is a line for `help()`.
    """

    name: str
    minimum: int
    maximum: int | None
    volatility: Volatility
    python: Callable[..., Any] | None
    raises: Callable[[Sequence[Type]], bool]
    result: Callable[[Sequence[Type]], Type]
    text: str


def _pure(
    name: str,
    arity: tuple[int, int | None],
    python: Callable[..., Any],
    result: Callable[[Sequence[Type]], Type],
    raises: Callable[[Sequence[Type]], bool],
    text: str,
) -> Builtin:
    return Builtin(name, *arity, "immutable", python, raises, result, text)


def _of_session(
    name: str, arity: tuple[int, int | None], result: Callable[[Sequence[Type]], Type], text: str
) -> Builtin:
    return Builtin(name, *arity, "volatile", None, ot.always, result, text)


def _any(types: Sequence[Type]) -> Type:
    return ANY


SECONDS = Type(Kind.INT | Kind.FLOAT)
ONE, TWO, MANY = (1, 1), (2, 2), (1, None)

_ENTRIES = (
    _pure("add", TWO, operators.add, ot.add, ot.add_raises, "a + b: the sum; joins strings and lists"),
    _pure("sub", TWO, operators.sub, ot.sub, ot.sub_raises, "a - b: the difference"),
    _pure("mul", TWO, operators.mul, ot.mul, ot.mul_raises, "a * b: the product"),
    _pure("div", TWO, operators.div, ot.div, ot.div_raises, "a / b: the quotient, a float"),
    _pure("mod", TWO, operators.mod, ot.mod, ot.mod_raises, "a % b: the remainder, with the sign of b"),
    _pure("pow", TWO, operators.power, ot.power, ot.power_raises, "a ^ b: a to the power of b"),
    _pure("neg", ONE, operators.neg, ot.neg, ot.sign_raises, "-a: the number with the other sign"),
    _pure("lt", TWO, ordering.lt, ot.boolean, ot.order_raises, "a < b"),
    _pure("le", TWO, ordering.le, ot.boolean, ot.order_raises, "a <= b"),
    _pure("eq", TWO, operators.eq, ot.boolean, ot.never, "a == b: whether the values are equal"),
    _pure("ne", TWO, operators.ne, ot.boolean, ot.never, "a != b: whether the values differ"),
    _pure("ge", TWO, ordering.ge, ot.boolean, ot.order_raises, "a >= b"),
    _pure("gt", TWO, ordering.gt, ot.boolean, ot.order_raises, "a > b"),
    _pure("in", TWO, operators.contains, ot.boolean, ot.membership_raises, "a IN b: b is a list, a dict or a string"),
    _pure("not_in", TWO, operators.lacks, ot.boolean, ot.membership_raises, "a NOT IN b"),
    _pure("item", TWO, operators.item_of, ot.item_of, ot.item_raises, "a[i]: of a list, a string or a dict"),
    _pure("slice", (3, 3), operators.slice_of, ot.slice_of, ot.slice_raises, "a[i:j]: of a list or a string"),
    _pure("len", ONE, library.length, ft.length, ft.length_raises, "the length of a list, a dict or a string"),
    _pure("count", ONE, library.count, ft.length, ft.are_not_lists, "the number of elements of a list"),
    _pure("sum", ONE, library.total, ft.total, ft.total_raises, "the sum of a list of numbers, 0 if it is empty"),
    _pure("min", MANY, library.least, ft.least, ft.extreme_raises, "the least of a list, or of the arguments"),
    _pure("max", MANY, library.greatest, ft.greatest, ft.extreme_raises, "the greatest of a list or the arguments"),
    _pure("average", ONE, library.average, ft.average, ot.always, "the mean of a list of numbers"),
    _pure("uniq", ONE, library.unique, ft.same_list, ft.are_not_lists, "the different elements of a list"),
    _pure(
        "sorted", (1, 2), library.in_order, ft.same_list, ft.sorting_raises, "a list in order; sorted(x, True) falls"
    ),
    _pure("zip", MANY, library.zipped, ft.zipped, ft.are_not_lists, "the first elements of lists, the second, ..."),
    _pure("range", (1, 3), library.numbers_from, ft.numbers_from, ft.range_raises, "range([start,] stop[, step])"),
    _pure("abs", ONE, library.absolute, ot.absolute, ot.sign_raises, "the number without its sign"),
    _pure("round", (1, 2), library.rounded, ft.rounded, ft.rounding_raises, "the nearest number of so many digits"),
    _pure("sqrt", ONE, library.square_root, ft.square_root, ft.square_root_raises, "the square root"),
    _pure("str", ONE, library.text, ft.text, ft.text_raises, "the value as text"),
    _pure("int", ONE, library.to_integer, ft.to_integer, ft.to_integer_raises, "text or a number as an integer"),
    _pure("float", ONE, library.to_float, ft.to_float, ft.are_not_numbers, "text or a number as a float"),
    _pure("distance", TWO, library.distance, ft.size, ft.size_raises, "the distance of two numbers or points"),
    _pure("norm", ONE, library.norm, ft.size, ft.size_raises, "the length of a list of numbers"),
    _of_session("print", MANY, lambda types: types[-1], "prints its arguments and has the value of the last"),
    _of_session("help", (0, 1), _any, "what functions there are, or what one does: help('len')"),
    _of_session("var", (0, 1), _any, "the script's variables, or the value of one: var('x')"),
    _of_session("clear", (0, 0), _any, "forgets the script's variables"),
    _of_session("getTime", (0, 0), lambda types: SECONDS, "the time of temporal variables, in seconds"),
    _of_session("eval", ONE, _any, "runs a text as a script, in sight of the current row"),
    _of_session("to", TWO, lambda types: types[0], "to(expr, name) names a column"),
)

# How functions are called, where a and b would not say enough.
_CALLS = {
    "sum": "sum(list)", "count": "count(list)", "average": "average(list)", "uniq": "uniq(list)",
    "min": "min(list) or min(a, b, ...)", "max": "max(list) or max(a, b, ...)", "len": "len(x)", "norm": "norm(list)",
    "sorted": "sorted(list) or sorted(list, True)", "zip": "zip(list, list, ...)", "str": "str(x)", "int": "int(x)",
    "range": "range(stop), range(start, stop) or range(start, stop, step)", "abs": "abs(x)", "sqrt": "sqrt(x)",
    "round": "round(x) or round(x, digits)", "float": "float(x)", "print": "print(a, b, ...)", "eval": "eval(text)",
    "help": "help() or help('name')", "var": "var() or var('name')", "to": "to(expr, name)", "neg": "neg(a)",
    "clear": "clear()", "getTime": "getTime()",
}  # fmt: skip


def usage(name: str) -> str:
    """How a built-in function is called."""
    return _CALLS.get(name) or f"{name}(a, b)"


BUILTINS: dict[str, Builtin] = {entry.name: entry for entry in _ENTRIES}


def _aggregate(function: Callable[[list[Any]], Any], nothing: Any) -> Callable[[Iterable[Any]], Any]:
    """The function over the values of a group: None is skipped, of no values the result is `nothing`."""

    def aggregate(values: Iterable[Any]) -> Any:
        kept = [value for value in values if value is not None]
        return function(kept) if kept else nothing

    return aggregate


AGGREGATES: dict[str, Callable[[Iterable[Any]], Any]] = {
    "count": _aggregate(library.count, 0),
    "sum": _aggregate(library.total, 0),
    "min": _aggregate(library.least, None),
    "max": _aggregate(library.greatest, None),
    "average": _aggregate(library.average, None),
}
