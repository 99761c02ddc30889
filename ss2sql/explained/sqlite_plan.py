"""SQLite's plan in words.

`EXPLAIN QUERY PLAN` gives a tree of short lines such as `SEARCH edge USING INDEX i (src=?)`. Each kind of line for
lowered queries has its sentence here; any other is shown unchanged.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import sqlglot
from sqlglot import TokenType

from ss2sql.explained.facts import PlanLine
from ss2sql.explained.outline import OutlinedQuery
from ss2sql.explained.words import cut, queue_words
from ss2sql.lowering.sql_query import SqlQuery
from ss2sql.records import dataclass
from ss2sql.runtime.pool import Pool

MOST_TEXT = 60  # characters of a source


@dataclass(frozen=True, slots=True)
class Line:
    """A line of SQLite's plan with the lines under it."""

    text: str
    inner: tuple[Line, ...]


@dataclass(frozen=True, slots=True)
class Names:
    """The meaning of a statement's names: values and tables; and the order of its queue."""

    walked: Mapping[str, str]
    tables: Mapping[str, str]
    queue: str


def plan_of(outlined: OutlinedQuery) -> tuple[PlanLine, ...]:
    """SQLite's plan of a query. Raises apsw.Error where it is unavailable: the session is closed, a table is gone."""
    assert outlined.lowered is not None
    rows = _asked(outlined)
    names = _names(outlined.lowered, queue_words(outlined.query))
    return tuple(_in_words(_tree(rows, 0), names, 0))


def _asked(outlined: OutlinedQuery) -> list[tuple[int, int, int, str]]:
    assert outlined.lowered is not None
    asked = replace(outlined.lowered, text=f"EXPLAIN QUERY PLAN {outlined.lowered.text}")
    cursor = outlined.host.database.cursor_of(asked, Pool(), lambda parameter: 0)
    try:
        return list(cursor)
    finally:
        cursor.close(True)


def _tree(rows: list[tuple[int, int, int, str]], parent: int) -> tuple[Line, ...]:
    return tuple(Line(text, _tree(rows, own)) for own, above, _, text in rows if above == parent)


def _in_words(lines: tuple[Line, ...], names: Names, depth: int, recursive: bool = False) -> list[PlanLine]:
    """The lines in words. Loops over tables are nested: a later one runs for each row of the one before."""
    made: list[PlanLine] = []
    loops = 0
    for line in lines:
        words = _sentence(line.text, names, recursive)
        if line.text.startswith(("SCAN ", "SEARCH ")):
            words = f"for each of them, {words}" if loops else words
            loops += 1
        made.append(PlanLine(depth, words, line.text))
        made.extend(_in_words(line.inner, names, depth + 1, recursive or line.text == "RECURSIVE STEP"))
    return made


def _names(lowered: SqlQuery, queue: str) -> Names:
    """The sources of a statement by the names that its plan uses."""
    texts = {parameter.name: parameter.expr.span.text or parameter.name for parameter in lowered.parameters}
    walked: dict[str, str] = {}
    tables: dict[str, str] = {}
    for name, argument, alias in _sources(lowered.text):
        if name in lowered.modules:
            walked[alias] = _called(_as_written(argument, texts), alias if alias != name else "")
        else:
            tables[alias] = name if name in (alias, f"{alias}_once") else _called(name, alias)
    return Names(walked, tables, queue)


def _sources(text: str) -> Iterator[tuple[str, str, str]]:
    """The sources after FROM and JOIN: a name, its arguments in parentheses, and its alias."""
    tokens = sqlglot.tokenize(text, read="sqlite")
    kinds = [token.token_type for token in tokens]
    for index, kind in enumerate(kinds):
        if kind not in (TokenType.FROM, TokenType.JOIN) or kinds[index + 1] == TokenType.L_PAREN:
            continue
        name = alias = tokens[index + 1].text
        end = index + 2
        argument = ""
        if kinds[end : end + 1] == [TokenType.L_PAREN]:
            close = _closing(kinds, end)
            argument = text[tokens[end].end + 1 : tokens[close].start]
            end = close + 1
        if kinds[end : end + 1] == [TokenType.ALIAS]:
            alias = tokens[end + 1].text
        yield name, argument, alias


def _closing(kinds: list[TokenType], opening: int) -> int:
    """The index of the parenthesis that closes the one at an index."""
    depth = 0
    for place in range(opening, len(kinds)):
        depth += (kinds[place] == TokenType.L_PAREN) - (kinds[place] == TokenType.R_PAREN)
        if not depth:
            return place
    raise AssertionError("lowered text has as many closing parentheses as opening ones")


def _as_written(argument: str, texts: Mapping[str, str]) -> str:
    """A source; a bound value in the script's notation."""
    alone = re.fullmatch(r":(\w+)(?: /\*.*\*/)?", argument.strip(), re.DOTALL)
    return cut(texts.get(alone[1], alone[1]) if alone else argument, MOST_TEXT)


def _called(name: str, alias: str) -> str:
    """A source and its alias, unless they are equal."""
    return name if alias in ("", "this", name, name.rpartition(".")[2]) else f"{name} (as {alias})"


# --- sentences -----------------------------------------------------------------------------------------

# With HEURISTIC a step is in the queue twice: as a result at its cost, and to be expanded with the estimate.
GUIDED = {
    "COMPOUND QUERY": "each step waits twice, for its own turn and for that of the steps after it:",
    "LEFT-MOST SUBQUERY": "the steps after it:",
    "UNION ALL": "its second turn:",
}

NAME = r"(?P<name>\S+|.+?)"
WHERE = r" \((?P<where>.*)\)"


