"""The conformance test of adapters: `check_world` reads a world in many ways and compares the results.

First every table is read directly and the rules of vtables/contract.py are tested one by one. Then random queries run
over the world, on both engines, and over a plain copy of its tables: lists of dicts, without filters and groups.
"""

from __future__ import annotations

import random
import warnings
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field
from math import dist, isclose
from typing import Any

from ss2sql.errors import Error
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import Kind
from ss2sql.results import cut_text
from ss2sql.session.session import connect
from ss2sql.vtables.attached_worlds import AttachedWorld, AttachedWorldTable
from ss2sql.vtables.contract import CacheOfQuery, Column, Gone, Table, TableFunction, Where, World, find_adapter
from ss2sql.vtables.reading import Reading, merge_column_demands, unwrap_world_key
from ss2sql.vtables.schema import Schema, get_schema, get_world_tables

Outcome = tuple[str, Any]


@dataclass(frozen=True, slots=True)
class TableCopy:
    """A table as a list of dicts: `title` is its name in scripts, `plain` are its columns of scalars."""

    title: str
    schema: Schema
    plain: Sequence[Column]
    rows: list[dict[str, Any]]

    @property
    def name(self) -> str:
        """The copy's name in scripts."""
        return "copy_of_" + self.title.replace(".", "_")


@dataclass(frozen=True, slots=True)
class QueryPair:
    """A query over the world as text, and over the copies."""

    table: str
    text: str
    copied: str


class QueryGenerator:
    """Generates random queries, and runs them."""

    def __init__(self, dice: random.Random, copies: Sequence[TableCopy], world: World) -> None:
        self.dice = dice
        self.copies = [copy for copy in copies if copy.plain]
        self.session = connect()
        self.session.attach("world", world)
        self.session.attach("numbers", [1, 2, 3])
        for copy in self.copies:  # only the needed columns: each query reads the types of all values
            columns = [column.name for column in copy.plain]
            rows = [{name: row[name] for name in columns} for row in copy.rows]
            self.session.attach(copy.name, rows or {name: [] for name in columns})
        self._turned: list[QueryPair] = []  # joins whose other order is still to come
        self._compiled: tuple[str, Any] = ("", None)

    def find_outcome(self, text: str, engine: Any) -> Outcome:
        try:
            if self._compiled[0] != text:  # both engines share one compilation
                self._compiled = text, self.session.compile(text)
            return "value", tag_checked_value(self._compiled[1].run(engine=engine).value)
        except Error as error:
            return "error", error.code if error.code != "X011" else f"{error.code} {error.message}"

    def find_missing_arguments_code(self, table: AttachedWorldTable) -> str:
        """The code of the error for a table function without its arguments."""
        kind, found = self.find_outcome(f"SELECT this FROM world.{table.table.name}() AS list;", "native")
        return str(found) if kind == "error" else "missing"

    def make_query(self) -> QueryPair:
        """A random query over one or two tables; one over numbers where no table has a column of scalars.

        After a join comes the same join with its tables in the other order.
        """
        if self._turned:
            return self._turned.pop()
        if not self.copies:
            return QueryPair("world", "SELECT this FROM numbers AS list;", "SELECT this FROM numbers AS list;")
        dice = self.dice
        first = dice.choice(self.copies)
        sources: list[tuple[str, TableCopy | None]] = [("a", first)]
        if dice.random() < 0.4:
            sources.append(("b", dice.choice([*self.copies, None])))
        named = [(name, copy) for name, copy in sources if copy is not None]
        columns = [f"{name}.{dice.choice(copy.plain).name}" for name, copy in named for _ in range(dice.randint(1, 3))]
        columns += [f"{name}.this" for name, copy in sources if copy is None]
        where = f" WHERE {self._make_condition(named, 2)}" if dice.random() < 0.9 else ""
        order = self._make_order(named)
        limit = f" LIMIT {dice.randint(1, 5)}" if dice.random() < 0.2 else ""
        start, end = f"SELECT {', '.join(columns)} FROM ", f"{where}{order}{limit} AS rows;"
        made = [_write_checked_query(sources, start, end)]
        if len(sources) > 1:
            made.append(_write_checked_query(sources[::-1], start, end))
            dice.shuffle(made)
        script, *self._turned = made
        return script

    def _make_order(self, named: Sequence[tuple[str, TableCopy]]) -> str:
        if self.dice.random() < 0.8:
            return ""
        name, copy = self.dice.choice(named)
        kinds = copy.schema.kinds
        keys = [c.name for c in copy.plain if kinds[c.name].is_only(_NUMBER) or kinds[c.name].is_only(_TEXT)]
        return f" ORDER BY {name}.{self.dice.choice(keys)}{self.dice.choice(('', ' DESC'))}" if keys else ""

    def _make_condition(self, named: Sequence[tuple[str, TableCopy]], depth: int) -> str:
        dice = self.dice
        if depth and dice.random() < 0.6:
            word = dice.choice((" AND ", " AND ", " OR "))
            inner = word.join(self._make_condition(named, depth - 1) for _ in range(dice.randint(2, 3)))
            return f"NOT ({inner})" if dice.random() < 0.15 else f"({inner})"
        name, copy = dice.choice(named)
        filtered = [column for column in copy.plain if column.filter]  # by which the adapter can filter: preferred
        column = dice.choice(filtered if filtered and dice.random() < 0.7 else copy.plain)
        left = f"{name}.{column.name}"
        kind = copy.schema.kinds[column.name]
        ordered = kind.is_only(_NUMBER) or kind.is_only(_TEXT)
        operator = dice.choice(("==", "!=", "<", "<=", ">", ">=")) if ordered else dice.choice(("==", "!="))
        if dice.random() < 0.1:
            values = ", ".join(self._make_literal(copy, column) for _ in range(3))
            return f"{left} {dice.choice(('IN', 'NOT IN'))} [{values}]"
        right = self._choose_column(named, kind) if dice.random() < 0.25 else self._make_literal(copy, column)
        return f"{left} {operator} {right}" if dice.random() < 0.8 else f"{right} {_TURNED[operator]} {left}"

    def _choose_column(self, named: Sequence[tuple[str, TableCopy]], kind: Any) -> str:
        """A column of the same kind, of any table."""
        alike = [f"{n}.{p.name}" for n, c in named for p in c.plain if c.schema.kinds[p.name].kinds == kind.kinds]
        shift = f" + {self.dice.randint(-2, 2)}" if kind.kinds == Kind.FLOAT and self.dice.random() < 0.5 else ""
        return f"{self.dice.choice(alike)}{shift}"

    def _make_literal(self, copy: TableCopy, column: Column) -> str:
        """A value that the column has, or one near it; rarely one of another kind."""
        if not copy.rows:
            return "0" if copy.schema.kinds[column.name].is_only(_NUMBER) else '""'
        value = self.dice.choice(copy.rows)[column.name]
        if type(value) is float and self.dice.random() < 0.4:
            value += self.dice.choice((-1.0, 1.0)) * self.dice.random()
        if type(value) is int and self.dice.random() < 0.2:
            value += self.dice.choice((-1, 1, 0.5))
        return write_checked_literal(value)


