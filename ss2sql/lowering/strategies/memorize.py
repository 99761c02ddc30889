"""MEMORIZE: the graph of rows is built first, then its paths without a repeated row are listed, shortest first."""

from ss2sql.lowering.strategies.base import Guard

GUARD = Guard(
    "memorize",
    "MEMORIZE",
    None,
    "enter",
    False,
    "Every path without a repeated row up to the bound, shortest first.",
)
