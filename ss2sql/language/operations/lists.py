"""Functions of lists, and elements of lists, strings and dicts."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ss2sql.errors import ExecutionError, suggest_names
from ss2sql.language.cancellation import ITEMS_PER_CHECK, iterate_checked
from ss2sql.language.conversion import format_value, read_column
from ss2sql.language.kinds import (
    ANY,
    INTEGER,
    NONE,
    NOTHING,
    Kind,
    Type,
    Types,
    are_comparable,
    bound_integers,
    keep_lists,
    make_list_type,
    make_numbers,
    make_text_type,
    unite,
)
from ss2sql.language.operations.operation import (
    INTEGERS,
    AggregateOperation,
    Form,
    Operation,
    When,
    are_numeric,
    are_orderable,
    check_integer,
    check_list,
    declare,
    each,
    element_type,
    exactly,
    find_sql_class,
    misuse,
)
from ss2sql.language.operations.operators import are_sql_integers
from ss2sql.language.values import (
    NUMBERS,
    SCALARS,
    Opaque,
    compare_values,
    convert_value,
    get_truth,
    has_dict_key,
    make_dict_key,
    make_hashable,
    sort_values,
)

LENGTH = 2**53  # no list and no string is longer: no machine's memory would hold it
RANGE_LIMIT = 10_000_000


def are_not_lists(types: Types) -> bool:
    """Whether a function of lists can fail: an argument may be no list."""
    return not each(Kind.LIST)(types)


def keep_element_type(types: Types) -> Type:
    """The type of a list with the elements of the first argument."""
    return keep_lists(types[0])


# --- elements ------------------------------------------------------------------------------------------


def _get_item(container: Any, index: Any) -> Any:
    """An element of a list or string (negative: from the end), a dict's value, or an object's public data attribute."""
    kind = type(container)
    if kind is list or kind is str:
        if type(index) not in INTEGERS:
            hint = "elements are counted from 0, from the end with -1, -2, ...; int(...) makes an integer"
            if kind is list and container and type(container[0]) is dict and type(index) is str:
                hint = f"these are rows: in a query over them their column is this[{format_value(index)}]"
            raise ExecutionError(
                "X001", f"cannot use {format_value(index)} as an index of {format_value(container)}", hints=(hint,)
            )
        try:
            return container[index]
        except IndexError:
            raise _make_index_operand_error(container, index) from None
    if kind is dict:
        key = make_dict_key(index)
        if has_dict_key(container, key):
            return container[key]
        hints = suggest_names(str(index), map(str, container)) if container else ("the dict is empty",)
        raise ExecutionError("X003", f"{format_value(container)} has no key {format_value(index)}", hints=hints)
    if type(index) is str and kind not in SCALARS and kind is not bytes:
        return read_column(container, index)
    array = _find_array(container)
    if array is not None and type(index) in INTEGERS:
        try:
            return convert_value(array[index], "the array")
        except IndexError:
            raise _make_index_operand_error(array, index) from None
    hint = "lists, strings and dicts have elements"
    raise ExecutionError("X001", f"cannot take an element of {format_value(container)}", hints=(hint,))


def _find_array(value: Any) -> Any:
    """The array that a representation has made, such as a grid: scripts read it as a list. None for anything else."""
    numpy = sys.modules.get("numpy")
    array = value.object if type(value) is Opaque else None
    return array if numpy is not None and isinstance(array, numpy.ndarray) and array.ndim else None


def _make_index_operand_error(container: Any, index: int) -> ExecutionError:
    length = len(container)
    elements = "character" if type(container) is str else "element"
    message = (
        f"index {index} is out of range: {format_value(container)} has {length} {elements}{'' if length == 1 else 's'}"
    )
    hint = f"indexes go from 0 to {length - 1}, or from -1 back to {-length}" if length else "test len(...) first"
    return ExecutionError("X003", message, hints=(hint,))


def _infer_item(types: Types) -> Type:
    container, index = types
    parts = []
    if container.may_be(Kind.LIST) and index.may_be(INTEGER):
        parts.append(_infer_elements_at(container, index))
    if index.may_be(INTEGER):
        parts.append(make_text_type([container]))
    if container.may_be(Kind.DICT | Kind.OBJECT):
        parts.append(ANY)
    return unite(parts)


def _infer_elements_at(container: Type, index: Type) -> Type:
    """The elements of the lists among the values that an index may mean."""
    places = bound_integers(index)
    if container.positions is None or places is None:
        return ANY if container.element is None else container.element
    length = len(container.positions)
    inside = range(max(places[0], -length), min(places[1], length - 1) + 1)
    return unite(container.positions[place] for place in inside)


def _can_item_fail(types: Types) -> bool:
    container, index = types
    places = bound_integers(index)
    if not container.is_only(Kind.LIST) or container.size is None or not index.is_only(INTEGER) or places is None:
        return True
    return places[0] < -container.size or places[1] >= container.size


def _make_forms(kind: Kind, index: When, inside: str) -> tuple[Form, ...]:
    """The forms of `container[index]` for such indexes: for containers of this kind, and for those that may be."""
    name = "dict" if kind is Kind.DICT else "list"
    return (
        Form("{0}[{1}]", lambda types: types[0].is_only(kind) and index(types[1:]), inside),
        Form(
            "{0}[{1}]", lambda types: types[0].may_be(kind) and index(types[1:]), f"type({{0}}) is {name} and {inside}"
        ),
    )


def _is_index_type_from_start(types: Types) -> bool:
    return types[0].kinds == Kind.INT and types[0].is_at_least(0)


def _are_places(types: Types) -> bool:
    """Tests for integers of at least 0: places counted from the start."""
    return are_sql_integers(types) and all(kind.is_at_least(0) for kind in types)


def _slice(container: Any, start: Any, stop: Any) -> Any:
    """A part of a list or string; None stands for a bound that is left out."""
    array = _find_array(container)
    if type(container) is not list and type(container) is not str and array is None:
        hint = "lists and strings have slices"
        raise ExecutionError("X001", f"cannot take a slice of {format_value(container)}", hints=(hint,))
    for bound in (start, stop):
        if bound is not None and type(bound) not in INTEGERS:
            hint = "the bounds of a slice are integers, or left out"
            raise ExecutionError("X001", f"cannot use {format_value(bound)} as the bound of a slice", hints=(hint,))
    return container[start:stop] if array is None else convert_value(array[start:stop], "the array")


def _can_slice_fail(types: Types) -> bool:
    container, *bounds = types
    return not container.is_only(Kind.LIST | Kind.STR) or not each(INTEGER | Kind.NONE)(bounds)


# --- lengths -------------------------------------------------------------------------------------------


def _measure_length(value: Any) -> int:
    """The number of elements of a list, keys of a dict, characters of a string."""
    if type(value) in (list, dict, str):
        return len(value)
    if (array := _find_array(value)) is not None:
        return len(array)
    raise misuse(f"{format_value(value)} has no length", "len works on lists, dicts and strings")


def infer_length(types: Types) -> Type:
    known = types[0].size if types[0].is_only(Kind.LIST) else None
    return Type(Kind.INT, 0, LENGTH) if known is None else Type(Kind.INT, known, known)


# --- the least and the greatest ------------------------------------------------------------------------


def are_of_one_kind(kind: Type) -> bool:
    """Whether equal values are identical, unlike 1, 1.0 and True."""
    return kind.kinds == Kind.BOOL or any(kind.is_only(one | Kind.NONE) for one in (Kind.INT, Kind.FLOAT, Kind.STR))


def _declare_extreme(
    name: str, pick: Callable[[Any], Any], sign: int, keeps: str, last: str, **others: str
) -> Operation:
    """The row of `min` or `max`. The first of equal values wins, as in SQLite's max; its min takes the last."""

    def find_extreme(first: Any, *others: Any) -> Any:
        values = (first, *others) if others else check_list(name, first)
        return find_extreme_of(values) if values else None

    def find_extreme_of(values: Any) -> Any:
        kinds = set(map(type, values))
        if kinds <= NUMBERS or kinds == {str}:
            return pick(values)
        best = values[0]
        for one in iterate_checked(values[1:]):
            if compare_values(one, best) == sign:
                best = one
        return best

    def infer_type(types: Types) -> Type:
        if len(types) == 1 and types[0].positions is None:
            return unite((element_type(types[0]), NONE))
        chosen = _list_extreme_types(types)
        if len(chosen) == 1:
            return chosen[0]
        return _infer_extreme(chosen, smallest=sign < 0) if are_numeric(chosen) else unite(chosen)

    def can_fail(types: Types) -> bool:
        if len(types) == 1 and not types[0].is_only(Kind.LIST):
            return True
        if len(types) == 1 and types[0].positions is None:
            return not are_comparable(element_type(types[0]), element_type(types[0]))
        chosen = _list_extreme_types(types)
        return len(chosen) > 1 and not are_comparable(unite(chosen), unite(chosen))

    find_extreme.__name__ = name
    return declare(
        name, (1, None), find_extreme, infer_type, can_fail, call=f"{name}(list) or {name}(a, b, ...)", **others,
        sqlite=(
            Form(f"{name}({{*}})", lambda types: _in_sql(types) and not unite(types).may_be(Kind.FLOAT), spread=True),
            Form(f"{name}({last})", _in_sql, spread=True),
        ),
        python=(
            Form("{0}", _are_orderable_types(1, 1), spread=True),
            Form(f"{{0}} if {{0}} {keeps} {{1}} else {{1}}", _are_orderable_types(2, 2), spread=True),
            Form(f"{name}({{*}})", _are_orderable_types(3, 10**6), spread=True),
            Form(f"{name}({{0}}) if {{0}} else None", _list_of_alike),
        ),
        portable=(Form(f"{'least' if sign < 0 else 'greatest'}({{*}})", _are_equal_identical, spread=True),),
        group=AggregateOperation(
            find_extreme_of, None, result=lambda kind: kind, can_fail=lambda kind: not are_comparable(kind, kind),
            in_sql=are_of_one_kind,
            sqlite=(Form(f"{name}({{0}})", lambda types: types[0].kinds != Kind.BOOL and are_of_one_kind(types[0])),),
            python=(Form(pick, are_orderable),),
            portable=(Form(f"{name}({{0}})", _are_equal_identical),),
        ),
    )  # fmt: skip


