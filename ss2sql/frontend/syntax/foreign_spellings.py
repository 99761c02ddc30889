"""Spellings of Python, SQL and other languages that SelectScript writes differently: each error shows the other way."""

from __future__ import annotations

import re
from collections.abc import Callable

from ss2sql.errors import ParseError
from ss2sql.frontend.syntax import tokenizer
from ss2sql.frontend.syntax.parse_failure import AROUND, CLAUSES, ParseFailure, spell
from ss2sql.frontend.syntax.tokenizer import CONTEXTUAL, END, OPENING, OPTIONS, OTHER_OPTIONS, VALUES, Token
from ss2sql.frontend.syntax.tree_builder import COMMENT_HINT, COMPARISONS


def _explain_comprehension(t: ParseFailure) -> ParseError | None:
    """`[x for x in nums]`."""
    if t.found.text != "for" or t.wants_operand or t.bracket is None:
        return None
    column = t.cut_text(t.bracket.end, t.peek().end)
    name = t.next.text if t.next.kind == "NAME" else "x"
    return t.explain("P006", "there is no for in SelectScript", f"write (SELECT {column} FROM {name} = ... AS list)")


def _explain_from_first(t: ParseFailure) -> ParseError | None:
    """`FROM people SELECT name`, as some languages have it."""
    if t.found.kind != "FROM" or t.peek().kind != ";" or t.bracket or t.next.kind == END:
        return None
    return t.explain("P001", "a query starts with SELECT, not with FROM", "write SELECT ... FROM ...")


def _explain_item_assignment(t: ParseFailure) -> ParseError | None:
    """`x[0] = 5`."""
    if t.found.kind != "=" or t.peek().kind != "]" or t.clause or "+" not in t.expected:
        return None
    left = t.read_operand()
    name, bracket, _ = left.partition("[")
    if not bracket or not name.isidentifier():
        return None
    hint = f"assign a new list to {name}, or write {left} == ... to compare"
    return t.explain("P006", f"an element is not assigned, and {left} is one", hint)


def _explain_inner_quote(t: ParseFailure) -> ParseError | None:
    """`'it's'` or `'it''s'`: the string ends at its second quote."""
    string = t.peek()
    if string.kind != "STRING" or t.found.kind not in ("NAME", "STRING") or string.end != t.found.start:
        return None
    quote, other = string.text[0], '"' if string.text[0] == "'" else "'"
    return t.explain("P001", f"the string {t.cut_text(string.start, string.end)} ends at its second {quote}",
                   f"a quote inside a string is written \\{quote}, or the string stands in {other}")  # fmt: skip


# --- spellings of SQL, and of other languages, that SelectScript writes differently: each error shows the right form
_JOIN = "name both columns: FROM a JOIN b ON a.x == b.x, or FROM a LEFT JOIN b ON a.x == b.x"
_FUNCTION = "functions are written in Python, and session.function(f) registers them"
_LIKE = "write {x} LIKE ..., where % is any text, _ any character, and case counts; or register a Python function"
_IF = "write IF(condition; then; else)"

