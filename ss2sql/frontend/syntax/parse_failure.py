"""A parse failure: the token that does not fit, what stands before it, and what would fit."""

from __future__ import annotations

from collections.abc import Container
from functools import cached_property
from typing import Any

from ss2sql.errors import ParseError, Source, Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import tokenizer
from ss2sql.frontend.syntax.parser import Table
from ss2sql.frontend.syntax.tokenizer import CLOSING, END, OPENING, OPTIONS, PAIRS, VALUES, Token

ALONE = frozenset(("BY", "JOIN", "WHEN"))  # second words that also stand without the first
CLAUSES = ("SELECT", "FROM", "WHERE", "START", "CONNECT", "STOP", "GROUP", "HAVING", "ORDER", "LIMIT", "AS")

# What stands around the sides of a comparison.
AROUND = frozenset((
    "AND", "OR", "XOR", "NOT", "WHERE", "HAVING", "ON", "WHEN", "THEN", "ELSE", "END", "WITH", "BY", "GROUP", "ORDER",
    "LIMIT", "START", "CONNECT", "STOP", "AS", "SELECT", "FROM", "JOIN", "LEFT", "UNION", ",", ";", ":", "PRIOR",
))  # fmt: skip


@dataclass
class ParseFailure:
    """The parser's state in front of `tokens[index]`, which does not fit.

    `values` holds, in order, what belongs to constructs that are not complete: tokens as they were read, and what
    the builder has made of complete parts.
    """

    source: Source
    table: Table
    tokens: list[Token]
    index: int
    states: list[int]
    values: list[Any]

    @property
    def found(self) -> Token:
        """The token that does not fit."""
        return self.tokens[self.index]

    @property
    def next(self) -> Token:
        """The token after it; after the last one the last itself."""
        return self.tokens[min(self.index + 1, len(self.tokens) - 1)]

    def peek(self, distance: int = 1) -> Token:
        """The token `distance` places ahead of it; before the first one an empty `;`."""
        return self.tokens[self.index - distance] if self.index >= distance else Token(";", "", 0, 0)

    def step_back(self) -> ParseFailure:
        """The failure with the token before it, which was only read, as the one that does not fit."""
        return ParseFailure(self.source, self.table, self.tokens, self.index - 1, self.states[:-1], self.values[:-1])

    @cached_property
    def expected(self) -> frozenset[str]:
        """The kinds of token that would fit."""
        return frozenset(kind for kind in self.table.rows[self.states[-1]] if self._is_expected(kind))

    def _is_expected(self, kind: str) -> bool:
        """Whether the parser can take a token of this kind, once it has completed the rules that end here."""
        states = list(self.states)
        while (target := self.table.rows[states[-1]].get(kind)) is not None:
            if target >= 0:
                return not kind.islower() and not kind.startswith("_")  # others are rules, not tokens
            rule = self.table.rules[~target]
            del states[len(states) - rule.size :]
            states.append(self.table.rows[states[-1]][rule.origin])
            if states[-1] == self.table.end:
                return True
        return False

    @property
    def wants_operand(self) -> bool:
        """Whether an expression is missing here, rather than complete."""
        return "NAME" in self.expected and "INTEGER" in self.expected

    @cached_property
    def _open_positions(self) -> list[int]:
        """The positions in `values` of tokens outside of closed brackets, the last one first."""
        found: list[int] = []
        depth = 0
        for position in range(len(self.values) - 1, -1, -1):
            kind = self._get_kind(position)
            depth += kind in CLOSING
            if kind and not depth:
                found.append(position)
            depth -= kind in OPENING and depth > 0
        return found

    @property
    def statement_start(self) -> int:
        """The offset of the beginning of this statement, after the `;` before it; 0 in the first one."""
        for value in self.values:
            if isinstance(value, Token) and value.kind in (";", *OPENING):
                return value.end if value.kind == ";" else 0
        return 0

    @property
    def brackets(self) -> list[Token]:
        """The open brackets, the innermost one first."""
        return [self.values[position] for position in self._open_positions if self._get_kind(position) in OPENING]

    @property
    def bracket(self) -> Token | None:
        """The innermost open bracket."""
        return self.brackets[0] if self.brackets else None

    @cached_property
    def clause(self) -> str:
        """What is being read: a clause or option by its keyword, else the innermost bracket with its owner.

        `WHERE`, `START WITH`, `COST`, `ON`, `WHEN`; `IF(`, `f(` for a call, `(`, `[`, `x[` for an index, `v{`, or none.
        """
        for position in self._open_positions:
            kind = self._get_kind(position)
            if kind in ("ON", "WHEN"):
                return kind
            if kind in CLAUSES or kind in OPTIONS:
                return f"{kind} {PAIRS[kind]}" if kind in PAIRS and kind in CLAUSES else kind
            if kind in OPENING:
                owner = self._get_kind(position - 1)
                if kind == "[":
                    return "x[" if self._ends_operand(position - 1) else "["
                return {"IF": "IF(", "NAME": "v{" if kind == "{" else "f("}.get(owner, kind)
        return ""

    @property
    def option(self) -> str:
        """The words of the option that is being read: `COST`, `NO CYCLE BY`."""
        first = next(position for position in self._open_positions if self._get_kind(position) in OPTIONS)
        kinds = (self._get_kind(position) for position in range(first, len(self.values)))
        return " ".join(kind for kind in kinds if kind in (*OPTIONS, "CYCLE", "FIRST", "BY"))

    def _get_kind(self, position: int) -> str:
        value = self.values[position] if position >= 0 else None
        return value.kind if isinstance(value, Token) else ""

    def _ends_operand(self, position: int) -> bool:
        kind = self._get_kind(position)
        return position >= 0 and (not kind or kind in VALUES or kind in CLOSING)

    def find_outside(self, index: int, step: int = 1, kinds: Container[str] = ()) -> int:
        """The index of the next token of these kinds, from `index` on forwards, or backwards with a `step` of -1.

        It stands outside of brackets; a bracket around, the end and the beginning (-1) are the last to be looked at.
        """
        depth = 0
        while index >= 0:
            token = self.tokens[index]
            depth += ((token.kind in OPENING) - (token.kind in CLOSING)) * step
            if depth < 0 or token.kind == END or (not depth and (token.keyword or token.kind) in kinds):
                break
            index += step
        return index

    def read_operand(self) -> str:
        """The text of the name, call, literal or bracket that ends before the failure."""
        index = self.index - 1
        while index > 0:
            if self.tokens[index].kind in CLOSING:
                index = max(self.find_outside(index - 1, -1), 0)
            ahead = self.tokens[index - 1].kind
            if self.tokens[index].kind in OPENING and (ahead == "NAME" or ahead in CLOSING):
                index -= 1
            elif self.tokens[index].kind not in OPENING and ahead == ".":
                index -= 2
            else:
                break
        return self.cut_text(self.tokens[max(index, 0)].start, self.peek().end)

    def read_side(self) -> str:
        """The text of the side of a comparison that ends before the failure."""
        first = self.find_outside(self.index - 1, -1, AROUND) + 1
        return self.source.text[self.tokens[first].start : self.peek().end] if first < self.index else "..."

    def read_next_side(self) -> str:
        """The text of the side of a comparison or of a column that begins after the failure; `...` for a long one."""
        last = self.find_outside(self.index + 1, 1, AROUND) - 1
        text = " ".join(self.source.text[self.found.end : self.tokens[last].end].split())
        return "None" if text.upper() == "NULL" else text if 0 < len(text) <= 60 else "..."

    def read_until(self, index: int, kinds: Container[str] = (";",)) -> str:
        """The text from the token at `index` to the next one of these kinds."""
        end = self.tokens[self.find_outside(index, 1, kinds)].start
        return self.source.text[self.tokens[index].start : end].strip()

    def read_column(self) -> str:
        """The text of the column of SELECT that ends before the failure."""
        ahead = [v.end for v in self.values if isinstance(v, Token) and v.kind in ("SELECT", ",")]
        return self.cut_text(ahead[-1], self.peek().end)

    def explain(self, code: str, message: str, *hints: str, at: Token | None = None) -> ParseError:
        """The error with this message, at the token that does not fit or at another one."""
        token = at or self.found
        return ParseError(code, message, Span(self.source, token.start, token.end), hints)

    def cut_text(self, start: int, end: int) -> str:
        """A stretch of the script, cut to the length of a message."""
        return tokenizer.shorten_text(self.source.text[start:end])


def spell(token: Token) -> str:
    """A token as messages name it: keywords in capitals, everything else in quotes."""
    if token.kind == END:
        return "the end of the script"
    if token.kind in tokenizer.RESERVED or token.kind in tokenizer.CONTEXTUAL or token.keyword:
        return token.text.upper()
    return tokenizer.shorten_text(token.text) if token.kind == "STRING" else f"'{tokenizer.shorten_text(token.text)}'"
