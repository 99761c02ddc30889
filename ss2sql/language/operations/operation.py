"""A row of the table of operations, and the checks of arguments.

Its *value*, a Python function, always decides. Everything else is a promise about the value (`result`, `can_fail`) or
a faster *form* of it, code that an engine's compiler puts in place of the call:

    Form("{0} || {1}", exactly(Kind.STR))                    right wherever `when` holds for the types of the arguments
    Form("{0} + {1}", sql_numbers, check=Check.SIZE)         where the call may fail, the sum counts if it is a number
    Form("sqrt({0})", sql_numbers, check="{0} >= 0")         where the call may fail, it counts if the check holds
    Form("upper({0})", exactly(Kind.STR), only="...")        it counts only where this holds, so it is always checked

The first form that fits is taken; one without a check only where the call cannot fail. Where no form fits, or a check
does not hold, the engine calls the value, so a missing form costs only time.

In a form `{0}` and `{1}` are arguments, `{*}` all of them, `{reversed}` all of them backwards, and `{value}`, in a
check, the form itself. Forms are plain text until an engine compiles one, so this module needs no sqlglot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from enum import Enum, auto
from typing import Any, TypeAlias

from ss2sql.errors import ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.conversion import format_value
from ss2sql.language.kinds import ANY, NOTHING, Kind, Type, Types, type_of, unite
from ss2sql.language.plan import Function, Volatility
from ss2sql.language.values import NUMBERS

INTEGERS = frozenset({int, bool})
_MISFITS = {
    type(None): "leave None out with WHERE",
    str: "int(...) and float(...) make numbers of text",
    dict: "the rows of a query are dicts: write {0}(SELECT ... AS list), with one column",
    list: "write {0}(flat(x)) for all numbers in lists; in a GROUP BY, max({0}(x)) for the list x of a row",
}


def misuse(message: str, hint: str) -> ExecutionError:
    return ExecutionError("X007", message, hints=(hint,))


def suggest_kind(value: Any, cure: str) -> str:
    """The cure for a value of another kind, or what to write so that None is left out."""
    return "test for it first, for example x != None AND ..." if value is None else cure


def check_list(function: str, value: Any) -> list[Any]:
    """The argument, if it is a list."""
    if type(value) is list:
        return value
    hint = f"collect the values in a list first: {function}(SELECT ... AS list)"
    raise misuse(f"{function} works on a list, not on {format_value(value)}", hint)


def check_numbers(function: str, values: Sequence[Any]) -> set[type]:
    """The types of the values, which have to be numbers."""
    kinds = set(map(type, values))
    if kinds <= NUMBERS:
        return kinds
    misfit = next(value for value in values if type(value) not in NUMBERS)
    hint = _MISFITS.get(type(misfit), "{0} works on numbers alone").format(function)
    raise misuse(f"{function} works on numbers, not on {format_value(misfit)}", hint)


def check_number(function: str, value: Any) -> Any:
    if type(value) is list:
        raise misuse(
            f"{function} works on numbers, not on {format_value(value)}", "write x[0] for the first number in x"
        )
    check_numbers(function, (value,))
    return value


def check_integer(function: str, value: Any) -> int:
    """The argument, if it is an integer; True counts as 1."""
    if type(value) in INTEGERS:
        return int(value)
    raise misuse(
        f"{function} works on integers, not on {format_value(value)}", suggest_kind(value, "int(...) makes an integer")
    )


def check_string(function: str, value: Any) -> str:
    if type(value) is str:
        return value
    raise misuse(
        f"{function} works on strings, not on {format_value(value)}", suggest_kind(value, "str(...) makes a string")
    )


# --- a row of the table of operations
When: TypeAlias = Callable[[Types], bool]


class Check(Enum):
    """Checks that engines know by name, because they depend on bounds or the limits of the run."""

    SIZE = auto()  # a number lies within 64 bits, or is finite; checked once for a whole sum
    NOT_NULL = auto()  # SQL found a value
    NUMBERS = auto()  # the arguments are two integers or two floats at run time, and their value is a small number
    ROOM = auto()  # a string or a list is no larger than the run allows; always checked
    ITSELF = auto()  # none is needed: the form fails as the value does


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """One form of an operation in SQL or Python, see above. `spread`: it takes the candidates of min and max."""

    text: str | Callable[..., Any]  # in Python also a function that is called with the arguments
    when: When = lambda types: True
    check: str | Check | None = None
    only: str | None = None
    spread: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class AggregateOperation:
    """An aggregate of GROUP BY: a function of the list of a group's values that are not None."""

    value: Callable[..., Any]  # of a list of one value at least
    nothing: Any  # of no values
    result: Callable[[Type], Type]  # the type of `value` for the type of the values
    can_fail: Callable[[Type], bool]
    in_sql: Callable[[Type], bool]  # whether the value is the same in any order, signs of zero apart: SQL has none
    sqlite: tuple[Form, ...] = ()  # else a callback collects the values
    python: tuple[Form, ...] = ()
    portable: tuple[Form, ...] = ()

    def type_of_group(self, kind: Type) -> Type:
        """The type for a group, which has a row, of values of this type, None among them perhaps."""
        known = self.result(remove_none_kind(kind))
        return unite((known, type_of(self.nothing))) if kind.may_be(Kind.NONE) else known

    def aggregate_group(self, values: Iterable[Any]) -> Any:
        """The aggregate of the values of a group, where None is skipped."""
        kept = [value for value in values if value is not None]
        return self.value(kept) if kept else self.nothing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Operation:
    """An operator, a built-in function, or an aggregate.

    `value` works on values of the language and raises ExecutionError without a span; it is None for functions that the
    session binds. `result` gives the type of the value for the types of the arguments; what would fail contributes
    nothing to it. `can_fail` is False only where no call with arguments of these types fails. `by_hand` names the
    engines that have code of their own for it.
    """

    name: str
    arity: tuple[int, int | None]
    value: Callable[..., Any] | None
    result: Callable[[Types], Type]
    can_fail: Callable[[Types], bool]
    call: str  # how it is called, for messages, completion and the docs
    about: str  # a line for help() and the docs
    example: str  # a script, whose value the docs show
    volatility: Volatility = "immutable"
    sqlite: tuple[Form, ...] = ()
    python: tuple[Form, ...] = ()
    portable: tuple[Form, ...] = ()  # in DuckDB's SQL, for all other databases
    by_hand: frozenset[str] = frozenset()
    symbol: str = ""  # of an operator
    negated: str = ""  # the comparison that holds where this one does not
    cheap: bool = False  # a few machine instructions, so it may be computed twice
    grows: bool = False  # the value may be larger than the arguments together, so it is measured
    group: AggregateOperation | None = None
    collects: bool = False  # with GROUP BY the first argument is the list of the values of a group
    takes_items: bool = False  # the value takes equally long lists of numbers also as their items, one after the other

    def make_function(self, types: Types | None = None) -> Function:
        """The function as the plan knows it; with `types` those of one call."""
        raises = types is None or self.can_fail(types)
        return Function(
            self.name, *self.arity, self.volatility, raises=raises, reason="built in", collects=self.collects
        )


