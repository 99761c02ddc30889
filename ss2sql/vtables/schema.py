"""The schema of a table: the types of its columns, the conversion of their values, and the layout of its groups.

Every value of a world passes through the cleaner of its column, on both executors: NumPy's scalars become numbers,
integers in float columns floats, tuples lists. Values that do not fit are refused with the names of table and column.

"mass friction" are two values. "pos(x=posX y z) quat" are a tuple of three and another value: the tuple is the column
`pos`, as a list, and its values are columns, too; the first has two names. So a group may return the result of one
call of a simulator unchanged, and only what is read is unpacked.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import chain, islice, repeat
from types import NoneType, UnionType
from typing import Any, TypeAlias, Union, get_args, get_origin

from ss2sql.errors import Error, ExecutionError, SessionError, Span, suggest_names
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.conversion import convert_value, format_value
from ss2sql.language.kinds import (
    ANY,
    BOOL,
    INT,
    INT_MAX,
    INT_MIN,
    LIST,
    NONE,
    STR,
    Kind,
    Type,
    is_encodable,
    make_list_type,
    unite,
)
from ss2sql.vtables.contract import (
    LARGEST,
    OPERATORS,
    Column,
    Element,
    Gone,
    Table,
    TableFunction,
    World,
    WorldFunction,
)

Cleaner = Callable[[Any], Any]

_PLAIN: dict[Any, Type] = {
    int: INT,
    float: Type(Kind.FLOAT, -LARGEST, LARGEST),
    bool: BOOL,
    str: STR,
    list: LIST,
    dict: Type(Kind.DICT),
    object: ANY,
    Element: Type(Kind.OBJECT),
    None: NONE,
    NoneType: NONE,
}


def find_declared_type(declared: Any) -> Type:
    """The type of the language that a declared type stands for. Raises TypeError for anything else."""
    if isinstance(declared, tuple):
        return make_list_type([find_declared_type(part) for part in declared])
    if get_origin(declared) in (UnionType, Union):
        return unite(map(find_declared_type, get_args(declared)))
    try:
        return _PLAIN[declared]
    except (KeyError, TypeError):
        raise TypeError(f"{declared!r} is no type of a column") from None


def format_declared_type(declared: Any) -> str:
    """A declared type as it is written in Python."""
    if isinstance(declared, tuple):
        return f"({', '.join(map(format_declared_type, declared))})"
    return declared.__name__ if isinstance(declared, type) else str(declared)


def misfit_error(message: str, *hints: str) -> ExecutionError:
    return ExecutionError("X004", message, hints=hints)


def make_cleaner(kind: Type, giver: str) -> Cleaner:
    """The function that converts values of one declared type to values of the language; `giver` names the column."""
    exact = _SCALARS.get(kind.kinds)
    low: Any = INT_MIN if exact is int else kind.low
    high: Any = INT_MAX if exact is int else kind.high

    def clean_value(value: Any) -> Any:
        if type(value) is exact and low <= value <= high:
            return value
        return _fit_value(convert_value(value, giver), kind, giver)

    return clean_value


_SCALARS: dict[Kind, type] = {Kind.FLOAT: float, Kind.INT: int, Kind.BOOL: bool}  # that are bounded


def _fit_value(value: Any, kind: Type, giver: str) -> Any:
    """A value of the language as one of this type: integers become floats where no integers are declared."""
    if kind.positions:
        if type(value) is list and len(value) == len(kind.positions):
            return [_fit_value(item, part, giver) for item, part in zip(value, kind.positions, strict=True)]
        if value is not None or not kind.may_be(Kind.NONE):
            raise _make_column_kind_error(giver, value, f"a list of {len(kind.positions)} values")
    if type(value) is int and kind.may_be(Kind.FLOAT) and not kind.may_be(Kind.INT):
        value = float(value)
    own = _CLASSES.get(type(value), Kind.OBJECT)
    if kind.kinds != Kind.ANY and not kind.may_be(own):
        raise _make_column_kind_error(giver, value, " or ".join(_ONE[one] for one in _ONE if kind.may_be(one)))
    if own is Kind.FLOAT and kind.low is not None and kind.high is not None and not kind.low <= value <= kind.high:
        hint = "floats of worlds lie within 1e100; None needs a column `float | None`"
        raise misfit_error(f"{giver} holds {value}", hint)
    if own is Kind.STR and not (kind.may_be(Kind.OBJECT) or is_encodable(value)):
        raise misfit_error(f"{giver} holds {value!r}, which is no text that can be written as UTF-8")
    return value


_TESTS = {
    Kind.FLOAT: "type({0}) is float and LOW <= {0} <= HIGH",
    Kind.INT: "type({0}) is int and LEAST <= {0} <= GREATEST",
    Kind.STR: "type({0}) is str and ({0}.isascii() or WRITTEN({0}))",
    Kind.BOOL: "({0} is True or {0} is False)",
}


_NAMES = {"LOW": -LARGEST, "HIGH": LARGEST, "LEAST": INT_MIN, "GREATEST": INT_MAX, "WRITTEN": is_encodable}


Kinds: TypeAlias = "tuple[Kind | tuple[Kind, ...], ...]"  # of values; a tuple for one that is a tuple itself


@cache
def make_column_test(kinds: Kinds) -> Callable[[Any], bool] | None:
    """A test that all values of a tuple are clean scalars of these kinds; None for other kinds.

    As one function of plain tests it takes 0.2 us for four values, a call for each value 0.6 us.
    """
    lines, tests = ["def fits(values):"], list[str]()

    def add_tests(names: str, wanted: Sequence[Any]) -> None:
        parts = [f"{names}_{number}" for number in range(len(wanted))]
        lines.append(f" if type({names}) is not tuple or len({names}) != {len(wanted)}: return False")
        lines.append(f" {', '.join(parts)}, = {names}")
        for name, kind in zip(parts, wanted, strict=True):
            if isinstance(kind, tuple):
                add_tests(name, kind)
            else:
                test = _TESTS[kind & ~Kind.NONE].format(name)
                tests.append(f"({name} is None or {test})" if kind & Kind.NONE else test)

    try:
        add_tests("values", kinds)
    except KeyError:
        return None
    lines.append(f" return {' and '.join(tests)}")
    made: dict[str, Any] = dict(_NAMES)
    exec("\n".join(lines), made)  # the code comes from this file alone
    return made["fits"]  # type: ignore[no-any-return]


_ONE = {Kind.INT: "an int", Kind.FLOAT: "a float", Kind.BOOL: "a bool", Kind.STR: "a str", Kind.LIST: "a list",
        Kind.DICT: "a dict", Kind.NONE: "None"}  # fmt: skip
_CLASSES: dict[type, Kind] = {
    NoneType: Kind.NONE, bool: Kind.BOOL, int: Kind.INT, float: Kind.FLOAT, str: Kind.STR, list: Kind.LIST,
    dict: Kind.DICT,
}  # fmt: skip


def _make_column_kind_error(giver: str, value: Any, wanted: str) -> ExecutionError:
    return misfit_error(f"{giver} holds {format_value(value)}, which is not {wanted}")


# --- the layout of a group: columns side by side, or inside of tuples
_PART = re.compile(r"([^\s()=]+(?:=[^\s()=]+)*)(?:\(([^()]*)\))?(?=\s|$)")


@dataclass(frozen=True, slots=True)
class Part:
    """One value of a group: the columns that show it, and where it is a tuple, those that show its values."""

    names: tuple[str, ...]
    inner: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a column: the value with a number, or one of the values of this tuple; `whole` is the tuple."""

    number: int
    inner: int | None = None
    whole: bool = False

    def get_value(self, values: Sequence[Any]) -> Any:
        value = values[self.number]
        if self.inner is not None:
            return value[self.inner]
        return list(value) if self.whole else value


