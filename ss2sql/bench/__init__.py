"""The race of `ss2sql bench`: the same search by every engine and strategy, timed, and its answers compared.

runs finds the statements, runs them by the strategies, and judges the answers by laws; it reports what came out.
"""

from __future__ import annotations

from ss2sql.bench.raced_strategies import parse_strategy as parse_strategy
from ss2sql.bench.runs import BenchResult as BenchResult
from ss2sql.bench.runs import BenchRules as BenchRules
from ss2sql.bench.runs import StatementRuns as StatementRuns
from ss2sql.bench.runs import collect_race_report as collect_race_report
from ss2sql.bench.runs import make_runs as make_runs
from ss2sql.bench.runs import print_runs as print_runs
