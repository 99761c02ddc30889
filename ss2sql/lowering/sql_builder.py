"""Small constructors for SQL as sqlglot trees, and the dialects that a tree is printed in."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import apsw
import sqlglot
from sqlglot import exp
from sqlglot.errors import TokenError
from sqlglot.generator import Generator

from ss2sql.errors.exceptions import CONTROL_CHARACTERS
from ss2sql.fast_dataclasses import dataclass
from ss2sql.lowering.sql_query import SQLITE_FUNCTIONS, strip_sql_unwritable

Node: TypeAlias = exp.Expr

MAX_OPERANDS_IN_ROW = 250  # parts joined by AND or OR without parentheses
_PLAIN_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_WORDS = frozenset(apsw.keywords) | {"TRUE", "FALSE"}


class WithoutAffinity(exp.Unary):
    """`+column`: the value without the affinity of its column. The dialect of SQLite prints it."""


def drop_affinity(column: exp.Expr) -> None:
    """Puts `+column` in the place of a column."""
    column.replace(WithoutAffinity(this=column.copy()))


def identifier(name: str) -> exp.Identifier:
    """A name, quoted where SQLite would take it for something else."""
    plain = _PLAIN_NAME.match(name) and name.upper() not in _WORDS
    return exp.Identifier(this=strip_sql_unwritable(name), quoted=not plain)


# Modules, the recursive table of a search, and copies of lists and tables.
_OF_A_STATEMENT = re.compile(r"elements|search|.*_(once|in_order)(_\d+)?\Z", re.DOTALL)


def can_need_sql_schema(name: str) -> bool:
    """Whether a table may have the name of such a virtual table or of a copy: its schema has to be written, too."""
    return bool(_OF_A_STATEMENT.match(name.lower()))


def column(name: str, table: str | None = None) -> exp.Column:
    return exp.Column(this=identifier(name), table=identifier(table) if table else None)


def call(name: str, *arguments: Node) -> exp.Anonymous:
    return exp.Anonymous(this=identifier(name), expressions=list(arguments))


def number(value: int | float) -> Node:
    text = repr(value)
    literal = exp.Literal.number(text.removeprefix("-"))
    return exp.Neg(this=literal) if text.startswith("-") else literal


def string(value: str) -> Node:
    """A text; characters that a terminal would obey, and 0, which would end the statement, are computed."""
    parts: list[Node] = [exp.Literal.string(part) for part in CONTROL_CHARACTERS.split(value)]
    result = parts[0]
    for char, part in zip(CONTROL_CHARACTERS.findall(value), parts[1:], strict=True):
        result = exp.DPipe(this=exp.DPipe(this=result, expression=call("char", number(ord(char)))), expression=part)
    return result if len(parts) == 1 else exp.Paren(this=result)


def null() -> exp.Null:
    return exp.Null()


def parameter(name: str) -> exp.Placeholder:
    return exp.Placeholder(this=name)


def case(branches: Iterable[tuple[Node, Node]], default: Node) -> Node:
    """`CASE WHEN condition THEN value ... ELSE default END`; the only form that promises an order of evaluation."""
    ifs = [exp.If(this=condition, true=value) for condition, value in branches]
    return exp.Case(ifs=ifs, default=default) if ifs else default


def case_in_order(conditions: Sequence[Node]) -> Node:
    """The conjunction of conditions, each of which is evaluated only where those before it hold."""
    return case([(negate(condition), number(0)) for condition in conditions[:-1]], conditions[-1])


def conjunction(parts: Sequence[Node]) -> Node | None:
    """`a AND b AND ...`, None where there are no parts."""
    return join_by_and(parts) if parts else None


def join_by_and(parts: Sequence[Node]) -> Node:
    parts = _group_operands(parts, join_by_and)
    result = parenthesize_sql(parts[0], exp.Or)
    for part in parts[1:]:
        result = exp.And(this=result, expression=parenthesize_sql(part, exp.Or))
    return result


def _group_operands(parts: Sequence[Node], join: Callable[[Sequence[Node]], Node]) -> Sequence[Node]:
    """Many parts in groups of parentheses, because SQLite takes no expression deeper than 1,000."""
    if len(parts) <= MAX_OPERANDS_IN_ROW:
        return parts
    starts = range(0, len(parts), MAX_OPERANDS_IN_ROW)
    return [exp.Paren(this=join(parts[start : start + MAX_OPERANDS_IN_ROW])) for start in starts]


def disjunction(parts: Sequence[Node]) -> Node:
    parts = _group_operands(parts, disjunction)
    result = parts[0]
    for part in parts[1:]:
        result = exp.Or(this=result, expression=part)
    return result


def parenthesize_sql(node: Node, *kinds: type[Node]) -> Node:
    """The node in parentheses if it is one of the given kinds."""
    return exp.Paren(this=node) if isinstance(node, kinds) else node


def wrap_operand(node: Node) -> Node:
    """The node, in parentheses where a neighbouring operator could tear it apart."""
    return parenthesize_sql(node, exp.Binary, exp.Connector, exp.Not, exp.Neg, exp.In)


_SUMS: tuple[type[Node], ...] = (exp.Add, exp.Sub)
_PRODUCTS: tuple[type[Node], ...] = (exp.Mul, exp.Div, exp.Mod)


def binary(kind: type[exp.Binary], left: Node, right: Node) -> Node:
    """`left kind right`, with parentheses where they are needed."""
    if issubclass(kind, exp.Predicate):  # comparisons
        loose = _SUMS + _PRODUCTS + (exp.DPipe,)
        return kind(this=_wrap_operand_unless(loose, left), expression=_wrap_operand_unless(loose, right))
    if issubclass(kind, _SUMS):
        return kind(
            this=_wrap_operand_unless(_SUMS + _PRODUCTS, left), expression=_wrap_operand_unless(_PRODUCTS, right)
        )
    return kind(
        this=_wrap_operand_unless(_PRODUCTS if issubclass(kind, _PRODUCTS) else (), left),
        expression=wrap_operand(right),
    )


def _wrap_operand_unless(loose: tuple[type[Node], ...], node: Node) -> Node:
    """The operand, as it is if it is one of these."""
    return node if isinstance(node, loose) else wrap_operand(node)


_OPPOSITE: dict[type[Node], type[exp.Binary]] = {
    exp.EQ: exp.NEQ,
    exp.NEQ: exp.EQ,
    exp.NullSafeEQ: exp.NullSafeNEQ,
    exp.NullSafeNEQ: exp.NullSafeEQ,
    exp.LT: exp.GTE,
    exp.GTE: exp.LT,
    exp.GT: exp.LTE,
    exp.LTE: exp.GT,
}


def negate(node: Node) -> Node:
    """The opposite of a condition that is never NULL; an equality is what databases look up."""
    if type(node) in _OPPOSITE:
        return binary(_OPPOSITE[type(node)], node.this.copy(), node.expression.copy())
    if isinstance(node, exp.Is) and isinstance(node.expression, exp.Not):  # IS NOT NULL
        return exp.Is(this=node.this.copy(), expression=node.expression.this.copy())
    if isinstance(node, exp.Not):
        inside: Node = node.this.unnest()
        return inside.copy()
    return exp.Not(this=wrap_operand(node.copy()))


def mark_sql_as_rare(node: Node) -> Node:
    """The node, marked as what is evaluated hardly ever."""
    node.meta["rare"] = True
    return node


def calls_python(node: Node) -> bool:
    """Whether the SQL has a call in it that is not one of SQLite's own functions, and not a rare one."""
    parts = node.walk(prune=lambda part: part.meta.get("rare", False))
    return any(
        isinstance(part, exp.Anonymous) and part.name.lower() not in SQLITE_FUNCTIONS and not part.meta.get("rare")
        for part in parts
    )