def _list_extreme_types(types: Types) -> Types:
    """The types of the candidates: several arguments, or the elements of a list, known one by one."""
    return types if len(types) > 1 else types[0].positions or types


def _in_sql(types: Types) -> bool:
    """Whether all have one form in SQL: a bool alone is a flag, beside a number a handle."""
    return find_sql_class(unite(types)) is not None


def _are_orderable_types(least: int, most: int) -> When:
    return lambda types: least <= len(types) <= most and are_orderable(types)


def _list_of_alike(types: Types) -> bool:
    return (
        len(types) == 1
        and types[0].is_only(Kind.LIST)
        and types[0].element is not None
        and are_orderable([types[0].element])
    )


def _are_equal_identical(types: Types) -> bool:
    """Whether equal values are identical, so that their order is irrelevant: 0.0 and -0.0 differ."""
    return unite(types).kinds & ~Kind.NONE in (Kind.INT, Kind.STR)


def _infer_extreme(types: Types, smallest: bool) -> Type:
    """The type of the least or greatest number; the least of several is at most each one's upper bound."""
    kinds = unite(types).kinds
    low, high = [kind.low for kind in types], [kind.high for kind in types]
    near, far, pick = (high, low, min) if smallest else (low, high, max)
    known = [bound for bound in near if bound is not None]
    inner = pick(known) if known else None
    outer = None if None in far else pick(bound for bound in far if bound is not None)
    return Type(kinds, outer, inner) if smallest else Type(kinds, inner, outer)


