"""The plan of a query in words: SQLite's own, and that of a query that runs elsewhere.

`EXPLAIN QUERY PLAN` gives a tree of short lines such as `SEARCH edge USING INDEX i (src=?)`. Each kind of line for
lowered queries has its sentence here; any other is shown unchanged.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import sqlglot
from sqlglot import TokenType

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.lowering.portable.pushdown import PushdownQuery
from ss2sql.lowering.sql_query import SqlQuery
from ss2sql.results.explain.findings import PlanLine, cut_explained_script, describe_queue
from ss2sql.results.explain.outline import OutlinedQuery
from ss2sql.runtime.external.level_query import WORDS, LevelPlan
from ss2sql.runtime.sqlite.interning import Interning

LONGEST = 60  # characters of a source


def describe_python_plan(query: plan.Query) -> tuple[PlanLine, ...]:
    """The loops over the sources, and around them the search."""
    search = query.search
    if search is None:
        return (*_describe_loops(query, 0), *_describe_post_processing(query))
    if search.repeats == "memorize":
        first = {"cost": "the cheapest", "probability": "the likeliest"}.get(search.order, "the shortest")
        lines = (
            PlanLine(0, "makes the graph of rows level by level; for each row that is new:"),
            *_describe_loops(query, 1),
            PlanLine(0, f"gives the paths of the graph, {first} first"),
        )
    else:
        lines = (
            PlanLine(0, "searches step by step:"),
            PlanLine(1, f"takes the steps that wait one by one, {describe_queue(query)}"),
            *_describe_loops(query, 1, inner=True),
            PlanLine(0, "gives the results as the search finds them"),
        )
    return (*lines, *_describe_post_processing(query))


def describe_table_plan(query: plan.Query, tables: LevelPlan) -> tuple[PlanLine, ...]:
    """The plan of a search from level to level in tables."""
    assert query.search
    because = "SQL" if tables.sql_hindrance is None else f"Python: {tables.sql_hindrance}"
    lines = (
        PlanLine(0, "searches level by level; all states of a level together:"),
        PlanLine(1, f"tries the steps from them, in {because}"),
        *_describe_loops(query, 2, inner=True),
        PlanLine(1, WORDS[query.search.repeats]),
        PlanLine(1, "gives the paths to the goals among them"),
    )
    return (*lines, *_describe_post_processing(query))


def describe_duckdb_plan(query: plan.Query, written: PushdownQuery) -> tuple[PlanLine, ...]:
    """The plan of a query that is one SELECT in DuckDB."""
    loaded = {id(table.value) for table in written.loaded}
    return (
        PlanLine(0, "finds the rows with one SELECT over"),
        *(line for source in query.sources for line in _put_duckdb_in_words(source, loaded, 1)),
        *_describe_post_processing(query),
    )


def _put_duckdb_in_words(source: plan.Source, loaded: set[int], depth: int) -> Iterator[PlanLine]:
    """The lines of a source, and of a query's sources."""
    if isinstance(source, plan.QuerySource):
        yield PlanLine(depth, f"the rows of ({cut_explained_script(source.query.span.text, LONGEST)}), over")
        for inner in source.query.sources:
            yield from _put_duckdb_in_words(inner, loaded, depth + 1)
        return
    assert isinstance(source, plan.ValueSource), "others are refused"
    words = cut_explained_script(source.value.span.text or source.name, LONGEST)
    if id(source.value) in loaded:
        yield PlanLine(depth, f"the elements of {words}, which it is given in a table")
    elif isinstance(source.value, plan.Variable):
        yield PlanLine(depth, f"{words}, which it reads itself")
    else:
        yield PlanLine(depth, f"the elements of {words}, which are written out")


def _describe_loops(query: plan.Query, depth: int, inner: bool = False) -> Iterator[PlanLine]:
    """The loops, each one inside of those before it."""
    for number, source in enumerate(query.sources):
        yield PlanLine(depth, f"{'for each of them, ' if number or inner else ''}{_describe_loop(source, query)}")