# Set operations of two queries; ALL keeps equal rows.
_SETS = {
    "UNION": "uniq({0} + {1})", "UNION ALL": "{0} + {1}", "EXCEPT": "uniq(difference({0}, {1}))",
    "MINUS": "uniq(difference({0}, {1}))", "INTERSECT": "uniq(SELECT this FROM {0} WHERE this IN {1} AS list)",
}  # fmt: skip
# Words after a complete expression {x}, and what to write instead.
_POSTFIX_HINTS = {
    "ISNULL": "write {x} IS NULL", "NOTNULL": "write {x} IS NOT NULL", "GLOB": _LIKE, "REGEXP": _LIKE,
    "ILIKE": "write lower({x}) LIKE lower({y})", "MATCH": _LIKE, "INNER": "write JOIN without INNER",
    "RIGHT": _JOIN, "FULL": _JOIN, "OUTER": _JOIN,
    "CROSS": "write a comma: FROM a, b", "NATURAL": _JOIN, "USING": _JOIN,
    "ON": "write JOIN in place of the comma in front of {x}",
    "OFFSET": "write LIMIT n OFFSET {y}", "FETCH": "write LIMIT n",
    "COLLATE": "sort by the value of a function that you register",
    "OVER": "use GROUP BY, or a query in the column, for instance sum(SELECT ... AS list)",
    "WHEN": _IF, "THEN": _IF, "ELSE": _IF,
    "TOP": "write LIMIT n after the other clauses", "CONTAINS": "write {y} IN {x}",
    "STARTS": "write starts({x}, ...)", "ENDS": "write ends({x}, ...)",
    "NULLS": "leave it out: None comes first, with DESC last",
    "INTO": "assign the query: name = SELECT ...",
    "CYCLE": "write NO CYCLE BY {y}, right after CONNECT BY", "UNTIL": "a search ends with STOP WITH condition",
    "FOR": "leave it out: a script only reads",
    "ESCAPE": "find(text, part) looks for a part as it stands; or register a Python function",
    "FILTER": "an aggregate skips None: write max(IF(condition; x; None))",
    "ASCENDING": "write ASC", "MOD": "write {x} % {y}", "DIV": "write int({x} / {y})",
    **{word: f"write {form.format('(SELECT ... AS list)', '(SELECT ... AS list)')}" for word, form in _SETS.items()},
}  # fmt: skip
# Words that were read as a name before something that does not fit, here {x}, and what to write.
_PREFIX_HINTS = {
    "CONNECT_BY_ROOT": "write root({x})", "ALL": "leave it out: a query gives all rows",
    "TOP": "write LIMIT n after the other clauses", "CASE": "write CASE WHEN {x} == ... THEN ... ELSE ... END",
    "PRIOR": "write prior(x): PRIOR stands in front of a name", "LAMBDA": _FUNCTION,
    "EXISTS": "write [] != (SELECT ... AS list)", "EXPLAIN": "call explain() on the compiled script",
}  # fmt: skip
# The same at the beginning of a statement, before a value.
_FIRST_HINTS = {
    "FOR": "a loop is a query: SELECT ... FROM {x} = list",
    "WHILE": "a loop that goes on is a search: START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 9",
    "RETURN": "the value of a script is that of its last statement: write {x} alone",
    "DEL": "variables stay; clear() forgets all of them",
    **dict.fromkeys(("DEF", "FUNCTION", "CLASS", "IMPORT"), _FUNCTION),
    **dict.fromkeys(("LET", "VAR", "CONST", "SET", "DECLARE"), "an assignment has no word in front: {x} = ..."),
}
_TESTED = frozenset(("WHERE", "HAVING", "STOP WITH", "IF(", "ON", "WHEN"))  # where a condition stands
_WRITING = frozenset((
    "INSERT", "UPDATE", "DELETE", "CREATE", "DROP", "ALTER", "REPLACE", "ATTACH", "DETACH", "PRAGMA", "BEGIN", "COMMIT",
    "ROLLBACK", "VACUUM", "MERGE", "TRUNCATE", "GRANT", "REVOKE", "REINDEX", "SAVEPOINT",
))  # fmt: skip
_SIGNS = {
    "**": "the power is ^", "//": "division is /, whole division floor(a / b), and a comment starts with #",
    "++": "write {x} = {x} + 1",
    "+=": "write {x} = {x} + ...", "-=": "write {x} = {x} - ...", "*=": "write {x} = {x} * ...",
    "/=": "write {x} = {x} / ...", ":=": "write {x} = ...", "=>": "write >= to compare", "=<": "write <= to compare",
    "===": "write == to compare", "->": 'write {x}.column, or {x}["key"]',
    ">>": "write int({x} / 2 ^ n)", "<<": "write {x} * 2 ^ n",
    "::": "write int({x}), float({x}) or str({x})",
}  # fmt: skip


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
            name = t.peek(2) if second is t.found else t.peek()
            both = Token(sign, sign, first.start, second.end)
            hint = _SIGNS[sign].format(x=name.text if name.kind == "NAME" else "x")
            if second is t.found and second.kind == "=" and t.clause in ("SELECT", *_TESTED):  # nothing is assigned
                hint = f"write {t.step_back().read_operand()} {first.kind} {_read_value_after(t)}"
            return t.explain("P006", f"there is no operator {sign}", hint, at=both)
    return None