# --- other lists ---------------------------------------------------------------------------------------


def _compute_uniq(values: Any) -> list[Any]:
    """The first of equal elements, in their order."""
    found: dict[Any, Any] = {}
    for value in iterate_checked(check_list("uniq", values)):
        found.setdefault(make_hashable(value), value)
    return list(found.values())


def _sort_list(values: Any, descending: Any = False) -> list[Any]:
    """The sorted elements; the sort is stable."""
    return sort_values(check_list("sorted", values), get_truth(descending))


def _can_sorting_fail(types: Types) -> bool:
    return not types[0].is_only(Kind.LIST) or not are_comparable(element_type(types[0]), element_type(types[0]))


def zip_lists(*lists: Any) -> list[list[Any]]:
    """Lists of the first elements, of the second ones, and so on, up to the length of the shortest list."""
    rows = zip(*(check_list("zip", values) for values in lists), strict=False)
    return list(map(list, rows if len(lists[0]) <= ITEMS_PER_CHECK else iterate_checked(rows)))


def make_range(*bounds: Any) -> list[int]:
    """The integers from 0 up to, not including, a stop; from a start to a stop; the same in steps."""
    limits = [check_integer("range", bound) for bound in bounds]
    if len(limits) == 3 and limits[2] == 0:
        raise misuse("the step of range is 0", "give a positive or a negative step")
    found = range(*limits)
    if found[RANGE_LIMIT:]:
        message = f"range({', '.join(map(str, limits))}) has too many elements"
        raise misuse(message, f"a list made by range has at most {RANGE_LIMIT} elements")
    return list(found)


