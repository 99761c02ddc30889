"""SQL for Pygments as it runs here: SQLite's parameters are `:name`, those of DuckDB and Spark `$name`."""

from __future__ import annotations

from typing import ClassVar

from pygments.lexers.sql import SqlLexer
from pygments.token import Name


class BoundSqlLexer(SqlLexer):
    """SQL with names for the values that are bound to it."""

    name = "SQL with parameters"
    aliases: ClassVar = []
    filenames: ClassVar = []
    mimetypes: ClassVar = []
    tokens: ClassVar = {**SqlLexer.tokens, "root": [(r"[:$][a-zA-Z_]\w*", Name.Variable), *SqlLexer.tokens["root"]]}
