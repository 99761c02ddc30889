"""Programs with parts of each other, sessions with a history, and the steps that a program takes.

Programs with parts of five random ones, which have the functions, tables and values of all five, come to the same by
the reference and both engines. And what a script comes to depends on the values that stand, not on what ran before: one
session of each engine lives through scripts, compiled ones run again, and through changes of its lists. For each script
a fresh session with the same values comes to the same, and leaves the same variables behind. `SS2SQL_PROGRAMS` sets how
many programs are tried.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout, suppress
from copy import deepcopy
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache, partial
from io import StringIO
from itertools import islice
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest
from agreement import Outcome, exact, is_allowed, judged, outcome, session_for
from fuzz_mutations import Donors, Mutator
from hypothesis import given, seed
from programs import ProgramCase, programs
from programs.drawn import SEED, amount, drawn
from programs.failing import FailingPrograms
from reference import Reference
from sessions import ENGINES

import ss2sql
from ss2sql.errors import Source
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse

many = drawn(amount(1 / 25))
LONGEST = 800  # characters
# What takes long, or gives very much, may do so on one engine alone.
LIMITED = {"T001", "X010", "X014"}
MOST = 100_000  # expressions that the reference evaluates of one script
ALONE = r"\b(count|sum|min|max|average)\b(?! *\()"  # aggregates of `this`, which the reference does not know


@pytest.mark.drawn
@seed(SEED)
@many
@given(programs())
def test_as_many_steps_as_a_program_takes_are_enough_and_one_fewer_are_not(case: ProgramCase) -> None:
    for engine in ENGINES:
        expected, steps = steps_of(case, engine)
        if steps:
            assert steps_of(case, engine, max_steps=steps) == (expected, steps)
            assert steps_of(case, engine, max_steps=steps - 1)[0].error == "T004"


def steps_of(case: ProgramCase, engine: str, **limits: int) -> tuple[Outcome, int]:
    """What a program comes to, and the steps of its searches; none where it fails or is refused."""
    with session_for(case, **limits) as ss, redirect_stdout(StringIO()):
        try:
            result = ss.run(case.script, engine=engine)  # type: ignore[arg-type]
        except ss2sql.Error as error:
            return Outcome(error=error.code), 0
        except Exception as error:
            return Outcome(error=type(error).__name__), 0
        return Outcome(exact(result.value)), result.stats.generated


# --- programs with parts of each other, and histories -------------------------------------------------------

COUNT = amount(1 / 5)
PARTS = 4
POOL = 400  # programs
TOGETHER = 5  # programs
OF_EACH = 20  # scripts
HISTORIES = 2
STEPS = 14  # of one history
MUTATED = 4  # scripts
CHANGES = 0.25  # of the steps; the others run a script
COMPILED = 0.6  # of the runs
LIMITS: dict[str, Any] = {"timeout": 2.0, "max_rows": 3000}
# What such objects, and calls that count, come to depends on how often and in which order they are asked; aggregates
# without `(this)` are unknown to the reference.
OMITTED = re.compile(f"tick|body|box|{ALONE}")


def mutated(known: list[str], omitted: re.Pattern[str], dice: Random) -> Iterator[str]:
    """Scripts of no end that are made of parts of known ones; those with something omitted are left out."""

    def kept(script: str) -> bool:
        return len(script) <= LONGEST and not omitted.search(script)

    scripts = [script for script in known if kept(script)]
    mutator = Mutator(Donors(scripts))
    while True:
        script = mutator.changed(dice.choice(scripts), dice)
        if kept(script):
            yield script


def engine_outcomes(
    session: Callable[[], ss2sql.Session], script: str, engines: tuple[str, ...] = ("native", "database", "auto")
) -> dict[str, Outcome]:
    """What the engines that run a script make of it; nothing of one that does not compile."""
    found: dict[str, Outcome | None] = {}
    for engine in engines:
        with session() as ss, suppress(ss2sql.Error):
            ss.compile(script).statements()
            found[engine] = outcome(ss, script, engine=engine, timeout=0.5, max_rows=3000)[0]
    return {engine: one for engine, one in found.items() if one is not None and one.error not in LIMITED}


class EnoughError(BaseException):
    """A script would take the reference evaluator minutes; no script can catch it."""


class Limited(Reference):
    """The reference evaluator, which gives up after a while."""

    left = MOST

    def evaluate(self, expr: Any, frame: Any) -> Any:
        self.left -= 1
        if not self.left:
            raise EnoughError
        return super().evaluate(expr, frame)


def is_no_program(found: Outcome) -> bool:
    """Engines refuse it as soon as it is compiled, where the reference fails when it runs, or knows no limit."""
    return found.error is not None and (found.error.startswith("R") or found.error in ("P002", "X005", "MemoryError"))


def reference_outcome(judge: Limited, script: str) -> Outcome | None:
    """None where the reference has nothing to say."""
    try:
        found = judged(judge, script)
    except EnoughError:
        return None
    return None if is_no_program(found) else found


@cache
def pool(part: int) -> tuple[ProgramCase, ...]:
    """Programs that come to the same whenever they run."""
    found: list[ProgramCase] = []

    @seed(SEED + part)
    @drawn(POOL)
    @given(programs())
    def draw(case: ProgramCase) -> None:
        kept = len(case.script) <= LONGEST and not OMITTED.search(case.script)
        if kept and "volatile" not in case.volatility.values():
            found.append(case)

    draw()
    return tuple(found)


def together(cases: list[ProgramCase], script: str) -> ProgramCase:
    """A script with what all of these have; a table hides a variable of another program."""
    tables = {name: rows for case in cases for name, rows in case.tables.items()}
    variables = {name: value for case in cases for name, value in case.variables.items() if name not in tables}
    return ProgramCase(script, variables, tuple(dict.fromkeys(name for case in cases for name in case.uses)), tables)


def mixed(part: int) -> Iterator[ProgramCase]:
    """Programs of no end."""
    dice = Random(f"{SEED} mixed {part}")
    while True:
        cases = dice.sample(pool(part), TOGETHER)
        for script in islice(mutated([case.script for case in cases], OMITTED, dice), OF_EACH):
            yield together(cases, script)


def outcomes(case: ProgramCase) -> dict[str, Outcome]:
    """What engines and reference make of it, as far as they run it; nothing of one that does not compile."""
    found = engine_outcomes(partial(session_for, case), case.script)
    # To the reference what an element lacks is None; engines may learn too late that it is a column of others.
    lacking = {one.error for one in found.values()} == {"X008"}
    if found and not lacking and not any(map(is_no_program, found.values())):
        judge = Limited(case.functions, case.variables, case.tables, case.volatility)
        expected = reference_outcome(judge, case.script)
        if expected is not None:
            found["reference"] = expected
    return {engine: one for engine, one in found.items() if not is_no_program(one)}


def agree(cases: Iterator[ProgramCase], count: int) -> None:
    """Runs programs until so many have come to the same in several evaluators."""
    compared = 0
    while compared < count:
        case = next(cases)
        found = outcomes(case)
        expected = found.get("reference", found.get("native"))
        for engine, one in found.items():
            assert expected is None or is_allowed(one, expected, engine), f"{case!r}\n{found}"
        compared += len(found) > 1


@pytest.mark.drawn
@pytest.mark.parametrize("part", range(PARTS))
def test_programs_with_parts_of_others(part: int) -> None:
    agree(mixed(part), COUNT // PARTS)


@dataclass
class Life:
    """A session of one engine, with the scripts that it has compiled."""

    engine: Any
    session: ss2sql.Session
    compiled: dict[str, ss2sql.Query] = field(default_factory=dict)

    def run(self, script: str, compiled: bool) -> Outcome | None:
        if compiled and script not in self.compiled:
            try:
                self.compiled[script] = self.session.compile(script, self.engine)
            except ss2sql.Error:
                compiled = False  # a run says why
        runs: Any = self.session
        if compiled:
            runs = SimpleNamespace(run=lambda _, **options: self.compiled[script].run(**options))
        return outcome(runs, script, engine=self.engine, **LIMITS)[0]

    @property
    def is_told_by_its_values(self) -> bool:
        """Whether a fresh session can be given all that this one knows: lists with sources are no values."""
        return not self.session.host.names.late


@dataclass
class History:
    """What happens to the sessions: changes of the lists that are attached, and scripts."""

    dice: Random
    case: ProgramCase
    scripts: list[str]
    values: dict[str, list[Any]]
    log: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.attached = {name: deepcopy(value) for name, value in self.case.variables.items()}
        here = replace(self.case, variables=self.attached)
        self.lives = [Life(engine, session_for(here)) for engine in ("native", "database")]

    def change(self) -> None:
        """One of the lists gets other values, of its own or of another name: in place, or by a new list.

        Or the values of a list inside of it change their order.
        """
        dice, names = self.dice, sorted(self.values)
        name = dice.choice(names)
        value = deepcopy(dice.choice(self.values[dice.choice([name, name, dice.choice(names)])]))
        now = self.attached.get(name)
        inner = [part for part in now if isinstance(part, list)] if isinstance(now, list) else []
        if inner and dice.random() < 0.5:
            which = dice.randrange(len(inner))
            inner[which].reverse()
            self.log.append(f"the list {which} in {name} is turned round")
            return
        if isinstance(now, list) and isinstance(value, list) and dice.random() < 0.5:
            now[:] = value
            self.log.append(f"{name}[:] = {value}")
            return
        self.attached[name] = value
        self.log.append(f"{name} = {value}")
        for life in self.lives:
            life.session.attach(name, value)

    def run(self) -> bool:
        """Runs a script, compares, and says whether the history goes on."""
        script, compiled = self.dice.choice(self.scripts), self.dice.random() < COMPILED
        self.log.append(f"{'compiled' if compiled else 'run'}: {script}")
        for life in self.lives:
            fresh = self.fresh(life)
            found = life.run(script, compiled)
            with fresh:
                expected = outcome(fresh, script, engine=life.engine, **LIMITS)[0]
                if {one.error for one in (found, expected) if one is not None} & LIMITED:
                    return False
                left = fresh.variables()
            if found is not None and found.error == "R009" and compiled:
                # What it does not know is a parameter to a compiled script.
                assert expected is None or expected.error is not None, self.told(life)
                return False
            assert found == expected, f"{self.told(life)}\nlive:  {found}\nfresh: {expected}"
            assert life.session.variables() == left, self.told(life)
        return all(life.is_told_by_its_values for life in self.lives)

    def fresh(self, life: Life) -> ss2sql.Session:
        """A session with the values that the one has now."""
        own = life.session.variables()
        lists = {name: deepcopy(value) for name, value in self.attached.items() if name not in own}
        session = session_for(replace(self.case, variables=lists))
        for name, value in own.items():
            session.set(name, value)
        return session

    def told(self, life: Life) -> str:
        return "\n".join((f"{life.engine}: {self.case!r}", *self.log))

    def close(self) -> None:
        for life in self.lives:
            life.session.close()


def history(part: int, dice: Random) -> History:
    cases = dice.sample(pool(part), TOGETHER)
    texts = [case.script for case in cases]
    values: dict[str, list[Any]] = {}
    base = together(cases, "1;")
    for case in cases:
        for name in case.variables.keys() - base.tables.keys():
            values.setdefault(name, []).append(case.variables[name])
    scripts = [*islice(mutated(texts, OMITTED, dice), MUTATED), *(text for text in texts if len(text) <= LONGEST)]
    return History(dice, base, scripts, values)


@pytest.mark.drawn
@pytest.mark.parametrize("part", range(HISTORIES))
def test_a_session_with_a_history_is_as_good_as_a_fresh_one(part: int) -> None:
    dice = Random(f"{SEED} histories {part}")
    compared = 0
    while compared < COUNT // HISTORIES:
        lived = history(part, dice)
        try:
            for _ in range(STEPS):
                if lived.values and dice.random() < CHANGES:
                    lived.change()
                elif lived.run():
                    compared += 1
                else:
                    break
        finally:
            lived.close()


# --- parts of programs as texts for eval ----------------------------------------------------------------


MOST_TEXTS = 3  # texts of a program
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
        for _ in range(dice.randint(1, MOST_TEXTS)):
            script = with_text(script, dice)
        if script != case.script:
            yield replace(case, script=script)


@pytest.mark.drawn
@pytest.mark.parametrize("part", range(PARTS))
def test_programs_with_texts(part: int) -> None:
    agree(with_texts(part), COUNT // PARTS)


# --- queries in which almost every part may fail --------------------------------------------------------


FAILING = amount(1 / 2)


def limited_outcome(case: ProgramCase, engine: Any) -> Outcome | None:
    """What an engine makes of it; None where it refuses it, or takes too long."""
    with session_for(case) as session:
        found = outcome(session, case.script, engine=engine, timeout=0.5, max_rows=3000)[0]
    return None if found is None or found.error in LIMITED else found


@pytest.mark.drawn
@pytest.mark.parametrize("part", range(PARTS))
def test_engines_give_the_values_of_the_reference(part: int) -> None:
    """The engine `auto` gives one wherever there is one."""
    writer = FailingPrograms(Random(f"{SEED} failing {part}"))
    compared = 0
    while compared < FAILING // PARTS:
        case = writer.case()
        judge = Limited(case.functions, case.variables, case.tables, case.volatility)
        expected = reference_outcome(judge, case.script)
        if expected is None:
            continue
        for engine in ("native", "database", "auto"):
            found = limited_outcome(case, engine)
            assert found is None or is_no_program(found) or is_allowed(found, expected, engine), (case, engine, found)
        compared += 1
