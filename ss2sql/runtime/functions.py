"""Python functions of the user: registration, and the rules of every call.

A function gets fresh values, so whatever it does to its arguments changes nothing else. A call of an
immutable or stable function is remembered by its arguments for the length of one run; the memo is bounded.
What comes back is made a value of the language at the border, where a bad one is refused by the function's
name. Each executor makes its own calls: calls.py those from SQL, native/calls.py those of generated code.
"""

from __future__ import annotations

import marshal
from collections.abc import Callable, Mapping
from dataclasses import replace
from inspect import isasyncgenfunction, iscoroutinefunction
from itertools import islice
from types import NoneType
from typing import Any

from ss2sql import plan
from ss2sql.errors import SessionError
from ss2sql.frontend.instances import Body
from ss2sql.frontend.text import RESERVED as RESERVED_WORDS
from ss2sql.language.operations import GROUPS, OPERATIONS
from ss2sql.lowering.names import SQLITE_FUNCTIONS
from ss2sql.records import dataclass
from ss2sql.runtime.search_functions import FUNCTIONS as SEARCH_FUNCTIONS

MEMO_LIMIT = 100_000

# Names that the SQL made by lowering uses for itself; a user's function of such a name gets another one in SQL.
RESERVED = SQLITE_FUNCTIONS | {
    *("collect", "collect_nothing", "collect_records", "collect_rows", "collect_set", "collect_value"),
    *(f"group_{name}" for name in GROUPS),
    *("list", "record", "field"),
    *("truth", "in_turn", "as_key", "recall", "remember", "elements", "search"),
    *("step_cost", "step_heuristic", "step_probability"),
    *("expand", "next_number", "next_position", *SEARCH_FUNCTIONS),
}


@dataclass(frozen=True, slots=True)
class UserFunction:
    """A registered function.

    `inferred` says that the volatility was found in its source, not declared; `body` is what the function computes
    where queries may compute it themselves, else the reason why not. A function that is proven to change nothing
    (`changes` is false) gets its arguments without a copy. `of_world` is what scripts call a function of worlds.
    One that is an `aggregate` takes a list, with GROUP BY that of the values of a group.
    """

    name: str
    function: Callable[..., Any]
    volatility: plan.Volatility
    inferred: bool
    reason: str
    minimum: int
    maximum: int | None
    parameters: tuple[str, ...] = ()
    inverse: Callable[..., Any] | None = None
    vectorized: bool = False
    body: Body | str = ""
    changes: bool = True
    of_world: str = ""
    aggregate: bool = False

    @property
    def plan(self) -> plan.Function:
        return plan.Function(
            self.name,
            self.minimum,
            self.maximum,
            self.volatility,
            builtin=False,
            reason=self.reason,
            parameters=self.parameters,
            body=self.body if isinstance(self.body, Body) else None,
            vectorized=self.vectorized,
            of_world=self.of_world,
            has_inverse=self.inverse is not None,
            collects=self.aggregate,
        )

    def inverted(self) -> UserFunction:
        """The inverse as a function; nobody has said that it changes nothing."""
        assert self.inverse is not None
        from ss2sql.frontend.purity import infer

        changes = infer(self.inverse).changes
        return replace(self, name=f"inverse of {self.name}", function=self.inverse, inverse=None, changes=changes)


def user_function(
    name: str,
    function: Callable[..., Any],
    volatility: plan.Volatility | None = None,
    inverse: Callable[..., Any] | None = None,
    vectorized: bool = False,
) -> UserFunction:
    """The registration of a function; its volatility is inferred from its source where none is given.

    Raises SessionError S002 for a name or a signature that scripts could not use.
    """
    if not isinstance(name, str) or name not in OPERATIONS:  # `in` is the name of an operator
        check_name(name)
    if not callable(function):
        hint = f"give the function without calling it; a value is given by session.set('{name}', value)"
        raise SessionError("S002", f"'{name}' is a {type(function).__name__}, not a function", hints=(hint,))
    if iscoroutinefunction(function) or isasyncgenfunction(function):
        hint = f"register a function that waits for it: lambda *arguments: asyncio.run({name}(*arguments))"
        raise SessionError("S002", f"'{name}' is async: a call gives a coroutine, and no value", hints=(hint,))
    if volatility not in (None, "immutable", "stable", "volatile"):
        raise SessionError("S002", f"volatility is 'immutable', 'stable' or 'volatile', not {volatility!r}")
    from ss2sql.frontend.purity import arity, infer  # which nobody needs who registers no function

    takes = arity(function)
    inferred = volatility is None
    purity = infer(function)  # also where the volatility is declared: who changes nothing needs no copies
    reason, changes = "declared", purity.changes
    if volatility is None:
        volatility, reason = purity.volatility, purity.reason
    if vectorized and volatility == "volatile":
        if not inferred:
            raise _volatile_block(name)
        # Nobody can keep to the written order of calls who leaves it to the run which rows make a block.
        volatility, reason, inferred = "stable", "takes arrays, which says that it is not volatile", False
    size = (takes.minimum, takes.maximum, takes.names)
    body = _body(name, function, volatility, inverse is not None, vectorized)
    return UserFunction(name, function, volatility, inferred, reason, *size, inverse, vectorized, body, changes)