def _infer_range(types: Types) -> Type:
    limits = [limit for limit in map(bound_integers, types) if limit is not None]
    if len(limits) < len(types):
        return NOTHING
    low = limits[0][0] if len(types) > 1 else 0
    upwards = make_numbers(Kind.INT, (low, max(limits[len(types) > 1][1] - 1, low)))
    return Type(Kind.LIST, element=upwards if len(types) < 3 else Type(Kind.INT), columns=())


def _can_range_fail(types: Types) -> bool:
    item = _infer_range(types).element if each(INTEGER)(types) else None
    return item is None or item.low is None or item.high is None or item.high - item.low >= RANGE_LIMIT


def _compute_reverse(value: Any) -> Any:
    return check_string_or_list("reverse", value)[::-1]


def check_string_or_list(function: str, value: Any) -> Any:
    """The argument, if it is a string or a list."""
    if type(value) is str or type(value) is list:
        return value
    raise misuse(
        f"{function} works on lists and strings, not on {format_value(value)}", "str(...) makes a string of a number"
    )


def _flatten_once(values: Any) -> list[Any]:
    found: list[Any] = []
    for value in iterate_checked(check_list("flat", values)):
        if type(value) is list:
            found.extend(value)
        else:
            found.append(value)
    return found


def _infer_flattened(types: Types) -> Type:
    if not types[0].may_be(Kind.LIST):
        return NOTHING
    item = element_type(types[0])
    inner = element_type(item) if item.may_be(Kind.LIST) else NOTHING
    others = replace(item, kinds=item.kinds & ~Kind.LIST, element=None, positions=None, length=None)
    return Type(Kind.LIST, element=ANY if ANY in (item, inner) else unite((inner, others if others.kinds else NOTHING)))


def _compute_index(values: Any, wanted: Any) -> int | None:
    """The place of the first element that equals the value."""
    try:
        return check_list("index", values).index(wanted)
    except ValueError:
        return None


def _subtract_lists(left: Any, right: Any) -> list[Any]:
    excluded = set(map(make_hashable, iterate_checked(check_list("difference", right))))
    return [value for value in iterate_checked(check_list("difference", left)) if make_hashable(value) not in excluded]


def _compute_single(values: Any) -> Any:
    """The only element of a list, None of an empty one: the value of a query as an operand."""
    found = check_list("single", values)
    if len(found) > 1:
        hint = "write LIMIT 1 for the first row, IN to look for a value in all, or AS list to compare with a list"
        raise ExecutionError("X007", "this query is to be one value, and it has several rows", hints=(hint,))
    return found[0] if found else None