def _describe_loop(source: plan.Source, query: plan.Query) -> str:
    match source:
        case plan.TableSource():
            left_out = "" if query.where is None or query.search else "that SQLite does not leave out for WHERE, "
            words = f"reads every row {left_out}of {source.table}"
        case plan.WorldSource():
            words = f"reads every element of {source.table.title}"
        case plan.QuerySource():
            words = f"finds the rows of ({cut_explained_script(source.query.span.text, LONGEST)})"
        case plan.ValueSource():
            words = f"walks the elements of {cut_explained_script(source.value.span.text or source.name, LONGEST)}"
    return words if source.name == "this" or words.endswith(source.name) else f"{words} (as {source.name})"


def _describe_post_processing(query: plan.Query) -> Iterator[PlanLine]:
    if query.group:
        yield PlanLine(0, "puts them into groups")
    if query.order:
        yield PlanLine(0, "sorts them for ORDER BY")
    if query.limit is not None:
        yield PlanLine(0, "keeps as many as LIMIT says")


MOST_TEXT = 60  # characters of a source


@dataclass(frozen=True, slots=True)
class PlanNode:
    """A line of SQLite's plan with the lines under it."""

    text: str
    inner: tuple[PlanNode, ...]


@dataclass(frozen=True, slots=True)
class PlanNames:
    """The meaning of a statement's names: values and tables; and the order of its queue."""

    walked: Mapping[str, str]
    tables: Mapping[str, str]
    queue: str


def describe_sqlite_plan(outlined: OutlinedQuery) -> tuple[PlanLine, ...]:
    """SQLite's plan of a query. Raises apsw.Error where it is unavailable: the session is closed, a table is gone."""
    assert outlined.lowered is not None
    rows = _read_explained_plan(outlined)
    names = _collect_names(outlined.lowered, describe_queue(outlined.query))
    return tuple(_put_plan_in_words(_nest_plan_rows(rows, 0), names, 0))


def _read_explained_plan(outlined: OutlinedQuery) -> list[tuple[int, int, int, str]]:
    assert outlined.lowered is not None
    explaining = replace(outlined.lowered, text=f"EXPLAIN QUERY PLAN {outlined.lowered.text}")
    cursor = outlined.host.database.open_cursor(explaining, Interning(), lambda parameter: 0)
    try:
        return list(cursor)
    finally:
        cursor.close(True)


def _nest_plan_rows(rows: list[tuple[int, int, int, str]], parent: int) -> tuple[PlanNode, ...]:
    return tuple(PlanNode(text, _nest_plan_rows(rows, own)) for own, above, _, text in rows if above == parent)


def _put_plan_in_words(
    lines: tuple[PlanNode, ...], names: PlanNames, depth: int, recursive: bool = False
) -> list[PlanLine]:
    """The lines in words. Loops over tables are nested: a later one runs for each row of the one before."""
    made: list[PlanLine] = []
    loops = 0
    for line in lines:
        words = _describe_line(line.text, names, recursive)
        if line.text.startswith(("SCAN ", "SEARCH ")):
            words = f"for each of them, {words}" if loops else words
            loops += 1
        made.append(PlanLine(depth, words, line.text))
        made.extend(_put_plan_in_words(line.inner, names, depth + 1, recursive or line.text == "RECURSIVE STEP"))
    return made


def _collect_names(lowered: SqlQuery, queue: str) -> PlanNames:
    """The sources of a statement by the names that its plan uses."""
    texts = {parameter.name: parameter.expr.span.text or parameter.name for parameter in lowered.parameters}
    walked: dict[str, str] = {}
    tables: dict[str, str] = {}
    for name, argument, alias in _find_explained_sources(lowered.text):
        table = lowered.modules.get(name)
        if table is not None:
            argument = argument if table.function is None else f"{table.function}({argument})"
            walked[alias] = _put_alias_in_words(_put_source_in_words(argument, texts), alias if alias != name else "")
        else:
            tables[alias] = name if name in (alias, f"{alias}_once") else _put_alias_in_words(name, alias)
    return PlanNames(walked, tables, queue)


