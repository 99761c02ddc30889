"""The settings and the results of a comparison."""

from __future__ import annotations

from dataclasses import asdict, field
from statistics import median
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.session.engines import Engine


@dataclass(frozen=True, slots=True)
class BenchRules:
    """The settings: engines, strategies, the number of runs after a first one, and a limit in seconds.

    `strategies` are options of CONNECT BY as a user writes them; "all" means all that suit the search. With `memory`
    each runs once more, slowly, to measure its memory.
    """

    engines: tuple[Engine, ...] = ("database", "native")
    strategies: tuple[str, ...] = ("all",)
    repeat: int = 5
    timeout: float = 10.0
    memory: bool = False


@dataclass(slots=True)
class BenchResult:
    """The result of one strategy on one engine."""

    strategy: str
    engine: str
    seconds: list[float] = field(default_factory=list)  # of its runs
    compile_seconds: float | None = None
    paths: int | None = None  # None for statements that are no search
    rows: int | None = None
    steps: int = 0  # of one run
    calls: dict[str, int] = field(default_factory=dict)  # of one run
    memory: int | None = None
    answer: str = ""  # in a few words
    same: bool = False  # equals the answer of the script as written, in any order
    forbidden: bool = False  # the language forbids the answer
    missing: str | None = None  # the reason why there are no runs

    @property
    def name(self) -> str:
        return f"{self.strategy} in {self.engine}" if self.strategy else self.engine

    @property
    def best(self) -> float | None:
        return min(self.seconds, default=None)

    @property
    def middle(self) -> float | None:
        return median(self.seconds) if self.seconds else None

    def as_dict(self) -> dict[str, Any]:
        return asdict(self) | {"best": self.best, "median": self.middle}
