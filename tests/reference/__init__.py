"""The reference: a slow, obvious evaluator of SelectScript that judges the other two.

Read it beside the language page. `values` and `functions` are sections 2 and 3, `sight` is section 4,
`evaluator` the expressions of section 3 and the statements, `queries` section 5, `search` section 6.
Nothing is clever: trees are walked again for every row, every function is called at every occurrence,
members are looked for one by one, and names are looked up when they are read.
"""

from .evaluator import Reference
from .values import Failure

__all__ = ["Failure", "Reference"]
