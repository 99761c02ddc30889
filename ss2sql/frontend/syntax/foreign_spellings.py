"""Spellings of Python, SQL and other languages that SelectScript writes differently: each error shows the other way."""

from __future__ import annotations

from collections.abc import Callable

from ss2sql.errors import ParseError
from ss2sql.frontend.syntax.parse_failure import CLAUSES, ParseFailure, spell
from ss2sql.frontend.syntax.tokenizer import OPTIONS, Token
from ss2sql.frontend.syntax.tree_builder import COMMENT_HINT

_FUNCTION = "functions are written in Python, and session.function(f) registers them"
_ASSIGN = "an assignment has no word in front: name = ..."
_READ = "a script only reads: change data from Python or with SQLite itself"

# Words at the beginning of a statement, and what to write.
_FIRST = {
    "FOR": "a loop is a query: SELECT ... FROM x = list",
    "WHILE": "a loop that goes on is a search: START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 9",
    "DEF": _FUNCTION, "FUNCTION": _FUNCTION, "CLASS": _FUNCTION, "IMPORT": _FUNCTION,
    "RETURN": "the value of a script is that of its last statement: write the value alone",
    "LET": _ASSIGN, "VAR": _ASSIGN, "CONST": _ASSIGN, "SET": _ASSIGN, "DECLARE": _ASSIGN,
    "WITH": "assign the inner query to a variable first: t = SELECT ... AS dict; "
            "a recursive query is written SELECT ... START WITH ... CONNECT BY ...",
    "EXPLAIN": "call explain() on the compiled script",
    "INSERT": _READ, "UPDATE": _READ, "DELETE": _READ, "CREATE": _READ, "DROP": _READ, "ALTER": _READ,
    "REPLACE": _READ, "ATTACH": _READ, "PRAGMA": _READ, "BEGIN": _READ,
}  # fmt: skip
# Words that were read as a name before something that does not fit: {x}.
_BEFORE = {
    "CONNECT_BY_ROOT": "write root({x})", "ALL": "leave it out: a query gives all rows", "LAMBDA": _FUNCTION,
    "TOP": "write LIMIT n after the other clauses", "CASE": "write CASE WHEN {x} == ... THEN ... ELSE ... END",
    "PRIOR": "write prior(x): PRIOR stands in front of a name", "EXISTS": "write [] != (SELECT ... AS list)",
    "BFS": "write BREADTH FIRST", "DFS": "write DEPTH FIRST", "DIJKSTRA": "write COST value",
    "ASTAR": "write COST value HEURISTIC value", "GREEDY": "write HEURISTIC {x} without COST",
    "DISTINCT": "write DISTINCT after SELECT, or CONNECT BY UNIQUE",
}  # fmt: skip
_JOIN = "write FROM a JOIN b ON a.id == b.id, or FROM a LEFT JOIN b ON a.id == b.id"
_LIKE = "write {x} LIKE ..., where % is any text, _ any character, and case counts; or register a Python function"
_IF = "write IF(condition; then; else)"
_LISTS = "write uniq((SELECT ... AS list) + (SELECT ... AS list)), for UNION ALL without uniq"
# Words after a complete expression {x}, and what to write instead.
_AFTER = {
    "ISNULL": "write {x} IS NULL", "NOTNULL": "write {x} IS NOT NULL", "GLOB": _LIKE, "REGEXP": _LIKE,
    "ILIKE": "write lower({x}) LIKE ...", "MATCH": _LIKE, "INNER": "write JOIN without INNER",
    "RIGHT": _JOIN, "FULL": _JOIN, "OUTER": _JOIN, "CROSS": "write a comma: FROM a, b", "NATURAL": _JOIN, "ON": _JOIN,
    "USING": _JOIN, "OFFSET": "write LIMIT n OFFSET m", "FETCH": "write LIMIT n",
    "FOR": "write (SELECT x FROM x = list AS list)",
    "COLLATE": "sort by the value of a function that you register",
    "OVER": "use GROUP BY, or a function of the whole list", "WHEN": _IF, "THEN": _IF, "ELSE": _IF,
    "TOP": "write LIMIT n after the other clauses", "CONTAINS": "write ... IN {x}",
    "NULLS": "leave it out: None comes first, with DESC last", "INTO": "assign the query: name = SELECT ...",
    "CYCLE": "write NO CYCLE BY key, right after CONNECT BY", "UNTIL": "a search ends with STOP WITH condition",
    "ASCENDING": "write ASC", "DESCENDING": "write DESC", "MOD": "write {x} % ...", "DIV": "write int({x} / ...)",
    "UNION": _LISTS, "EXCEPT": "write difference((SELECT ... AS list), (SELECT ... AS list))",
    "MINUS": "write difference((SELECT ... AS list), (SELECT ... AS list))",
    "INTERSECT": "write SELECT this FROM (SELECT ... AS list) WHERE this IN (SELECT ... AS list) AS list",
}  # fmt: skip
_SIGNS = {
    "**": "the power is ^", "//": "division is /, whole division floor(a / b), and a comment starts with #",
    "++": "write x = x + 1",
    "+=": "write x = x + ...", "-=": "write x = x - ...", "*=": "write x = x * ...", "/=": "write x = x / ...",
    ":=": "write x = ...", "=>": "write >= to compare", "=<": "write <= to compare", "===": "write == to compare",
    "->": 'write x.column, or x["key"]', ">>": "write int(x / 2 ^ n)", "<<": "write x * 2 ^ n",
    "::": "write int(x), float(x) or str(x)",
}  # fmt: skip
_TESTED = frozenset(("WHERE", "HAVING", "STOP WITH", "IF(", "ON", "WHEN"))  # where a condition stands
_COMPARE = "write == to compare"


