"""Random programs with parts of them given to `eval` as texts: the reference and both engines come to the same.

A text means what it would mean without `eval`, but where its place counts: it is read when it runs, sees rows and not
their groups, and is a value of any type.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from random import Random
from typing import Any

import pytest
from mutated_scripts import LONGEST
from programs import ProgramCase
from programs.drawn import amount
from test_program_laws import SEED, agree, pool

from ss2sql.errors import Source
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse

COUNT = amount(1 / 5)
PARTS = 4
MOST = 3  # texts of a program
WITHOUT_TEXT = (ast.Assign, ast.TemporalAssign, ast.Star, ast.From, ast.Option, ast.OrderKey, ast.Script)


def expressions(node: Any) -> Iterator[Any]:
    """What an `eval` may stand for, in the order of the script."""
    if isinstance(node, tuple):
        for part in node:
            yield from expressions(part)
    elif is_dataclass(node) and not isinstance(node, ast.Representation):
        if not isinstance(node, WITHOUT_TEXT):
            yield node
        for part in fields(node):
            if part.compare:
                yield from expressions(getattr(node, part.name))


def with_text(script: str, dice: Random) -> str:
    """The script with one of its expressions as a text, if that can be written without escapes."""
    tree = parse(Source(script))
    node = dice.choice(list(expressions(tree.statements)))
    start, end = node.span.start, node.span.end
    text = script[start:end]
    quote = next((mark for mark in "\"'" if mark not in text), None)
    if quote is None or "\\" in text:
        return script
    return f"{script[:start]}(eval({quote}{text}{quote})){script[end:]}"  # MAXIMUM wants the outer parentheses


def with_texts(part: int) -> Iterator[ProgramCase]:
    """Programs of no end."""
    dice = Random(f"{SEED} texts {part}")
    cases = [case for case in pool(part) if len(case.script) <= LONGEST]
    while True:
        case = dice.choice(cases)
        script = case.script
        for _ in range(dice.randint(1, MOST)):
            script = with_text(script, dice)
        if script != case.script:
            yield replace(case, script=script)


@pytest.mark.drawn
@pytest.mark.parametrize("part", range(PARTS))
def test_programs_with_texts(part: int) -> None:
    agree(with_texts(part), COUNT // PARTS)
