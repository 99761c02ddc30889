"""What a run of random programs came to: one line, the share of every feature, and both as JSON."""

from __future__ import annotations

import json
import textwrap
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from .features import NAMED, features


@dataclass
class Score:
    """Counts programs, what they use, and how often the evaluators differed."""

    seed: int
    programs: int = 0
    differences: int = 0
    notes: Counter[str] = field(default_factory=Counter)
    found: Counter[str] = field(default_factory=Counter)
    began: float = field(default_factory=time.perf_counter)

    def count(self, script: str, *notes: str) -> None:
        """One more program, and what is worth telling about it."""
        self.programs += 1
        self.notes.update(notes)
        self.found.update(features(script))

    @property
    def shares(self) -> dict[str, float]:
        """How many of all programs have a feature, in percent, the rarest first."""
        shares = {name: round(100 * self.found[name] / max(self.programs, 1), 1) for name in NAMED}
        return dict(sorted(shares.items(), key=lambda pair: pair[1]))

    @property
    def line(self) -> str:
        """The score in one line."""
        rarest, share = next(iter(self.shares.items()))
        notes = "".join(f", {count:,} {note}" for note, count in sorted(self.notes.items()))
        return (
            f"score: {self.programs:,} programs, seed {self.seed}, {self.differences} differences, "
            f"{time.perf_counter() - self.began:.0f} s{notes}; {len(NAMED)} features, "
            f"the rarest, {rarest}, in {share} %"
        )

    def text(self) -> str:
        """The line, and below it the share of every feature."""
        shares = ", ".join(f"{name} {share:.0f}" for name, share in self.shares.items())
        return "\n".join([self.line, *textwrap.wrap(f"percent: {shares}", 118, subsequent_indent="  ")])

    def write(self, path: Path) -> None:
        """The same as JSON."""
        path.parent.mkdir(exist_ok=True)
        content = {
            "programs": self.programs,
            "seed": self.seed,
            "differences": self.differences,
            "seconds": round(time.perf_counter() - self.began, 1),
            **self.notes,
            "features": self.shares,
        }
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