class Layout:
    """The layout of one group. Raises ValueError for a text that is none."""

    def __init__(self, text: str) -> None:
        parts = [
            Part(tuple(names.split("=")), tuple(tuple(one.split("=")) for one in inner.split()))
            for names, inner in _PART.findall(text)
        ]
        if _PART.sub("", text).strip() or not parts:
            raise ValueError(f"{text!r} does not name columns")
        self.parts = tuple(parts)
        self.places: dict[str, Place] = {}
        for number, part in enumerate(parts):
            self.places.update(dict.fromkeys(part.names, Place(number, whole=bool(part.inner))))
            for inner, names in enumerate(part.inner):
                self.places.update(dict.fromkeys(names, Place(number, inner)))
        self.names = tuple(chain.from_iterable((*part.names, *chain.from_iterable(part.inner)) for part in parts))

    @property
    def items(self) -> dict[str, tuple[str, ...]]:
        """The columns of lists, each with a column for each item."""
        lists = [part for part in self.parts if part.inner]
        return {name: tuple(inner[0] for inner in part.inner) for part in lists for name in part.names}

    @property
    def heads(self) -> tuple[str, ...]:
        """A column for each value."""
        return tuple(part.names[0] for part in self.parts)

    def list_tested_kinds(self, kinds: Mapping[str, Type]) -> Kinds:
        return tuple(
            tuple(kinds[names[0]].kinds for names in part.inner) if part.inner else kinds[part.names[0]].kinds
            for part in self.parts
        )

    def find_contradiction(self, kinds: Mapping[str, Type]) -> str | None:
        """The contradiction between the layout and the types of the columns, if any."""
        for part in self.parts:
            for names in (part.names, *part.inner):
                if len({kinds[name] for name in names}) > 1:
                    return f"{' and '.join(names)} are the same value, and of different types"
            inner = tuple(kinds[names[0]] for names in part.inner)
            if inner and (kinds[part.names[0]].positions != inner or not all(kind.is_only(_FLAT) for kind in inner)):
                return f"'{part.names[0]}' is no list of {len(inner)} plain values as they are declared"
        return None

    def clean_values(self, cleaners: Mapping[str, Cleaner], raw: Sequence[Any]) -> tuple[Any, ...]:
        """The group's values, converted; tuples stay tuples. Raises TypeError, ValueError for too few."""
        return tuple(
            [
                tuple(cleaners[part.names[0]](value)) if part.inner else cleaners[part.names[0]](value)
                for part, value in zip(self.parts, raw, strict=True)
            ]
        )


