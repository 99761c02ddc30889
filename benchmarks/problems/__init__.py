"""The problems that run.py measures, one file per subject."""

from __future__ import annotations

from problems import (
    arrays,
    chain,
    compiling,
    grid,
    hanoi,
    hierarchy,
    joins,
    jugs,
    map,
    memorize,
    navigation,
    nested,
    particles,
    plans,
    puzzle,
    reach,
    worlds,
)
from problems.base import Problem

SUBJECTS = (
    plans, hanoi, nested, map, puzzle, jugs, grid, memorize, reach, hierarchy, joins, particles, worlds, navigation,
    chain, arrays, compiling,
)  # fmt: skip
PROBLEMS: dict[str, Problem] = {problem.name: problem for subject in SUBJECTS for problem in subject.PROBLEMS}

__all__ = ["PROBLEMS", "SUBJECTS", "Problem"]
