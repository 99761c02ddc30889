"""The tables and functions of simulators, as their adapters declare them."""

from __future__ import annotations

from inspect import signature

from writing import sentence, table

from ss2sql.session.descriptions import describe_table_columns
from ss2sql.vtables.attached_worlds import AttachedWorld, AttachedWorldTable
from ss2sql.vtables.contract import World


def world(kind: type[World]) -> str:
    """The tables and functions of a simulator, as they are declared now. It need not be installed."""
    bare = kind.__new__(kind)
    World.__init__(bare, None)  # what a simulator's own __init__ does would need the simulator
    return declared(bare)


def declared(world: World) -> str:
    """The same of a world."""
    attached = AttachedWorld("space", world, lambda name, table: name)
    return "\n".join([*map(_table, attached.tables.values()), _functions(attached)])


def _table(attached: AttachedWorldTable) -> str:
    schema = attached.schema
    title = f"space.{schema.signature}" if schema.parameters else attached.title
    head = f"### `FROM {title}`\n\n{sentence(attached.table.text)}"
    if schema.walked is not None:
        return f"{head} The columns are those of `{schema.walked.name}`.\n"
    rows = (
        (f"`{name}`", kind.replace("|", "or"), unit, used and f"`{used}`", text)
        for name, kind, unit, used, text in describe_table_columns(attached)
    )
    return f"{head}\n\n{table('column | type | unit | filter | meaning', rows)}\n"


def _functions(attached: AttachedWorld) -> str:
    rows = []
    for name, (method, volatility) in sorted(attached.functions.items()):
        parameters = ", ".join(
            one.name if one.default is one.empty else f"{one.name}={one.default!r}"
            for one in signature(method).parameters.values()
        )
        rows.append((f"`{name}({parameters})`", volatility, " ".join((method.__doc__ or "").split())))
    return f"### Functions\n\n{table('function | volatility | result', rows)}\n"
