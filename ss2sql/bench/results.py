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
    """The result of one strategy on one engine.

    `seconds` are those of its runs, `missing` the reason why there are none. `answer` is its answer in a few words:
    `same` if it equals that of the script as written, in any order, `forbidden` if the language forbids it. `paths` is
    None for statements that are no search. `steps` and `calls` are those of one run.
    """

    strategy: str
    engine: str
    seconds: list[float] = field(default_factory=list)
    compile_seconds: float | None = None
    paths: int | None = None
    rows: int | None = None
    steps: int = 0
    calls: dict[str, int] = field(default_factory=dict)
    memory: int | None = None
    answer: str = ""
    same: bool = False
    forbidden: bool = False
    missing: str | None = None

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