def between(node: Node, low: float, high: float) -> Node:
    """`node BETWEEN low AND high`, with a copy of the node."""
    return exp.Between(this=wrap_operand(node.copy()), low=number(low), high=number(high))


def alias(node: Node, name: str) -> Node:
    return exp.Alias(this=node, alias=identifier(name))


def named(node: Node, name: str | None) -> Node:
    """A column of SELECT under a name; without one, or where it has that name, as it is."""
    return node if name is None or (isinstance(node, exp.Column) and node.name == name) else alias(node, name)


def table(name: str, label: str, schema: str | None = None) -> exp.Table:
    """`schema.name AS label`."""
    short = label == name and schema is None
    return exp.Table(
        this=identifier(name),
        db=identifier(schema) if schema else None,
        alias=None if short else exp.TableAlias(this=identifier(label)),
    )


def table_function(name: str, arguments: Sequence[Node], label: str) -> exp.Table:
    """`name(arguments) AS label`."""
    return exp.Table(this=call(name, *arguments), alias=exp.TableAlias(this=identifier(label)))


def derived(select: exp.Query, label: str) -> exp.Subquery:
    """`(SELECT ...) AS label`."""
    return exp.Subquery(this=select, alias=exp.TableAlias(this=identifier(label)))


def build_sql_union(selects: Sequence[exp.Select], distinct: bool = False) -> exp.Query:
    """The SELECTs with UNION ALL between them, or UNION."""
    joined: exp.Query = selects[0]
    for one in selects[1:]:
        joined = exp.Union(this=joined, expression=one, distinct=distinct)
    return joined


def select(
    outputs: Sequence[Node],
    sources: Sequence[Node],
    where: Node | None = None,
    order: Sequence[tuple[Node, bool]] = (),
    limit: Node | None = None,
    offset: Node | None = None,
) -> exp.Select:
    """A SELECT over sources joined in the order written. `order` holds (key, descending)."""
    query = exp.Select(expressions=list(outputs))
    if sources:
        query.set("from_", exp.From(this=sources[0]))
    joins = [source if isinstance(source, exp.Join) else exp.Join(this=source, kind="CROSS") for source in sources[1:]]
    query.set("joins", joins)
    if where is not None:
        query.set("where", exp.Where(this=where))
    return sort_query(query, order, limit, offset)


