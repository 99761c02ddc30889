"""Python's objects as tables: adapters of simulators, frames and other sources, and what a query reads of them.

contract is what an adapter declares, and which object has which adapter; schema checks it; attached_worlds is what a
session makes of it. reading is what one query reads. body_functions serves all simulators.
"""

from __future__ import annotations

from ss2sql.vtables.contract import Column as Column
from ss2sql.vtables.contract import Element as Element
from ss2sql.vtables.contract import Gone as Gone
from ss2sql.vtables.contract import Table as Table
from ss2sql.vtables.contract import TableFunction as TableFunction
from ss2sql.vtables.contract import Where as Where
from ss2sql.vtables.contract import World as World
from ss2sql.vtables.contract import function as function
from ss2sql.vtables.contract import register_world as register_world
