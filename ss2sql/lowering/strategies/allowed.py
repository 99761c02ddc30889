"""No guard: rows may repeat."""

from ss2sql.lowering.strategies.base import Guard

GUARD = Guard("allowed", "", None, "enter", True, "Every path, cycles included.")
