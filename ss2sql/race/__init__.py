"""The race of `ss2sql bench`: the same search by every engine and strategy, timed, and its answers compared.

`heats` finds the statements that are raced and runs them, `lineup` says by which strategies, `timing` runs one. `jury`
compares the answers, by what `promises` knows that they owe each other; `../told.py` reads from the plan what rows tell
of a state. `cells` holds what came out, `sheet` and `picture` show it.
"""

from __future__ import annotations

from ss2sql.race.cells import Cell as Cell
from ss2sql.race.cells import Rules as Rules
from ss2sql.race.heats import Heat as Heat
from ss2sql.race.heats import heats as heats
from ss2sql.race.lineup import strategy_of as strategy_of
from ss2sql.race.picture import draw as draw
from ss2sql.race.sheet import outcome as outcome
from ss2sql.race.sheet import show as show
