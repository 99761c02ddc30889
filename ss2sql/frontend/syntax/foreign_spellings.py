"""Spellings of SQL and Python that SelectScript writes differently: each error says what to write."""

from __future__ import annotations

import re
from collections.abc import Callable

from ss2sql.errors import ParseError
from ss2sql.frontend.syntax.parse_failure import CLAUSES, VALUES, ParseFailure, spell
from ss2sql.frontend.syntax.tokenizer import CLOSING, CONTEXTUAL, OPENING, OPTIONS, Token
from ss2sql.frontend.syntax.tree_builder import COMMENT_HINT

_JOIN = "write FROM a JOIN b ON a.id == b.id, or FROM a LEFT JOIN b ON a.id == b.id"
_LIKE = "write {x} LIKE ..., where % is any text, _ any character, and case counts; or register a Python function"
_IF = "write IF(condition; then; else)"
_LIMIT = "write LIMIT n after the other clauses"
# Set operations of two queries; ALL keeps equal rows.
_SETS = {
    "UNION": "uniq({0} + {1})", "UNION ALL": "{0} + {1}", "EXCEPT": "uniq(difference({0}, {1}))",
    "MINUS": "uniq(difference({0}, {1}))", "INTERSECT": "uniq(SELECT this FROM {0} WHERE this IN {1} AS list)",
}  # fmt: skip
# Words after a complete expression {x}, and before {y}.
_INFIXES = {
    "ISNULL": "write {x} IS NULL", "NOTNULL": "write {x} IS NOT NULL", "GLOB": _LIKE, "REGEXP": _LIKE, "MATCH": _LIKE,
    "ILIKE": "write lower({x}) LIKE lower({y})", "MOD": "write {x} % {y}", "INNER": "write JOIN without INNER",
    "RIGHT": _JOIN, "FULL": _JOIN, "OUTER": _JOIN, "NATURAL": _JOIN, "ON": _JOIN, "USING": _JOIN,
    "CROSS": "write a comma: FROM a, b", "OFFSET": "write LIMIT n OFFSET {y}", "FETCH": "write LIMIT n", "TOP": _LIMIT,
    "COLLATE": "sort by the value of a function that you register",
    "OVER": "use GROUP BY, or a function of the whole list", "WHEN": _IF, "THEN": _IF, "ELSE": _IF,
    "NULLS": "leave it out: None comes first, with DESC last", "INTO": "assign the query: name = SELECT ...",
    **{word: f"write {form.format('(SELECT ... AS list)', '(SELECT ... AS list)')}" for word, form in _SETS.items()},
}  # fmt: skip
# Words that were read as a name before something that does not fit.
_PREFIXES = {
    "CONNECT_BY_ROOT": "write root(name)", "ALL": "leave it out: a query gives all rows", "TOP": _LIMIT,
    "CASE": "write CASE WHEN x == ... THEN ... ELSE ... END",
    "PRIOR": "write prior(x): PRIOR stands in front of a name", "EXISTS": "write [] != (SELECT ... AS list)",
    "EXPLAIN": "call explain() on the compiled script",
}  # fmt: skip
_FUNCTION = "functions are written in Python, and session.function(f) registers them"
# Words at the beginning of a statement.
_FIRST = {
    "FOR": "a loop is a query: SELECT ... FROM x = list", "DEF": _FUNCTION, "IMPORT": _FUNCTION,
    "WHILE": "a loop that goes on is a search: START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 9",
}  # fmt: skip
_WRITING = frozenset((
    "INSERT", "UPDATE", "DELETE", "CREATE", "DROP", "ALTER", "REPLACE", "ATTACH", "DETACH", "PRAGMA", "BEGIN", "COMMIT",
    "ROLLBACK", "VACUUM", "MERGE", "TRUNCATE", "GRANT", "REVOKE",
))  # fmt: skip
_SIGNS = {
    "**": "the power is ^", "//": "division is /, whole division floor(a / b), and a comment starts with #",
    "+=": "write x = x + ...", "-=": "write x = x - ...", ":=": "write x = ...", "=>": "write >= to compare",
    "=<": "write <= to compare", "===": "write == to compare", "->": 'write x.column, or x["key"]',
    "::": "write int(x), float(x) or str(x)",
}  # fmt: skip
_TESTED = frozenset(("WHERE", "HAVING", "STOP WITH", "IF(", "ON", "WHEN"))  # where a condition stands