def _explain_concatenation(t: ParseFailure) -> ParseError | None:
    if t.found.text != "||":
        return None
    joined, either = f"write {t.read_operand()} + {_read_value_after(t)} to join strings", "the logical or is OR"
    compared = _stands_beside_comparison(t, -1) + _stands_beside_comparison(t, 1)
    hints = [either] if compared == 2 else [either, joined] if not compared and t.clause in _TESTED else [joined]
    return t.explain("P006", "there is no operator ||", *hints)


def _stands_beside_comparison(t: ParseFailure, step: int) -> bool:
    """Whether a comparison stands before the sign that does not fit (`step` is -1) or after it (1), up to AND or OR."""
    token = t.tokens[t.find_outside(t.index + step, step, AROUND | COMPARISONS | {"OTHER"})]
    return (token.keyword or token.kind) in COMPARISONS


def _explain_is(t: ParseFailure) -> ParseError | None:
    """`age IS 36`, `age IS NOT 36`, `age NOT NULL`."""
    if t.peek().kind == "NOT" and t.found.text.upper() in ("NULL", "NONE") and "IN" in t.expected:
        return t.explain("P006", "NOT NULL does not fit here", f"write {t.step_back().read_operand()} IS NOT NULL")
    negated = t.peek().kind == "NOT" and t.peek(2).kind == "IS"
    if (t.peek().kind != "IS" and not negated) or t.found.kind not in (*VALUES, *OPENING, "-"):
        return None
    ahead = t.step_back().step_back() if negated else t.step_back()
    left = ahead.read_side() if t.clause in _TESTED else ahead.read_operand()
    right = t.step_back().read_next_side()
    if t.found.text.upper() == "DISTINCT" and t.next.kind == "FROM":
        negated, right = not negated, "..."
    hint = f"write {left} {'!=' if negated else '=='} {right}"
    return t.explain("P006", "IS asks for None alone", hint, at=ahead.found)


def _explain_cast(t: ParseFailure) -> ParseError | None:
    """`CAST(age AS TEXT)`, `EXTRACT(YEAR FROM born)`."""
    if t.clause != "f(" or t.bracket is None:
        return None
    value = t.cut_text(t.bracket.end, t.peek().end)
    if t.found.kind == "FROM" and value.strip().upper() in ("YEAR", "MONTH", "DAY", "HOUR", "MINUTE", "SECOND"):
        kind = "date" if value.strip().upper() in ("YEAR", "MONTH", "DAY") else "datetime"
        cure = f"write {value.strip().lower()}({kind}({t.read_next_side()}))"
        return t.explain("P006", "FROM stands in a query alone", cure)
    if t.found.kind == "," and value.split()[:1] == ["DISTINCT"]:
        columns = f"[{value.strip()[8:].strip()}, {tokenizer.shorten_text(t.read_until(t.index + 1))}]"
        return t.explain("P006", "DISTINCT counts one value of a row", f"write count(DISTINCT {columns})")
    if t.found.kind != "AS":
        return None
    return t.explain("P006", "AS stands in SELECT alone", f"write int({value}), float({value}) or str({value})")


def _explain_set_operation(t: ParseFailure) -> ParseError | None:
    """`SELECT ... UNION SELECT ...`, and other set operations."""
    word = t.found.text.upper()
    every = word == "UNION" and t.next.text.upper() == "ALL"
    if word not in _SETS or t.tokens[min(t.index + 1 + every, len(t.tokens) - 1)].kind != "SELECT":
        return None
    words, texts, tail = _split_set_operations(t)
    columns = [re.split(r"\bFROM\b", text, maxsplit=1, flags=re.IGNORECASE)[0].split() for text in texts]
    # Rows of dicts are equal by their names, too, and those of `*` are not seen here.
    named = "*" not in columns[0] and all(one == columns[0] for one in columns)
    form = "dict" if named else "rows" if any({"*"} & set(one) or "," in "".join(one) for one in columns) else "list"
    parts = [tokenizer.shorten_query(" ".join(text.split())) for text in texts]
    shapes = [re.search(r"\bFROM\b.*( AS \w+)\Z", part, re.IGNORECASE) for part in parts]
    form = next((shape[1] for shape in shapes if shape), f" AS {form}")
    lists = [f"({part}{'' if shape else form})" for part, shape in zip(parts, shapes, strict=True)]
    cure = lists[0]
    for operation, other in zip(words, lists[1:], strict=True):
        cure = _SETS[operation].format(cure, other)
    if tail:
        cure = f"SELECT * FROM ({cure}) {tail if named or tail.startswith('LIMIT') else 'ORDER BY ...'}"
    return t.explain("P006", f"there is no {word} in SelectScript", f"write {cure}")


