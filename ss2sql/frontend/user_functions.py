"""Python functions of the user as a session registers them.

A function gets copies, so whatever it does to its arguments changes nothing else. A call of an immutable or stable
function is evaluated once for its arguments in one run. What comes back becomes a value of the language, or is refused
by the function's name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from inspect import isasyncgenfunction, iscoroutinefunction
from typing import Any

from ss2sql.errors import SessionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.tokenizer import RESERVED as RESERVED_WORDS
from ss2sql.language import plan
from ss2sql.language.operations import OPERATIONS


@dataclass(frozen=True, slots=True)
class FunctionBody:
    """A function as an expression of its parameters."""

    parameters: tuple[str, ...]
    defaults: Mapping[str, ast.Literal]  # values of parameters that a call may leave out
    tree: ast.Expr
    text: str  # the expression as Python writes it
    uses: frozenset[str]  # the built-in functions in it


@dataclass(frozen=True, slots=True)
class UserFunction:
    """A registered function."""

    name: str
    function: Callable[..., Any]
    volatility: plan.Volatility
    inferred: bool  # the volatility was found in the source, not declared
    reason: str
    minimum: int
    maximum: int | None
    parameters: tuple[str, ...] = ()
    inverse: Callable[..., Any] | None = None
    vectorized: bool = False
    body: FunctionBody | str = ""  # what it computes, where queries may compute it themselves; else the reason why not
    changes: bool = True  # may change its arguments, so it gets copies
    indexed: frozenset[int] = frozenset()  # but not of flat lists at these places, of which it only reads items
    of_world: str = ""  # what scripts call a function of worlds
    aggregate: bool = False  # takes a list, with GROUP BY that of the values of a group

    @property
    def giver(self) -> str:
        """What messages about a value call the function that gave it."""
        return f"the function '{self.of_world or self.name}'"

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
            body=self.body if isinstance(self.body, FunctionBody) else None,
            vectorized=self.vectorized,
            of_world=self.of_world,
            has_inverse=self.inverse is not None,
            collects=self.aggregate,
            indexed=self.indexed,
        )

    def make_inverse(self) -> UserFunction:
        """The inverse as a function; nobody has said that it changes nothing."""
        assert self.inverse is not None
        from ss2sql.frontend.volatility import infer_purity

        changes = infer_purity(self.inverse).changes
        return replace(self, name=f"inverse of {self.name}", function=self.inverse, inverse=None, changes=changes)


def make_user_function(
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
        check_user_function_name(name)
    if not callable(function):
        hint = f"give the function without calling it; a value is given by session.set('{name}', value)"
        raise SessionError("S002", f"'{name}' is a {type(function).__name__}, not a function", hints=(hint,))
    if iscoroutinefunction(function) or isasyncgenfunction(function):
        hint = f"register a function that waits for it: lambda *arguments: asyncio.run({name}(*arguments))"
        raise SessionError("S002", f"'{name}' is async: a call gives a coroutine, and no value", hints=(hint,))
    if volatility not in (None, "immutable", "stable", "volatile"):
        raise SessionError("S002", f"volatility is 'immutable', 'stable' or 'volatile', not {volatility!r}")
    from ss2sql.frontend.volatility import infer_arity, infer_purity  # which nobody needs who registers no function

    takes = infer_arity(function)
    inferred = volatility is None
    purity = infer_purity(function)  # also where the volatility is declared: who changes nothing needs no copies
    reason, changes = "declared", purity.changes
    if volatility is None:
        volatility, reason = purity.volatility, purity.reason
    if vectorized and volatility == "volatile":
        if not inferred:
            message = (
                f"'{name}' takes arrays, so it cannot be volatile: which rows are called together is left to the run"
            )
            hint = "declare it stable or immutable, or register it without vectorized"
            raise SessionError("S002", message, hints=(hint,))
        # Nobody can keep to the written order of calls who leaves it to the run which rows make a block.
        volatility, reason, inferred = "stable", "takes arrays, which says that it is not volatile", False
    size = (takes.minimum, takes.maximum, takes.names)
    body = _find_inlinable_body(name, function, volatility, inverse is not None, vectorized)
    return UserFunction(
        name, function, volatility, inferred, reason, *size, inverse, vectorized, body, changes, purity.indexed
    )


def _find_inlinable_body(
    name: str, function: Callable[..., Any], volatility: plan.Volatility, has_inverse: bool, vectorized: bool
) -> FunctionBody | str:
    """What queries may compute in place of a call, or the reason why they must call."""
    if volatility != "immutable":
        return f"is {volatility}"
    if name in OPERATIONS:
        return "stands in for a built-in function"
    if has_inverse or vectorized:
        return "has an inverse" if has_inverse else "takes arrays"
    from ss2sql.frontend.inlining import translate_function_body

    return translate_function_body(function)


def check_is_string(name: Any) -> None:
    """Raises SessionError S002 for a name that is no text."""
    if not isinstance(name, str):
        raise SessionError("S002", f"a name is a text, not {type(name).__name__}", hints=("put it into quotes",))


def check_user_function_name(name: str) -> None:
    """Raises SessionError S002 if scripts could not use the name."""
    check_is_string(name)
    if not name.isidentifier():
        hints = ("use letters, digits and _, a letter first",)
    elif name.upper() in RESERVED_WORDS:
        hints = (f"'{name}' is a word of the language; choose another name",)
    else:
        return
    raise SessionError("S002", f"'{name}' is not a name that a script can use", hints=hints)