def _explain_inner_quote(t: ParseFailure) -> ParseError | None:
    """`'it's'` or `'it''s'`: the string ends at its second quote."""
    string = t.peek()
    if string.kind != "STRING" or t.found.kind not in ("NAME", "STRING") or string.end != t.found.start:
        return None
    quote, other = string.text[0], '"' if string.text[0] == "'" else "'"
    return t.explain("P001", f"the string {t.cut_text(string.start, string.end)} ends at its second {quote}",
                   f"a quote inside a string is written \\{quote}, or the string stands in {other}")  # fmt: skip


def _explain_comment(t: ParseFailure) -> ParseError | None:
    """`--comment` reads as two minus signs; parsing fails later on the same line, or right after it."""
    line = t.source.text.rfind("\n", 0, t.peek().start) + 1
    for index in range(t.index, 0, -1):
        first, second = t.tokens[index - 1], t.tokens[index]
        if first.start < line:
            return None
        if first.kind == second.kind == "-" and first.end == second.start:
            both = Token("--", "--", first.start, second.end)
            return t.explain("P006", "-- does not start a comment", COMMENT_HINT, at=both)
    return None


def _explain_sign(t: ParseFailure) -> ParseError | None:
    """Two signs side by side that are one operator elsewhere."""
    for first, second in ((t.peek(), t.found), (t.found, t.next)):
        sign = first.text + second.text
        if first.end == second.start and sign in _SIGNS and t.clause != "x[":  # x[::2]
            both = Token(sign, sign, first.start, second.end)
            return t.explain("P006", f"there is no operator {sign}", _SIGNS[sign], at=both)
    return None


def _explain_concatenation(t: ParseFailure) -> ParseError | None:
    if t.found.text != "||":
        return None
    if t.clause in _TESTED or t.clause == "(":
        return t.explain("P006", "there is no operator ||", "the logical or is OR, and strings are joined by +")
    return t.explain("P006", "there is no operator ||", f"write {t.read_left()} + {t.read_right()} to join strings")


def _explain_is(t: ParseFailure) -> ParseError | None:
    """`age IS 36`, `age IS NOT 36`."""
    negated = t.peek().kind == "NOT" and t.peek(2).kind == "IS"
    if (t.peek().kind != "IS" and not negated) or t.found.kind not in (*VALUES, *OPENING, "-"):
        return None
    ahead = t.step_back().step_back() if negated else t.step_back()
    hint = f"write {ahead.read_left()} {'!=' if negated else '=='} {t.step_back().read_right()}"
    return t.explain("P006", "IS asks for None alone", hint, at=ahead.found)


def _explain_cast(t: ParseFailure) -> ParseError | None:
    """`CAST(age AS TEXT)`, `EXTRACT(YEAR FROM born)`."""
    if t.clause != "f(" or t.bracket is None or t.found.kind not in ("AS", "FROM"):
        return None
    value = t.cut_text(t.bracket.end, t.peek().end).strip()
    if t.found.kind == "AS":
        return t.explain("P006", "AS stands in SELECT alone", f"write int({value}), float({value}) or str({value})")
    if value.upper() in ("YEAR", "MONTH", "DAY", "HOUR", "MINUTE", "SECOND"):
        return t.explain("P006", "FROM stands in a query alone", f"write {value.lower()}({t.read_right()})")
    return None


def _explain_assignment(t: ParseFailure) -> ParseError | None:
    """`=` where nothing can be assigned: in a condition, in a column, after something that is not a name."""
    if t.found.kind != "=" or "+" not in t.expected:
        return None
    left, right = t.read_left(), t.read_right()
    compare = f"write {left} == {right} to compare"
    if (quantified := re.fullmatch(r"(?:ANY|SOME) ?(\(SELECT\b.*\))", right, re.IGNORECASE)) is not None:
        compare = f"write {left} IN {quantified[1]}"
    if t.clause in _TESTED:
        return t.explain("P006", f"= assigns, but {t.clause.rstrip('(')} needs a condition", compare)
    if t.clause == "SELECT":
        return t.explain("P006", "a column is not assigned", f"write {right} AS {left} to name a column", compare)
    if isinstance(ahead := t.values[-2] if len(t.values) > 1 else None, Token) and ahead.kind == "PRIOR":
        cure = f"write PRIOR {left} == {right} to compare"
        return t.explain("P006", "= assigns, but PRIOR stands in a condition", cure)
    if t.clause in OPTIONS:
        cure = f"write {t.clause} 1 {t.peek().text} = ..."
        return t.explain("P001", f"{t.clause} needs a value in front of the assignments", cure)
    if t.clause in ("START WITH", "CONNECT BY") and t.peek(2).kind == "AND":
        begin = max(i for i in range(t.index) if t.tokens[i].kind in ("START", "CONNECT"))
        cure = f"write {t.source.text[t.tokens[begin].start : t.peek(2).start].strip()}, {left} = {right}"
        return t.explain("P006", f"the assignments of {t.clause} are separated by commas", cure, at=t.peek(2))
    return t.explain("P001", f"only a name can be assigned here, not {left}", compare)


