"""Names of columns that no database takes for something else."""

from __future__ import annotations

import re

import apsw

PLAIN_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
# What is reserved in SQLite, and beside it in DuckDB, Spark and PostgreSQL.
_RESERVED_ELSEWHERE = (
    "analyse anti any array asymmetric at authorization binary both cast client column concurrently cube date "
    "describe false fetch for force freeze function grant ilike initially install interval lambda lateral leading "
    "leave localtime localtimestamp lock map merge minus native nothing only out overlaps percentile pivot placing "
    "position positional qualify range revoke rollup semi session_user show similar some struct summarize symmetric "
    "system table tablesample time timestamp top trailing true try_cast unique unknown unpivot user using values "
    "variable variadic verbose window within"
)
RESERVED = frozenset(word.lower() for word in apsw.keywords).union(_RESERVED_ELSEWHERE.split())
OWN_COLUMNS = (
    *("step", "parent", "place", "depth", "goal", "goes_on", "nth", "previous", "distance", "total"),
    *("trail", "flags", "nth_to_row", "part", "nth_of_part"),
)


class ColumnNames:
    """The names of the columns of some tables."""

    def __init__(self) -> None:
        self.taken = set(OWN_COLUMNS)

    def claim(self, wanted: str, otherwise: str) -> str:
        """The wanted name where it can stand without quotes and is not taken, which goes without case; else another."""
        base = wanted.lower() if is_plain_name(wanted) else otherwise
        name, count = base, 1
        while name in self.taken:
            count += 1
            name = f"{base}_{count}"
        self.taken.add(name)
        return name


def is_plain_name(name: str) -> bool:
    """Whether the name can stand without quotes in every database."""
    return bool(PLAIN_NAME.match(name)) and name.isascii() and name.lower() not in RESERVED