def _write_checked_query(sources: Sequence[tuple[str, TableCopy | None]], start: str, end: str) -> QueryPair:
    """A query over these sources, as scripts for the world and for its copies."""
    table = next(copy.title for _, copy in sources if copy is not None)
    items = [(name, copy.title if copy else "numbers", copy.name if copy else "numbers") for name, copy in sources]
    texts = (start + ", ".join(f"{item[0]} = {item[place]}" for item in items) + end for place in (1, 2))
    return QueryPair(table, *texts)


_NUMBER = Kind.INT | Kind.FLOAT
_TEXT = Kind.STR
_TURNED = {"==": "==", "!=": "!=", "<": ">", "<=": ">=", ">": "<", ">=": "<="}


def write_checked_literal(value: Any) -> str:
    """A scalar as scripts write it."""
    if isinstance(value, str):
        escaped = "".join(c if c.isprintable() and c not in "\\'" else f"\\U{ord(c):08x}" for c in value)
        return f"'{escaped}'"
    text = repr(value)
    return f"({text})" if text.startswith("-") else text


def tag_checked_value(value: Any) -> Any:
    """A value that equals another only if the types are equal as well."""
    if isinstance(value, (list, tuple)):
        return (type(value).__name__, *map(tag_checked_value, value))
    if isinstance(value, dict):
        return ("dict", *((name, tag_checked_value(part)) for name, part in value.items()))
    return type(value).__name__, repr(value) if isinstance(value, float) else value


MANY = 1000  # elements of a table
Arguments = Mapping[str, Sequence[tuple[Any, ...]]]


class BrokenRuleError(AssertionError):
    """An adapter breaks a rule. `rule` is its name, `table` where it was seen, `query` the script that showed it."""

    def __init__(self, rule: str, table: str, detail: str, query: str = "") -> None:
        super().__init__(f"{rule}: {table}: {detail}" + (f"\n  {query}" if query else ""))
        self.rule = rule
        self.table = table
        self.query = query