def _split_set_operations(t: ParseFailure) -> tuple[list[str], list[str], str]:
    """The operations of `SELECT ... UNION SELECT ...` from the first query on, these queries, and their ORDER BY."""
    words: list[str] = []
    texts: list[str] = []
    begin = max(t.find_outside(t.index - 1, -1, ("SELECT",)), 0)
    tail = t.find_outside(t.index, 1, ("ORDER", "LIMIT", ";"))
    index = t.find_outside(begin, 1, ("NAME",))
    while index < tail:
        word, every = t.tokens[index].text.upper(), t.tokens[index + 1].text.upper() == "ALL"
        if word in _SETS and t.tokens[index + 1 + every].kind == "SELECT":
            words.append(f"{word} ALL" if every else word)
            texts.append(t.source.text[t.tokens[begin].start : t.tokens[index - 1].end])
            begin = index + 1 + every
        index = t.find_outside(index + 1, 1, ("NAME",))
    texts.append(t.source.text[t.tokens[begin].start : t.tokens[tail].start].strip())
    return words, texts, " ".join(t.read_until(tail).split())


def _explain_option(t: ParseFailure) -> ParseError | None:
    """Options of CONNECT BY by other names, or followed by a `=`."""
    if t.clause != "CONNECT BY":
        return None
    begin = max((i for i in range(t.index) if t.tokens[i].kind == "CONNECT"), default=t.index) + 2
    for index in range(begin, t.index + 1):
        token, following = t.tokens[index], t.tokens[min(index + 1, len(t.tokens) - 1)]
        word, value = token.text.upper(), t.cut_text(following.end, t.peek().end).strip()
        if word in OPTIONS and following.kind == "=" and index + 1 < t.index and t.found.kind == "NAME":
            return t.explain("P006", f"{word} is an option, and takes no =", f"write {word} {value}", at=token)
        starts = index == begin and (word != "A" or following.kind == "*")
        if starts and word in OTHER_OPTIONS and following.kind in ("*", *VALUES):
            counts = OTHER_OPTIONS[word] == "MAXIMUM" and following.kind == "INTEGER"
            option = OTHER_OPTIONS[word] + (f" {following.text}" if counts else "")
            if word == "GREEDY" and t.tokens[index + 2].kind != "=":
                option = f"HEURISTIC {following.text}"
            prior = next((i for i in range(index, len(t.tokens)) if t.tokens[i].text.upper() == "PRIOR"), None)
            if word == "NOCYCLE" and prior is not None:
                option += f" BY {t.tokens[prior + 1].text},"
            return t.explain("P006", f"there is no option {token.text}{'*' if word == 'A' else ''}",
                           f"write {option}", at=token)  # fmt: skip
    return None


def _explain_each(t: ParseFailure) -> ParseError | None:
    """`START WITH EACH town = list`."""
    if t.found.kind != "=" or t.expected != {"IN"}:
        return None
    values = tokenizer.shorten_text(t.read_until(t.index + 1, ("CONNECT", ";")))
    return t.explain("P006", "EACH goes through a list", f"write EACH {t.peek().text} IN {values}")


def _explain_unpacking(t: ParseFailure) -> ParseError | None:
    """`a, b = [1, 2]`."""
    if t.found.kind != "," or t.clause or t.peek().kind != "NAME" or t.peek(2).kind not in (";", END):
        return None
    index, names = t.index, [t.peek().text]
    while t.tokens[index].kind == "," and t.tokens[index + 1].kind == "NAME":
        names.append(t.tokens[index + 1].text)
        index += 2
    if t.tokens[index].kind != "=":
        return None
    parts = "; ".join(f"{name} = both[{number}]" for number, name in enumerate(names))
    value = tokenizer.shorten_text(t.read_until(index + 1))
    return t.explain("P006", "one name is assigned at a time", f"write both = {value}; {parts}")