OPERATIONS = (
    declare(
        "single", 1, _compute_single, lambda types: unite((element_type(types[0]), NONE)), True, call="single(list)",
        about="the only element of a list, None of an empty one; so is (SELECT x FROM t) in a comparison",
        example="[single([4]), single([])]",
    ),
    declare(
        "item", 2, _get_item, _infer_item, _can_item_fail, call="a[i]", cheap=True,
        about="a[i]: of a list, a string or a dict", example="[[4, 5][-1], 'abc'[0]]",
        python=(
            Form("{0}[{1}]", lambda types: types[0].is_only(Kind.LIST) and types[1].kinds == Kind.INT),
            *_make_forms(Kind.DICT, exactly(Kind.STR), "{1} in {0}"),
            *_make_forms(Kind.LIST, _is_index_type_from_start, "len({0}) > {1}"),
            *_make_forms(Kind.LIST, exactly(Kind.INT), "len({0}) > {1} > -1"),  # one from the end is left to the value
        ),
        portable=(
            Form("list_extract({0}, {1} + 1)", lambda types: types[0].kinds == Kind.LIST and _are_places(types[1:])),
        ),
        by_hand=frozenset({"sqlite"}),  # lists that stay the same are packed
    ),
    declare(
        "slice", 3, _slice, lambda types: unite((keep_element_type(types), make_text_type(types[:1]))), _can_slice_fail,
        call="a[i:j]", about="a[i:j]: of a list or a string", example="[[1, 2, 3][1:], 'abcd'[:2]]",
        portable=(
            Form("substring({0}, {1} + 1, greatest({2} - {1}, 0))",
                 lambda types: types[0].kinds == Kind.STR and _are_places(types[1:])),
        ),
    ),
    declare(
        "len", 1, _measure_length, infer_length, lambda types: not types[0].is_only(Kind.STR | Kind.LIST | Kind.DICT),
        call="len(x)", about="the length of a list, a dict or a string", example="[len([4, 5]), len('abc')]",
        # SQLite counts characters up to the first NUL only.
        sqlite=(Form("length({0})", exactly(Kind.STR), only="instr({0}, char(0)) = 0"),),
        python=(Form("len({0})", each(Kind.STR | Kind.LIST | Kind.DICT)),),
        portable=(
            Form("cast(length({0}) AS BIGINT)", exactly(Kind.STR)),
            Form("cast(len({0}) AS BIGINT)", exactly(Kind.LIST)),
        ),
    ),
    _declare_extreme("min", min, -1, "<=", "{reversed}", about="the least of a list, or of the arguments",
             example="[min([3, 1, 2]), min(3, 1)]"),
    _declare_extreme("max", max, 1, ">=", "{*}", about="the greatest of a list or the arguments",
                  example="max(['a', 'b'])"),
    declare(
        "uniq", 1, _compute_uniq, keep_element_type, are_not_lists,
        call="uniq(list)", about="the different elements of a list", example="uniq([2, 1, 2, 1.0])",
    ),
    declare(
        "sorted", (1, 2), _sort_list, keep_element_type, _can_sorting_fail, call="sorted(list) or sorted(list, True)",
        about="a list in order; sorted(x, True) falls", example="[sorted([2, 3, 1]), sorted([2, 3, 1], True)]",
    ),
    declare(
        "zip", (1, None), zip_lists,
        lambda types: Type(Kind.LIST, element=make_list_type([element_type(t) for t in types]), columns=()),
        are_not_lists,
        grows=True, call="zip(list, list, ...)", example="zip([1, 2], ['a', 'b'])",
        about="the first elements of lists, the second, ...",
    ),
    declare(
        "range", (1, 3), make_range, _infer_range, _can_range_fail, grows=True,
        call="range(stop), range(start, stop) or range(start, stop, step)", about="range([start,] stop[, step])",
        example="[range(3), range(1, 3), range(6, 0, -2)]",
    ),
    declare(
        "reverse", 1, _compute_reverse, lambda types: unite((keep_element_type(types), make_text_type(types))),
        lambda types: not types[0].is_only(Kind.LIST | Kind.STR), call="reverse(x)",
        about="a list or a string backwards", example="[reverse([1, 2, 3]), reverse('abc')]",
        python=(Form("{0}[::-1]", each(Kind.LIST | Kind.STR)),), portable=(Form("reverse({0})", exactly(Kind.STR)),),
    ),
    declare(
        "flat", 1, _flatten_once, _infer_flattened, are_not_lists, call="flat(list)", grows=True,
        about="a list with the elements of its lists in their places", example="flat([[1, 2], 3, [[4]]])",
    ),
    declare(
        "index", 2, _compute_index, Type(Kind.INT | Kind.NONE, 0, LENGTH), lambda types: are_not_lists(types[:1]),
        call="index(list, x)", about="the place of the first element that equals x, None without one",
        example="[index(['a', 'b'], 'b'), index([], 1)]",
    ),
    declare(
        "difference", 2, _subtract_lists, keep_element_type, are_not_lists, call="difference(a, b)",
        about="the elements of the list a that are not in the list b", example="difference([1, 2, 3, 2], [2])",
    ),
)  # fmt: skip
