"""Messages for scripts that do not fit the grammar: the reason in words of the language, and the cure.

`explain_parse_failure` tries one explanation after the other: a missing second word of a keyword, a spelling of SQL, a
misspelt keyword, a bracket, a clause in the wrong place. The last one lists what could stand there.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from difflib import get_close_matches

from ss2sql.errors import ParseError, Span, join_words
from ss2sql.frontend.syntax import foreign_spellings, tokenizer
from ss2sql.frontend.syntax.parse_failure import CLAUSES, ParseFailure, spell
from ss2sql.frontend.syntax.tokenizer import CLOSING, END, OPENING, OPTIONS, PAIRS, VALUES, Token
from ss2sql.frontend.syntax.tree_builder import CHAIN_HINT, COMPARISONS, ORDER

# What a clause or a bracket expects, with an example.
_WANTED = {
    "SELECT": ("a column", "for instance SELECT this, mass FROM space"),
    "FROM": ("a source", "for instance FROM space, or FROM n = [1, 2, 3]"),
    "WHERE": ("a condition", "for instance WHERE mass > 50"),
    "START WITH": ("an assignment or a condition", "for instance START WITH level = 1, node = 'a'"),
    "CONNECT BY": ("an assignment or a condition", "for instance CONNECT BY NO CYCLE level = level + 1"),
    "STOP WITH": ("a condition", "for instance STOP WITH level == 7"),
    "GROUP BY": ("a value to group by", "for instance GROUP BY colour"),
    "HAVING": ("a condition", "for instance HAVING count(*) > 1"),
    "ORDER BY": ("a value to sort by", "for instance ORDER BY mass DESC"),
    "LIMIT": ("a number", "for instance LIMIT 10"),
    "AS": ("a representation such as list or value", "for instance AS list"),
    "MAXIMUM": ("a whole number or a value in parentheses", "for instance MAXIMUM 10, or MAXIMUM (n)"),
    "IF(": ("a condition", "write IF(condition; then; else)"),
    "f(": ("an argument", "an argument is a value, or name = value"),
    "x[": ("an index", "for instance x[0], x[1:3] or x['key']"),
}
_VALUE = ("a value", "a value is a name, a number, a string, a list, a call, a query or an operation on values")
# The likely meaning of a sign after something complete, in a clause or anywhere.
_BETWEEN = {
    ("WHERE", ","): "conditions are joined by AND or OR, and a list stands in square brackets",
    ("[", ":"): "a list of numbers in a row is range(from, to)",
    **dict.fromkeys(((option, ";") for option in OPTIONS), "a comma and a condition or assignment follow it"),
    ("IF(", ","): "IF has a condition and two branches, commas separate the values of a branch: IF(a; b, c; d)",
    ("", "{"): "there are no blocks: write IF(condition; then; else)",
}
_COMMA = "leave the comma out, or write what should follow it"


def explain_parse_failure(t: ParseFailure) -> ParseError:
    """The error for a token that does not fit."""
    if error := tokenizer.explain_unreadable(t.source, t.found):
        return error
    checks: tuple[Callable[[ParseFailure], ParseError | None], ...] = (
        _explain_missing_word, _explain_keyword_as_name, _explain_reserved_word, *foreign_spellings.CHECKS,
        _explain_misspelling, _explain_closing_bracket, _explain_search_clause, _explain_missing, _explain_chain,
        _explain_missing_end, _explain_clause, _explain_descending,
    )  # fmt: skip
    return next((error for check in checks if (error := check(t))), None) or _explain_surplus(t)


def _explain_missing_word(t: ParseFailure) -> ParseError | None:
    """`STOP level == 7`: the second word of a keyword is missing."""
    first = t.peek()
    if first.kind not in PAIRS:
        return None
    second = PAIRS[first.kind]
    return t.explain(_choose_error_code(t), f"expected {second} after {first.kind}, found {spell(t.found)}",
                   f"the keyword is {first.kind} {second}")  # fmt: skip


def _explain_keyword_as_name(t: ParseFailure) -> ParseError | None:
    """`FROM a, WHERE b`: the keyword was read as a name, because what should stand before it is missing."""
    word = t.peek()
    if word.kind != "NAME" or word.keyword not in CLAUSES or t.values[-1:] != [word]:
        return None
    if word.keyword == "LIMIT" and t.peek(2).kind == "BY":
        return None  # an option by another name
    meant = t.found.keyword == PAIRS[word.keyword] if word.keyword in PAIRS else t.found.kind in (*VALUES, *OPENING)
    if not meant:
        return None
    if t.peek(2).kind == ";" and not t.bracket:
        return t.explain(
            "P001", f"a query starts with SELECT, not with {spell(word)}", f"the order is {ORDER}", at=word
        )
    return _explain_missing(t.step_back())


def _explain_misspelling(t: ParseFailure) -> ParseError | None:
    """A word that is nearly a keyword that would fit in its place."""
    places: list[tuple[Token, frozenset[str]]] = []
    if t.found.kind == "NAME" and not t.wants_operand:
        places.append((t.found, t.expected))
    if t.peek().kind == "NAME" and t.values[-1:] == [t.peek()]:
        places.append((t.peek(), t.step_back().expected & {"SELECT", *OPTIONS}))
    for token, fitting in places:
        if close := _find_similar_keywords(token.text.upper(), fitting):
            hint = f"did you mean {join_words(close)}?"
            return t.explain("P001", f"'{tokenizer.shorten_text(token.text)}' is not a keyword", hint, at=token)
    return None


def _find_similar_keywords(word: str, fitting: frozenset[str]) -> list[str]:
    """The keywords in `fitting`, or their pairs, that are spelt nearly like `word`."""
    keywords = [kind for kind in sorted(fitting) if kind.isalpha() and kind not in VALUES]
    spelt = {keyword: keyword for keyword in keywords if len(keyword) > 2}
    for keyword in keywords:
        if keyword in PAIRS:
            spelt[keyword] = spelt[f"{keyword} {PAIRS[keyword]}"] = f"{keyword} {PAIRS[keyword]}"
    if word in keywords:
        return []
    if len(word) <= 3:  # too short for a distance: the same letters in another order, all but one of a short word's
        # letters, or the beginning of a long word
        mixed = [spelt[keyword] for keyword in spelt if sorted(keyword) == sorted(word)]
        lacking = [spelt[k] for k in spelt if len(word) == 3 and word in (k[:i] + k[i + 1 :] for i in range(len(k)))]
        begun = [spelt[k] for k in spelt if len(word) == 3 and len(k) > 6 and k.startswith(word)]
        return mixed or lacking or begun
    longer = [keyword for keyword in spelt if len(keyword) > 3 and word.startswith(keyword)]
    return list(dict.fromkeys(spelt[close] for close in longer + get_close_matches(word, spelt, n=2, cutoff=0.7)))


def _explain_closing_bracket(t: ParseFailure) -> ParseError | None:
    """A closing bracket that does not belong to the innermost open one."""
    closing = t.found.kind
    if closing not in CLOSING:
        return None
    if t.bracket is None:
        return t.explain("P001", f"'{closing}' closes nothing", f"leave it out, or open it with '{CLOSING[closing]}'")
    if t.bracket.kind == CLOSING[closing]:
        return None
    right = OPENING[t.bracket.kind]
    return _add_bracket_place(
        t, t.explain("P001", f"expected '{right}', found '{closing}'", f"'{t.bracket.kind}' needs '{right}'")
    )


def _explain_reserved_word(t: ParseFailure) -> ParseError | None:
    """A reserved word where a name is meant."""
    if t.peek().kind == "NOT" and t.found.kind in ("=", "==") and not t.step_back().wants_operand:
        left = t.step_back().read_operand()
        return t.explain("P001", f"NOT does not go with {t.found.text}", f"write {left} != ...", at=t.peek())
    word = t.peek() if t.found.kind == "=" and t.peek().kind in tokenizer.RESERVED else t.found
    if word.kind not in tokenizer.RESERVED or (word is t.found and "NAME" not in t.expected):
        return None
    if word.kind == "THIS" and word is not t.found and t.clause:  # `WHERE this = 1`
        return None
    if word is t.found and t.next.kind != "=" and t.peek().kind not in (".", "AS"):
        return None
    hint = f'write {t.step_back().read_operand()}["{word.text}"]' if t.peek().kind == "." else "choose another name"
    return t.explain("P001", f"{word.kind} is a reserved word, not a name", hint, at=word)


def _explain_missing(t: ParseFailure) -> ParseError | None:
    """Something is missing in front of the token: a value, a name, an assignment."""
    found, before = t.found, t.peek()
    clause = t.clause if before.kind in (",", "WITH", "BY", "(", "[") or before.kind == t.clause else ""
    if t.wants_operand:
        if before.kind in ("UNIQUE", "CYCLE", "FIRST", "MEMORIZE"):
            clause = "CONNECT BY"
        what, hint = _VALUE if before.kind == "," and clause == "IF(" else _WANTED.get(clause, _VALUE)
        if t.clause in OPTIONS and before.kind == "BY":
            what, hint = "a key", "for instance UNIQUE BY town, or UNIQUE BY (town, day)"
    elif "+" in t.expected or t.expected == {"="}:
        return None
    elif before.kind == "IF":
        what, hint = "'('", _WANTED["IF("][1]
    elif before.kind == "NOT":
        what, hint = "IN", "write a NOT IN b, or NOT in front of the whole condition"
    elif before.kind == ".":
        what, hint = "this or a column", "for instance n.this, or n.mass"
    elif "NAME" in t.expected or before.kind == "MAXIMUM":
        what, hint = _WANTED["CONNECT BY" if t.clause in OPTIONS and before.kind != "MAXIMUM" else t.clause]
    else:
        return None
    ahead = f"{t.peek(2).kind} {before.kind}" if before.kind in ("WITH", "BY", "FIRST") else spell(before)
    after = "" if before.kind == ";" and not t.bracket else f" after {ahead}"
    word = f"{spell(found)} {PAIRS[found.keyword]}" if found.keyword in PAIRS else spell(found)
    hint = _COMMA if before.kind == "," else hint
    error = t.explain(_choose_error_code(t), f"expected {what}{after}, found {word}", hint)
    return _add_bracket_place(t, error) if found.kind in (END, ";") else error


def _explain_search_clause(t: ParseFailure) -> ParseError | None:
    """In START WITH and CONNECT BY: assignments without =, options with commas, after assignments or other clauses."""
    name, word = t.peek(), t.found.keyword or t.found.kind
    late = name if t.peek(2).kind == "," and name.keyword in OPTIONS else t.found if word in OPTIONS else None
    behind = t.clause.replace(" ", "").isalpha() and t.clause not in OPTIONS and late is t.found and not t.wants_operand
    if late is not None and (behind or t.clause == "CONNECT BY"):
        where = "a condition or an assignment" if t.clause == "CONNECT BY" else t.clause
        return t.explain("P001", f"{spell(late)} stands after {where}",
                       "options stand right after CONNECT BY, several keys as BY (a, b)",
                       at=late)  # fmt: skip
    if t.clause in OPTIONS and t.found.kind in COMPARISONS and "," in t.expected:
        option, value = t.option, t.read_operand()
        return t.explain("P001", f"{option} takes a value, and {spell(t.found)} makes a condition of it",
                       f"a comma stands between {option} and the condition of CONNECT BY; a whole comparison is put "
                       f"into parentheses: {option} ({value} {t.found.text} ...)")  # fmt: skip
    begins = t.found.kind in (*VALUES, *OPENING, "NOT", "IF", "-", "SELECT")
    if t.clause in OPTIONS and begins and "," in t.expected and not t.wants_operand:
        cure = f"write {_read_option(t, t.index)}, and then the condition"
        return t.explain("P001", f"a comma stands between {t.option} and the condition of CONNECT BY", cure)
    if t.expected == {"="}:
        clause = "CONNECT BY" if t.clause in OPTIONS else t.clause
        hint = f"{clause} takes assignments such as level = 1"
        if name.keyword == "BY":
            hint = f"BY stands right after UNIQUE, NO CYCLE or MEMORIZE: UNIQUE BY {t.found.text}"
        elif t.peek(2).kind != "," and t.found.kind not in VALUES:
            hint = f"write {_read_option(t, t.index - 1)}, {name.text}"
        return t.explain(_choose_error_code(t), f"expected '=' after {spell(name)}, found {spell(t.found)}", hint)
    return None


def _read_option(t: ParseFailure, end: int) -> str:
    """The text of the option before the token at `end`."""
    first = max((i for i in range(end) if t.tokens[i].kind in OPTIONS), default=0)
    return t.source.text[t.tokens[first].start : t.tokens[end - 1].end]


def _explain_chain(t: ParseFailure) -> ParseError | None:
    if t.found.kind not in COMPARISONS or "AND" not in t.expected:
        return None
    return t.explain("P001", f"a comparison does not go on with {spell(t.found)}", CHAIN_HINT)


def _explain_missing_end(t: ParseFailure) -> ParseError | None:
    """What an open construct needs before it can end: FROM, END of CASE, ON of JOIN, a closing bracket."""
    closing = OPENING[t.bracket.kind] if t.bracket is not None else ""
    needed = next((word for word in ("END", "ON", "FROM", closing) if word in t.expected), None)
    ends = (*CLAUSES, ";", END, ")", "]", "JOIN", "LEFT", *("," * (needed in ("END", "ON"))))
    word, after = t.found.keyword or t.found.kind, t.next.keyword or t.next.kind
    source = needed == "FROM" and t.found.kind == "NAME" and after in ends
    if needed is None or (needed == "FROM" and t.clause != "SELECT") or not (word in ends or source):
        return None
    hints = {
        "END": ("write CASE WHEN ... END",),
        "ON": (_hint_at_source(t),),
        "FROM": ("a query has a source: SELECT ... FROM source", "a value alone needs no SELECT"),
    }.get(needed, (_BETWEEN["IF(", ","] if t.clause == "IF(" and word == ";" else f"write the missing '{closing}'",))
    if source:
        hints = (f"write FROM {t.cut_text(t.found.start, t.found.end)}",)
    shown = f"'{needed}'" if needed == closing else needed
    error = t.explain(_choose_error_code(t), f"expected {shown} before {spell(t.found)}", *hints)
    return _add_bracket_place(t, error) if needed == closing else error


def _explain_clause(t: ParseFailure) -> ParseError | None:
    """A clause where none can stand."""
    word = t.found.keyword or t.found.kind
    if word == "HAVING":
        hint = "write GROUP BY key HAVING condition, or use WHERE"
        if t.next.text == "leaf":  # which does not stand in WHERE
            hint = "write GROUP BY key in front of it"
        return t.explain("P001", "HAVING stands right after GROUP BY", hint)
    if word in ("WITH", "BY"):
        firsts = [f"{first} {word}" for first in CLAUSES if PAIRS.get(first) == word]
        return t.explain("P001", f"{word} does not fit here", f"the keywords are {join_words(firsts)}")
    if word in CLAUSES and word != "SELECT":
        whole = f"{word} {PAIRS[word]}" if word in PAIRS else word
        return t.explain(
            "P001",
            f"{whole} does not fit here",
            f"each clause stands once, its conditions joined by AND, and the order is {ORDER}",
        )
    return None


def _explain_descending(t: ParseFailure) -> ParseError | None:
    """`ORDER BY DESC x`."""
    word = t.peek()
    first = t.peek(2).kind in ("BY", ",")
    if t.clause != "ORDER BY" or not first or word.keyword not in ("ASC", "DESC") or t.found.kind not in VALUES:
        return None
    return t.explain("P001", f"{spell(word)} stands after the value", f"write {t.found.text} {spell(word)}", at=word)


def _explain_surplus(t: ParseFailure) -> ParseError:
    """Something follows a complete expression: what could stand between the two?"""
    fitting = []
    if "+" in t.expected and t.clause != "FROM":
        fitting.append("an operator")
    fitting += [f"'{sign}'" for sign in (",", ":", ")", "]", "}") if sign in t.expected]
    if t.clause == "SELECT":
        fitting.append("FROM")
    elif "AS" in t.expected:
        fitting.append("a clause")
    if ";" in t.expected:
        fitting.append("';'")
    message = f"expected {join_words(fitting or sorted(t.expected))} between {spell(t.peek())} and {spell(t.found)}"
    if t.clause == "FROM":
        return t.explain(_choose_error_code(t), message, _hint_at_source(t))
    if t.found.kind == "IF":
        return t.explain("P001", message, "IF stands in front: IF(condition; then; else)")
    starts = t.found.kind in VALUES or t.found.kind in tokenizer.RESERVED
    if starts and (not t.clause or (t.peek(2).kind == "AS" and ";" in t.expected)):
        call = ["a call has parentheses"] if t.peek().kind == "NAME" and not t.clause else []
        return t.explain("P001", message, f"write ; in front of {t.cut_text(t.found.start, t.found.end)}", *call)
    hint = _BETWEEN.get((t.clause, t.found.kind)) or _BETWEEN.get(("", t.found.kind))
    if hint is None and t.clause == "[":
        hint = "the elements of a list are separated by commas"
    if hint is None and starts and t.clause in ("START WITH", "CONNECT BY", *OPTIONS):
        option = _read_option(t, t.index) if t.peek().kind == ")" else ""
        keys = re.fullmatch(r"(UNIQUE|NO CYCLE) ?\(([^()]*)\)", " ".join(option.split()), re.IGNORECASE)
        hint = f"commas separate conditions and assignments: {t.read_operand()}, {t.found.text}"
        if keys is not None:
            by = keys[2] if keys[2].isidentifier() else f"({keys[2]})"
            hint = f"write {keys[1]} BY {by}, {t.found.text}"
    hint = hint or "write what should stand between them, or leave one of them out"
    return _add_bracket_place(t, t.explain(_choose_error_code(t), message, hint))


def _hint_at_source(t: ParseFailure) -> str:
    if t.found.kind == "SELECT" or (t.found.kind == "NAME" and t.next.kind == "="):
        return f"write ; in front of {t.found.text}"
    if "ON" in t.expected and (t.found.kind != "NAME" or t.found.keyword):
        return f"write ON condition after {t.read_operand()}; ON True gives all pairs"
    if t.found.kind == "NAME":
        return f"write {t.found.text} = {t.read_operand()} to name the source"
    return "a source that is more than a name, a call or a list stands in parentheses"


def _choose_error_code(t: ParseFailure) -> str:
    return "P002" if t.found.kind == END else "P001"


def _add_bracket_place(t: ParseFailure, error: ParseError) -> ParseError:
    if t.bracket is not None:
        error.related = ((Span(t.source, t.bracket.start, t.bracket.end), "opened here"),)
    return error
