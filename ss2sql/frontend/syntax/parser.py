"""The parser: runs the LALR table over the tokens of a script; the builder makes the tree.

It works without recursion. After an error it resumes after the next `;` outside brackets, so that one run reports the
errors of several statements.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ParseError, Source, Span, combine_errors
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import ast, tokenizer
from ss2sql.frontend.syntax.tokenizer import Token
from ss2sql.frontend.syntax.tree_builder import Builder

if TYPE_CHECKING:
    from ss2sql.frontend.syntax.parse_failure import ParseFailure

MAX_ERRORS = 10


def parse(source: Source) -> ast.Script:
    """The syntax tree of a script.

    Raises ParseError: with all errors found, at most ten, in its `errors`.
    """
    tokens = tokenizer.tokenize(source)
    if all(token.kind == ";" for token in tokens[:-1]):
        raise ParseError(
            "P008", "there is no statement in this script", Span(source, 0, 0),
            ["write an expression or a query, for instance SELECT this FROM [1, 2, 3] AS list;"],
        )  # fmt: skip
    builder = Builder(source)
    errors: list[ParseError] = []
    position = 0
    while position < len(tokens) and len(errors) < MAX_ERRORS:
        outcome = run_automaton(builder, tokens, position, len(tokens))
        if isinstance(outcome, ast.Script):
            errors += builder.list_errors()
            if not errors:
                return outcome
            break
        # Before the parser refuses a token it completes rules that only other tokens could follow. A second run
        # that halts in front of the token keeps what belongs to it apart.
        failure = run_automaton(Builder(source), tokens, position, outcome.index)
        assert not isinstance(failure, ast.Script)
        # The rest of a statement whose query does not end is misread: that is no second error.
        if not builder.has_unended_query(max(tokens[position].start, failure.statement_start)):
            from ss2sql.frontend.syntax import syntax_errors  # needed for errors alone

            errors.append(syntax_errors.explain_parse_failure(failure))
        position = find_resume_point(failure)
    else:
        errors += builder.list_errors()
    raise combine_errors(sorted(errors, key=lambda error: error.span.start if error.span else 0)[:MAX_ERRORS])


def run_automaton(builder: Builder, tokens: list[Token], position: int, halt: int) -> ast.Script | ParseFailure:
    """Parses `tokens[position:halt]`; gives the script, or the state before the first token that does not fit."""
    source, table = builder.script_source, load_parse_table()
    rows, end_state = table.rows, table.end
    rules = list(zip(table.rules, builder.list_actions(table), strict=True))
    states, values, starts = [table.start], list[Any](), list[int]()
    end = tokens[position].start
    for index in range(position, halt):
        token = tokens[index]
        if token.keyword is not None and token.keyword in rows[states[-1]]:
            token.kind = token.keyword  # the grammar expects the keyword here; else it is a name
        kind = token.kind
        while (target := rows[states[-1]].get(kind)) is not None and target < 0:
            rule, action = rules[~target]
            if rule.action is None:
                states[-1] = rows[states[-2]][rule.origin]
                continue
            at = len(values) - rule.size
            children = _collect_rule_children(rule, values[at:])
            start = starts[at] if rule.size else end
            del states[at + 1 :], values[at:], starts[at:]
            values.append(children if action is None else action(Span(source, start, end), *children))
            starts.append(start)
            states.append(rows[states[-1]][rule.origin])
            if states[-1] == end_state:
                script: ast.Script = values[0]
                return script
        if target is None:
            return _make_parse_failure(source, table, tokens, index, states, values)
        states.append(target)
        values.append(token)
        starts.append(token.start)
        end = token.end
    return _make_parse_failure(source, table, tokens, halt, states, values)


def _make_parse_failure(*state: Any) -> ParseFailure:
    from ss2sql.frontend.syntax.parse_failure import ParseFailure

    return ParseFailure(*state)


def _collect_rule_children(rule: Rule, symbols: list[Any]) -> list[Any]:
    """The children of a complete rule. Growing lists are extended in place, in linear time."""
    children: list[Any] = []
    for index in rule.children:
        if index >= 0:
            children.append(symbols[index])
        elif children or rule.action:
            children.extend(symbols[~index])
        else:
            children = symbols[~index]
    return children


def find_resume_point(failure: ParseFailure) -> int:
    """The index of the token at which parsing resumes after an error: after the next `;` outside brackets.

    Where a bracket is never closed, only brackets after the error count; a string that is not closed has most likely
    swallowed the `;`.
    """
    tokens = failure.tokens
    if failure.found.kind == "OPEN_STRING" and failure.found.text.rstrip().endswith(";"):
        return failure.index + 1
    outside = len(failure.brackets)
    depth, fallback = 0, len(tokens)
    inside = failure.found.kind == ";" and failure.clause in tokenizer.OPTIONS  # where a comma is meant
    for index in range(failure.index + inside, len(tokens)):
        kind = tokens[index].kind
        if kind == ";" and outside <= 0:
            return index + 1
        if kind == ";" and depth == 0:
            fallback = min(fallback, index + 1)
        step = (kind in tokenizer.OPENING) - (kind in tokenizer.CLOSING)
        outside += step
        depth = max(0, depth + step)
    return fallback if outside > 0 else len(tokens)


# --- the table of the automaton
# Reading the file takes a tenth of the time that lark needs to build its parser, without importing lark. Who changes
# the grammar writes it anew by `parse_table`; a test compares them.
GRAMMAR = Path(__file__).with_name("grammar.lark")
TABLE = GRAMMAR.with_name("grammar_table.json")


@dataclass(frozen=True, slots=True)
class Rule:
    """One line of the grammar: `size` symbols are taken from the stack and replaced by `origin`.

    `action` names the builder's method; it is "" for a rule that only collects children into a list, and None
    for a rule that passes its one symbol on. `children` says which symbols are children: `i` for the i-th
    symbol, `~i` for the i-th symbol's own children.
    """

    origin: str
    size: int
    action: str | None
    children: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Table:
    """The automaton. `rows[state][symbol]` is the next state, or `~r` where rule `r` is complete."""

    rows: tuple[Mapping[str, int], ...]
    rules: tuple[Rule, ...]
    start: int
    end: int


@cache
def load_parse_table() -> Table:
    """The table of the installed grammar; the first call reads it."""
    # It may lie in a zip file; importlib.resources would take 6 ms to load.
    data = json.loads(__loader__.get_data(str(TABLE)))  # type: ignore[name-defined]
    symbols = data["symbols"]
    rows = [
        dict(zip(map(symbols.__getitem__, found), targets, strict=True))
        for found, targets in zip(data["found"], data["targets"], strict=True)
    ]
    rules = tuple(Rule(symbols[origin], size, action, tuple(kept)) for origin, size, action, kept in data["rules"])
    return Table(tuple(map(rows.__getitem__, data["states"])), rules, data["start"], data["end"])
