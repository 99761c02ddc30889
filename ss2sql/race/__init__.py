"""`ss2sql bench`: the same search by every engine and strategy, timed, and its answers compared.

race/heats.py finds the searches of a script and runs them, race/lineup.py lists the strategies, race/timing.py runs one
statement. race/jury.py compares the answers by the laws of race/promises.py; ss2sql/told.py decides whether equal rows
are equal steps. race/cells.py has the results, race/sheet.py and race/picture.py show them.
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