def _explain_assignment(t: ParseFailure) -> ParseError | None:
    """`=` where nothing can be assigned: in a condition, in a column, after something that is not a name."""
    if t.found.kind != "=" or "+" not in t.expected:
        return None
    tested = t.clause in _TESTED
    left, right = t.read_side() if tested else t.read_operand(), t.read_next_side()
    compare = f"write {left} == {right} to compare"
    if t.next.text in ("?", ":", "@"):  # a parameter
        name = t.tokens[t.index + 2].text if t.next.text != "?" else "wanted"
        compare = f"write {left} == {name}, and give {name} a value: run(script, {name}=...)"
    if (quantified := re.fullmatch(r"(ANY|SOME|ALL) ?\((SELECT\b.*)\)", right, re.IGNORECASE)) is not None:
        word, query = quantified.groups()
        every = f"write difference({query} AS list, [{left}]) == []"
        compare = every if word.upper() == "ALL" else f"write {left} IN ({query})"
    if tested:
        return t.explain("P006", f"= assigns, but {t.clause.rstrip('(')} needs a condition", compare)
    if t.clause == "SELECT":
        return t.explain("P006", "a column is not assigned", f"write {right} AS {left} to name a column", compare)
    ahead = t.values[-2] if len(t.values) > 1 else None
    if isinstance(ahead, Token) and ahead.kind == "PRIOR":
        return t.explain(
            "P006", "= assigns, but PRIOR stands in a condition", f"write PRIOR {left} == {right} to compare"
        )
    if t.clause in OPTIONS:
        return t.explain(
            "P001", f"{t.clause} needs a value in front of the assignments", f"write {t.clause} 1 {left} = ..."
        )
    if t.clause in ("START WITH", "CONNECT BY") and t.peek(2).kind == "AND":
        begin = max(i for i in range(t.index) if t.tokens[i].kind in ("START", "CONNECT"))
        ahead_of_it = t.source.text[t.tokens[begin].start : t.peek(2).start].strip()
        return t.explain("P006", f"the assignments of {t.clause} are separated by commas",
                       f"write {ahead_of_it}, {left} = {right}", at=t.peek(2))  # fmt: skip
    return t.explain("P001", f"only a name can be assigned here, not {left}", compare)


def _read_value_after(t: ParseFailure) -> str:
    """The literal, name or column after the token that does not fit; `...` for anything longer."""
    last = t.index + 1
    while t.tokens[last].kind in VALUES and [token.kind for token in t.tokens[last + 1 : last + 3]] == [".", "NAME"]:
        last += 2
    if t.next.kind not in VALUES or t.tokens[last + 1].kind in ("(", "[", "{", "."):
        return "..."
    text = t.cut_text(t.next.start, t.tokens[last].end)
    return "None" if text.upper() == "NULL" else text


def _explain_missing_as(t: ParseFailure) -> ParseError | None:
    """`SELECT expr name FROM ...`."""
    if t.clause != "SELECT" or "FROM" not in t.expected or "," not in t.expected:
        return None
    if t.found.kind == "NAME" and not t.found.keyword and t.next.kind in (",", "FROM"):
        distinct_on = re.match(r"DISTINCT\s+ON\s*\((.*)\)\Z", t.read_column(), re.IGNORECASE | re.DOTALL)
        if distinct_on:
            cure = f"write GROUP BY {distinct_on[1]}, and first(x) for other columns"
            return t.explain("P006", "there is no DISTINCT ON in SelectScript", cure)
        return t.explain("P006", f"expected ',' or FROM between {spell(t.peek())} and {spell(t.found)}",
                       f"write {t.read_column()} AS {t.found.text} to name a column")  # fmt: skip
    return None