_FLAT = Kind.NONE | Kind.BOOL | Kind.INT | Kind.FLOAT | Kind.STR


# --- the schema of a table
def get_schema(table: Table | TableFunction) -> Schema:
    """The schema of a table, made once. Raises SessionError S002 for declarations that contradict each other."""
    known: Schema | None = table.__dict__.get("_schema")
    if known is None:
        known = table.__dict__["_schema"] = Schema(table)
    return known


class Schema:
    """The declarations of one table, checked.

    `kinds` are the types of the columns in their order, `texts` those that hold strings. Of a table function
    `parameters` are its parameters in order, `required` says how many of them have no default, and `walked` is the
    table whose keys it gives, if it does.
    """

    def __init__(self, table: Table | TableFunction) -> None:
        self.table = table
        self.title = table.name
        self.walked: Table | None = None
        self.parameters: tuple[str, ...] = ()
        self.required = 0
        self.signature = ""
        if isinstance(table, TableFunction):
            self._read_parameters(table)
        # The table whose keys are walked; None where rows come as tuples.
        self.keyed = table if isinstance(table, Table) else self.walked
        columns = table.columns if self.walked is None else self.walked.columns
        self.columns: tuple[Column, ...] = tuple(columns)
        self.kinds: dict[str, Type] = {}
        self.cleaners: dict[str, Cleaner] = {}
        for column in self.columns:
            self._declare_column(column)
        self.texts = frozenset(name for name, kind in self.kinds.items() if kind.is_only(Kind.STR | Kind.NONE))
        self.groups: dict[str, Layout] = {}  # of each group its columns
        # Whether `convert_row` would leave a tuple of a group unchanged; false if unsure. It takes 0.2 us, that 1.1.
        self.quick_tests: dict[str, Callable[[Any], bool]] = {}
        self.arrays: frozenset[str] = frozenset()
        self.blocks: frozenset[str] = frozenset()
        self.group_of: dict[str, str] = {}
        self.places: dict[str, tuple[str, ...]] = {}  # of `this`, or of a column, the columns of its coordinates
        self.items: dict[str, tuple[str, ...]] = {}  # the columns that are the items of a list column
        if self.walked is not None:
            walked = get_schema(self.walked)
            self.groups, self.group_of, self.places = walked.groups, walked.group_of, walked.places
            self.arrays, self.blocks, self.items = walked.arrays, walked.blocks, walked.items
            self.quick_tests = walked.quick_tests
        elif isinstance(table, Table):
            self._read_groups(table)
            self._read_places(table)

    # --- declarations ----------------------------------------------------------------------------------

    def _make_error(self, message: str, *hints: str) -> SessionError:
        owner = type(self.table.world).__name__
        return SessionError("S002", f"the table '{self.title}' of {owner}: {message}", hints=hints)

    def _declare_column(self, column: Column) -> None:
        from ss2sql.frontend.user_functions import check_user_function_name

        try:
            check_user_function_name(column.name)
            kind = find_declared_type(column.type)
        except (SessionError, TypeError) as error:
            raise self._make_error(f"the column '{column.name}' is declared wrongly: {error}") from None
        if column.name in self.kinds:
            raise self._make_error(f"two columns are called '{column.name}'")
        for operator in sorted(column.operators):
            if operator not in OPERATORS:
                message = f"the column '{column.name}' cannot be filtered by '{operator}'"
                raise self._make_error(message, f"choose from {' '.join(OPERATORS)}")
        self.kinds[column.name] = kind
        self.cleaners[column.name] = make_cleaner(kind, f"the column '{column.name}' of {self.title}")

    def _read_groups(self, table: Table) -> None:
        if type(table).keys is Table.keys:
            raise self._make_error("it has no method keys(where)")
        self.arrays, self.blocks = frozenset(table.arrays), frozenset(table.blocks)
        for group, text in chain(table.groups.items(), table.arrays.items(), table.blocks.items()):
            if not callable(getattr(table, group, None)):
                raise self._make_error(f"the group '{group}' has no method of this name")
            self._read_group(table, group, text)
        if table.key and table.key not in self.kinds:
            raise self._make_error(f"its key '{table.key}' is no column", *suggest_names(table.key, self.kinds))
        for name in self.kinds:
            if name not in self.group_of and name != table.key:
                raise self._make_error(f"the column '{name}' is in no group", f'groups = {{"{name}": "{name}"}}')

    def _read_group(self, table: Table, group: str, text: str) -> None:
        try:
            layout = self.groups[group] = Layout(text)
        except ValueError as error:
            raise self._make_error(f"the group '{group}': {error}") from None
        for name in layout.names:
            if name not in self.kinds:
                raise self._make_error(
                    f"the group '{group}' gives '{name}', which is no column", *suggest_names(name, self.kinds)
                )
            if name in self.group_of or name == table.key or layout.names.count(name) > 1:
                raise self._make_error(f"the column '{name}' is given twice")
            self.group_of[name] = group
        wrong = layout.find_contradiction(self.kinds)
        if wrong is None and group in self.arrays and len(layout.parts) < len(layout.names):
            wrong = "it gives arrays, one for each column"
        if wrong is not None:
            raise self._make_error(f"the group '{group}': {wrong}")
        self.items.update(layout.items)
        quick = len(layout.parts) > 1 or group in self.blocks
        tested = make_column_test(layout.list_tested_kinds(self.kinds)) if quick else None
        self.quick_tests[group] = tested or (lambda values: False)

    def _read_places(self, table: Table) -> None:
        for name, text in table.places.items():
            names = self.places[name] = tuple(text.split())
            if len(names) not in (2, 3):
                raise self._make_error(
                    f"the place of '{name}' has {len(names)} coordinates", "a point has two or three"
                )
            for one in names:
                if one not in self.kinds or not self.kinds[one].is_only(Kind.FLOAT):
                    raise self._make_error(f"'{one}' is no coordinate of '{name}'", "name columns of floats")
            if name == "this":
                if not isinstance(getattr(getattr(table.world, "distance", None), "__ss2sql__", None), WorldFunction):
                    raise self._make_error("its elements have a place, but the world has no function 'distance'")
            elif name not in self.kinds or self.kinds[name].positions != tuple(self.kinds[one] for one in names):
                raise self._make_error(f"'{name}' has a place, but is no column of {len(names)} floats")
            else:
                self.items[name] = names

    def _read_parameters(self, table: TableFunction) -> None:
        if type(table).rows is TableFunction.rows:
            raise self._make_error("it has no method rows(...)")
        signature = inspect.signature(table.rows)
        for name, parameter in signature.parameters.items():
            if parameter.kind is not inspect.Parameter.POSITIONAL_OR_KEYWORD:
                hint = "write rows(self, x, radius=1.0)"
                raise self._make_error(f"the parameter '{name}' of rows is none by position", hint)
        self.parameters = tuple(signature.parameters)
        self.required = sum(p.default is inspect.Parameter.empty for p in signature.parameters.values())
        defaults = {name: parameter.default for name, parameter in signature.parameters.items()}
        shown = (n if d is inspect.Parameter.empty else f"{n}={d!r}" for n, d in defaults.items())
        self.signature = f"{table.name}({', '.join(shown)})"
        if table.table:
            walked = next((t for t in get_world_tables(table.world) if t.name == table.table), None)
            if not isinstance(walked, Table) or table.columns:
                raise self._make_error(f"it gives keys of '{table.table}', and has no columns of its own")
            self.walked = walked

    # --- values ----------------------------------------------------------------------------------------

    def convert_row(self, group: str, raw: Any, key: Hashable) -> tuple[Any, ...]:
        """The group's values for one key, converted; tuples within them stay tuples."""
        if type(raw) is tuple and self.quick_tests[group](raw):
            return raw
        layout = self.groups[group]
        values = (raw,) if len(layout.parts) == 1 else raw
        try:
            return layout.clean_values(self.cleaners, values)
        except (TypeError, ValueError):
            raise self._make_count_error(layout.heads, raw, f"the group '{group}'") from None
        except ExecutionError:
            return self._convert_for_element(layout, values, key)

    def _convert_for_element(self, layout: Layout, values: Any, key: Hashable) -> tuple[Any, ...]:
        """The same, with errors that name the element."""
        title, shown = f"{self.title}[{format_value(key)}]", getattr(self.keyed, "key", "")
        cleaners = {name: make_cleaner(self.kinds[name], f"the column '{name}' of {title}") for name in layout.names}
        try:
            return layout.clean_values(cleaners, values)
        except ExecutionError as error:
            if shown:
                cure = f"leave it out first: WHERE {shown} != {format_value(key)} AND ..."
                error.hints = (f"set it anew in the simulation, or {cure}", *error.hints)
            raise

    def convert_function_row(self, raw: Any) -> tuple[Any, ...]:
        """The values of a row of a table function, converted."""
        try:
            return tuple([clean(value) for clean, value in zip(self.cleaners.values(), raw, strict=True)])
        except (TypeError, ValueError):
            raise self._make_count_error(tuple(self.kinds), raw, "a row") from None

    def _make_count_error(self, names: Sequence[str], raw: Any, giver: str) -> ExecutionError:
        count = f"{len(raw)} values" if hasattr(raw, "__len__") else f"a {type(raw).__name__}"
        text = f"{giver} of {self.title} gives {count} for the {len(names)} columns {', '.join(names)}"
        return world_error(text)

    def split_arrays(self, group: str, raw: Any, keys: Sequence[Hashable]) -> Iterator[tuple[Any, ...]]:
        """The rows of a group of arrays, key by key."""
        names = self.groups[group].names
        arrays = [raw] if len(names) == 1 else list(islice(raw, len(names) + 1))
        if len(arrays) != len(names):
            raise world_error(
                f"the group '{group}' of {self.title} gives {len(arrays)} arrays for {len(names)} columns"
            )
        columns = [
            array.tolist() if hasattr(array, "tolist") else list(islice(array, len(keys) + 1)) for array in arrays
        ]
        for name, values in zip(names, columns, strict=True):
            if len(values) != len(keys):
                size = f"{len(values)} values for {len(keys)} keys"
                raise world_error(f"the group '{group}' of {self.title} gives {size} in the column '{name}'")
        rows: Iterable[Any] = columns[0] if len(names) == 1 else zip(*columns, strict=True)
        return map(self.convert_row, repeat(group), rows, keys)

    def read_value(self, key: Hashable, name: str) -> Any:
        """One column of the element with this key, read now."""
        if name == getattr(self.keyed, "key", ""):
            return self.cleaners[name](key)
        group = self.group_of[name]
        return self.groups[group].places[name].get_value(self.read_row(group, key))

    def read_row(self, group: str, key: Hashable, span: Span | None = None) -> tuple[Any, ...]:
        """The group's values for one key, read now."""
        method = getattr(self.keyed, group)
        try:
            if group in self.arrays:
                return next(self.split_arrays(group, method([key]), [key]))
            if group not in self.blocks:
                return self.convert_row(group, method(key), key)
            (raw,) = method([key])
            return self.convert_row(group, raw, key)
        except Error as error:
            raise error.with_span(span) from error.__cause__
        except Exception as error:
            raise make_adapter_error(self, error, key).with_span(span) from error


