"""A program with everything that it needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from .library import LIBRARY


@dataclass(frozen=True, repr=False)
class ProgramCase:
    """A script with its variables, the names of the functions of `library` that it uses, and its tables.

    `functions` makes the functions anew whenever it is read, so that those that count start at zero in every
    evaluator. `repr` is a call that makes the same case.
    """

    script: str
    variables: dict[str, Any] = field(default_factory=dict)
    uses: tuple[str, ...] = ()
    tables: dict[str, list[dict[str, Any]]] = field(default_factory=dict)

    @property
    def functions(self) -> dict[str, Callable[..., Any]]:
        """New functions by name."""
        return {name: LIBRARY[name][0]() for name in self.uses}

    @property
    def volatility(self) -> dict[str, str]:
        """The declared volatility by name; it is inferred for functions that are missing here."""
        return {name: declared for name in self.uses if (declared := LIBRARY[name][1]) is not None}

    def __repr__(self) -> str:
        quoted = '"""' + self.script.replace("\\", "\\\\") + '"""' if '"""' not in self.script else repr(self.script)
        if self.script.endswith('"'):
            quoted = repr(self.script)
        parts = [f"    script={quoted},"]
        for name in ("variables", "uses", "tables"):
            value = getattr(self, name)
            if value:
                parts.append(f"    {name}={value!r},")
        return "\n".join(["ProgramCase(", *parts, ")"])