def _find_explained_sources(text: str) -> Iterator[tuple[str, str, str]]:
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
            close = _find_closing_parenthesis(kinds, end)
            argument = text[tokens[end].end + 1 : tokens[close].start]
            end = close + 1
        if kinds[end : end + 1] == [TokenType.ALIAS]:
            alias = tokens[end + 1].text
        yield name, argument, alias


def _find_closing_parenthesis(kinds: list[TokenType], opening: int) -> int:
    """The index of the parenthesis that closes the one at an index."""
    depth = 0
    for place in range(opening, len(kinds)):
        depth += (kinds[place] == TokenType.L_PAREN) - (kinds[place] == TokenType.R_PAREN)
        if not depth:
            return place
    raise AssertionError("lowered text has as many closing parentheses as opening ones")


def _put_source_in_words(argument: str, texts: Mapping[str, str]) -> str:
    """A source; a bound value in the script's notation."""
    alone = re.fullmatch(r":(\w+)(?: /\*.*\*/)?", argument.strip(), re.DOTALL)
    return cut_explained_script(texts.get(alone[1], alone[1]) if alone else argument, MOST_TEXT)


def _put_alias_in_words(name: str, alias: str) -> str:
    """A source and its alias, unless they are equal."""
    return name if alias in ("", "this", name, name.rpartition(".")[2]) else f"{name} (as {alias})"


# --- sentences -----------------------------------------------------------------------------------------

# With HEURISTIC a step is in the queue twice: as a result at its cost, and to be expanded with the estimate.
REPLACED_LINES = {
    "COMPOUND QUERY": "each step waits twice, for its own turn and for that of the steps after it:",
    "LEFT-MOST SUBQUERY": "the steps after it:",
    "UNION ALL": "its second turn:",
}

NAME = r"(?P<name>\S+|.+?)"
WHERE = r" \((?P<where>.*)\)"


def _describe_line(text: str, names: PlanNames, recursive: bool) -> str:
    if recursive and text == "SCAN search":
        return f"takes the steps that wait in a queue one by one, {names.queue}"
    if recursive and text in REPLACED_LINES:
        return REPLACED_LINES[text]
    for pattern, words in SENTENCES:
        found = re.fullmatch(pattern, text)
        if found:
            return words(found, names)
    return f"{text} (as SQLite says it)"


def _name_plan_table(found: re.Match[str], names: PlanNames) -> str:
    name = found["name"]
    return "an inner query" if name.startswith("(") else names.tables.get(name, name)


def _format_conditions(text: str) -> str:
    """`src=? AND n>?` with an ellipsis for each unknown value."""
    return re.sub(r"(\S+?)(<=|>=|=|<|>)\?", r"\1 \2 …", text).replace(" AND ", " and ")


def _describe_scan(found: re.Match[str], names: PlanNames) -> str:
    if found["name"] == "search":
        return "gives the results as the search finds them"
    index = found["index"]
    return f"reads every row of {_name_plan_table(found, names)}" + (
        f" in the order of its index {index}" if index else ""
    )


def _describe_virtual(found: re.Match[str], names: PlanNames) -> str:
    """A virtual table; those of worlds list the adapter's filters in their plan."""
    name, demands = found["name"], found["asked"]
    if demands.startswith("each element"):
        left_out = re.fullmatch(r"each element, (.*) IS NOT \?", demands)
        but = f" but those whose {left_out[1]} is …" if left_out else ""
        return f"walks the elements of {names.walked.get(name, name)}{but}"
    table = names.tables.get(name, name)
    if demands == "all":
        return f"reads every element of {table}"
    parts = demands.split(", ")
    parameters = [part.removesuffix(" := ?") for part in parts if part.endswith(" := ?")]
    filters = [part for part in parts if not part.endswith(" := ?")]
    words = f"asks for the elements of {table}"
    if parameters:
        words += f" for a given {' and '.join(parameters)}"
    return words + (f" with {_put_ranges_in_words(filters)}; the adapter uses these conditions" if filters else "")


