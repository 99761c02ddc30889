"""SQL text with what it needs beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ss2sql.lowering.sql_query import ListTable


class Sql(str):
    """SQL text with what it needs beside it.

    `parameters` are the values bound to its `:names`, `statements` the texts of the script's statements one
    by one, `modules` the virtual tables that it reads, with the columns of their elements.
    """

    parameters: Mapping[str, Any]
    statements: tuple[Sql, ...]
    modules: Mapping[str, ListTable]

    def __new__(
        cls,
        text: str,
        parameters: Mapping[str, Any] | None = None,
        statements: tuple[Sql, ...] = (),
        modules: Mapping[str, ListTable] | None = None,
    ) -> Sql:
        self = super().__new__(cls, text)
        self.parameters = dict(parameters or {})
        self.statements = statements or (self,)
        self.modules = dict(modules or {})
        return self


def join_sql(texts: Sequence[Sql]) -> Sql:
    """The texts of several statements as one, each with its own parameters in `statements`."""
    if len(texts) == 1:
        return texts[0]
    parameters = {name: value for text in texts for name, value in text.parameters.items()}
    modules = {name: columns for text in texts for name, columns in text.modules.items()}
    joined = "\n\n".join(text if text.startswith("--") else f"{text};" for text in texts)
    return Sql(joined, parameters, tuple(texts), modules)
