"""The SQL dialects that a lowered query can be printed in, one row each."""

from __future__ import annotations

from dataclasses import dataclass

from sqlglot import exp


@dataclass(frozen=True, slots=True)
class Dialect:
    """A dialect by its name in sqlglot. User names keep their case; lines are indented by two blanks."""

    name: str

    def print(self, tree: exp.Expr) -> str:
        return tree.sql(self.name, pretty=True, normalize_functions=False)


SQLITE = Dialect("sqlite")
