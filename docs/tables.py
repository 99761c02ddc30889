"""The tables of pages that are made of the code: functions, representations, strategies, rewrites, worlds.

A page asks for a table with `<!-- written by docs/generate.py: NAME -->`, and it stands up to the next
`<!-- end of what is written -->`. NAME is one of `TABLES`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from inspect import getdoc, signature
from pathlib import Path
from typing import Any

from command_tables import commands
from function_tables import GROUPS, functions
from grammar import grammar
from house import house
from walk import PACKAGE, forms, walk
from world_tables import declared, world
from writing import first, table

from ss2sql.frontend.resolve.query_clauses import SYNONYMS
from ss2sql.lowering.strategies import ORDERS, REPEAT_RULES, RepeatRule
from ss2sql.lowering.unsupported import RULES
from ss2sql.runtime.representations.shape import REPRESENTATIONS
from ss2sql.vtables.mujoco import MuJoCoWorld
from ss2sql.vtables.ode import OdeWorld
from ss2sql.vtables.openrave import OpenRaveWorld
from ss2sql.vtables.pybullet import PyBulletWorld

BLOCK = re.compile(
    r"(<!-- written by docs/generate\.py: ([\w ]+) -->\n).*?(<!-- end of what is written -->)", re.DOTALL
)


def pages() -> list[Path]:
    """The pages that ask for tables."""
    found = [PACKAGE / "ARCHITECTURE.md", *sorted(Path(__file__).parent.rglob("*.md"))]
    return [page for page in found if "_build" not in page.parts and BLOCK.search(page.read_text("utf-8"))]


def filled(page: str) -> str:
    """The page with the tables that it asks for, as they are now."""
    return BLOCK.sub(lambda block: f"{block[1]}\n{TABLES[block[2]]().strip()}\n\n{block[3]}", page)


# --- representations and strategies --------------------------------------------------------------------


def representations() -> str:
    """What AS can name, of the language and of worlds of PyBullet."""
    return table("AS | result", _representations())


def _representations() -> Iterator[tuple[str, str]]:
    for name, function in REPRESENTATIONS.items():
        names = [name, *(short for short, long in SYNONYMS.items() if long == name)]
        yield ", ".join(f"`{each}{_arguments(function)}`" for each in names), first(getdoc(function) or "")
    for name, method in PyBulletWorld.representations.items():
        function = getattr(PyBulletWorld, method)
        yield f"`{name}{_arguments(function)}`", f"{first(getdoc(function) or '')} (PyBullet)"


def _arguments(function: Callable[..., Any]) -> str:
    names = [name for name in signature(function).parameters if name not in ("self", "table")]
    return f"({', '.join(names)})" if names else ""


def orders() -> str:
    """The orders of searches."""
    rows = (
        (f"`{order.keyword}`", ", ".join(f"`{name}{' DESC' * falls}`" for name, falls in order.queue), order.promise)
        for order in ORDERS.values()
    )
    return table("order | `ORDER BY` of the queue | what you can rely on", rows)


def guards() -> str:
    """What happens to rows that repeat."""
    return table("rule for rows that repeat | runs | what you get", map(_guard, REPEAT_RULES.values()))


def _guard(guard: RepeatRule) -> tuple[str, str, str]:
    keyword = f"`{guard.keyword}`" if guard.keyword else "none"
    return keyword, "on SQLite" if guard.lowered else "natively", guard.promise


def native_reasons() -> str:
    """What runs natively, and what to do where that is not wanted."""
    return table("what | cure", ((rule.reason, rule.cure) for rule in RULES))


# --- measured ------------------------------------------------------------------------------------------

# The problems of benchmarks.md that say what a strategy costs.
MEASURED = {
    "depth first": "hanoi-default hierarchy chain",
    "breadth first": "chain-breadth",
    "no cycle": "hanoi-nocycle",
    "unique": "reach reach-noindex hanoi-unique puzzle jugs chain-unique",
    "cost": "grid-cost grid-cost-table grid-cost-function",
    "heuristic": "grid-astar grid-astar-table grid-astar-function",
    "memorize": "memorize-robot memorize-hanoi memorize-one",
    "flat queries": "nested-moves map-1 colouring particles-mean particles-mean-table particles-cells "
    "particles-cells-table particles-best particles-best-table",
    "worlds": "worlds-scan worlds-lookup worlds-near",
}  # fmt: skip


def figures(problems: str) -> str:
    """What benchmarks.md says of the problems: the time of Python by hand, and the engines as multiples of it."""
    page = (Path(__file__).parent / "benchmarks.md").read_text("utf-8")
    asked = {problem: text for problem, text, *_ in _rows_under(page, "| problem | what it asks |")}
    shown, before = [], ""
    for problem, *numbers in _rows_under(page, "| problem | size | Python, ms | database | native |"):
        if problem in problems.split():
            shown.append(("" if problem == before else f"`{problem}`: {asked[problem]}", *numbers[:4]))
            before = problem
    return table("problem | size | Python by hand, ms | database | native", shown, numbers=3)


def _rows_under(page: str, head: str) -> list[list[str]]:
    """The cells of a table of Markdown."""
    body = page.split(f"\n{head}", 1)[1].split("\n\n")[0]
    return [[cell.strip() for cell in line.strip("|").split(" |")] for line in body.splitlines()[2:]]


TABLES: dict[str, Callable[[], str]] = {
    **{f"functions of {group}": lambda group=group: functions(group) for group in GROUPS},  # type: ignore[misc]
    "commands": commands,
    "grammar": grammar,
    "representations": representations,
    "orders": orders,
    "guards": guards,
    "native": native_reasons,
    "walk": walk,
    "house": house,
    "forms": forms,
    **{f"figures of {name}": lambda names=names: figures(names) for name, names in MEASURED.items()},  # type: ignore[misc]
    "pybullet": lambda: declared(PyBulletWorld(0)),
    "mujoco": lambda: world(MuJoCoWorld),
    "ode": lambda: world(OdeWorld),
    "openrave": lambda: world(OpenRaveWorld),
}