def explain_foreign_spelling(t: ParseFailure) -> ParseError | None:
    """The error for a known spelling of another language; None for anything else."""
    checks: tuple[Callable[[ParseFailure], ParseError | None], ...] = (
        _explain_first_word, _explain_inner_quote, _explain_comment, _explain_sign, _explain_is, _explain_assignment,
        _explain_word_before, _explain_missing_as, _explain_after_as, _explain_word, _explain_star, _explain_dot,
        _explain_list,
    )  # fmt: skip
    return next((error for check in checks if (error := check(t))), None)


def _explain_first_word(t: ParseFailure) -> ParseError | None:
    """`for x in nums: ...`, `let x = 5`, `UPDATE staff ...`, `WITH t AS (...) SELECT ...`."""
    word = t.peek()
    hint = _FIRST.get(word.text.upper())
    if hint is None or word.kind != "NAME" or t.peek(2).kind != ";" or t.bracket:
        return None
    return t.explain("P006", f"there is no {word.text} in SelectScript", hint, at=word)


def _explain_inner_quote(t: ParseFailure) -> ParseError | None:
    """`'it's'` or `'it''s'`: the string ends at its second quote."""
    string = t.peek()
    if string.kind != "STRING" or t.found.kind not in ("NAME", "STRING") or string.end != t.found.start:
        return None
    quote = string.text[0]
    return t.explain("P001", f"the string {t.cut_text(string.start, string.end)} ends at its second {quote}",
                   f"a quote inside a string is written \\{quote}")  # fmt: skip


def _explain_comment(t: ParseFailure) -> ParseError | None:
    """`-- comment` reads as two minus signs; parsing fails later on the same line, or right after it."""
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


def _explain_is(t: ParseFailure) -> ParseError | None:
    """`age IS 36`, `age IS NOT 36`."""
    word = t.peek(2) if t.peek().kind == "NOT" else t.peek()
    if word.kind != "IS":
        return None
    return t.explain("P006", "IS asks for None alone", "write == or != to compare", at=word)


def _explain_assignment(t: ParseFailure) -> ParseError | None:
    """`=` where nothing can be assigned: in a condition, in a column, after something that is not a name."""
    if t.found.kind != "=" or "+" not in t.expected:
        return None
    ahead = t.values[-2] if len(t.values) > 1 else None
    after_prior = isinstance(ahead, Token) and ahead.kind == "PRIOR"
    if t.clause in _TESTED or after_prior:
        what = "PRIOR stands in" if after_prior else f"{t.clause.rstrip('(')} needs"
        return t.explain("P006", f"= assigns, but {what} a condition", _COMPARE)
    if t.clause == "SELECT":
        return t.explain("P006", "a column is not assigned", "write value AS name to name a column", _COMPARE)
    if t.clause in OPTIONS:
        return t.explain(
            "P001",
            f"{t.clause} needs a value in front of the assignments",
            f"write {t.clause} 1 {t.read_operand()} = ...",
        )
    if t.clause in ("START WITH", "CONNECT BY") and t.peek(2).kind == "AND":
        return t.explain(
            "P006", f"the assignments of {t.clause} are separated by commas", "write a comma for AND", at=t.peek(2)
        )
    return t.explain("P001", f"only a name can be assigned here, not {t.read_operand()}", _COMPARE)