@dataclass(slots=True)
class Report:
    """What was tested: the number of queries and of elements by table, and table functions without arguments."""

    queries: int = 0
    elements: dict[str, int] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)


def check_world(
    world: Any,
    seed: int = 0,
    queries: int = 200,
    change: Callable[[random.Random], Any] | None = None,
    arguments: Arguments | None = None,
) -> Report:
    """Judges an adapter.

    Args:
        world: a World, or an object that has an adapter. It should have some elements; up to 200 are enough. Random
            queries join tables with each other, so many elements take long: a warning says so.
        seed: of the random choices.
        queries: how many random queries to run, on each engine.
        change: makes births, deaths and moves, now and then between two queries; it gets the source of random numbers.
        arguments: for each table function some tuples of arguments. Functions that are missing here are called with
            values of columns of the same names, or left out.

    Returns:
        What was tried.

    Raises:
        BrokenRuleError: for the first rule that is broken, with its name and what was seen.
    """
    judge = _Judge(world, random.Random(seed), arguments or {})
    judge.check_rules()
    judge.warn_of_size()
    rounds = 4 if change is not None else 1
    for number in range(rounds):
        judge.compare_random_queries((queries + number) // rounds)
        if change is not None:
            judge.check_after_change(change)
    return judge.report


@contextmanager
def _guard_judged_rule(rule: str, table: str) -> Iterator[None]:
    """Exceptions inside break a rule."""
    try:
        yield
    except Exception as error:
        text = error.message if isinstance(error, Error) else f"{type(error).__name__}: {error}"
        raise BrokenRuleError(rule, table, text) from error


class _Judge:
    def __init__(self, source: Any, dice: random.Random, arguments: Arguments) -> None:
        self.dice = dice
        self.arguments = arguments
        self.report = Report()
        world = find_adapter(source)
        if world is None:
            raise BrokenRuleError("there is an adapter", type(source).__name__, "no adapter serves this type")
        self.world: World = world
        with _guard_judged_rule("declarations hold together", type(world).__name__):
            get_world_tables(world)
            self.attached = AttachedWorld("world", world, lambda name, table: name)

    # --- one rule after the other ----------------------------------------------------------------------

    def check_rules(self) -> None:
        """All rules that can be tested without a query."""
        for table in self.attached.tables.values():
            if isinstance(table.table, Table):
                self._check_table(table.table, table.schema)
        for table in self.attached.tables.values():
            if isinstance(table.table, TableFunction):
                self._check_table_function(table.table, table.schema)
        self._check_functions()

    def warn_of_size(self) -> None:
        """Warns of a table that is so large that the random queries may take very long."""
        name, most = max(self.report.elements.items(), key=lambda item: item[1], default=("", 0))
        if most > MANY:
            message = (
                f"check_world: the table '{name}' has {most:,} elements, and random queries join tables with each "
                "other: give it a world of at most 200 elements, which are enough, or queries=0 for the rules alone"
            )
            warnings.warn(message, stacklevel=3)

    def _check_table(self, table: Table, schema: Schema) -> None:
        keys = self._list_keys(table, Where())
        for key in keys:
            try:
                hash(key)
            except TypeError:
                raise BrokenRuleError("keys are hashable", table.name, f"{key!r} is not") from None
        if len(set(keys)) < len(keys):
            twice = next(key for key in keys if keys.count(key) > 1)
            raise BrokenRuleError("keys are unique", table.name, f"{twice!r} comes twice")
        if self._list_keys(table, Where()) != keys:
            raise BrokenRuleError("keys are the same each time", table.name, "a second call gives others")
        rows = self._read_rows(table, schema, keys)
        again = self._read_rows(table, schema, keys)
        if rows != again:
            place = next(index for index, pair in enumerate(zip(rows, again, strict=True)) if pair[0] != pair[1])
            detail = f"{keys[place]!r} is first {rows[place]}, then {again[place]}"
            raise BrokenRuleError("reading changes nothing", table.name, detail)
        self._check_arrays(table, schema, keys, rows)
        for _ in range(60):
            self._check_filter(table, schema, keys, rows)
        self._check_places(table, schema, keys, rows)
        self.report.elements[table.name] = len(keys)

    def _list_keys(self, table: Table, where: Where) -> list[Any]:
        with _guard_judged_rule("keys can be listed", table.name), CacheOfQuery(self.world, {}):
            return list(table.keys(where))

    def _read_rows(self, table: Table, schema: Schema, keys: Sequence[Hashable]) -> list[dict[str, Any]]:
        """All columns of the elements with these keys, read anew."""
        reading = Reading(schema)
        reading.announced = keys
        with _guard_judged_rule("values fit their columns", table.name):
            readers = {name: reading.make_reader(name) for name in schema.kinds}
            return [{name: read(key) for name, read in readers.items()} for key in keys]

    def _check_arrays(self, table: Table, schema: Schema, keys: list[Any], rows: list[dict[str, Any]]) -> None:
        """Arrays and blocks have the values of the requested keys, in their order."""
        if not (schema.arrays or schema.blocks) or not keys:
            return
        known = dict(zip(keys, rows, strict=True))
        for _ in range(10):
            some = self.dice.sample(keys, self.dice.randint(1, len(keys)))
            for key, row in zip(some, self._read_rows(table, schema, some), strict=True):
                if row != known[key]:
                    detail = f"read with {some}, {key!r} is {row} instead of {known[key]}"
                    raise BrokenRuleError("values belong to their keys", table.name, detail)

    def _check_filter(self, table: Table, schema: Schema, keys: list[Any], rows: list[dict[str, Any]]) -> None:
        """`keys(where)` has all keys that `where` allows, in the same order."""
        usable = [(column.name, sorted(column.operators)) for column in schema.columns if column.operators]
        if not usable or not rows:
            return
        demands = []
        for name, operators in self.dice.choices(usable, k=self.dice.randint(1, 3)):
            value = self.dice.choice(rows)[name]
            if isinstance(value, float) and self.dice.random() < 0.3:
                value += self.dice.choice((-1.0, 1.0)) * self.dice.random()
            demands.append(((name, self.dice.choice(operators)), value))
        where = merge_column_demands(demands, schema)
        found = self._list_keys(table, where)
        conditions = ", ".join(f"{name} {operator} {value!r}" for (name, operator), value in demands)
        selected = set(found)
        for key, row in zip(keys, rows, strict=True):
            if key not in selected and all(one.allows(row[name]) for name, one in where.items()):
                detail = f"with {conditions} the key {key!r} is missing, whose row is {row}"
                raise BrokenRuleError("keys are never too few", table.name, detail)
        if len(selected) < len(found):
            raise BrokenRuleError("keys are unique", table.name, f"with {conditions} one comes twice: {found}")
        if found != [key for key in keys if key in selected]:
            detail = f"with {conditions} they come as {found}, without as {keys}"
            raise BrokenRuleError("keys keep one order", table.name, detail)

    def _check_places(self, table: Table, schema: Schema, keys: list[Any], rows: list[dict[str, Any]]) -> None:
        """Elements are where `places` says, and `distance` measures from there."""
        points = {name: [[row[one] for one in columns] for row in rows] for name, columns in schema.places.items()}
        for name in points.keys() - {"this"}:
            for key, row, point in zip(keys, rows, points[name], strict=True):
                if row[name] != point:
                    raise BrokenRuleError(
                        "places are true", table.name, f"of {key!r} {name} is {row[name]}, not {point}"
                    )
        measure: Any = getattr(self.world, "distance", None)
        own = points.get("this") or []
        for _ in range(20 if own else 0):
            one, other = self.dice.randrange(len(keys)), self.dice.randrange(len(keys))
            away = [value + self.dice.uniform(-2, 2) for value in own[other]]
            calls = ((keys[one], keys[other], own[other]), (keys[one], away, away), (away[:2], keys[one], away[:2]))
            for first, second, point in calls:
                wanted = dist(own[one][: len(point)], point)
                found = measure(first, second)
                if not isclose(found, wanted, rel_tol=1e-7, abs_tol=1e-12):
                    detail = f"distance({first!r}, {second!r}) is {found}, the straight distance is {wanted}"
                    raise BrokenRuleError("places are true", table.name, detail)

    # --- functions -------------------------------------------------------------------------------------

    def _check_table_function(self, table: TableFunction, schema: Schema) -> None:
        calls = list(self.make_arguments(table, schema))
        if not calls:
            self.report.skipped.append(table.name)
        for arguments in calls:
            shown = f"{table.name}({', '.join(map(repr, arguments))})"
            with _guard_judged_rule("table functions give rows that fit", shown):
                walked = None if schema.walked is None else Reading(get_schema(schema.walked))
                rows, again = (Reading(schema, walked).call_function(arguments) for _ in range(2))
            if rows != again:
                raise BrokenRuleError("reading changes nothing", shown, f"it gives {rows}, then {again}")
            if schema.walked is not None:
                known = set(self._list_keys(schema.walked, Where()))
                stranger = next((key for key in rows if key not in known), None)
                if stranger is not None:
                    detail = f"it gives {stranger!r}, which is no key of {schema.walked.name}"
                    raise BrokenRuleError("table functions give keys of their table", shown, detail)
                if len(set(rows)) < len(rows):
                    raise BrokenRuleError("keys are unique", shown, f"one comes twice: {rows}")

    def make_arguments(self, table: TableFunction, schema: Schema) -> Iterator[tuple[Any, ...]]:
        if table.name in self.arguments:
            yield from self.arguments[table.name]
            return
        principal = self.attached.principal
        needed = schema.parameters[: schema.required]
        if not all(name in principal.schema.kinds for name in needed):
            return
        assert isinstance(principal.table, Table)
        rows = self._read_rows(principal.table, principal.schema, self._list_keys(principal.table, Where()))
        for row in self.dice.sample(rows, min(5, len(rows))):
            yield tuple(row[name] for name in needed)

    def _check_functions(self) -> None:
        """Functions that are declared stable give the same value twice."""
        principal = self.attached.principal
        assert isinstance(principal.table, Table)
        for key in self._list_keys(principal.table, Where())[:5]:
            element = principal.table.element(key)
            for name, (method, volatility) in self.attached.functions.items():
                if volatility == "volatile":
                    continue
                try:
                    one, other = (method(unwrap_world_key(element, self.world)) for _ in range(2))
                except TypeError:
                    continue  # its argument is no element
                if repr(one) != repr(other):
                    detail = f"{name}({element!r}) is {one!r}, then {other!r}"
                    raise BrokenRuleError("functions keep what they declare", principal.table.name, detail)
                if self.attached.get_declaration(name).indexed:
                    column = principal.schema.read_value(key, name)
                    items = [method(unwrap_world_key(element, self.world), index) for index in range(len(column))]
                    if not one == items == column:
                        detail = f"{name}({element!r}) is {one!r} and {items!r} by index, the column {column!r}"
                        raise BrokenRuleError("functions keep what they declare", principal.table.name, detail)

    # --- queries ---------------------------------------------------------------------------------------

    def copy_tables(self) -> list[tuple[AttachedWorldTable, TableCopy]]:
        """The tables with keys as plain lists of dicts."""
        found = []
        for table in self.attached.tables.values():
            if isinstance(table.table, Table):
                rows = self._read_rows(table.table, table.schema, self._list_keys(table.table, Where()))
                plain = [column for column in table.schema.columns if table.schema.kinds[column.name].is_only(_PLAIN)]
                found.append((table, TableCopy(table.title, table.schema, plain, rows)))
        return found

    def compare_random_queries(self, number: int) -> None:
        copies = self.copy_tables()
        questions = QueryGenerator(self.dice, [copy for _, copy in copies], self.world)
        for _ in range(number):
            script = questions.make_query()
            expected = questions.find_outcome(script.copied, "native")
            for engine in ("database", "native"):
                found = questions.find_outcome(script.text, engine)
                if found != expected:
                    detail = f"on the {engine} engine it gives {cut_text(repr(found), 600)}"
                    detail += f", the copy {cut_text(repr(expected), 600)}"
                    raise BrokenRuleError("queries see what is there", script.table, detail, script.text)
            self.report.queries += 1
        for table in self.attached.tables.values():
            if table.schema.required:
                missing = questions.find_missing_arguments_code(table)
                if missing != "R005":
                    raise BrokenRuleError("missing arguments are an error", table.title, f"the error is {missing}")

    def check_after_change(self, change: Callable[[random.Random], Any]) -> None:
        """Changes the world, and reads elements that no longer exist."""
        tables = [t for t in get_world_tables(self.world) if isinstance(t, Table)]
        before = [(table, self._list_keys(table, Where())) for table in tables]
        change(self.dice)
        for table, keys in before:
            living = set(self._list_keys(table, Where()))
            for key in keys:
                if key not in living:
                    self._check_gone_element(table, get_schema(table), key)

    def _check_gone_element(self, table: Table, schema: Schema, key: Hashable) -> None:
        for group in schema.groups:
            if group in schema.arrays:
                continue
            try:
                answer = getattr(table, group)([key] if group in schema.blocks else key)
            except Gone:
                continue
            except Exception as error:
                detail = f"{group}({key!r}) of a dead element raises {type(error).__name__} instead"
                raise BrokenRuleError("the dead raise Gone", table.name, detail) from error
            raise BrokenRuleError("the dead raise Gone", table.name, f"{group}({key!r}) still gives {answer!r}")


_PLAIN = Kind.NONE | Kind.BOOL | Kind.INT | Kind.FLOAT | Kind.STR