def _explain_column_name(t: ParseFailure) -> ParseError | None:
    """`SELECT expr AS 'a name' FROM ...`, with brackets around the name, too."""
    if t.peek().kind != "AS" or t.step_back().clause != "SELECT" or t.found.kind not in ("STRING", "["):
        return None
    column, text = t.step_back().read_column(), t.found.text
    if t.found.kind == "[":
        closing = next((token for token in t.tokens[t.index :] if token.kind == "]"), t.next)
        text = repr(t.cut_text(t.found.end, closing.start))
    name = text.strip("'\"")
    form = f"{column} AS {name}" if name.isidentifier() else f"to({column}, {text})"
    return t.explain("P001", f"expected a name after AS, found {spell(t.found)}", f"write {form}")


def _explain_after_as(t: ParseFailure) -> ParseError | None:
    """What follows a query that AS has ended: a clause, another source, an index."""
    ahead = t.values[-2] if len(t.values) > 1 else None
    if not isinstance(ahead, Token) or ahead.kind != "AS" or t.found.text.upper() in _POSTFIX_HINTS:
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


def _explain_modifier(t: ParseFailure) -> ParseError | None:
    """Words in front of a statement or an expression: `INSERT INTO t`, `let x = 5`, `lambda x: x`, `CASE a WHEN 1`."""
    word, upper = t.peek(), t.peek().text.upper()
    first = t.peek(2).kind == ";" and not t.bracket
    if word.kind != "NAME" or t.values[-1:] != [word]:
        return None
    if first and upper in _WRITING:
        return t.explain("P006", f"a script only reads, there is no {upper}",
                       "change data from Python or with SQLite itself", at=word)  # fmt: skip
    if first and upper == "WITH":
        return t.explain("P006", "there is no WITH in front of a query", *_explain_with(t), at=word)
    before_value = t.found.kind in (*VALUES, *OPENING, "-")
    hint = _PREFIX_HINTS.get(upper) or (_FIRST_HINTS.get(upper) if first and before_value else None)
    if hint is None:
        return None
    hint = hint.format(x=t.cut_text(t.found.start, t.found.end))
    if upper == "CASE" and t.next.keyword == "WHEN":
        value = t.tokens[t.index + 2]
        hint = f"write CASE WHEN {t.found.text} == {t.cut_text(value.start, value.end)}"
    return t.explain("P006", _tell_that_missing(word.text), hint, at=word)


def _explain_with(t: ParseFailure) -> tuple[str, ...]:
    """`WITH t AS (SELECT ...) SELECT ...` as two statements."""
    if t.next.kind == "AS" and t.tokens[t.index + 2].kind == "(":
        closing = t.find_outside(t.index + 3)
        inner = t.source.text[t.tokens[t.index + 2].start : t.tokens[closing].end]
        rest = t.read_until(closing + 1) if t.tokens[closing].kind != END else ""
        if rest and rest[0] != "," and len(inner) + len(rest) <= 120:
            return (f"write {t.found.text} = {' '.join(inner.split())}; {' '.join(rest.split())}",)
    return ("assign the inner query to a variable first",
            "a recursive query is written SELECT ... START WITH ... CONNECT BY ...")  # fmt: skip


def _explain_word(t: ParseFailure) -> ParseError | None:
    """Words after an expression: operators, joins, set operations."""
    upper = t.found.text.upper()
    if (
        t.found.kind not in ("NAME", upper)
        or upper not in _POSTFIX_HINTS
        or t.peek().text.upper() == "NO"
        or t.wants_operand
        or t.expected == {"="}
    ):
        return None
    spelling, hint, x, y = upper, _POSTFIX_HINTS[upper], t.read_operand(), _read_value_after(t)
    if t.peek().kind == "NOT":
        spelling, x, hint = f"NOT {upper}", t.step_back().read_operand(), hint.replace(" LIKE ", " NOT LIKE ")
    return t.explain("P006", _tell_that_missing(spelling), hint.format(x=x, y=y))


_SOURCE = r"((?:\w+ ?= ?)?(?:\w+\.)?\w+)"
_JOINED = re.compile(
    rf"{_SOURCE} (NATURAL |RIGHT |FULL )?(LEFT )?(?:OUTER )?JOIN {_SOURCE}(?: ON (.*)| USING ?\((.*)\))?", re.IGNORECASE
)


