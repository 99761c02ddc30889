"""Whether other processes are worth it: what calls cost here, and how many of them go together.

To hand a call to another process and to take back its result costs 10 to 15 us, which includes finding it beforehand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from typing import Any

from ss2sql.records import dataclass
from ss2sql.runtime.workers.sending import Kept, Sent

SAMPLES = 3  # calls that are made here, to see what they cost
LONG = 0.01  # seconds of a call that is sample enough by itself
CHEAP = 50e-6  # seconds of a call below which it stays here
START = 0.05  # seconds of work before processes are started, which takes longer if the user's modules are large
LEAST = 0.001  # seconds of work that are worth a round of messages
FEWEST = 2  # calls that are worth it
BATCH = 0.01  # seconds of work for one message
MOST = 1_000  # calls of one block: what is known beforehand stays in memory until the block is done


@dataclass(slots=True)
class Timed:
    """A function of the user in one run: what its calls have cost, and which of them wait to be made elsewhere.

    `sent` is what other processes get, or why they cannot have it.
    """

    name: str
    function: Callable[..., Any]
    sent: Sent | Kept
    calls: int = 0
    seconds: float = 0.0
    waiting: list[bytes] = field(default_factory=list)

    def add(self, calls: int, seconds: float) -> None:
        """Takes note of what calls have cost."""
        self.calls += calls
        self.seconds += seconds

    @property
    def cost(self) -> float:
        """Seconds of one call."""
        return self.seconds / self.calls if self.calls else 0.0

    @property
    def is_known(self) -> bool:
        """Whether enough calls were made to say what one costs."""
        return self.calls >= SAMPLES or self.seconds >= LONG

    @property
    def is_shared(self) -> bool:
        """Whether other processes get calls of it."""
        return isinstance(self.sent, Sent) and self.is_known and self.cost >= CHEAP

    @property
    def may_be_shared(self) -> bool:
        """The same, or it is too early to say."""
        return isinstance(self.sent, Sent) and (self.cost >= CHEAP or not self.is_known)

    @property
    def work(self) -> float:
        """Seconds of the calls that wait."""
        return len(self.waiting) * self.cost

    def batches(self, workers: int) -> list[list[bytes]]:
        """The calls that wait, as many together as make a message worth while and leave something for every worker."""
        size = max(1, min(int(BATCH / max(self.cost, 1e-9)), -(-len(self.waiting) // workers)))
        found = [self.waiting[at : at + size] for at in range(0, len(self.waiting), size)]
        self.waiting = []
        return found
