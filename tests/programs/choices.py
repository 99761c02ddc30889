"""Decisions from bytes: small bytes mean simple decisions, so that Hypothesis shrinks a program by lowering bytes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


class Choices:
    """Reads one byte per decision; when the bytes are used up every decision is the simplest one."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.used = 0

    def below(self, number: int) -> int:
        """A number from 0 to `number` - 1, at most 256 different ones."""
        byte = self.data[self.used] if self.used < len(self.data) else 0
        self.used += 1
        return byte * number // 256

    def chance(self, percent: int) -> bool:
        """True in `percent` of 100 cases; False is the simple decision."""
        return self.below(100) >= 100 - percent

    def pick(self, options: Sequence[T]) -> T:
        """One of the options; the first is the simplest."""
        return options[self.below(len(options))]

    def weighted(self, *options: tuple[int, T]) -> T:
        """One of the options by its weight; the weights add up to at most 256. The first is the simplest."""
        place = self.below(sum(weight for weight, _ in options))
        for weight, option in options:
            place -= weight
            if place < 0:
                return option
        raise AssertionError(options)

    def some(self, options: Sequence[T], least: int, most: int) -> list[T]:
        """Between `least` and `most` options, repetitions allowed."""
        return [self.pick(options) for _ in range(least + self.below(most - least + 1))]

    def shuffled(self, items: list[T]) -> list[T]:
        rest, result = list(items), []
        while rest:
            result.append(rest.pop(self.below(len(rest))))
        return result
