"""Random expressions: templates by kind, whose holes are filled with what is in sight or with smaller expressions.

A kind says what an expression most probably gives; now and then a hole gets another kind on purpose, so that
programs fail with the errors of the language.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from .choices import Choices
from .library import LIBRARY

# What a value of one kind may also stand for. `maybe` is an integer or None, `any` everything but rows.
ALSO = {
    "int": ("int", "num", "maybe", "any"), "num": ("num", "any"), "bool": ("bool", "num", "any"),
    "str": ("str", "any"),
    "list": ("list", "any"),  # of integers
    "maybe": ("maybe", "any"), "any": ("any",), "row": ("row",), "pattern": ("pattern",),
}  # fmt: skip

LITERALS = {
    "int": ("1", "0", "2", "3", "-1", "4", "5"),
    "num": ("1", "0.5", "1.0", "2", "2.5", "-0.5", "1e3", ".25", "9007199254740993", "9007199254740992.0"),
    "bool": ("True", "False"),
    "str": ("'a'", "'b'", "''", "'ab'", "'ü'", "'1'"),
    "list": ("[1]", "[]", "[2, 1]", "[0, 1, 1]"),
    "maybe": ("None", "1", "2"),
    "any": ("None", "1", "1.0", "'a'", "True", "[1]", "[]", "[[1.0]]", "0", "'1'"),
    "row": ("'row'",),
    "pattern": ("'a%'", "'%b'", "'_'", "'%'", "''", "'a'", "'%b%'", "'_b%'"),
}

TEMPLATES = {
    "int": (
        (9, "({int} + {int})"), (5, "({int} - {int})"), (5, "({int} * {int})"), (4, "({int} % {int})"),
        (5, "IF({bool}; {int}; {int})"),
        (2, "CASE WHEN {bool} THEN {int} WHEN {bool} THEN {int} ELSE {int} END"),
        (2, "len({list})"), (2, "-{int}"), (2, "same({int})"), (2, "abs({int})"), (2, "(2 ^ ({int} % 5))"),
        (2, "{list}[{int}]"), (2, "int({num})"), (1, "picky({int})"), (1, "(9223372036854775807 + {int})"),
        (1, "add({int}, {int})"), (1, "weigh({any})"), (1, "weigh(body({int}))"), (1, "floor({num})"),
        (1, "ceil({num} / 2)"), (1, "clamp({int}, 0, 3)"), (1, "find({str}, {str})"), (1, "coalesce({maybe}, {int})"),
    ),
    "num": (
        (6, "{int}"), (5, "({num} / {int})"), (4, "half({num})"), (3, "({num} * {num})"), (3, "({num} + {num})"),
        (2, "round({num}, 1)"), (2, "sqrt(abs({num}))"), (1, "float({int})"), (1, "distance([{int}, 0], [{int}, 0])"),
        (1, "strange({int})"), (1, "({num} % {num})"), (1, "median([{num}, {int}])"), (1, "sin({num})"),
    ),
    "bool": (
        (8, "({int} < {int})"), (6, "({num} >= {num})"), (6, "({any} == {any})"), (4, "({any} != {any})"),
        (3, "({int} <> {int})"), (3, "({str} <= {str})"), (2, "({list} > {list})"), (4, "({any} IN {list})"),
        (2, "({int} NOT IN {list})"), (2, "({str} IN {str})"), (4, "(NOT {bool})"), (6, "({bool} AND {bool})"),
        (6, "({bool} OR {bool})"), (2, "({bool} XOR {bool})"), (4, "even({int})"), (3, "({maybe} == None)"),
        (2, "({maybe} IS NULL)"), (1, "({any} IS NOT NULL)"), (3, "({int} BETWEEN {int} AND {num})"),
        (1, "({any} NOT BETWEEN {int} AND {any})"), (2, "({str} LIKE {pattern})"), (1, "({str} NOT LIKE {pattern})"),
        (4, "IF({bool}; {bool}; {bool})"), (1, "IF({bool}; {bool})"), (1, "({int} IN {any})"), (2, "{int}"),
        (1, "{list}"), (1, "starts({str}, {str})"), (1, "any({list})"), (1, "all({list})"),
    ),
    "str": (
        (6, "({str} + {str})"), (3, "str({any})"), (2, "{str}[{int}]"), (2, "{str}[1:]"), (1, "lookup({int})"),
        (1, "IF({bool}; {str}; {str})"), (1, "upper({str})"), (1, "lower({str})"), (1, "strip({str})"),
        (1, "replace({str}, {str}, 'x')"), (1, "join({list}, {str})"), (1, "type({any})"),
    ),
    "list": (
        (6, "[{int}, {int}]"), (4, "({list} + {list})"), (3, "{list}[1:]"), (2, "{list}[:{int}]"), (3, "grow({list})"),
        (2, "flip({list})"), (2, "sorted({list})"), (2, "uniq({list})"), (2, "range({int} % 4)"), (1, "bag({int})"),
        (1, "reverse({list})"), (1, "flat([{list}, {int}])"), (1, "difference({list}, {list})"),
    ),
    "maybe": (
        (3, "{int}"), (1, "None"), (1, "nothing({any})"), (1, "IF({bool}; {int}; None)"),
        (1, "CASE WHEN {bool} THEN {int} END"), (1, "index({list}, {int})"), (1, "first({list})"),
    ),
    "any": (
        (8, "{int}"), (4, "{num}"), (4, "{str}"), (3, "{bool}"), (3, "{list}"), (3, "{maybe}"), (2, "[{any}]"),
        (2, "pair({any})"), (1, "array({int})"), (1, "same({any})"), (1, "zip({list}, {list})"), (1, "picky({any})"),
        (1, "strange({int})"), (1, "body({int})"), (1, "flip([{any}, {list}])"), (1, "len({row})"),
    ),
}  # fmt: skip

# Functions of a list that mean something else inside of a query with GROUP BY.
AGGREGATING = {
    "int": ((3, "sum({list})"), (2, "count({list})")),
    "num": ((2, "(1 * sum([{num}, {num}]))"),),
    "maybe": ((2, "max({list})"), (2, "min({list})"), (1, "average({list})")),
}

# Texts that are read when they run, and volatile functions: not with GROUP BY, where an equal text is the same key.
READ_LATE = {
    "int": ((2, 'eval("{int}")'), (2, 'eval("{int} + 1")'), (5, "tick()"), (4, "blink({int})")),
    "any": ((4, 'eval("{any}")'), (2, "[box({int}), 1]"), (3, "tick()"), (3, "body({int})"), (2, "picky({any})")),
    "bool": ((2, 'eval("{int} < {int}")'), (2, "({any} == box({int}))"), (1, "(box({int}) IN [box({int}), 1])")),
}

Parts = tuple[str, ...]  # texts and kinds in turn, a text first and last


def split(templates: Iterable[tuple[int, str]]) -> tuple[tuple[int, Parts], ...]:
    return tuple((weight, tuple(re.split(r"\{(\w+)\}", text))) for weight, text in templates)


PLAIN = {kind: split(templates) for kind, templates in TEMPLATES.items()}
WITH_LISTS = {kind: PLAIN[kind] + split(AGGREGATING.get(kind, ())) for kind in PLAIN}
EVERYTHING = {kind: WITH_LISTS[kind] + split(READ_LATE.get(kind, ())) for kind in PLAIN}
CALLED = re.compile(r"([a-z]+)\(")

LITERAL = re.compile(r"""-?[\d.]+(?:e\d+)?|'[^']*'|"[^"]*"|True|False|None""")


