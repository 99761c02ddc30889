"""A Python function in a query that joins tables of DuckDB: as a function of DuckDB, by hand, and as ss2sql does it.

    python benchmarks/python_functions.py [--rows 100000,1000000]

Each run has a process of its own. Prints a table for Markdown: seconds of the processor, and calls of the function. It
is one of pure Python, with 7 times as many arguments as there are different values. By hand it is declared to have
side effects; without that, DuckDB may call it more often than once for a row.
"""

from __future__ import annotations

import argparse
import resource
import time
from typing import Any

from apart import run_apart, tell

TABLES = """
    CREATE TABLE sales AS SELECT i AS id, i % 1000 AS kind, i // 7 AS code FROM range({rows}) AS r(i);
    CREATE TABLE kinds AS SELECT i AS kind, i % 10 AS shelf FROM range(1000) AS r(i);
"""
BY_HAND = """
    SELECT kinds.shelf, count(*), max(sales.id) FROM sales JOIN kinds ON sales.kind = kinds.kind
    WHERE kinds.shelf < 5 AND digits(sales.code) > 20 GROUP BY kinds.shelf ORDER BY min(sales.rowid)
"""
SCRIPT = """
    SELECT kinds.shelf, count(*), max(sales.id) FROM sales, kinds
    WHERE sales.kind == kinds.kind AND kinds.shelf < 5 AND digits(sales.code) > 20 GROUP BY kinds.shelf AS rows
"""
WAYS = ("by hand", "native", "database", "lists, native", "lists, database")
SECONDS = 300


def measure(way: str, rows: int) -> None:
    """Runs the query and prints what it took."""
    import duckdb

    import ss2sql

    calls = 0

    def digits(number: int) -> int:
        nonlocal calls
        calls += 1
        return sum(map(int, str(number)))

    own = duckdb.connect(config={"threads": 1})
    own.execute(TABLES.format(rows=rows))
    values: dict[str, Any] = {}
    if way.startswith("lists"):
        for name in ("sales", "kinds"):
            values[name] = own.execute(f"FROM {name}").to_arrow_table().to_pylist()
    with ss2sql.connect(engine="duckdb", session=own) as ss:
        ss.function("digits", digits, volatility="immutable")
        own.create_function("digits", digits, ["BIGINT"], "BIGINT", side_effects=True)  # type: ignore[call-overload]
        for name, value in values.items():
            ss.attach(name, value)
        busy = time.process_time()
        engine: Any = way.removeprefix("lists, ")
        value = own.execute(BY_HAND).fetchall() if way == "by hand" else ss.run(SCRIPT, engine=engine).value
        cpu, peak = time.process_time() - busy, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        tell(value=value, cpu=cpu, peak=peak, calls=calls)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", default="100000,1000000")
    parser.add_argument("--one", nargs=2, metavar=("WAY", "ROWS"))
    options = parser.parse_args()
    if options.one:
        measure(options.one[0], int(options.one[1]))
        return
    print("| rows | " + " | ".join(WAYS) + " |\n|--:|" + "--:|" * len(WAYS))
    for rows in options.rows.split(","):
        found = [run_apart(__file__, ("--one", way, rows), SECONDS) for way in WAYS]
        values = [told["value"] for _, told in found if told is not None]
        assert all(value == values[0] for value in values)
        cells = [f"{told['cpu']:.2f} s, {told['calls']:,} calls" if told else text for text, told in found]
        print(f"| {int(rows):,} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
