"""Rewrites change how a query is evaluated, never what it gives: random programs with each of them switched off.

Those that are made here have products, conditions of many parts and nested queries. They call functions that note their
calls, so that it can be seen whether a rewrite evaluates what the written order does not evaluate, or in another order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from agreement import EARLY, executor_outcome, is_allowed, reference_outcome
from hypothesis import given, seed
from hypothesis import strategies as st
from programs import ProgramCase, programs
from programs.choices import Choices
from programs.drawn import amount, drawn
from sessions import ENGINES

from ss2sql.lowering.rewrites import REWRITES

SWITCHES = ["nothing", *REWRITES]
PROGRAMS = 2 * amount(3 / 10)  # of each kind; each without one of the rewrites
DECISIONS = 200
Calls = list[tuple[Any, ...]]


@dataclass(frozen=True)
class NotedCase:
    """A script with its variables and tables; `calls` are those of the evaluator that asked last for functions."""

    script: str
    variables: dict[str, Any] = field(default_factory=dict)
    tables: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    calls: Calls = field(default_factory=list, compare=False, repr=False)

    @property
    def functions(self) -> dict[str, Callable[..., Any]]:
        self.calls.clear()
        return {name: self._noted(name, function) for name, function in FUNCTIONS.items()}

    @property
    def volatility(self) -> dict[str, str]:
        return dict.fromkeys(FUNCTIONS, "immutable")

    def _noted(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def one(x: Any) -> Any:
            self.calls.append((name, repr(x)))
            return function(x)

        def two(x: Any, y: Any) -> Any:
            self.calls.append((name, repr(x), repr(y)))
            return function(x, y)

        return two if name == "mix" else one

    @property
    def different_calls(self) -> Calls:
        """The calls in their order, without those that an evaluator may remember."""
        return list(dict.fromkeys(self.calls))


def picky(x: Any) -> Any:
    if x == 3:
        raise ValueError("three is not allowed")
    return x


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "grow": lambda x: x + 1 if isinstance(x, int) else [x],
    "odd": lambda x: isinstance(x, int) and x % 2 == 1,
    "picky": picky,
    "mix": lambda x, y: [x, y],
    "around": lambda x: [x, x + 1][: x % 3] if isinstance(x, int) else [],
}


def noted_program(data: bytes) -> NotedCase:
    """The program that the bytes stand for."""
    return Asking(Choices(data)).program()


class Asking:
    """Writes one query, and what stands before it."""

    def __init__(self, choices: Choices) -> None:
        self.choices = choices
        self.variables: dict[str, Any] = {}
        self.tables: dict[str, list[dict[str, Any]]] = {}
        self.before = ""
        self.names: list[str] = []

    def program(self) -> NotedCase:
        c = self.choices
        sources = ", ".join(self.source(name) for name in "abc"[: c.weighted((30, 2), (40, 3), (20, 1))])
        where = f" WHERE {self.condition(3)}" if c.chance(90) else ""
        shown = ", ".join(self.value(2) for _ in range(1 + c.below(2)))
        ending = c.weighted((60, ""), (15, f" ORDER BY {self.value(1)}"), (15, " LIMIT 2"), (10, " LIMIT 1"))
        script = f"SELECT {shown} FROM {sources}{where}{ending} AS rows"
        return NotedCase(self.before + script, self.variables, self.tables)

    def source(self, name: str) -> str:
        c = self.choices
        form = c.weighted((40, "list"), (30, "literal"), (14, "lateral"), (6, "empty"), (6, "table"), (6, "query"))
        text = f"xs{len(self.names)}"
        match form:
            case "list":
                self.variables[text] = c.some((1, 2, 3, 4, 0), 1, 3)
            case "empty":
                self.variables[text] = []
            case "table":
                self.tables[text] = [{"k": number} for number in c.some((1, 2, 3), 1, 2)]
                self.names.append(f"{name}.k")
                return f"{name} = {text}"
            case "lateral" if self.names:
                text = c.pick(("around({v})", "[{v}, 1]", "range({v})")).format(v=c.pick(self.names))
            case "query":
                text = c.pick(
                    ("(SELECT this FROM [1, 2, 3] WHERE this > 1 AS list)", "(SELECT to(this + 1, k) FROM [1, 2])")
                )
                self.names.append(f"{name}.this" if text.endswith("list)") else f"{name}.k")
                return f"{name} = {text}"
            case _:
                text = c.pick(("[1, 2, 3]", "[2, 3]", "[1]", "range(3)", "[1, 1.0, 2]"))
        self.names.append(f"{name}.this")
        return f"{name} = {text}"

    # --- values ----------------------------------------------------------------------------------------

    def plain(self) -> str:
        return self.choices.pick((*self.names, "2", "(1 + 1)"))

    def value(self, depth: int) -> str:
        c = self.choices
        if not depth:
            return self.plain()
        form = c.weighted(
            (30, "{p}"), (14, "grow({v})"), (10, "picky({v})"), (10, "mix({v}, {v})"), (6, "({p} + {p})"),
            (5, "6 / {p}"), (5, "IF({c}; {v}; {v})"), (4, "[{v}, {v}]"), (4, "[{v}, {v}][0]"), (4, "len({n})"),
            (3, "(2 * 3)"), (3, "odd({v})"), (3, "{c}"), (2, "{n}"),
        )  # fmt: skip
        return self.filled(form, depth - 1)

    def filled(self, form: str, depth: int) -> str:
        text, rest = "", form
        while "{" in rest:
            head, _, rest = rest.partition("{")
            hole, _, rest = rest.partition("}")
            text += head
            match hole:
                case "p":
                    text += self.plain()
                case "v":
                    text += self.value(depth)
                case "c":
                    text += self.condition(depth)
                case "n":
                    text += self.nested()
        return text + rest

    # --- conditions ------------------------------------------------------------------------------------

    def condition(self, depth: int) -> str:
        c = self.choices
        if depth and c.chance(60):
            join = c.weighted((60, " AND "), (25, " OR "), (5, " XOR "))
            parts = [self.condition(depth - 1) for _ in range(2 + c.below(3))]
            parts += [parts[0]] if c.chance(10) else []
            return f"({join.join(parts)})"
        if depth and c.chance(20):
            return f"NOT {self.condition(depth - 1)}"
        form = c.weighted(
            (30, "{p} != {p}"), (12, "{p} < {p}"), (12, "odd({v})"), (10, "picky({v}) > 0"), (8, "grow({v}) != {v}"),
            (5, "6 / {p} > 1"), (4, "True"), (4, "False"), (3, "1 == 1"), (3, "{p}"), (3, "mix({v}, {v})"),
            (5, "{p} IN [1, 2]"), (3, "around({p})"), (3, "{p} == 1 OR {p} == 2"), (20, "{asks}"),
        )  # fmt: skip
        return f"({self.asks() if form == '{asks}' else self.filled(form, max(depth - 1, 0))})"

    # --- nested queries --------------------------------------------------------------------------------

    def asks(self) -> str:
        """A condition that asks something of a nested query over a list."""
        c = self.choices
        form = c.pick(
            ("[] == {n}", "{n} != []", "NOT {n}", "{n}", "len({n}) == 0", "0 < len({n})", "count({n}) >= 2",
             "len({n}) == 1", "{p} IN {n}", "{p} NOT IN {n}", "max({n}) == 2", "min({n}) != 1", "max({m}) > 2",
             "min({m}) <= 1", "2 <= max({m})", "{n} AND True", "IF({n}; {p} > 1; {p} == 1)", "len({n}) != 2")
        )  # fmt: skip
        form = form.replace("{m}", f"(SELECT this FROM [{self.plain()}, {self.plain()}] AS list)")
        return self.filled(form, 1)

    def nested(self) -> str:
        c = self.choices
        outer = self.plain()
        if c.chance(25):
            pairs = [c.some(self.names, 2, 2) for _ in range(1 + c.below(2))]
            name = f"pairs{len(self.before)}"
            self.before += f"{name} = {pairs}; "
            test = c.pick(("==", "<", "!="))
            texts = [f'eval(this[{index}] + ";")' for index in (0, 1)]
            return f"(SELECT {c.pick(('this', '1'))} FROM {name} WHERE {texts[0]} {test} {texts[1]} AS list)"
        items = ", ".join(c.pick((self.plain(), "1", "2", "3")) for _ in range(1 + c.below(3)))
        literal = f"[{items}]"
        if c.chance(25):
            name = f"late{len(self.before)}"
            if "." not in items:
                self.before += f"{name} = {literal}; "
                literal = name
        where = c.pick((f"this == {outer}", f"this < {outer}", "this != 2", f"this == {outer} OR this == 1", "True", "",
                        f"picky(this) == {outer}", f"6 / this > {outer}", f"this IN [1, {outer}]"))  # fmt: skip
        columns = c.weighted((60, "this"), (15, "this, 1"), (10, f"this + {outer}"), (8, "grow(this)"))
        return f"(SELECT {columns} FROM {literal}{f' WHERE {where}' if where else ''} AS list)"


def agreed(case: ProgramCase | NotedCase, switch: str) -> None:
    """Without a rewrite the engines come to what the reference evaluator does.

    Natively by calls of the written order, in this order; SQL may make others. None is made twice.
    """
    expected = reference_outcome(case)  # type: ignore[arg-type]
    calls = case.different_calls if isinstance(case, NotedCase) else []
    for engine in (*ENGINES, "auto"):
        outcome = executor_outcome(case, engine, disable=[] if switch == "nothing" else [switch])  # type: ignore[arg-type]
        assert is_allowed(outcome, expected, engine), (engine, switch)
        if isinstance(case, NotedCase) and outcome is not None and outcome.error != EARLY:
            if engine == "native" and expected.error is None:
                written = iter(calls)
                assert all(call in written for call in case.different_calls), switch
            elif engine != "native":
                assert switch == "memo" or len(case.calls) == len(set(case.calls)), (engine, switch)


@pytest.mark.drawn
@seed(1)
@drawn(PROGRAMS)
@given(programs(), st.sampled_from(SWITCHES))
def test_random_programs_do_not_notice_a_rewrite(case: ProgramCase, switch: str) -> None:
    agreed(case, switch)


@pytest.mark.drawn
@seed(2)
@drawn(PROGRAMS)
@given(st.binary(min_size=DECISIONS, max_size=DECISIONS).map(noted_program), st.sampled_from(SWITCHES))
def test_random_programs_call_their_functions_as_they_may(case: NotedCase, switch: str) -> None:
    """Programs made for rewrites: the same answer; natively by the calls of the written order that it needs."""
    agreed(case, switch)
