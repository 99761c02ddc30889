"""The problems that run.py measures: scripts with the same work written by hand. One file per problem."""

from __future__ import annotations

from problems import chain, compiling, hanoi
from problems.base import Compiling, Problem

RUNS: tuple[Problem, ...] = (*hanoi.PROBLEMS, *chain.PROBLEMS)
COMPILES: tuple[Compiling, ...] = compiling.PROBLEMS

__all__ = ["COMPILES", "RUNS", "Compiling", "Problem"]
