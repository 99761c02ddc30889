"""The built-in functions, each with an example whose value is computed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO

from writing import table

import ss2sql
from ss2sql.runtime.builtins import BUILTINS

# A script for each function, whose value the table shows. Those without a value worth showing have None.
EXAMPLES: dict[str, str | None] = {
    "add": "[2 + 3, 'ab' + 'c', [1] + [2]]", "sub": "5 - 7", "mul": "1.5 * 4", "div": "7 / 2",
    "mod": "[-7 % 3, 7 % -3]",
    "pow": "[2 ^ 10, 2 ^ -1]", "neg": "-(3)", "lt": "[1 < 2, 'a' < 'B', [1, 2] < [1, 3]]", "le": "2 <= 2",
    "eq": "[1 == 1.0, [1] == [1.0], '1' == 1]", "ne": "None != 0", "ge": "1 >= 2", "gt": "'b' > 'a'",
    "in": "[2 IN [1, 2], 'b' IN 'abc']", "not_in": "3 NOT IN [1, 2]", "item": "[[4, 5][-1], 'abc'[0]]",
    "slice": "[[1, 2, 3][1:], 'abcd'[:2]]", "len": "[len([4, 5]), len('abc')]", "count": "count([4, None, 5])",
    "sum": "[sum([1, 2.5]), sum([])]", "min": "[min([3, 1, 2]), min(3, 1)]", "max": "max(['a', 'b'])",
    "average": "average([1, 2, 6])", "uniq": "uniq([2, 1, 2, 1.0])",
    "sorted": "[sorted([2, 3, 1]), sorted([2, 3, 1], True)]",
    "zip": "zip([1, 2], ['a', 'b'])", "range": "[range(3), range(1, 3), range(6, 0, -2)]", "abs": "abs(-3)",
    "round": "[round(2.567), round(2.567, 1)]", "sqrt": "sqrt(2.25)", "str": "str([1, 2.0])",
    "int": "[int('12'), int(3.9)]", "float": "[float('1e3'), float(2)]",
    "distance": "[distance([0, 0], [3, 4]), distance(1, 5)]",
    "norm": "norm([3, 4])", "print": "print('n is', 1 + 1)", "help": "help('len')", "var": "[n = 3, var('n')]",
    "clear": "[n = 3, clear()]", "getTime": None, "eval": "eval('1 + 1')",
    "to": "SELECT to(this * 2, double) FROM [1, 2] AS dict",
}  # fmt: skip
GROUPS = {
    "operators": "add sub mul div mod pow neg lt le eq ne ge gt in not_in item slice",
    "lists": "len count sum min max average uniq sorted zip range",
    "numbers": "abs round sqrt int float distance norm",
    "text": "str",
    "session": "print help var clear getTime eval to",
}


def functions(group: str) -> str:
    """The built-in functions of a group: how they are called, what they do, an example."""
    return table("function | | example | gives", (_function(name) for name in GROUPS[group].split()))


def _function(name: str) -> Iterator[str]:
    entry, example = BUILTINS[name], EXAMPLES[name]
    yield f"`{name}`"
    yield entry.text.replace("*", "\\*")
    yield f"`{example}`" if example else ""
    yield f"`{_value(example)}`" if example else ""


def _value(script: str) -> str:
    with ss2sql.connect() as session, redirect_stdout(StringIO()):
        return repr(session.eval(f"{script};"))