def _explain_missing_as(t: ParseFailure) -> ParseError | None:
    """`SELECT expr name FROM ...`."""
    if t.clause != "SELECT" or "FROM" not in t.expected or "," not in t.expected:
        return None
    if t.found.kind == "NAME" and not t.found.keyword and t.next.kind in (",", "FROM"):
        return t.explain("P006", f"expected ',' or FROM between {spell(t.peek())} and {spell(t.found)}",
                       f"write {t.read_left()} AS {t.found.text} to name a column")  # fmt: skip
    return None


def _explain_column_name(t: ParseFailure) -> ParseError | None:
    """`SELECT expr AS 'a name' FROM ...`."""
    if t.peek().kind != "AS" or t.step_back().clause != "SELECT" or t.found.kind != "STRING":
        return None
    cure = f"write to({t.step_back().read_left()}, {t.found.text})"
    return t.explain("P001", f"expected a name after AS, found {spell(t.found)}", cure)


def _explain_after_as(t: ParseFailure) -> ParseError | None:
    """What follows a query that AS has ended: a clause, another source, an index."""
    ahead = t.values[-2] if len(t.values) > 1 else None
    if not isinstance(ahead, Token) or ahead.kind != "AS" or t.found.text.upper() in _INFIXES:
        return None
    shape, word = t.peek(), t.found.keyword or t.found.kind
    if word in ("[", ".", "^", "{"):
        return t.explain("P009", f"a query to the left of {spell(t.found)} stands in parentheses",
                       f"write (SELECT ... AS {shape.text}){t.found.text} ...")  # fmt: skip
    if word not in {*CLAUSES, ",", "JOIN", "LEFT"} - {"SELECT", "FROM"}:
        return None
    return t.explain("P006", f"AS ends the query, {spell(t.found)} cannot follow it",
                   "AS says the form of the result and is the last clause",
                   f"to name a source write FROM {shape.text} = ...")  # fmt: skip


def _explain_statement(t: ParseFailure) -> ParseError | None:
    """Statements that write, those of Python, and WITH in front of a query."""
    word = t.peek()
    if word.kind != "NAME" or t.peek(2).kind != ";" or t.bracket:
        return None
    upper = word.text.upper()
    if upper in _FIRST:
        return t.explain("P006", f"there is no {word.text} in SelectScript", _FIRST[upper], at=word)
    if upper in _WRITING:
        cure = "change data from Python or with SQLite itself"
        return t.explain("P006", f"a script only reads, there is no {upper}", cure, at=word)
    if upper == "WITH":
        cures = _write_as_statements(t) or (
            "assign the inner query to a variable first",
            "a recursive query is written SELECT ... START WITH ... CONNECT BY ...",
        )
        return t.explain("P006", "there is no WITH in front of a query", *cures, at=word)
    return None


def _write_as_statements(t: ParseFailure) -> tuple[str, ...]:
    """`WITH t AS (SELECT ...) SELECT ...` as two statements; nothing for a longer one."""
    opened = t.index + 2
    if t.next.kind != "AS" or t.tokens[opened].kind != "(":
        return ()
    closed = _find_end(t, opened + 1)
    end = _find_end(t, min(closed + 1, len(t.tokens) - 1))
    inner = t.source.text[t.tokens[opened].start : t.tokens[closed].end]
    rest = t.source.text[t.tokens[closed].end : t.tokens[end].start].strip()
    if not rest or rest.startswith(",") or len(inner) + len(rest) > 120:
        return ()
    return (f"write {t.found.text} = {' '.join(inner.split())}; {' '.join(rest.split())}",)


def _find_end(t: ParseFailure, begin: int) -> int:
    """The index of the token that ends the query which begins there: `;`, a closing bracket or the last token."""
    depth = 0
    for index in range(begin, len(t.tokens)):
        depth += (t.tokens[index].kind in OPENING) - (t.tokens[index].kind in CLOSING)
        if depth < 0 or (not depth and t.tokens[index].kind == ";"):
            return index
    return len(t.tokens) - 1