def _explain_join(t: ParseFailure) -> ParseError | None:
    """`FROM a RIGHT JOIN b ON ...`, FULL, NATURAL and USING of two sources by their names."""
    word = t.found.text.upper()
    begin = t.find_outside(t.index - 1, -1, ("FROM",)) + 1
    found = _JOINED.fullmatch(" ".join(t.read_until(begin, ("WHERE", "GROUP", "ORDER", "LIMIT", "AS", ";")).split()))
    if word not in ("RIGHT", "FULL", "NATURAL", "USING") or found is None:
        return None
    left, kind, outer, right, condition, columns = found.groups(default="")
    a, b = (re.split(r" ?= ?", source)[0] if "=" in source else source.split(".")[-1] for source in (left, right))
    if columns or kind:
        names = re.split(r"\s*,\s*", columns.strip() or "x")
        condition = condition or " AND ".join(f"{a}.{name} == {b}.{name}" for name in names)
    left_join = f"FROM {right} LEFT JOIN {left} ON {condition}"
    cures = {
        "RIGHT": left_join,
        "FULL": f"(SELECT ... FROM {left} LEFT JOIN {right} ON {condition} AS dict) + "
                f"(SELECT ... {left_join} WHERE {a}.this == None AS dict)",
        "NATURAL": f"FROM {left} {outer.upper()}JOIN {right} ON {condition}, for each column x of both",
        "USING": f"FROM {left} {outer.upper()}JOIN {right} ON {condition}",
    }  # fmt: skip
    return t.explain("P006", _tell_that_missing(word), f"write {cures[word]}")


def _tell_that_missing(word: str) -> str:
    fits = word.upper() in CONTEXTUAL
    return f"{word.upper()} does not fit here" if fits else f"there is no {word} in SelectScript"


# Aggregates of SQL, as functions of a list.
_AGGREGATES = {"SUM": "sum", "AVG": "average", "MIN": "min", "MAX": "max", "COUNT": "count"}


def _explain_window(t: ParseFailure) -> ParseError | None:
    """`sum(km) OVER (PARTITION BY town ORDER BY day)` over all rows of one source: the query in its place."""
    closing = t.find_outside(t.index + 2) if t.next.kind == "(" else t.index
    if t.found.text.upper() != "OVER" or t.tokens[closing].kind != ")":
        return None
    window = t.source.text[t.next.end : t.tokens[closing].start].strip()
    keys = re.fullmatch(r"(?:PARTITION BY (\w+))?\s*(?:ORDER BY (\w+)(?: ASC| (DESC))?)?", window, re.IGNORECASE)
    behind = t.read_until(t.find_outside(closing + 1, 1, ("FROM",)), ("ORDER", "LIMIT", "AS", ";"))
    source = re.fullmatch(r"FROM\s+(\w+)(?:\s*=\s*(\w+))?", behind, re.IGNORECASE)
    call = re.fullmatch(r"(\w+)\s*\((\*|\w*)\)", t.read_operand())
    if keys is None or source is None or call is None:
        return None
    aggregate, (outer, rows) = _AGGREGATES.get(call[1].upper()), (source[1], source[2] or source[1])
    sign = (">" if keys[3] else "<") + "=" * (aggregate is not None)
    other = "y" if outer == "x" else "x"
    conditions = [f"{other}.{call[2]} != None"] if aggregate and call[2] != "*" else []
    conditions += [f"{other}.{keys[1]} == {outer}.{keys[1]}"] if keys[1] else []
    conditions += [f"{other}.{keys[2]} {sign} {outer}.{keys[2]}"] if keys[2] else []
    where = f" WHERE {' AND '.join(conditions)}" if conditions else ""
    if aggregate is not None:
        value = "1" if call[2] == "*" else f"{other}.{call[2]}"
        cure = f"write {aggregate}(SELECT {value} FROM {other} = {rows}{where} AS list)"
    elif keys[2] and call[1].upper() in ("RANK", "ROW_NUMBER"):
        cure = f"write (SELECT count(*) FROM {other} = {rows}{where}) + 1 for a rank"
    else:
        return None
    return t.explain("P006", _tell_that_missing("OVER"), cure)


