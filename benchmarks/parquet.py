"""Which engine for a query over the rows of a Parquet file: seconds and memory of one that filters, groups and sorts.

    python benchmarks/parquet.py [--rows 100000,1000000,10000000] [--engines 'native;database;duckdb'] [--memory 2GB]

Each run has a process of its own. Prints a table for Markdown.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path

from apart import run_apart, tell

SCRIPT = """
    SELECT kind, count(*), sum(amount), max(price) FROM sales WHERE price > 5
    GROUP BY kind ORDER BY sum(amount) DESC LIMIT 5 AS rows
"""
SALES = """
    SELECT i AS id, 'kind ' || (i * 7919) % 100 AS kind, (i * 31) % 1000 AS amount, (i % 97) / 8.0::DOUBLE AS price
    FROM range({rows}) AS r(i)
"""
SECONDS = 900


def measure(engine: str, file: str, memory: str) -> None:
    """Runs the query and prints what it took."""
    import duckdb

    import ss2sql

    own = duckdb.connect(config={"memory_limit": memory, "threads": 1})
    with ss2sql.connect(engine=engine, session=own) as ss:  # type: ignore[arg-type]
        begin, busy = time.perf_counter(), time.process_time()
        ss.attach("sales", file)
        result = ss.run(SCRIPT)
        took = time.perf_counter() - begin, time.process_time() - busy
        assert result.engine == engine
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        tell(value=result.value, wall=took[0], cpu=took[1], peak=peak)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", default="100000,1000000,10000000")
    parser.add_argument("--engines", default="native;database;duckdb")
    parser.add_argument("--memory", default="2GB")
    parser.add_argument("--one", nargs=2, metavar=("ENGINE", "FILE"))
    options = parser.parse_args()
    if options.one:
        measure(*options.one, options.memory)
        return
    import duckdb

    engines = options.engines.split(";")
    print("| rows | " + " | ".join(engines) + " |\n|--:|" + "--:|" * len(engines))
    for rows in map(int, options.rows.split(",")):
        with tempfile.TemporaryDirectory(prefix="ss2sql-") as folder:
            file = str(Path(folder) / "sales.parquet")
            with duckdb.connect() as connection:
                connection.sql(SALES.format(rows=rows)).write_parquet(file)
            arguments = ("--memory", options.memory, "--one")
            found = [run_apart(__file__, (*arguments, engine, file), SECONDS) for engine in engines]
        values = [told["value"] for _, told in found if told is not None]
        assert all(value == values[0] for value in values)
        print(f"| {rows:,} | " + " | ".join(text for text, _ in found) + " |", flush=True)


if __name__ == "__main__":
    main()
