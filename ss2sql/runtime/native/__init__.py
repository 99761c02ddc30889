"""The native executor: every plan as Python code.

compiled.py is what the rest of the package sees. It examines the plan (facts.py) and compiles it into one
`Unit` (unit.py): builder.py the queries, flat.py and hunt.py what finds their results, loops.py their
sources, lookups.py equalities that need no walk over all elements, call_code.py calls of the user's functions, which
calls.py makes, expressions.py everything else, with Python's own operators where forms.py allows them. The code
is made as syntax trees (pen.py) that carry the positions of the script, so that locate.py finds the place of
any exception. When it runs, tasks.py and endings.py do what follows after the results were found, searches/ decides
which step of a search comes next, options.py checks the values of options, texts.py compiles what `eval` reads,
and pace.py looks at the clock. deep.py makes room for deep nesting.
"""

from __future__ import annotations

from ss2sql.runtime.native.compiled import NativeQuery as NativeQuery
from ss2sql.runtime.native.compiled import compile_statement as compile_statement