def key_of(expression: str) -> str:
    """The expression as a key of ORDER BY, which refuses literals: such a one becomes an element of a list."""
    return f"[{expression}]" if LITERAL.fullmatch(expression) else expression


@dataclass
class Sight:
    """The texts of what can be read in a place, by kind."""

    texts: dict[str, list[str]] = field(default_factory=lambda: {kind: [] for kind in ALSO})

    def add(self, text: str, kind: str) -> None:
        for also in ALSO[kind]:
            self.texts[also].append(text)

    def inner(self, hidden: Iterable[str], columns: Iterable[str]) -> Sight:
        """What a nested query still sees: not the outer `this`, nothing that its own names hide."""
        gone = ("this", *(f"{name}." for name in hidden))
        bare = set(columns)
        return Sight(
            {
                kind: [text for text in texts if not text.startswith(gone) and text not in bare]
                for kind, texts in self.texts.items()
            }
        )


class Expressions:
    """Writes expressions and notes the functions that they call."""

    def __init__(self, choices: Choices) -> None:
        self.choices = choices
        self.uses: dict[str, None] = {}
        self.templates = EVERYTHING

    def call(self, text: str) -> str:
        """The text, after noting its functions."""
        for name in CALLED.findall(text):
            if name in LIBRARY and name != "add":
                self.uses[name] = None
        return text

    def expr(self, kind: str, sight: Sight, depth: int) -> str:
        """An expression of about this kind, at most `depth` templates deep."""
        if depth <= 0 or self.choices.chance(20):
            return self.leaf(kind, sight)
        parts = self.template(kind, sight)
        if parts[0].startswith("eval("):
            depth = 0  # strings within strings would need escapes
        written = [self.call(parts[0])]
        for hole, text in zip(parts[1::2], parts[2::2], strict=True):
            written.append(self.expr(self.hole(hole), sight, depth - 1))
            written.append(self.call(text))
        return "".join(written)

    def template(self, kind: str, sight: Sight) -> Parts:
        """A template; preferably one that can read something in sight."""
        if kind not in self.templates:
            return ("", kind, "")
        parts: Parts = ()
        for _ in range(3):
            parts = self.choices.weighted(*self.templates[kind])
            if any(sight.texts[hole] for hole in parts[1::2]):
                break
        return parts

    def hole(self, kind: str) -> str:
        return "any" if self.choices.chance(2) else kind

    def leaf(self, kind: str, sight: Sight) -> str:
        """Something in sight, or a literal."""
        texts = sight.texts[kind]
        if texts and not self.choices.chance(18):
            return self.choices.pick(texts)
        return self.choices.pick(LITERALS[kind])