def _volatile_block(name: str) -> SessionError:
    message = f"'{name}' takes arrays, so it cannot be volatile: which rows are called together is left to the run"
    return SessionError("S002", message, hints=("declare it stable or immutable, or register it without vectorized",))


def _body(
    name: str, function: Callable[..., Any], volatility: plan.Volatility, has_inverse: bool, vectorized: bool
) -> Body | str:
    """What queries may compute in place of a call, or the reason why they must call."""
    if volatility != "immutable":
        return f"is {volatility}"
    if name in OPERATIONS:
        return "stands in for a built-in function"
    if has_inverse or vectorized:
        return "has an inverse" if has_inverse else "takes arrays"
    from ss2sql.frontend.inline import body_of

    return body_of(function)


# The built-in functions and operators as the plan knows them.
BUILT_IN: Mapping[str, plan.Function] = {name: row.function() for name, row in OPERATIONS.items()}


def check_text(name: Any) -> None:
    """Raises SessionError S002 for a name that is no text."""
    if not isinstance(name, str):
        raise SessionError("S002", f"a name is a text, not {type(name).__name__}", hints=("put it into quotes",))


def check_name(name: str) -> None:
    """Raises SessionError S002 if scripts could not use the name."""
    check_text(name)
    if not name.isidentifier():
        hints = ("use letters, digits and _, a letter first",)
    elif name.upper() in RESERVED_WORDS:
        hints = (f"'{name}' is a word of the language; choose another name",)
    else:
        return
    raise SessionError("S002", f"'{name}' is not a name that a script can use", hints=hints)


def sql_names(functions: Mapping[str, Any]) -> dict[str, str]:
    """SQL names for registered functions: their own, but apart where SQL sees no difference or needs the name.

    The order of registration does not matter.
    """
    taken, names = {word.lower() for word in RESERVED} | {name.lower().replace(" ", "_") for name in OPERATIONS}, {}
    for name in sorted(functions, key=lambda word: (word.lower(), word)):
        candidate = stem = _cut(name)
        count = 1
        while candidate.lower() in taken and (name not in OPERATIONS or name in RESERVED):
            count += 1
            candidate = f"{stem}_{count}"
        taken.add(candidate.lower())
        names[name] = candidate
    return names


def _cut(name: str) -> str:
    """A name that SQLite takes for a function, which has 255 bytes at most, with room for a number."""
    return name.encode()[:240].decode(errors="ignore")


def forget_half(memory: dict[Any, Any]) -> None:
    """Makes room by forgetting the older half. One by one, each would cost a walk over those that went before it.

    That walk takes 14 us in a dict of 100,000.
    """
    for key in list(islice(memory, (len(memory) + 1) // 2)):
        del memory[key]


class Refused:
    """In a memory of calls: the error with which the call ended."""

    __slots__ = ("error",)

    def __init__(self, error: Exception) -> None:
        self.error = error


class Memo:
    """The remembered results of one function, by its SQL arguments; the oldest go when there are too many.

    1 and 1.0 are one key of a dict but two arguments of a function, and so are 0.0 and -0.0: where there are numbers
    among the arguments, `exact` keeps the result by marshal's bytes of them, where a look costs 0.2 us. Handles and
    strings need no such care: their results are in `plain`, where it costs 0.1 us, and so are all where the types have
    `told_apart` the arguments. `calls` counts real calls, `hits` answers from the memo. `failures` keeps what calls
    have raised, by marshal's bytes: a statement that is run again must not call a second time.
    """

    __slots__ = ("calls", "exact", "failures", "hits", "limit", "plain", "told_apart")

    def __init__(self, limit: int) -> None:
        self.plain: dict[Any, Any] = {}
        self.exact: dict[bytes, Any] = {}
        self.failures: dict[bytes, Exception] = {}
        self.hits = 0
        self.calls = 0
        self.limit = limit
        self.told_apart = False

    def begin(self) -> tuple[Any, ...]:
        """Empties the memo for one more execution and gives what it held, for `end`."""
        outer = (self.plain, self.exact, self.failures, self.calls, self.hits, self.told_apart)
        self.plain, self.exact, self.failures, self.calls, self.hits = {}, {}, {}, 0, 0
        return outer

    def end(self, outer: tuple[Any, ...]) -> tuple[int, int]:
        """Puts back what the memo held before, and gives the numbers of calls and of hits."""
        counts = self.calls, self.hits
        self.plain, self.exact, self.failures, self.calls, self.hits, self.told_apart = outer
        return counts

    def keep(self, arguments: tuple[Any, ...], result: Any) -> None:
        """Notes a result."""
        plain, exact = self.plain, self.exact
        if len(plain) + len(exact) >= self.limit:
            if not self.limit:
                return
            forget_half(plain if len(plain) > len(exact) else exact)
        if result is not None and (self.told_apart or ONE_KIND.issuperset(map(type, arguments))):
            plain[arguments] = result
        else:
            exact[marshal.dumps(arguments, 2)] = result


ONE_KIND = frozenset({bytes, str, NoneType})  # of SQL values that equal only what they are
