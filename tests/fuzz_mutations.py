"""Changes of a script that keep it near the language: by tokens of the grammar, and by parts of other scripts.

Everything is decided by a `Random`, so that the same seed gives the same change. A text that does not parse is changed
by its tokens alone.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from random import Random
from typing import Any

from ss2sql.errors import Error, Source
from ss2sql.frontend.syntax import ast, tokenizer
from ss2sql.frontend.syntax.parser import parse

# Nodes that may stand where another one of their kind stands; whatever is missing here is an expression.
KINDS = {
    "From": "source", "Option": "option", "OrderKey": "key", "Representation": "representation", "Assign": "assign",
    "Script": "script", "Star": "star",
}  # fmt: skip
PHRASES = [
    "SELECT this FROM xs", "SELECT a.this, b.this FROM a = xs, b = [a.this, 1]", "WHERE this > 1", "STOP WITH p > 3",
    "START WITH p = 0", "CONNECT BY p = p + this", "CONNECT BY NO CYCLE MEMORIZE 3 p = this", "GROUP BY k HAVING v",
    "ORDER BY this DESC", "LIMIT 2", "AS list", "AS plane('XY', [x, y], s = 1)", "COST 1 HEURISTIC 0",
    "PROBABILITY 0.5", "MAXIMUM 2", "DEPTH FIRST", "BREADTH FIRST", "UNIQUE", "IF(n; 1; 2, 3)", "eval('this;')",
    "to(this, 'k')", "v{5} = 1", "v{}", "v{-1.0}", "count(*)", "sum(this)", "space.near(0, 0, 0)", "f(this)",
    "tick()", "edges", "(SELECT * FROM edges WHERE src == n)", "NOT IN", "x = y", "this.k", "[1][0, 0]", "'ab'[1:]",
]  # fmt: skip
WORDS = sorted(word.lower() for word in tokenizer.RESERVED | tokenizer.CONTEXTUAL)
SIGNS = [*"()[]{},;:.=<>+-*/%^", "==", "!=", "<>", "<=", ">="]
NAMES = [
    "xs", "n", "word", "rows", "columns", "towers", "edges", "space", "f", "g", "tick", "k", "v", "p", "src", "dst",
    "id", "x", "pos", "mass", "this", "a", "b", "level", "list", "value", "len", "max", "sum", "str", "range", "nobody",
    "é", "ſ", "add", "eval", "var", "help", "print", "sorted", "zip", "distance", "sqrt", "select_", "_", "__class__",
]  # fmt: skip
VALUES = [
    "0", "1", "2", "-1", "7", "0.5", "1.", ".5", "1e3", "1e308", "1e-320", "9223372036854775807", "9223372036854775808",
    "10 ^ 12", "2 ^ 62", "''", "'a'", '"b"', "'\\n'", "'\\ud83d'", "'{'", "True", "None", "[]", "[[1], 2]", "'1;'",
]  # fmt: skip
NESTING = [
    "({})", "[{}]", "NOT {}", "-{}", "f({})", "{}[0]", "(SELECT {} FROM xs)", "IF({}; 1; 2)", "{} + 1", "1 ^ {}",
    "({} AND n)", "({} OR this)", "({} XOR this)", "eval('{}')", "len([{}])", "(x = {})", "({} == 1)", "{} == 1 OR n",
    "g({}, this)", "sum([{}, 1])", "max([{}, this])", "({} IN [1, this])", "'a' + str({})", "[{}, 1][0]", "[this, {}]",
    "IF(this; {}; 3)", "{} / 2", "{} % 3", "round({}, 1)", "uniq([{}])", "print({})", "zip([{}], [1])", "(this * {})",
    "distance([{}, 0], [1, 1])", "{}[1:]", "a.this + {}", "({})[this]", "(SELECT {} FROM xs AS value)",
    "(SELECT this FROM [{}, 1] WHERE this > n AS list)", "(SELECT 1 FROM xs WHERE {} AS list)",
    "(SELECT 1 FROM xs GROUP BY {} AS list)",
    "(SELECT this FROM xs START WITH p = {} CONNECT BY NO CYCLE p = p + 1 AS list)", "(SELECT {} FROM space)",
    "[] == (SELECT this FROM [[n, {}]] WHERE this[0] == this[1] AS list)", "len(SELECT 1 FROM xs WHERE {} AS list)",
]  # fmt: skip
MOST_NESTING = (1, 1, 1, 2, 3, 5, 20, 60, 250)


class Donors:
    """Parts of scripts by kind, for other scripts to take."""

    def __init__(self, scripts: Iterable[str]) -> None:
        self.parts: dict[str, list[str]] = defaultdict(list)
        self.scripts = list(dict.fromkeys(scripts))
        for script in self.scripts:
            for kind, (start, end) in parts_of(script):
                self.parts[kind].append(script[start:end])
        self.parts = {kind: list(dict.fromkeys(texts)) for kind, texts in self.parts.items()}  # type: ignore[assignment]


def parts_of(script: str) -> list[tuple[str, tuple[int, int]]]:
    """The kind and place of every node of a script; none where it does not parse."""
    try:
        waiting: list[Any] = [parse(Source(script))]
    except Error:
        return []
    found = []
    while waiting:
        node = waiting.pop()
        if isinstance(node, tuple):
            waiting.extend(node)
        elif type(node).__module__ == ast.__name__:
            found.append((KINDS.get(type(node).__name__, "expression"), (node.span.start, node.span.end)))
            waiting.extend(getattr(node, name) for name in node.__dataclass_fields__)
    return found


class Mutator:
    """Changes scripts at random."""

    def __init__(self, donors: Donors) -> None:
        self.donors = donors
        self.by_tokens: list[Callable[[str, Random], str]] = [
            self.without_tokens, self.with_a_phrase, self.with_another_token, self.with_tokens_twice, self.swapped,
            self.with_a_piece_of_another, self.in_other_letters, self.two_scripts,
        ]  # fmt: skip
        self.by_parts = [self.with_a_part_of_another, self.with_a_part_twice, self.nested, self.with_an_own_part]

    def changed(self, script: str, dice: Random) -> str:
        """The script after one to four changes."""
        for _ in range(dice.choice((1, 1, 1, 2, 2, 3, 4))):
            change = dice.choice(self.by_parts if dice.random() < 0.6 else self.by_tokens)
            script = change(script, dice)
        return script

    # --- by the tree -----------------------------------------------------------------------------------

    def with_a_part_of_another(self, script: str, dice: Random) -> str:
        """One node is replaced by one of its kind from another script."""
        return self._replaced(script, dice, lambda kind, _: dice.choice(self.donors.parts.get(kind, [""])))

    def with_an_own_part(self, script: str, dice: Random) -> str:
        """One node is replaced by another one of the same script."""
        own = parts_of(script)
        return self._replaced(script, dice, lambda kind, _: _cut(script, dice.choice([p for k, p in own if k == kind])))

    def with_a_part_twice(self, script: str, dice: Random) -> str:
        """A source, column, key, option is written again behind a comma or a blank."""
        glue = dice.choice((", ", " ", "; ", " AND ", " + "))
        return self._replaced(script, dice, lambda _, written: written + glue + written)

    def nested(self, script: str, dice: Random) -> str:
        """A node within others, now and then very deep."""
        form, times = dice.choice(NESTING), dice.choice(MOST_NESTING)

        def deeper(_: str, written: str) -> str:
            for _level in range(times):
                if len(written) > 4000:
                    break
                written = form.replace("{}", written)
            return written

        return self._replaced(script, dice, deeper)

    def _replaced(self, script: str, dice: Random, other: Callable[[str, str], str]) -> str:
        parts = parts_of(script)
        if not parts:
            return self.with_another_token(script, dice)
        kind, (start, end) = dice.choice(parts)
        return script[:start] + other(kind, script[start:end]) + script[end:]

    # --- by tokens -------------------------------------------------------------------------------------

    def without_tokens(self, script: str, dice: Random) -> str:
        start, end = self._stretch(script, dice)
        return script[:start] + script[end:]

    def with_tokens_twice(self, script: str, dice: Random) -> str:
        start, end = self._stretch(script, dice)
        return script[:end] + " " + script[start:end] * dice.choice((1, 1, 1, 2, 30)) + script[end:]

    def with_a_phrase(self, script: str, dice: Random) -> str:
        _, end = self._stretch(script, dice)
        return f"{script[:end]} {self.anything(dice)} {script[end:]}"

    def with_another_token(self, script: str, dice: Random) -> str:
        start, end = self._stretch(script, dice, 1)
        return f"{script[:start]} {self.anything(dice)} {script[end:]}"

    def swapped(self, script: str, dice: Random) -> str:
        (a, b), (c, d) = sorted((self._stretch(script, dice, 2), self._stretch(script, dice, 2)))
        return script if b > c else script[:a] + script[c:d] + script[b:c] + script[a:b] + script[d:]

    def with_a_piece_of_another(self, script: str, dice: Random) -> str:
        other = dice.choice(self.donors.scripts)
        start, end = self._stretch(other, dice, 12)
        _, place = self._stretch(script, dice)
        return script[:place] + " " + other[start:end] + " " + script[place:]

    def in_other_letters(self, script: str, dice: Random) -> str:
        start, end = self._stretch(script, dice, 3)
        change = dice.choice((str.upper, str.lower, str.title, str.swapcase, lambda part: part.replace(" ", "\r\n")))
        return script[:start] + change(script[start:end]) + script[end:]

    def two_scripts(self, script: str, dice: Random) -> str:
        return script + dice.choice(("; ", "\n", ";\r\n", ", ")) + dice.choice(self.donors.scripts)

    @staticmethod
    def anything(dice: Random) -> str:
        return dice.choice(dice.choice((PHRASES, WORDS, SIGNS, NAMES, VALUES)))

    @staticmethod
    def _stretch(script: str, dice: Random, most: int = 4) -> tuple[int, int]:
        """The place of some tokens that stand side by side; the end of the script where there are none."""
        tokens = list(tokenizer.iterate_tokens(script))
        if not tokens:
            return len(script), len(script)
        first = dice.randrange(len(tokens))
        last = min(len(tokens) - 1, first + dice.randrange(most))
        return tokens[first].start, tokens[last].end


def _cut(script: str, place: tuple[int, int]) -> str:
    return script[place[0] : place[1]]
