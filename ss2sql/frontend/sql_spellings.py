"""Spellings of SQL, and of other languages, that SelectScript writes differently: each error shows the right form."""

from __future__ import annotations

from collections.abc import Callable

from ss2sql.errors import ParseError
from ss2sql.frontend.builder import COMMENT
from ss2sql.frontend.text import CLOSING, OPENING, Token
from ss2sql.frontend.trouble import OPTIONS, VALUES, Trouble, named

_JOIN = "write FROM a JOIN b ON a.id == b.id, or FROM a LEFT JOIN b ON a.id == b.id"
_LIKE = "write {x} LIKE ..., where % is any text, _ any character, and case counts; or register a Python function"
_UNION = "join lists with +: (SELECT ... AS list) + (SELECT ... AS list)"
_IF = "write IF(condition; then; else)"

# Words behind a complete expression, which is {x}, and what to write instead.
_BEHIND = {
    "ISNULL": "write {x} IS NULL", "NOTNULL": "write {x} IS NOT NULL", "ILIKE": _LIKE, "GLOB": _LIKE, "REGEXP": _LIKE,
    "MATCH": _LIKE, "INNER": _JOIN, "RIGHT": _JOIN, "FULL": _JOIN, "OUTER": _JOIN,
    "CROSS": _JOIN, "NATURAL": _JOIN, "ON": _JOIN, "USING": _JOIN, "UNION": _UNION, "EXCEPT": _UNION,
    "INTERSECT": _UNION, "OFFSET": "write LIMIT n OFFSET m",
    "FETCH": "write LIMIT n", "COLLATE": "sort by the value of a function that you register",
    "OVER": "use GROUP BY, or a function of the whole list", "WHEN": _IF, "THEN": _IF, "ELSE": _IF,
    "TOP": "write LIMIT n behind the other clauses", "CONTAINS": "write 'part' IN {x}",
    "STARTS": "write {x}[:n] == 'part', with its length n", "ENDS": "write {x}[-n:] == 'part', with its length n",
    "INTO": "assign the query: name = SELECT ...",
    "UNTIL": "a search ends with STOP WITH condition", "MOD": "write {x} % ...", "DIV": "write int({x} / ...)",
}  # fmt: skip
# Words that were read as a name, with something behind them that does not fit.
_AHEAD = {
    "ALL": "leave it out: a query gives all rows",
    "TOP": "write LIMIT n behind the other clauses", "CASE": _IF,
    "PRIOR": "write prior(x): PRIOR stands in front of a name",
    "EXISTS": "write [] != (SELECT ... AS list)", "EXPLAIN": "call explain() on the compiled script",
}  # fmt: skip
_WRITING = frozenset((
    "INSERT", "UPDATE", "DELETE", "CREATE", "DROP", "ALTER", "REPLACE", "ATTACH", "DETACH", "PRAGMA", "BEGIN", "COMMIT",
    "ROLLBACK", "VACUUM", "MERGE", "TRUNCATE", "GRANT", "REVOKE", "REINDEX", "SAVEPOINT",
))  # fmt: skip
_SIGNS = {
    "**": "the power is ^", "//": "division is /, and a comment starts with #", "++": "write {x} = {x} + 1",
    "+=": "write {x} = {x} + ...", "-=": "write {x} = {x} - ...", "*=": "write {x} = {x} * ...",
    "/=": "write {x} = {x} / ...", ":=": "write {x} = ...", "=>": "write >= to compare", "=<": "write <= to compare",
    "===": "write == to compare", "->": 'write {x}.column, or {x}["key"]',
    ">>": "write int({x} / 2 ^ n)", "<<": "write {x} * 2 ^ n",
    "::": "write int({x}), float({x}) or str({x})",
}  # fmt: skip


def explain(t: Trouble) -> ParseError | None:
    """The error for a known foreign spelling; None where the text is none."""
    checks: tuple[Callable[[Trouble], ParseError | None], ...] = (
        _comment, _sign, _assignment, _modifier, _column_name, _behind_as, _statement, _word, _star, _dot, _list,
        _quotes,
    )  # fmt: skip
    return next((error for check in checks if (error := check(t))), None)


def _comment(t: Trouble) -> ParseError | None:
    """`-- comment` reads as two minus signs; the trouble comes later on the same line, or right behind it."""
    line = t.source.text.rfind("\n", 0, t.before().start) + 1
    for index in range(t.index, 0, -1):
        first, second = t.tokens[index - 1], t.tokens[index]
        if first.start < line:
            return None
        if first.kind == second.kind == "-" and first.end == second.start:
            both = Token("--", "--", first.start, second.end)
            return t.error("P006", "-- does not start a comment", COMMENT, at=both)
    return None