def declare(
    name: str,
    arity: int | tuple[int, int | None],
    value: Callable[..., Any] | None,
    result: Type | Callable[[Types], Type],
    can_fail: bool | Callable[[Types], bool],
    **others: Any,
) -> Operation:
    """Makes a row; a constant `result` or `can_fail` is passed itself."""
    return Operation(
        name=name,
        arity=(arity, arity) if isinstance(arity, int) else arity,
        value=value,
        result=(lambda types: result) if isinstance(result, Type) else result,
        can_fail=(lambda types: can_fail) if isinstance(can_fail, bool) else can_fail,
        **others,
    )


def declare_aggregate(
    name: str,
    compute: Callable[..., Any],
    result: Type | Callable[[Type], Type],
    *,
    about: str,
    example: str,
    nothing: Any = None,
    accepts: Callable[[str, list[Any]], Any] | None = check_numbers,
    can_fail: Callable[[Type], bool] | None = None,
    in_sql: Callable[[Type], bool] | None = None,
    of_list: dict[str, Any] | None = None,
    **forms: Any,
) -> Operation:
    """The row of an aggregate, which is also a function of one list with the same value and type.

    Args:
        name: the function.
        compute: gets a list of one value at least.
        result: the type of the value for the type of the elements.
        about, example: see Operation.
        nothing: the value of an empty list.
        accepts: raises the error for wrong values; by default they must be numbers.
        can_fail: whether a value of such elements can fail; by default if they may be no numbers.
        in_sql: see AggregateOperation.
        of_list: fields of the function of a list, such as its forms.
        **forms: those of the aggregate.
    """

    def check_and_compute(values: list[Any]) -> Any:
        if accepts is not None:
            accepts(name, values)
        return compute(values)

    def compute_of_list(argument: Any) -> Any:
        values = check_list(name, argument)
        return check_and_compute(values) if values else nothing

    def type_of_list(types: Types) -> Type:
        return (
            unite((type_of_value(element_type(types[0])), type_of(nothing))) if types[0].may_be(Kind.LIST) else NOTHING
        )

    def can_fail_of(types: Types) -> bool:
        return not types[0].is_only(Kind.LIST) or may_fail(element_type(types[0]))

    def type_of_value(kind: Type) -> Type:
        return result if isinstance(result, Type) else result(kind)

    may_fail = can_fail or (lambda kind: not kind.is_only(Kind.NUMBER))
    compute_of_list.__name__ = name
    group = AggregateOperation(
        check_and_compute, nothing, type_of_value, may_fail, in_sql or is_number_or_none, **forms
    )
    row = declare(
        name, 1, compute_of_list, type_of_list, can_fail_of,
        call=f"{name}(list)", about=about, example=example, group=group,
    )  # fmt: skip
    return replace(row, **of_list) if of_list else row


