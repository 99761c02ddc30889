"""What two runs of a script may rightly differ in."""

from __future__ import annotations

from ss2sql import plan
from ss2sql.walk import walk


def whims(query: plan.Query) -> str | None:
    """Why two runs of a query may give two answers that are both right; None where they may not."""
    for node in walk(query):
        match node:
            case plan.Call(function=function) if function.volatility == "volatile":
                return f"{function.name} is volatile"
            case plan.Assign(name=name) | plan.TemporalAssign(name=name):
                return f"it assigns {name}"
            case plan.Eval():
                return "it reads a text with eval"
    return None
