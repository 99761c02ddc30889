"""The 8-puzzle with boards as texts, whose steps can be said in SQL: all boards are searched for one that is none.

`problems/puzzle.py` has boards as lists, and looks for a way.
"""

from __future__ import annotations

BOARDS = 181_440  # that can be reached
START = "123456780"
# Where the gap can go from each place: `at` is its place, `low` and `high` the two fields that change.
SLIDES = [
    {"at": at, "low": min(at, to), "high": max(at, to)}
    for at in range(9)
    for to in (at - 3, at - 1, at + 1, at + 3)
    if 0 <= to < 9 and (abs(at - to) == 3 or at // 3 == to // 3)
]
MOVED = "board[0:s.low] + board[s.high:s.high+1] + board[s.low+1:s.high] + board[s.low:s.low+1] + board[s.high+1:9]"


def script(moved: str = MOVED) -> str:
    """The search, with what a board becomes; `slides` are SLIDES."""
    return f"""
        SELECT {moved} FROM s = slides WHERE board == "nowhere" START WITH board = "{START}"
        CONNECT BY UNIQUE board = {moved} STOP WITH board[s.at:s.at+1] != "0" AS list;
    """
