"""Random flat queries over tables, each written twice: in SelectScript and in the SQL of DuckDB.

They stay where both languages mean the same. Where SelectScript's law differs, the SQL says what SelectScript means, or
the query is not made:

- `x == None` is true or false: IS NOT DISTINCT FROM; `!=` is IS DISTINCT FROM. SQL's `=` would give a third truth.
- None in arithmetic, or compared by order, is an error; in SQL it is NULL. Such operands are never None here.
- `IN` and `NOT IN` find None; in SQL they do not. The lists and nested queries here have none.
- `%` has the sign of the divisor, in SQL that of the dividend; dividing by zero is an error, in SQL NULL or infinity.
- Truth is Python's: a number, a string or a list can stand as a condition. Here only what is true or false does.
- `sum` of nothing is 0, in SQL NULL.
- ORDER BY puts None first, with DESC last; DuckDB has to be told.
- Rows keep the order of the sources, groups that of their first appearance. SQL promises neither: without an ORDER BY
  that decides between all different rows, the order is not compared.
- A zero below zero is kept; DuckDB may lose its sign. Both are equal.
- `1`, `1.0` and `True` are equal and stay what they are; a column of DuckDB has one type. So has each column here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from programs import ProgramCase
from programs.choices import Choices

DECISIONS = 160
TYPES = {"a": "BIGINT", "b": "BIGINT", "s": "VARCHAR", "w": "DOUBLE"}
Rows = list[dict[str, Any]]
Both = tuple[str, str]  # an expression in SelectScript and in SQL

# By kind: the two forms, in which {kind} stands for an expression. `maybe` is an integer or None.
FORMS: dict[str, tuple[tuple[int, str, str], ...]] = {
    "int": (
        (6, "({int} + {int})", "({int} + {int})"), (4, "({int} - {int})", "({int} - {int})"),
        (4, "({int} * {int})", "({int} * {int})"), (4, "({int} % 3)", "((({int} % 3) + 3) % 3)"),
        (3, "len({str})", "length({str})"), (2, "abs({int})", "abs({int})"),
        (4, "IF({bool}; {int}; {int})", "CASE WHEN {bool} THEN {int} ELSE {int} END"),
    ),
    "num": (
        (4, "({int} / 4)", "({int} / 4)"),
        (4, "({num} + {int})", "({num} + {int})"),
        (3, "({num} * {num})", "({num} * {num})"),
    ),
    "str": ((4, "({str} + {str})", "({str} || {str})"),),
    "maybe": ((3, "IF({bool}; {maybe}; None)", "CASE WHEN {bool} THEN {maybe} END"),),
    "bool": (
        (6, "({int} < {int})", "({int} < {int})"), (5, "({num} >= {int})", "({num} >= {int})"),
        (4, "({str} <= {str})", "({str} <= {str})"), (5, "({int} == {int})", "({int} = {int})"),
        (4, "({str} != {str})", "({str} <> {str})"), (5, "({maybe} == None)", "({maybe} IS NULL)"),
        (4, "({maybe} == {int})", "({maybe} IS NOT DISTINCT FROM {int})"),
        (4, "({maybe} != {maybe})", "({maybe} IS DISTINCT FROM {maybe})"),
        (4, "({int} IN [1, 3])", "({int} IN (1, 3))"), (3, "({int} NOT IN [0, 2])", "({int} NOT IN (0, 2))"),
        (3, "({str} IN 'abc')", "contains('abc', {str})"), (5, "({bool} AND {bool})", "({bool} AND {bool})"),
        (5, "({bool} OR {bool})", "({bool} OR {bool})"), (4, "({bool} XOR {bool})", "({bool} <> {bool})"),
        (4, "(NOT {bool})", "(NOT {bool})"),
    ),
}  # fmt: skip
LITERALS = {
    "int": ("1", "0", "2", "3"), "num": ("0.5", "1.5"), "str": ("'a'", "''", "'bc'"), "maybe": ("1", "2"),
    "bool": ("True", "False"),
}  # fmt: skip
BARE = {literal for literals in LITERALS.values() for literal in literals}  # ORDER BY refuses them
LITERAL_TYPES = {"int": "BIGINT", "num": "DOUBLE", "str": "VARCHAR", "maybe": "BIGINT", "bool": "BOOLEAN"}
COLUMNS = {"int": ("a",), "num": ("w",), "str": ("s",), "maybe": ("b", "a"), "bool": ()}
# Questions about a nested query, whose text from its columns on is {rows}.
NESTED = (
    ("({int} IN (SELECT {rows} AS list))", "({int} IN (SELECT {rows}))"),
    ("([] == (SELECT {rows} AS list))", "(NOT EXISTS (SELECT {rows}))"),
    ("(len((SELECT {rows} AS list)) > 1)", "((SELECT count(*) FROM (SELECT {rows})) > 1)"),
)
AGGREGATES = (
    ("count(*)", "count(*)", ""), ("count({0})", "count({0})", "maybe"),
    ("sum({0})", "coalesce(sum({0}), 0)", "maybe"), ("sum({0})", "sum({0})", "num"), ("min({0})", "min({0})", "maybe"),
    ("max({0})", "max({0})", "str"), ("average({0})", "avg({0})", "num"), ("average({0})", "avg({0})", "maybe"),
    ("(1 + max({0}))", "(1 + max({0}))", "int"),
)  # fmt: skip


@dataclass(frozen=True)
class Twin:
    """A program, the same query in SQL, and whether its order is decided."""

    case: ProgramCase
    sql: str
    ordered: bool


def twin(data: bytes) -> Twin:
    """The query that the bytes stand for."""
    return Twins(Choices(data)).query()


class Twins:
    """Writes one query."""

    def __init__(self, choices: Choices) -> None:
        self.choices = choices
        self.names: list[str] = []
        self.inner = 0

    def table(self) -> Rows:
        c = self.choices
        return [
            {
                "a": c.pick((1, 2, 3, 0, -1)),
                "b": c.pick((1, None, 2, 3)),
                "s": c.pick(("a", "b", "ab", "", "ü")),
                "w": c.pick((0.5, 1.0, 2.5, -0.5)),
            }
            for _ in range(1 + c.below(5))
        ]

    def query(self) -> Twin:
        c = self.choices
        tables = {name: self.table() for name in ("t", "u")}
        self.names = ["x", "y"][: c.weighted((60, 1), (40, 2))]
        sources = [(name, c.pick(("t", "u"))) for name in self.names]
        where = self.expr("bool", 3) if c.chance(70) else None
        if c.chance(40):
            keys = [self.expr(c.pick(("int", "maybe", "str", "bool", "num")), 1) for _ in range(1 + c.below(2))]
            having = (f" HAVING count(*) {sign} {number}" for sign in ("> ", "<=") for number in (1, 2))
            tail = f"{c.pick(('', '', *having))}"
            shown = [*keys, *(self.aggregate() for _ in range(1 + c.below(2)))]
            group = [f" GROUP BY {', '.join(key[side] for key in keys)}{tail}" for side in (0, 1)]
        else:
            shown = [self.expr(c.pick(("int", "num", "str", "maybe", "bool")), 2) for _ in range(1 + c.below(3))]
            group = ["", ""]
        order, limit = c.chance(50), f" LIMIT {c.pick((2, 1, 3, 0))}"
        descending = [c.chance(40) for _ in shown]
        ordered = [(one, down) for one, down in zip(shown, descending, strict=True) if one[0] not in BARE]
        order = order and bool(ordered)
        limit = limit if order and c.chance(50) else ""
        texts = []
        for side in (0, 1):
            ends = [(" DESC", " ASC"), (" DESC NULLS LAST", " ASC NULLS FIRST")][side]
            keys_text = ", ".join(one[side] + ends[0 if down else 1] for one, down in ordered)
            texts.append(
                f"SELECT {', '.join(one[side] for one in shown)} FROM "
                + ", ".join(f"{name} = {of}" if side == 0 else f"{of} AS {name}" for name, of in sources)
                + (f" WHERE {where[side]}" if where else "")
                + group[side]
                + (f" ORDER BY {keys_text}" if order else "")
                + limit
            )
        return Twin(ProgramCase(texts[0] + " AS rows", tables=tables), texts[1], order)

    def expr(self, kind: str, depth: int) -> Both:
        c = self.choices
        if kind == "bool" and depth > 1 and not self.inner and c.chance(20):
            return self.nested()
        columns = [f"{name}.{column}" for name in self.names for column in COLUMNS[kind]]
        if not depth or c.chance(25):
            if kind == "bool" and not depth:
                return self.filled("({int} < {int})", "({int} < {int})", 0)
            if columns and c.chance(85):
                text = c.pick(columns)
                return text, text
            literal = c.pick(LITERALS[kind])  # with its type: ORDER BY 1 would be the first column, 0.5 a decimal
            return literal, f"{literal}::{LITERAL_TYPES[kind]}"
        _, one, other = c.weighted(*((weight, (weight, one, other)) for weight, one, other in FORMS[kind]))
        return self.filled(one, other, depth - 1)

    def filled(self, one: str, other: str, depth: int) -> Both:
        """Both forms, with the same expressions in the same places."""
        while "{" in one:
            kind = one.partition("{")[2].partition("}")[0]
            first, second = self.expr(kind, depth)
            one, other = one.replace(f"{{{kind}}}", first, 1), other.replace(f"{{{kind}}}", second, 1)
        return one, other

    def nested(self) -> Both:
        """A condition about a nested query, which sees the row around it."""
        c = self.choices
        one, other = c.pick(NESTED)
        self.inner += 1
        outer = self.expr("int", 1)
        self.names.insert(0, "z")
        inner, where, table = self.expr("int", 1), self.expr("bool", 1), c.pick(("t", "u"))
        self.names.remove("z")
        self.inner -= 1
        texts = []
        for side, form in enumerate((one, other)):
            source = f"z = {table}" if side == 0 else f"{table} AS z"
            rows = f"{inner[side]} FROM {source} WHERE {where[side]}"
            texts.append(form.format(int=outer[side], rows=rows))
        return texts[0], texts[1]

    def aggregate(self) -> Both:
        one, other, kind = self.choices.pick(AGGREGATES)
        first, second = self.expr(kind, 1) if kind else ("", "")
        return one.format(first), other.format(second)
