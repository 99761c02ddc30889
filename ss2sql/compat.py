"""The spelling of the paper's program stub, so that it runs with its import line changed.

import ss2sql.compat as SelectScript

ss = SelectScript.Interpreter()
ss.addFunction("move", move)
ir = SelectScript.compile(problem)
result = ss.eval(ir)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ss2sql.errors import Source
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse
from ss2sql.session.session import Session, connect


@dataclass(frozen=True, slots=True)
class Script:
    """A script that has been parsed, but not yet resolved: `Interpreter.eval` knows the functions."""

    text: str
    tree: ast.Script


def compile(script: str) -> Script:
    """The parsed script. Raises ParseError."""
    return Script(script, parse(Source(script)))


class Interpreter:
    """A session under the paper's names."""

    def __init__(self) -> None:
        self.session: Session = connect()

    def addFunction(self, name: str, function: Callable[..., Any]) -> None:  # noqa: N802 - the paper's name
        """Makes a Python function callable from scripts."""
        self.session.function(name, function)

    def addVariable(self, name: str, value: Any) -> None:  # noqa: N802
        """Makes a Python object known to scripts."""
        self.session.attach(name, value)

    def callVariable(self, name: str) -> Any:  # noqa: N802
        """The value of a variable that scripts or `addVariable` have set. Raises KeyError if there is none."""
        return self.session.get(name)

    def eval(self, script: Script | str) -> Any:
        """The value of a script, compiled or not."""
        return self.session.eval(script.text if isinstance(script, Script) else script)


__all__ = ["Interpreter", "Script", "compile"]