class AdapterGuard:
    """A context for calls of the adapter: its exceptions become errors of ours with the reason and a place."""

    __slots__ = ("schema", "span")

    def __init__(self, schema: Schema, span: Span | None = None) -> None:
        self.schema = schema
        self.span = span

    def __enter__(self) -> None:
        return

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: object) -> None:
        if isinstance(error, Error):
            error.with_span(self.span)
        elif isinstance(error, Exception):
            raise make_adapter_error(self.schema, error).with_span(self.span) from error


def make_adapter_error(schema: Schema, error: Exception, key: Hashable = None) -> Error:
    """The error for an adapter's exception while it read the element with a key, or the keys."""
    what = schema.title if key is None else f"{schema.title}[{format_value(key)}]"
    reason = _quote_adapter_error(error)
    if isinstance(error, Gone):
        return world_error(f"{what} no longer exists{reason}", "ask for the elements anew: SELECT ... FROM the world")
    hint = "the adapter raised it: its traceback is that of error.__cause__"
    return world_error(f"{what} cannot be read: {type(error).__name__}{reason}", hint)


def _quote_adapter_error(error: Exception) -> str:
    """An exception's message after a colon; empty where it has none, or raises itself."""
    try:
        text = str(error)
    except Exception:  # its class is the adapter's
        return ""
    return f": {text}" if text else ""


def world_error(message: str, *hints: str) -> ExecutionError:
    """The error for a world that cannot be read, or breaks its declarations."""
    return ExecutionError("X011", message, hints=hints)


def get_world_tables(world: World) -> tuple[Table | TableFunction, ...]:
    """The tables of a world, made once for each world. Raises SessionError S002 where it has none, or two of a name."""
    known: tuple[Table | TableFunction, ...] | None = world.__dict__.get("_tables")
    if known is None:
        known = tuple(table(world) for table in type(world).tables)
        names = [table.name for table in known]
        twice = next((name for name in names if names.count(name) > 1 or not name.isidentifier()), None)
        if not known or not isinstance(known[0], Table) or twice is not None:
            what = "its first table is none with keys"
            if twice is not None:
                what = f"'{twice}' cannot be a table's name, or is one twice"
            raise SessionError("S002", f"{type(world).__name__} cannot be a world: {what}")
        world.__dict__["_tables"] = known
    return known