def _sentence(text: str, names: Names, recursive: bool) -> str:
    if recursive and text == "SCAN search":
        return f"takes the steps that wait in a queue one by one, {names.queue}"
    if recursive and text in GUIDED:
        return GUIDED[text]
    for pattern, words in SENTENCES:
        found = re.fullmatch(pattern, text)
        if found:
            return words(found, names)
    return f"{text} (as SQLite says it)"


def _table(found: re.Match[str], names: Names) -> str:
    name = found["name"]
    return "an inner query" if name.startswith("(") else names.tables.get(name, name)


def _conditions(text: str) -> str:
    """`src=? AND n>?` with an ellipsis for each unknown value."""
    return re.sub(r"(\S+?)(<=|>=|=|<|>)\?", r"\1 \2 …", text).replace(" AND ", " and ")


def _scan(found: re.Match[str], names: Names) -> str:
    if found["name"] == "search":
        return "gives the results as the search finds them"
    index = found["index"]
    return f"reads every row of {_table(found, names)}" + (f" in the order of its index {index}" if index else "")


def _virtual(found: re.Match[str], names: Names) -> str:
    """A virtual table; those of worlds list the adapter's filters in their plan."""
    name, asked = found["name"], found["asked"]
    if asked.startswith("each element"):
        left_out = re.fullmatch(r"each element, (.*) IS NOT \?", asked)
        but = f" but those whose {left_out[1]} is …" if left_out else ""
        return f"walks the elements of {names.walked.get(name, name)}{but}"
    table = names.tables.get(name, name)
    if asked == "all":
        return f"reads every element of {table}"
    parts = asked.split(", ")
    given = [part.removesuffix(" := ?") for part in parts if part.endswith(" := ?")]
    filters = [part for part in parts if not part.endswith(" := ?")]
    words = f"asks for the elements of {table}"
    if given:
        words += f" for a given {' and '.join(given)}"
    return words + (f" with {_ranges(filters)}; the adapter uses these conditions" if filters else "")


def _ranges(filters: list[str]) -> str:
    """`x >= ?` and `x <= ?` as one condition."""
    asked: dict[str, list[str]] = {}
    for condition in filters:
        column, operator, _ = condition.rsplit(" ", 2)
        asked.setdefault(column, []).append(operator)
    both = {column: {operator[0] for operator in operators} == {"<", ">"} for column, operators in asked.items()}
    return " and ".join(
        f"{column} from … to …" if both[column] else " and ".join(f"{column} {operator} …" for operator in operators)
        for column, operators in sorted(asked.items())
    )


def _search(found: re.Match[str], names: Names) -> str:
    kind, where = found["kind"], _conditions(found["where"])
    rows = f"looks up the rows of {_table(found, names)} with {where}"
    if kind.startswith("AUTOMATIC"):
        return f"{rows} in an index that SQLite makes for this query"
    if kind == "INTEGER PRIMARY KEY" and found["where"] == "rowid=?":
        return f"looks up the row of {_table(found, names)} by its number"
    if kind.endswith("PRIMARY KEY"):
        return f"{rows} by its primary key"
    covering = kind.startswith("COVERING ")
    index = kind.removeprefix("COVERING ").removeprefix("INDEX ")
    return f"{rows} in its index {index}" + (", which has all that is needed" if covering else "")


def _sorted(found: re.Match[str], names: Names) -> str:
    what = found["what"]
    if what == "ORDER BY":
        return "sorts the rows for ORDER BY"
    if what == "GROUP BY":
        return "sorts the rows into groups"
    if what.endswith("ORDER BY"):
        return "sorts rows that are equal so far by the other terms of ORDER BY"
    return f"keeps rows in order, for {what}"


def _always(words: str) -> Callable[[re.Match[str], Names], str]:
    return lambda found, names: words


SENTENCES: tuple[tuple[str, Callable[[re.Match[str], Names], str]], ...] = (
    (rf"SCAN {NAME} VIRTUAL TABLE INDEX \d+:(?P<asked>.*)", _virtual),
    (r"SCAN CONSTANT ROW|SCAN \d+ CONSTANT ROWS?", _always("makes a row of what is known")),
    (rf"SCAN {NAME}(?: USING (?:COVERING )?INDEX (?P<index>\S+))?", _scan),
    (rf"SEARCH {NAME} USING (?P<kind>.*?){WHERE}(?: LEFT-JOIN)?", _search),
    (rf"BLOOM FILTER ON {NAME}{WHERE}", _always("keeps a note of the values there, to skip lookups that find nothing")),
    (r"CO-ROUTINE search", _always("searches step by step:")),
    (rf"CO-ROUTINE {NAME}", lambda found, names: f"makes the rows of {_table(found, names)} on demand:"),
    (rf"MATERIALIZE {NAME}", lambda found, names: f"once, beforehand, and kept as {_table(found, names)}:"),
    (r"SETUP|INITIAL RECURSIVE PART", _always("the start:")),
    (r"RECURSIVE STEP", _always("the steps:")),
    (r"CORRELATED SCALAR SUBQUERY \d+", _always("for each row, computes the value of a query of its own:")),
    (r"SCALAR SUBQUERY \d+", _always("once, computes the value of a query of its own:")),
    (r"CORRELATED LIST SUBQUERY \d+", _always("for each row, makes a list by a query of its own:")),
    (r"(?:LIST|REUSE LIST) SUBQUERY \d+", _always("once, makes a list by a query of its own:")),
    (r"USE TEMP B-TREE FOR (?P<what>.*)", _sorted),
    (r"COMPOUND QUERY", _always("puts the rows of several queries together:")),
    (r"LEFT-MOST SUBQUERY", _always("the first query:")),
    (r"UNION ALL", _always("the next query:")),
)