def _sign(t: Trouble) -> ParseError | None:
    """Two signs side by side that are one operator elsewhere."""
    for first, second in ((t.before(), t.found), (t.found, t.next)):
        sign = first.text + second.text
        if first.end == second.start and sign in _SIGNS:
            name = t.before(2) if second is t.found else t.before()
            both = Token(sign, sign, first.start, second.end)
            hint = _SIGNS[sign].format(x=name.text if name.kind == "NAME" else "x")
            return t.error("P006", f"there is no operator {sign}", hint, at=both)
    return None


def _assignment(t: Trouble) -> ParseError | None:
    """`=` where nothing can be assigned: in a condition, in a column, behind something that is not a name."""
    if t.found.kind != "=" or "+" not in t.expected:
        return None
    left, right = t.operand(), _value_behind(t)
    compare = f"write {left} == {right} to compare"
    if t.clause in ("WHERE", "HAVING", "STOP WITH", "IF(", "ON", "WHEN"):
        return t.error("P006", f"= assigns, but {t.clause.rstrip('(')} needs a condition", compare)
    if t.clause == "SELECT":
        return t.error("P006", "a column is not assigned", f"write {right} AS {left} to name a column", compare)
    ahead = t.values[-2] if len(t.values) > 1 else None
    if isinstance(ahead, Token) and ahead.kind == "PRIOR":
        return t.error(
            "P006", "= assigns, but PRIOR stands in a condition", f"write PRIOR {left} == {right} to compare"
        )
    if t.clause in OPTIONS:
        return t.error(
            "P001", f"{t.clause} needs a value in front of the assignments", f"write {t.clause} 1 {left} = ..."
        )
    if t.clause in ("START WITH", "CONNECT BY") and t.before(2).kind == "AND":
        return t.error("P006", f"the assignments of {t.clause} are separated by commas",
                       f"write {t.clause} ..., {left} = {right}", at=t.before(2))  # fmt: skip
    return t.error("P001", f"only a name can be assigned here, not {left}", compare)


def _value_behind(t: Trouble) -> str:
    """The literal, name or column behind the token that does not fit; `...` for anything longer."""
    last = t.index + 1
    while t.tokens[last].kind in VALUES and [token.kind for token in t.tokens[last + 1 : last + 3]] == [".", "NAME"]:
        last += 2
    if t.next.kind not in VALUES or t.tokens[last + 1].kind in ("(", "[", "{", "."):
        return "..."
    text = t.text(t.next.start, t.tokens[last].end)
    return "None" if text.upper() == "NULL" else text


def _column_name(t: Trouble) -> ParseError | None:
    """`SELECT expr name FROM ...`."""
    if t.clause != "SELECT" or "FROM" not in t.expected or "," not in t.expected:
        return None
    if t.found.kind == "NAME" and not t.found.keyword and t.next.kind in (",", "FROM"):
        return t.error("P006", f"expected ',' or FROM between {named(t.before())} and {named(t.found)}",
                       f"write {t.column()} AS {t.found.text} to name a column")  # fmt: skip
    return None


def _behind_as(t: Trouble) -> ParseError | None:
    """What follows a query that AS has ended: a clause, another source, an index."""
    ahead = t.values[-2] if len(t.values) > 1 else None
    if not isinstance(ahead, Token) or ahead.kind != "AS" or t.found.text.upper() in _BEHIND:
        return None
    shape, word = t.before(), t.found.keyword or t.found.kind
    if word in ("[", ".", "^", "{"):
        return t.error("P009", f"a query to the left of {named(t.found)} stands in parentheses",
                       f"write (SELECT ... AS {shape.text}){t.found.text} ...")  # fmt: skip
    if word not in ("WHERE", "START", "CONNECT", "STOP", "GROUP", "HAVING", "ORDER", "LIMIT", "AS", ","):
        return None
    return t.error("P006", f"AS ends the query, {named(t.found)} cannot follow it",
                   "AS says the form of the result and is the last clause",
                   f"to name a source write FROM {shape.text} = ...")  # fmt: skip