# --- what `when` tests ----------------------------------------------------------------------------------


def each(kinds: Kind) -> When:
    """Tests that all arguments are of these kinds."""
    return lambda types: all(kind.is_only(kinds) for kind in types)


def exactly(kind: Kind) -> When:
    """Tests that all arguments are of this one kind."""
    return lambda types: all(one.kinds == kind for one in types)


are_numeric = each(Kind.NUMBER)


def are_orderable(types: Types) -> bool:
    """Tests that all are numbers, or all are strings."""
    return are_numeric(types) or each(Kind.STR)(types)


def find_sql_class(kind: Type, none: bool = False) -> str | None:
    """`number` or `text` if all values are of that class in SQL, None apart if allowed.

    A bool alone is a number; beside other kinds it is a handle, which has no class.
    """
    allowed = Kind.NONE if none else Kind(0)
    real = Kind.INT | Kind.FLOAT
    if kind.kinds == Kind.BOOL or (kind.is_only(real | allowed) and kind.may_be(real)):
        return "number"
    return "text" if kind.is_only(Kind.STR | allowed) and kind.may_be(Kind.STR) else None


def are_numbers(types: Types) -> bool:
    """Numbers in SQL, or None, which the check looks for."""
    return all(find_sql_class(kind, none=True) == "number" for kind in types)


def are_integers(types: Types) -> bool:
    return are_numbers(types) and each(Kind.BOOL | Kind.INT | Kind.NONE)(types)


def have_one_sql_class(types: Types) -> bool:
    """Tests that all are numbers or None in SQL, or all are text or None."""
    classes = {find_sql_class(kind, none=True) for kind in types}
    return len(classes) == 1 and None not in classes


def is_number_or_none(kind: Type) -> bool:
    return kind.is_only(Kind.NUMBER | Kind.NONE)


def element_type(kind: Type) -> Type:
    """The elements of the lists among the values."""
    if not kind.may_be(Kind.LIST):
        return NOTHING
    return ANY if kind.element is None else kind.element


def remove_none_kind(kind: Type) -> Type:
    return replace(kind, kinds=kind.kinds & ~Kind.NONE)
