"""A session on the native engine without rewrites and without a memo, and the places of errors."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import ss2sql
from ss2sql.errors import Error
from ss2sql.language import plan
from ss2sql.session.session import OFF_SWITCHES


@cache
def plain() -> ss2sql.Session:
    """The session of all hosts without functions: to open one takes long."""
    return ss2sql.connect(disable=list(OFF_SWITCHES))


class FakeHost:
    """Without a memo every call that the executor makes is counted in the `calls` of a result.

    `functions` are Python functions by name, `volatility` theirs where it is not immutable.
    """

    def __init__(
        self,
        functions: dict[str, Callable[..., Any]] | None = None,
        volatility: dict[str, plan.Volatility] | None = None,
        **variables: Any,
    ) -> None:
        self.session = ss2sql.connect(disable=list(OFF_SWITCHES)) if functions else plain()
        self.session.run("clear();")
        for name, function in (functions or {}).items():
            self.session.function(name, function, volatility=(volatility or {}).get(name, "immutable"))
        for name, value in variables.items():
            self.session.set(name, value)

    def result(self, script: str) -> ss2sql.Result:
        return self.session.run(script, engine="native")

    def run(self, script: str) -> Any:
        return self.result(script).value

    def error(self, script: str) -> Error:
        """The error that a script ends with."""
        try:
            self.run(script)
        except Error as error:
            return error
        raise AssertionError(f"no error: {script}")


def place(error: Error) -> str:
    """`line:column` of an error, with the text that it points at."""
    assert error.span is not None
    return f"{error.span.line}:{error.span.column} {error.span.text}"
