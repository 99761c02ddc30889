"""The operators as functions of values: Python's results, within 64 bits and finite, and the language's errors."""

from __future__ import annotations

from typing import Any

from ss2sql.errors import ExecutionError, did_you_mean
from ss2sql.runtime.messages import check, complex_result, float_overflow, show
from ss2sql.runtime.ordering import NUMBERS

_INTEGERS = frozenset({int, bool})


def _misfit(left: Any, symbol: str, right: Any) -> ExecutionError:
    """The error for operands that `symbol` does not work on."""
    message = f"cannot compute {show(left)} {symbol} {show(right)}"
    if left is None or right is None:
        hint = "None is not a number: test for it first, for example IF(x == None; ...; ...)"
    elif symbol == "+" and (type(left) is list or type(right) is list):
        hint = "+ joins lists with lists: write [x] for a list of one"
    elif symbol == "+" and (type(left) is str or type(right) is str):
        hint = "+ joins strings with str(...), or adds numbers made with int(...) or float(...)"
    else:
        hint = f"{symbol} works on numbers"
    return ExecutionError("X001", message, hints=(hint,))


def _by_zero(left: Any, symbol: str, right: Any) -> ExecutionError:
    hint = "test the divisor first, for example IF(x != 0; ...; ...)"
    return ExecutionError("X002", f"division by zero: {show(left)} {symbol} {show(right)}", hints=(hint,))


def add(left: Any, right: Any) -> Any:
    """`left + right` of numbers, strings or lists."""
    kind, other = type(left), type(right)
    if kind in NUMBERS and other in NUMBERS:
        return check(left + right)
    if kind is other and (kind is str or kind is list):
        return left + right
    raise _misfit(left, "+", right)


def sub(left: Any, right: Any) -> Any:
    """`left - right`."""
    if type(left) in NUMBERS and type(right) in NUMBERS:
        return check(left - right)
    raise _misfit(left, "-", right)


def mul(left: Any, right: Any) -> Any:
    """`left * right` of numbers; lists and strings are not repeated."""
    if type(left) in NUMBERS and type(right) in NUMBERS:
        return check(left * right)
    raise _misfit(left, "*", right)


def div(left: Any, right: Any) -> Any:
    """`left / right`, true division: a float."""
    if type(left) not in NUMBERS or type(right) not in NUMBERS:
        raise _misfit(left, "/", right)
    try:
        return check(left / right)
    except ZeroDivisionError:
        raise _by_zero(left, "/", right) from None


def mod(left: Any, right: Any) -> Any:
    """`left % right`, with the sign of the divisor."""
    if type(left) not in NUMBERS or type(right) not in NUMBERS:
        raise _misfit(left, "%", right)
    try:
        return left % right
    except ZeroDivisionError:
        raise _by_zero(left, "%", right) from None


def power(base: Any, exponent: Any) -> Any:
    """`base ^ exponent`: an integer where both are and the exponent is not negative, else a float."""
    if type(base) not in NUMBERS or type(exponent) not in NUMBERS:
        raise _misfit(base, "^", exponent)
    whole = type(base) in _INTEGERS and type(exponent) in _INTEGERS
    if whole and exponent > 63 and not -1 <= base <= 1:
        # Too large whatever it is, and Python would take its time to find out.
        message = f"integer overflow: {base} ^ {exponent} does not fit into 64 bits"
        raise ExecutionError("X004", message, hints=("make the base a float, for example with float(...)",))
    try:
        result = base**exponent
    except ZeroDivisionError:
        raise _by_zero(base, "^", exponent) from None
    except OverflowError:
        raise float_overflow() from None
    if type(result) is complex:
        raise complex_result(f"{show(base)} ^ {show(exponent)}")
    return check(result)


def neg(value: Any) -> Any:
    """`-value`."""
    if type(value) in NUMBERS:
        return check(-value)
    raise ExecutionError("X001", f"cannot compute -{show(value)}", hints=("- works on numbers",))


def eq(left: Any, right: Any) -> bool:
    """`left == right`, of any two values."""
    return bool(left == right)


def ne(left: Any, right: Any) -> bool:
    """`left != right`, of any two values."""
    return not eq(left, right)


def contains(item: Any, container: Any) -> bool:
    """`item IN container`: an element of a list, a key of a dict, a part of a string."""
    kind = type(container)
    if kind is list:
        return item in container
    if kind is dict:
        return _is_key(container, _as_key(item))
    if kind is str and type(item) is str:
        return item in container
    hint = "IN looks for a string in a string, an element in a list or a key in a dict"
    raise ExecutionError("X001", f"cannot look for {show(item)} in {show(container)}", hints=(hint,))


def lacks(item: Any, container: Any) -> bool:
    """`item NOT IN container`."""
    return not contains(item, container)


def item_of(container: Any, index: Any) -> Any:
    """`container[index]`: an element of a list or string, negative from the end, or the value of a dict's key."""
    kind = type(container)
    if kind is list or kind is str:
        if type(index) not in _INTEGERS:
            hint = "elements are counted from 0, from the end with -1, -2, ...; int(...) makes an integer"
            raise ExecutionError("X001", f"cannot use {show(index)} as an index of {show(container)}", hints=(hint,))
        try:
            return container[index]
        except IndexError:
            raise _out_of_range(container, index) from None
    if kind is dict:
        key = _as_key(index)
        if _is_key(container, key):
            return container[key]
        hints = did_you_mean(str(index), map(str, container)) if container else ("the dict is empty",)
        raise ExecutionError("X003", f"{show(container)} has no key {show(index)}", hints=hints)
    hint = "lists, strings and dicts have elements"
    raise ExecutionError("X001", f"cannot take an element of {show(container)}", hints=(hint,))


def _out_of_range(container: Any, index: int) -> ExecutionError:
    length = len(container)
    elements = "character" if type(container) is str else "element"
    message = f"index {index} is out of range: {show(container)} has {length} {elements}{'' if length == 1 else 's'}"
    hint = f"indexes go from 0 to {length - 1}, or from -1 back to {-length}" if length else "test len(...) first"
    return ExecutionError("X003", message, hints=(hint,))


def slice_of(container: Any, start: Any, stop: Any) -> Any:
    """`container[start:stop]` of a list or string; None stands for a bound that is left out."""
    if type(container) is not list and type(container) is not str:
        hint = "lists and strings have slices"
        raise ExecutionError("X001", f"cannot take a slice of {show(container)}", hints=(hint,))
    for bound in (start, stop):
        if bound is not None and type(bound) not in _INTEGERS:
            hint = "the bounds of a slice are integers, or left out"
            raise ExecutionError("X001", f"cannot use {show(bound)} as the bound of a slice", hints=(hint,))
    return container[start:stop]


def _as_key(value: Any) -> Any:
    """A value as a key of a dict, where a list is a tuple."""
    return tuple(map(_as_key, value)) if type(value) is list else value


def _is_key(container: dict[Any, Any], key: Any) -> bool:
    try:
        return key in container
    except TypeError:  # a dict is no key
        return False
