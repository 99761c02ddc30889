"""How many random programs a test tries, and how Hypothesis draws them.

`SS2SQL_PROGRAMS` sets the number of programs of each kind, 40 without it: `make test-slow` tries 1,000, `make nightly`
20,000. `SS2SQL_SEED` draws others.
"""

import os

from hypothesis import HealthCheck, Phase, settings

FEWEST = 40
PROGRAMS = int(os.environ.get("SS2SQL_PROGRAMS", FEWEST))
assert PROGRAMS > 0, "SS2SQL_PROGRAMS sets how many programs are tried: not none"
SEED = int(os.environ.get("SS2SQL_SEED", "2015"))


def amount(share: float = 1.0) -> int:
    """How many programs of a kind are tried: a share of all for a kind that takes long, but not below 40."""
    return max(min(PROGRAMS, FEWEST), int(PROGRAMS * share))


def drawn(count: int, *, shrunk: bool = True) -> settings:
    """So many programs, however long they take, of which none is kept; one that fails is `shrunk`, or shown as is."""
    phases = tuple(Phase) if shrunk else (Phase.generate,)
    return settings(
        max_examples=count, deadline=None, database=None, phases=phases, suppress_health_check=list(HealthCheck)
    )
