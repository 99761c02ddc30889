"""How Hypothesis draws many random programs."""

from hypothesis import HealthCheck, Phase, settings


def drawn(count: int, *, shrunk: bool = True) -> settings:
    """So many programs, however long they take, of which none is kept; one that fails is `shrunk`, or shown as is."""
    phases = tuple(Phase) if shrunk else (Phase.generate,)
    return settings(
        max_examples=count, deadline=None, database=None, phases=phases, suppress_health_check=list(HealthCheck)
    )