def sort_key(node: Node) -> Node:
    """A key of ORDER BY or GROUP BY; a number alone would be taken for the position of a column."""
    plain = node
    while isinstance(plain, (exp.Neg, exp.Paren)):
        plain = plain.this
    return string("") if isinstance(plain, exp.Literal) and not plain.is_string else node


def sort_query(
    query: exp.Select, order: Sequence[tuple[Node, bool]], limit: Node | None = None, offset: Node | None = None
) -> exp.Select:
    if order:
        query.set("order", _build_order(order))
    if limit is not None:
        query.set("limit", exp.Limit(expression=limit))
    if offset is not None:
        query.set("offset", exp.Offset(expression=offset))
    return query


def row_number(order: Sequence[tuple[Node, bool]]) -> exp.Window:
    """The number of a row, from 1, sorted by (key, descending)."""
    return exp.Window(this=exp.RowNumber(), order=_build_order(order) if order else None)


def _build_order(order: Sequence[tuple[Node, bool]]) -> exp.Order:
    keys = [exp.Ordered(this=sort_key(node), desc=descending, nulls_first=not descending) for node, descending in order]
    return exp.Order(expressions=keys)


def keep_condition(condition: Node) -> Node:
    """A condition within AND or OR; `0 AND x` would go away, and with it the sources in x, for which the rest waits."""
    return binary(exp.NEQ, condition, number(0)) if isinstance(condition, exp.Literal) else condition


def build_sql_no_limit() -> Node:
    """`LIMIT -1`: no limit, but SQLite then keeps a subquery apart and its order as written."""
    return number(-1)


# --- the SQL dialects that a lowered query can be printed in, one row each
if TYPE_CHECKING:
    _Base = Generator
else:
    _Base = object

MAX_LINE_WIDTH = 60  # characters in parentheses that stay on their line


class _ShortParentheses(_Base):
    """Printing as sqlglot does it, but for parentheses: it would give each of them a line of its own.

    `OWN` prints nodes that sqlglot does not have.
    """

    OWN: ClassVar[dict[type[exp.Expr], Callable[[Generator, Any], str]]] = {}

    def paren_sql(self, expression: exp.Paren) -> str:
        inside = self.sql(expression, "this")
        if len(inside) <= MAX_LINE_WIDTH and "\n" not in inside:
            return f"({inside})"
        # Not sqlglot's own method: it would print the inside again, and so on within it, 2 ^ depth times.
        return f"({self.seg(self.indent(inside), sep='')}{self.seg(')', sep='')}"


class _Sqlite(_ShortParentheses):
    """What later releases of sqlglot 30 do, for all of them: the text is the same whichever prints it."""

    OWN: ClassVar[dict[type[exp.Expr], Callable[[Generator, Any], str]]] = {
        WithoutAffinity: lambda printer, node: f"+{printer.sql(node, 'this')}"
    }
    SUPPORTS_TABLE_ALIAS_COLUMNS = True  # nothing but a CTE is given any; early ones leave them out

    def nullsafeeq_sql(self, expression: exp.NullSafeEQ) -> str:
        return self.binary(expression, "IS")

    def nullsafeneq_sql(self, expression: exp.NullSafeNEQ) -> str:
        return self.binary(expression, "IS NOT")


@dataclass(frozen=True, slots=True)
class Dialect:
    """A dialect by its name in sqlglot. User names keep their case; lines are indented by two blanks."""

    name: str
    printer_class: type[_ShortParentheses] = _ShortParentheses

    def print_tree(self, tree: exp.Expr) -> str:
        """The SQL tree as text."""
        options: dict[str, Any] = {"pretty": True, "normalize_functions": False}
        try:
            return _build_dialect_class(self)(dialect=self.name, **options).generate(tree)
        except TokenError as error:
            if isinstance(error.__cause__, RecursionError):  # sqlglot reads types while it prints
                raise error.__cause__ from None
            raise


@cache
def _build_dialect_class(dialect: Dialect) -> type[Generator]:
    """The class that prints a dialect: what sqlglot has for it, printing as the row says."""
    known: type[Generator] = sqlglot.Dialect.get_or_raise(dialect.name).generator_class
    return type(
        "Printer", (dialect.printer_class, known), {"TRANSFORMS": {**known.TRANSFORMS, **dialect.printer_class.OWN}}
    )


SQLITE = Dialect("sqlite", _Sqlite)
DUCKDB = Dialect("duckdb")
SPARK = Dialect("spark")
POSTGRES = Dialect("postgres")

DIALECTS: dict[str, Dialect] = {dialect.name: dialect for dialect in (SQLITE, DUCKDB, SPARK, POSTGRES)}
