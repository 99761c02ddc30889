"""Random programs whose answers all evaluators must agree on.

`programs()` is a Hypothesis strategy of `ProgramCase`. Its parts, in order of control flow: `case` is the program
with its variables, functions and tables, `choices` turns drawn bytes into decisions, `library` holds the Python
functions, `expressions` writes expressions, `flat` queries, `searches` hierarchical queries, `scripts` whole
programs; `drawn` says how many are drawn, `features` reports what a script uses.

`joins` writes joins, `hierarchies` searches over edges, `failing` queries in which almost every part may fail.
"""

from .case import ProgramCase
from .features import features
from .scripts import programs

__all__ = ["ProgramCase", "features", "programs"]