def _explain_set_operation(t: ParseFailure) -> ParseError | None:
    """`SELECT ... UNION SELECT ...`; of more queries, and of those in parentheses, the form alone is shown."""
    every = t.found.text.upper() == "UNION" and t.next.text.upper() == "ALL"
    word, second = "UNION ALL" if every else t.found.text.upper(), t.index + 1 + every
    if word not in _SETS or t.tokens[min(second, len(t.tokens) - 1)].kind != "SELECT":
        return None
    first = depth = 0
    for first in range(t.index - 1, -1, -1):
        depth += (t.tokens[first].kind in CLOSING) - (t.tokens[first].kind in OPENING)
        if not depth and t.tokens[first].kind == "SELECT":
            break
    end = _find_end(t, second)
    texts = [t.source.text[t.tokens[a].start : t.tokens[b].end] for a, b in ((first, t.index - 1), (second, end - 1))]
    more = any(token.text.upper() in (*_SETS, "ORDER", "LIMIT") for token in t.tokens[second:end])
    columns = [re.split(r"\bFROM\b", text, maxsplit=1, flags=re.IGNORECASE)[0].split() for text in texts]
    # Rows of dicts are equal by their names, too, and those of `*` are not seen here.
    named = "*" not in columns[0] and columns[0] == columns[1]
    form = "dict" if named else "rows" if any("*" in one or "," in "".join(one) for one in columns) else "list"
    parts = ["SELECT ..." if more or len(text) > 60 else " ".join(text.split()) for text in texts]
    lists = [f"({part})" if re.search(r" AS \w+\Z", part) else f"({part} AS {form})" for part in parts]
    return t.explain(
        "P006", f"there is no {t.found.text.upper()} in SelectScript", f"write {_SETS[word].format(*lists)}"
    )


def _explain_word(t: ParseFailure) -> ParseError | None:
    """Words in front of an expression, and after one: operators, joins, set operations."""
    word = t.peek()
    upper = word.text.upper()
    if word.kind == "NAME" and upper in _PREFIXES and t.values[-1:] == [word]:
        return t.explain("P006", _tell_that_missing(upper), _PREFIXES[upper], at=word)
    upper = t.found.text.upper()
    fits = upper in _INFIXES and t.found.kind in ("NAME", upper)
    if not fits or t.wants_operand or t.expected == {"="} or word.text.upper() == "NO":
        return None
    if word.kind == "NOT":
        cure = _INFIXES[upper].replace(" LIKE ", " NOT LIKE ").format(x=t.step_back().read_left(), y=t.read_right())
        return t.explain("P006", _tell_that_missing(f"NOT {upper}"), cure)
    return t.explain("P006", _tell_that_missing(upper), _INFIXES[upper].format(x=t.read_left(), y=t.read_right()))


def _tell_that_missing(word: str) -> str:
    return f"{word} does not fit here" if word in CONTEXTUAL else f"there is no {word} in SelectScript"


def _explain_star(t: ParseFailure) -> ParseError | None:
    if t.found.kind == "*" and t.peek().kind == "." and t.peek(2).kind == "NAME":
        source = t.peek(2).text
        return t.explain("P006", f"there is no {source}.* in SelectScript",
                       f"write {source}.this for the element, {source}.x for a column, SELECT * for all")  # fmt: skip
    alone = t.found.kind == "," and t.peek().kind == "*" and "FROM" in t.expected
    if t.clause == "SELECT" and (alone or (t.found.kind == "*" and t.peek().kind == ",")):
        return t.explain("P006", "* is the only column, or none", "write SELECT *, or name the columns")
    return None


def _explain_list(t: ParseFailure) -> ParseError | None:
    """Lists without square brackets, dicts, parameters with a colon."""
    if t.found.kind == "," and t.clause in ("(", "") and not t.wants_operand:
        start = t.peek().start if t.bracket is None else t.bracket.end
        items = t.source.text[start : t.tokens[_find_end(t, t.index)].start].strip().rstrip(",")
        return t.explain("P006", "a list stands in square brackets", f"write [{items if len(items) <= 40 else '...'}]")
    if t.found.kind == "," and t.clause == "LIMIT":
        number = t.cut_text(t.next.start, t.next.end)
        return t.explain("P006", "LIMIT has one number", f"write LIMIT {number} OFFSET {t.read_left()}")
    if t.found.kind == "{" and t.wants_operand:
        return t.explain("P001", "a dict cannot be written in a script", "give it to the session from Python")
    if t.found.kind == ":" and t.wants_operand and t.clause != "x[":
        return t.explain("P006", "a parameter has no sign", f"write {t.next.text or 'its name'} alone")
    return None


# The errors for known spellings, None for anything else; the first that fits counts.
CHECKS: tuple[Callable[[ParseFailure], ParseError | None], ...] = (
    _explain_inner_quote, _explain_comment, _explain_sign, _explain_concatenation, _explain_is, _explain_cast,
    _explain_set_operation, _explain_assignment, _explain_statement, _explain_word, _explain_missing_as,
    _explain_column_name, _explain_after_as, _explain_star, _explain_list,
)  # fmt: skip
