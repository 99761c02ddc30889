"""NO CYCLE: a row does not occur twice on a path."""

from ss2sql.lowering.strategies.base import Guard

GUARD = Guard("no cycle", "NO CYCLE", "on_path", "enter", True, "Every path without a repeated row.")