def _put_ranges_in_words(filters: list[str]) -> str:
    """`x >= ?` and `x <= ?` as one condition."""
    ranges: dict[str, list[str]] = {}
    for condition in filters:
        column, operator, _ = condition.rsplit(" ", 2)
        ranges.setdefault(column, []).append(operator)
    both = {column: {operator[0] for operator in operators} == {"<", ">"} for column, operators in ranges.items()}
    return " and ".join(
        f"{column} from … to …" if both[column] else " and ".join(f"{column} {operator} …" for operator in operators)
        for column, operators in sorted(ranges.items())
    )


def _describe_search(found: re.Match[str], names: PlanNames) -> str:
    kind, where = found["kind"], _format_conditions(found["where"])
    rows = f"looks up the rows of {_name_plan_table(found, names)} with {where}"
    if kind.startswith("AUTOMATIC"):
        return f"{rows} in an index that SQLite makes for this query"
    if kind == "INTEGER PRIMARY KEY" and found["where"] == "rowid=?":
        return f"looks up the row of {_name_plan_table(found, names)} by its number"
    if kind.endswith("PRIMARY KEY"):
        return f"{rows} by its primary key"
    covering = kind.startswith("COVERING ")
    index = kind.removeprefix("COVERING ").removeprefix("INDEX ")
    return f"{rows} in its index {index}" + (", which has all that is needed" if covering else "")


def _describe_sort(found: re.Match[str], names: PlanNames) -> str:
    what = found["what"]
    if what == "ORDER BY":
        return "sorts the rows for ORDER BY"
    if what == "GROUP BY":
        return "sorts the rows into groups"
    if what.endswith("ORDER BY"):
        return "sorts rows that are equal so far by the other terms of ORDER BY"
    return f"keeps rows in order, for {what}"


def _say_always(words: str) -> Callable[[re.Match[str], PlanNames], str]:
    return lambda found, names: words


SENTENCES: tuple[tuple[str, Callable[[re.Match[str], PlanNames], str]], ...] = (
    (rf"SCAN {NAME} VIRTUAL TABLE INDEX \d+:(?P<asked>.*)", _describe_virtual),
    (r"SCAN CONSTANT ROW|SCAN \d+ CONSTANT ROWS?", _say_always("makes a row of what is known")),
    (rf"SCAN {NAME}(?: USING (?:COVERING )?INDEX (?P<index>\S+))?", _describe_scan),
    (rf"SEARCH {NAME} USING (?P<kind>.*?){WHERE}(?: LEFT-JOIN)?", _describe_search),
    (
        rf"BLOOM FILTER ON {NAME}{WHERE}",
        _say_always("keeps a note of the values there, to skip lookups that find nothing"),
    ),
    (r"CO-ROUTINE search", _say_always("searches step by step:")),
    (rf"CO-ROUTINE {NAME}", lambda found, names: f"makes the rows of {_name_plan_table(found, names)} on demand:"),
    (rf"MATERIALIZE {NAME}", lambda found, names: f"once, beforehand, and kept as {_name_plan_table(found, names)}:"),
    (r"SETUP|INITIAL RECURSIVE PART", _say_always("the start:")),
    (r"RECURSIVE STEP", _say_always("the steps:")),
    (r"CORRELATED SCALAR SUBQUERY \d+", _say_always("for each row, computes the value of a query of its own:")),
    (r"SCALAR SUBQUERY \d+", _say_always("once, computes the value of a query of its own:")),
    (r"CORRELATED LIST SUBQUERY \d+", _say_always("for each row, makes a list by a query of its own:")),
    (r"(?:LIST|REUSE LIST) SUBQUERY \d+", _say_always("once, makes a list by a query of its own:")),
    (r"USE TEMP B-TREE FOR (?P<what>.*)", _describe_sort),
    (r"COMPOUND QUERY", _say_always("puts the rows of several queries together:")),
    (r"LEFT-MOST SUBQUERY", _say_always("the first query:")),
    (r"UNION ALL", _say_always("the next query:")),
)
