"""Makes of out/bench.json a table of ratios on the terminal, out/bench.png, and with --docs docs/benchmarks.md.

python benchmarks/compare.py           # the table, and cost against size in out/bench.png
python benchmarks/compare.py --docs    # and both in the documentation
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import click
from problems import PROBLEMS, Problem
from problems.base import BASE, COMPILING, CONTENDERS, ENGINES, ON_DUCKDB, Target
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1]
OUT = ROOT / "out" / "bench.json"
PLOT = ROOT / "out" / "bench.png"
PAGE = ROOT / "docs" / "benchmarks.md"
PICTURE = ROOT / "docs" / "benchmarks.png"
BEGIN, END = "<!-- figures: written by benchmarks/compare.py -->", "<!-- end of figures -->"

Record = dict[str, Any]
HEADS = {ON_DUCKDB: "on DuckDB", "numpy": "NumPy", "sql": "SQL", "duckdb": "DuckDB", "duckdb-key": "USING KEY"}
OTHERS = tuple(name for name in CONTENDERS if name != BASE)


# --- ratios and targets -----------------------------------------------------------------------------------------


def taken(group: Iterable[Record], clock: str = "wall") -> dict[str, float]:
    """Seconds by contender, of those that gave an answer."""
    key = "cpu" if clock == "cpu" else "seconds"
    return {record["contender"]: record[key] for record in group if record["status"] in ("ok", "differs")}


def ratios(group: Sequence[Record], clock: str = "wall") -> dict[str, float]:
    """The seconds of each contender of one problem and size, divided by those of the base."""
    seconds = taken(group, clock)
    return {name: value / seconds[BASE] for name, value in seconds.items()} if seconds.get(BASE) else {}


def reached(
    target: Target, group: Sequence[Record], all_records: Sequence[Record], clock: str = "wall"
) -> float | None:
    """What the target bounds, as measured; None where it was not, or where the problem is smaller than it says.

    The other contender is one of the same problem, or the name of another problem of the same size.
    """
    if not group or group[0]["size"] < target.since:
        return None
    seconds = taken(group, clock)
    mine = seconds.get(target.contender)
    if mine is None or target.against is None:
        return mine
    other = seconds.get(target.against)
    if target.against in PROBLEMS:
        twins = [r for r in all_records if (r["problem"], r["size"]) == (target.against, group[0]["size"])]
        other = taken(twins, clock).get(target.contender)
    return mine / other if other else None


def verdict(target: Target, value: float) -> str:
    """One target as text: what it asks of whom, and whether it is met."""
    most = f"{target.most * 1000:g} ms" if target.against is None else f"{target.most:.3g}"
    against = "" if target.against in (BASE, None) else f" x {HEADS.get(target.against, target.against)}"
    whom = "" if target.contender == COMPILING else f"{target.contender} "
    return f"{whom}{most}{against} {'met' if value <= target.most else 'missed'}"


def groups(records: Sequence[Record]) -> list[list[Record]]:
    """The records of each problem and size, in the order in which they were measured."""
    return [list(group) for _, group in groupby(records, key=lambda record: (record["problem"], record["size"]))]


def line(record: Record, group: Sequence[Record], records: Sequence[Record], clock: str = "wall") -> str:
    """One record for the terminal, while it is measured."""
    start = f"{record['problem']:22} {record['size']:>9,} {record['contender']:10}"
    if "seconds" not in record:
        return f"{start} {record['status']}: {record['reason']}"
    text = f"{start} {record['seconds'] * 1000:10,.2f} ms"
    if (ratio := ratios(group, clock).get(record["contender"])) is not None:
        text += f"  ratio {ratio:7.2f}"
    for target in PROBLEMS[record["problem"]].targets:
        value = reached(target, group, records, clock)
        if target.contender == record["contender"] and value is not None:
            text += f"  target {verdict(target, value)}"
    if "compile" in record:
        text += f"  {record['steps']:,} steps, compiled in {record['compile'] * 1000:.1f} ms"
    return text if record["status"] == "ok" else f"{text}  {record['status']}: {record['reason']}"


# --- tables -----------------------------------------------------------------------------------------------------


def milliseconds(seconds: float) -> str:
    value = seconds * 1000
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def cell(record: Record | None, ratio: float | None, problem: Problem, name: str) -> str:
    """A ratio, or the word for what kept it from being measured."""
    if record is None:
        return "" if name not in problem.contenders else "not run"
    if name == ON_DUCKDB and record["status"] == "refused":
        return ""
    if record["status"] == "ok" and ratio is not None:
        return f"{ratio:,.0f}" if ratio >= 100 else f"{ratio:.2g}" if ratio < 10 else f"{ratio:.1f}"
    return str(record["status"])


def ratio_rows(records: Sequence[Record], clock: str = "wall") -> tuple[list[str], list[list[str]]]:
    """The table of ratios: one row per problem and size."""
    heads = ["problem", "size", "Python, ms", *(HEADS.get(name, name) for name in OTHERS), "target"]
    rows = []
    for group in groups(records):
        problem = PROBLEMS[group[0]["problem"]]
        if BASE not in problem.others:
            continue
        by_name, ratio = {record["contender"]: record for record in group}, ratios(group, clock)
        base, seconds = by_name.get(BASE, {"status": "not run"}), taken(group, clock).get(BASE)
        row = [problem.name, f"{group[0]['size']:,} {problem.size_is}"]
        row.append(base["status"] if seconds is None else milliseconds(seconds))
        row += [cell(by_name.get(name), ratio.get(name), problem, name) for name in OTHERS]
        found = [(target, reached(target, group, records, clock)) for target in problem.targets]
        row.append(", ".join(verdict(target, value) for target, value in found if value is not None))
        rows.append(row)
    return heads, rows


def means(records: Sequence[Record], clock: str = "wall") -> dict[str, tuple[float, int]]:
    """The geometric mean of the ratios of both engines and `auto`, each problem at its largest size; and how many."""
    largest = {group[0]["problem"]: group for group in groups(records)}
    found: dict[str, list[float]] = {"auto": [], **{name: [] for name in ENGINES}}
    for group in largest.values():
        ratio = ratios(group, clock)
        chosen = next((record["auto"] for record in group if "auto" in record), None)
        for name, engine in (("auto", chosen), *((name, name) for name in ENGINES)):
            if engine in ratio:
                found[name].append(ratio[engine])
    return {
        name: (math.exp(math.fsum(map(math.log, some)) / len(some)), len(some)) for name, some in found.items() if some
    }


def means_line(records: Sequence[Record], clock: str) -> str:
    parts = (f"{name} {mean:.2g} ({count} problems)" for name, (mean, count) in means(records, clock).items())
    return f"Geometric mean of the ratios, of each problem at its largest size: {', '.join(parts)}."


def compile_rows(records: Sequence[Record]) -> tuple[list[str], list[list[str]]]:
    """What compiling took, which no ratio contains; of a problem of several sizes the largest."""
    heads = ["script", "size", *(f"{name}{times}" for name in ENGINES for times in ("", ", first time")), "target"]
    rows: dict[Any, list[str]] = {}
    for group in groups(records):
        problem = PROBLEMS[group[0]["problem"]]
        by_name = {record["contender"]: record for record in group}
        size = f"{group[0]['size']:,} {problem.size_is}"
        if COMPILING in problem.others:
            found = [(target, reached(target, group, records)) for target in problem.targets]
            verdicts = ", ".join(verdict(target, value) for target, value in found if value is not None)
            alone = by_name[COMPILING]
            spent = milliseconds(alone["seconds"]) if "seconds" in alone else alone["status"]
            rows[problem.name, size] = [problem.name, size, spent, "", "", "", verdicts]
        elif any("compile" in record for record in group):
            spent_by = [by_name.get(name, {}).get(key) for name in ENGINES for key in ("compile", "compile_first")]
            rows[problem.name] = [problem.name, size, *("" if s is None else milliseconds(s) for s in spent_by), ""]
    return heads, list(rows.values())


def reasons(records: Sequence[Record]) -> list[str]:
    """Why there is a word and not a number, one line per reason."""
    places: dict[tuple[str, str], list[str]] = {}
    for record in records:
        if record["status"] != "ok" and (record["contender"], record["status"]) != (ON_DUCKDB, "refused"):
            place = f"{record['problem']} {record['size']:,} {record['contender']}"
            places.setdefault((record["status"], record["reason"]), []).append(place)
    return [f"{status}: {reason} ({', '.join(found)})" for (status, reason), found in places.items()]


CLOCKS = {"wall": "time by the clock", "cpu": "time of the processors, of all cores together"}


def machine_line(machine: dict[str, Any], clock: str) -> str:
    return (
        f"{machine['cpu']}, {machine['cores']} cores, Python {machine['python']}, SQLite {machine['sqlite']}, "
        f"ss2sql {machine['ss2sql']}; {CLOCKS[clock]}"
    )


def shown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    table = Table(box=None, pad_edge=False)
    for number, head in enumerate(heads):
        table.add_column(head, justify="left" if number == 0 or head == "target" else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    rule = ["---" if number == 0 or head == "target" else "--:" for number, head in enumerate(heads)]
    return "\n".join(f"| {' | '.join(row)} |" for row in (heads, rule, *rows))


# --- the plot ---------------------------------------------------------------------------------------------------

COLOURS = {
    "database": "#d62728", "native": "#ff9896", ON_DUCKDB: "#7f7f00", "python": "#000000", "sql": "#1f77b4",
    "networkx": "#2ca02c", "rustworkx": "#8c564b", "igraph": "#9467bd", "duckdb": "#e0a800", "duckdb-key": "#f5d76e",
    "numpy": "#17becf",
}  # fmt: skip
LEAST_SIZES = 3  # a curve of fewer points shows nothing


def curves(records: Sequence[Record], clock: str) -> dict[str, dict[str, list[tuple[int, float]]]]:
    """By problem and contender the points of size and milliseconds; of problems that were measured at several sizes."""
    found: dict[str, dict[str, list[tuple[int, float]]]] = {}
    for record in records:
        if record["status"] == "ok" and record["contender"] in COLOURS:
            points = found.setdefault(record["problem"], {}).setdefault(record["contender"], [])
            points.append((record["size"], taken([record], clock)[record["contender"]] * 1000))
    return {name: lines for name, lines in found.items() if len(lines.get(BASE, ())) >= LEAST_SIZES}


def draw(records: Sequence[Record], machine: dict[str, Any], clock: str, file: Path) -> bool:
    """Cost against size, both logarithmic, one field per problem. False where matplotlib is missing."""
    try:
        import matplotlib as mpl
    except ModuleNotFoundError:
        return False
    mpl.use("Agg")
    from matplotlib import pyplot
    from matplotlib.ticker import NullFormatter, NullLocator

    found = curves(records, clock)
    if not found:
        return True
    columns = min(3, len(found))
    lines = -(-len(found) // columns)
    figure, fields = pyplot.subplots(lines, columns, figsize=(4.2 * columns, 3.3 * lines), squeeze=False)
    for field in fields.flat[len(found) :]:
        field.set_visible(False)
    shown = [one for one in CONTENDERS if any(one in by_contender for by_contender in found.values())]
    for field, (name, by_contender) in zip(fields.flat, found.items(), strict=False):
        for contender in shown:
            points = by_contender.get(contender, ())
            wide = 2.2 if contender in (BASE, "database") else 1.2
            field.plot(*zip(*points, strict=True) if points else ((), ()), "o-", color=COLOURS[contender],
                       linewidth=wide, markersize=3.5, label=HEADS.get(contender, contender))  # fmt: skip
        field.set(xscale="log", yscale="log", title=name, xlabel=PROBLEMS[name].size_is, ylabel="ms")
        sizes = [size for size, _ in by_contender[BASE]]
        field.set_xticks(sizes, [f"{size:,}" for size in sizes])
        field.xaxis.set_minor_locator(NullLocator())
        field.yaxis.set_minor_formatter(NullFormatter())
        field.grid(True, which="major", alpha=0.3)
    handles, labels = fields.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=-(-len(labels) // 2), frameon=False)
    figure.text(0.5, 0.002, machine_line(machine, clock), ha="center", va="bottom", fontsize=8, color="#555555")
    figure.tight_layout(rect=(0, 0.02, 1, 0.96))
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=80, metadata={"Software": None})
    pyplot.close(figure)
    return True


# --- the page ---------------------------------------------------------------------------------------------------


def figures(records: Sequence[Record], machine: dict[str, Any], clock: str) -> str:
    """What stands between the marks of the page."""
    words = "\n".join(f"- {reason}" for reason in reasons(records))
    parts = [
        f"Measured on: {machine_line(machine, clock)}.",
        f"![Cost against size, both logarithmic, one field per problem]({PICTURE.name})",
        "## Ratios",
        markdown(*ratio_rows(records, clock)),
        means_line(records, clock),
        *(["Where a word stands in place of a number:", words] if words else []),
        "## Compiling",
        "Milliseconds to parse, resolve and lower the script, for each engine. No ratio above contains them. The first "
        "time in a process loads modules and looks at the tables of the script.",
        markdown(*compile_rows(records)),
        "## What is measured",
        markdown(["problem", "what it asks", "what is compared"], [[p.name, p.about, p.compared] for p in
                                                                   PROBLEMS.values()]),
    ]  # fmt: skip
    return "\n\n".join(parts)


def with_figures(page: str, text: str) -> str:
    """The page with its figures replaced."""
    before, rest = page.split(BEGIN)
    return f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.split(END)[1]}"


@click.command(help="Shows out/bench.json as a table of ratios and draws out/bench.png.")
@click.option("--docs", is_flag=True, help="writes table and plot into docs/ too")
@click.option("--json", "file", type=click.Path(path_type=Path, exists=True), default=OUT, help="what run.py wrote")
@click.option(
    "--clock", type=click.Choice(["wall", "cpu"]), default="wall", help="cpu: on a machine that does other things"
)
def main(docs: bool, file: Path, clock: str) -> None:
    text = json.loads(file.read_text("utf-8"))
    records, machine = text["records"], text["machine"]
    console = Console(highlight=False, width=200 if not Console().is_terminal else None)
    console.print(f"Ratios to Python by hand. {machine_line(machine, clock)}\n")
    console.print(shown(*ratio_rows(records, clock)))
    console.print(means_line(records, clock))
    for reason in reasons(records):
        console.print(reason, soft_wrap=True)
    console.print("\nCompiling, ms")
    console.print(shown(*compile_rows(records)))
    drawn = draw(records, machine, clock, PLOT)
    console.print(f"drawn: {PLOT.relative_to(ROOT)}" if drawn else "no plot: matplotlib is not installed")
    if docs:
        if not drawn:
            raise click.ClickException("the page needs its plot: pip install matplotlib")
        shutil.copyfile(PLOT, PICTURE)
        PAGE.write_text(with_figures(PAGE.read_text("utf-8"), figures(records, machine, clock)), encoding="utf-8")
        console.print(f"written: {PAGE.relative_to(ROOT)}, {PICTURE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