def _explain_word_before(t: ParseFailure) -> ParseError | None:
    """Words in front of an expression: CASE, PRIOR, TOP, BFS."""
    word = t.peek()
    hint = _BEFORE.get(word.text.upper())
    if hint is None or word.kind != "NAME" or t.values[-1:] != [word]:
        return None
    hint = hint.format(x=t.cut_text(t.found.start, t.found.end))
    return t.explain("P006", f"there is no {word.text} in SelectScript", hint, at=word)


def _explain_missing_as(t: ParseFailure) -> ParseError | None:
    """`SELECT expr name FROM ...`."""
    if t.clause != "SELECT" or "FROM" not in t.expected or "," not in t.expected:
        return None
    if t.found.kind == "NAME" and not t.found.keyword and t.next.kind in (",", "FROM"):
        return t.explain("P006", f"expected ',' or FROM between {spell(t.peek())} and {spell(t.found)}",
                       f"write {t.read_column()} AS {t.found.text} to name a column")  # fmt: skip
    return None


def _explain_after_as(t: ParseFailure) -> ParseError | None:
    """What follows a query that AS has ended: a clause, another source, an index."""
    ahead = t.values[-2] if len(t.values) > 1 else None
    if not isinstance(ahead, Token) or ahead.kind != "AS":
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


def _explain_word(t: ParseFailure) -> ParseError | None:
    """Words after an expression: operators, joins, set operations."""
    upper = t.found.text.upper()
    hint = _AFTER.get(upper)
    if hint is None or t.found.kind not in ("NAME", upper) or t.wants_operand or t.expected == {"="}:
        return None
    if t.peek().text.upper() == "NO":
        return None
    return t.explain("P006", f"there is no {t.found.text} in SelectScript", hint.format(x=t.read_operand()))


def _explain_star(t: ParseFailure) -> ParseError | None:
    if t.found.kind == "*" and t.peek().kind == "." and t.peek(2).kind == "NAME":
        source = t.peek(2).text
        return t.explain("P006", f"there is no {source}.* in SelectScript",
                       f"write {source}.this for the element, {source}.x for a column, SELECT * for all")  # fmt: skip
    alone = t.found.kind == "," and t.peek().kind == "*" and "FROM" in t.expected
    if t.clause == "SELECT" and (alone or (t.found.kind == "*" and t.peek().kind == ",")):
        return t.explain("P006", "* is the only column, or none", "write SELECT *, or name the columns")
    return None


def _explain_dot(t: ParseFailure) -> ParseError | None:
    """`p.name.upper()`."""
    if t.found.kind == "(" and t.peek(2).kind == "." and "+" in t.expected:
        owner, _, name = t.read_operand().rpartition(".")
        return t.explain("P001", f"values have no functions of their own, such as {name}", f"write {name}({owner})")
    return None


def _explain_list(t: ParseFailure) -> ParseError | None:
    """Lists without square brackets, dicts, parameters with a colon."""
    if t.found.kind == "," and t.clause in ("(", "") and not t.wants_operand:
        return t.explain("P006", "a list stands in square brackets", "write [a, b]")
    if t.found.kind == "," and t.clause == "LIMIT":
        return t.explain("P006", "LIMIT has one number", "write LIMIT n OFFSET m")
    if t.found.kind == "{" and t.wants_operand:
        return t.explain("P001", "a dict cannot be written in a script", "give it to the session from Python")
    if t.found.kind == ":" and t.wants_operand and t.clause != "x[":
        return t.explain("P006", "a parameter has no sign", f"write {t.next.text or 'its name'} alone")
    return None