def _statement(t: Trouble) -> ParseError | None:
    """Statements that write, and WITH in front of a query."""
    word = t.before()
    if word.kind != "NAME" or t.before(2).kind != ";" or t.bracket:
        return None
    upper = word.text.upper()
    if upper in _WRITING:
        return t.error("P006", f"a script only reads, there is no {upper}",
                       "change data from Python or with SQLite itself", at=word)  # fmt: skip
    if upper == "WITH":
        return t.error("P006", "there is no WITH in front of a query", "assign the inner query to a variable first",
                       "a recursive query is written SELECT ... START WITH ... CONNECT BY ...", at=word)  # fmt: skip
    return None


def _modifier(t: Trouble) -> ParseError | None:
    """Words in front of an expression: DISTINCT, CASE, PRIOR."""
    word = t.before()
    upper = word.text.upper()
    if word.kind != "NAME" or upper not in _AHEAD or t.values[-1:] != [word]:
        return None
    return t.error("P006", f"there is no {upper} in SelectScript", _AHEAD[upper], at=word)


def _word(t: Trouble) -> ParseError | None:
    """Words behind an expression: operators, joins, set operations."""
    upper = t.found.text.upper()
    if t.found.kind not in ("NAME", upper) or upper not in _BEHIND or t.wants_operand or t.expected == {"="}:
        return None
    spelling, hint, x = upper, _BEHIND[upper], t.operand()
    if t.before().kind == "NOT":
        spelling, x, hint = f"NOT {upper}", t.back().operand(), hint.replace(" LIKE ", " NOT LIKE ")
    return t.error("P006", f"there is no {spelling} in SelectScript", hint.format(x=x))


def _star(t: Trouble) -> ParseError | None:
    if t.found.kind == "*" and t.before().kind == "." and t.before(2).kind == "NAME":
        source = t.before(2).text
        return t.error("P006", f"there is no {source}.* in SelectScript",
                       f"write {source}.this for the element, {source}.x for a column, SELECT * for all")  # fmt: skip
    alone = t.found.kind == "," and t.before().kind == "*" and "FROM" in t.expected
    if t.clause == "SELECT" and (alone or (t.found.kind == "*" and t.before().kind == ",")):
        return t.error("P006", "* is the only column, or none", "write SELECT *, or name the columns")
    return None


def _dot(t: Trouble) -> ParseError | None:
    """A dot stands between a source and its column; there are no longer paths."""
    if t.found.kind == "." and "+" in t.expected:
        key = t.next.text if t.next.kind == "NAME" else "key"
        return t.error("P001", f"a dot stands behind the name of a source only, not behind {t.operand()}",
                       f'write {t.operand()}["{key}"] to read a key')  # fmt: skip
    return None


def _list(t: Trouble) -> ParseError | None:
    """Lists without square brackets, dicts, parameters with a colon."""
    if t.found.kind == "," and t.clause in ("(", "") and not t.wants_operand:
        return t.error("P006", "a list stands in square brackets", f"write [{_items(t)}]", *_decimal_comma(t))
    if t.found.kind == "," and t.clause == "LIMIT":
        number = t.text(t.next.start, t.next.end)
        return t.error("P006", "LIMIT has one number", f"write LIMIT {number} OFFSET {t.operand()}")
    if t.found.kind == "{" and t.wants_operand:
        return t.error("P001", "a dict cannot be written in a script", "give it to the session from Python")
    if t.found.kind == ":" and t.wants_operand and t.clause != "x[":
        return t.error("P006", "a parameter has no sign", f"write {t.next.text or 'its name'} alone")
    return None


def _items(t: Trouble) -> str:
    """What stands in the parentheses that were meant as a list, if it is short."""
    depth = 0
    for token in t.tokens[t.index :] if t.clause == "(" else ():
        depth += (token.kind in OPENING) - (token.kind in CLOSING)
        if depth < 0 and t.bracket is not None and token.start - t.bracket.end <= 40:
            return t.source.text[t.bracket.end : token.start].strip().rstrip(",")
    return f"{t.operand()}, ..."


def _decimal_comma(t: Trouble) -> list[str]:
    first, second = t.before(), t.next
    if first.kind == second.kind == "INTEGER" and first.end == t.found.start and t.found.end == second.start:
        return [f"a fraction has a point: {first.text}.{second.text}"]
    return []


def _quotes(t: Trouble) -> ParseError | None:
    """`'it''s'` reads as two strings."""
    before = t.before()
    if t.found.kind == before.kind == "STRING" and before.end == t.found.start:
        quote = before.text[0]
        return t.error("P006", "two strings stand side by side", f"a quote inside a string is written \\{quote}")
    return None