def _explain_filter(t: ParseFailure) -> ParseError | None:
    """`count(*) FILTER (WHERE a > 1)`."""
    call = re.fullmatch(r"(\w+)\s*\(\s*(DISTINCT\s+)?(.*)\)", t.read_operand(), re.IGNORECASE | re.DOTALL)
    where = t.tokens[min(t.index + 2, len(t.tokens) - 1)]
    if t.found.text.upper() != "FILTER" or where.keyword != "WHERE" or call is None:
        return None
    condition = t.source.text[where.end : t.tokens[t.find_outside(t.index + 2)].start].strip()
    name, distinct, value = _AGGREGATES.get(call[1].upper(), call[1]), call[2] or "", call[3].strip()
    cure = f"write {name}({distinct}IF({condition}; {'1' if value == '*' else value}; None))"
    grouped = t.tokens[t.find_outside(t.index, 1, ("GROUP",))].keyword == "GROUP"
    return t.explain("P006", _tell_that_missing("FILTER"), cure if grouped else f"{cure}, and GROUP BY 1")


def _explain_star(t: ParseFailure) -> ParseError | None:
    if t.found.kind == "*" and t.peek().kind == "." and t.peek(2).kind == "NAME":
        source = t.peek(2).text
        return t.explain("P006", f"there is no {source}.* in SelectScript",
                       f"write {source}.this for the element, SELECT * for all columns, or name them")  # fmt: skip
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
        if t.bracket is None and t.next.kind == "NAME" and t.tokens[t.index + 2].kind == "=":
            before = t.source.text[t.statement_start : t.found.start].strip()
            return t.explain("P001", "statements are separated by ;", f"write {before}; {t.next.text} = ...")
        if t.read_operand().upper().startswith("VALUES"):
            return t.explain("P006", "a list stands in square brackets", "write [[1, 'a'], [2, 'b']] for rows")
        ahead = [token for token in t.tokens[: t.index] if token.start < t.bracket.start] if t.bracket else []
        if ahead and ahead[-1].keyword in ("UNIQUE", "CYCLE"):
            option = "UNIQUE" if ahead[-1].keyword == "UNIQUE" else "NO CYCLE"
            return t.explain("P006", "keys stand behind BY", f"write {option} BY ({_spell_list(t)}),")
        return t.explain("P006", "a list stands in square brackets", f"write [{_spell_list(t)}]")
    if t.found.kind == "," and t.clause == "LIMIT":
        number = t.cut_text(t.next.start, t.next.end)
        return t.explain("P006", "LIMIT has one number", f"write LIMIT {number} OFFSET {t.read_operand()}")
    if t.found.kind == "{" and t.wants_operand:
        return t.explain("P001", "a dict cannot be written in a script", "give it to the session from Python")
    if t.found.kind == t.peek().kind == ":" and t.clause == "x[":
        each = "write (SELECT x[n] FROM n = range(0, len(x), step) AS list) for each step-th element"
        return t.explain("P006", "a slice has no step", "write reverse(x) to turn a list or a string", each)
    if t.found.kind == ":" and t.wants_operand and t.clause != "x[":
        return t.explain("P006", "a parameter has no sign", f"write {t.next.text or 'its name'} alone")
    return None


def _spell_list(t: ParseFailure) -> str:
    """The contents of parentheses that were meant as a list, if short."""
    closing = t.tokens[t.find_outside(t.index)]
    if t.clause == "(" and t.bracket is not None and closing.kind != END and closing.start - t.bracket.end <= 40:
        return t.source.text[t.bracket.end : closing.start].strip().rstrip(",")
    return f"{t.read_operand()}, ..."


# The errors for known spellings, None for anything else; the first that fits counts.
CHECKS: tuple[Callable[[ParseFailure], ParseError | None], ...] = (
    _explain_from_first, _explain_comprehension, _explain_item_assignment, _explain_inner_quote, _explain_comment,
    _explain_sign, _explain_concatenation, _explain_is, _explain_cast, _explain_set_operation, _explain_option,
    _explain_each, _explain_unpacking, _explain_assignment, _explain_modifier, _explain_missing_as,
    _explain_column_name, _explain_after_as, _explain_window, _explain_filter, _explain_join, _explain_word,
    _explain_star, _explain_dot, _explain_list,
)  # fmt: skip
