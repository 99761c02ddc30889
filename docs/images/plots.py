"""Makes the pictures of results.md anew: `python docs/images/plots.py`."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

from matplotlib import pyplot as plt

import ss2sql

HERE = Path(__file__).parent / "plots"

ROADS = [
    ("Ulm", "Augsburg", 80), ("Ulm", "Stuttgart", 95), ("Augsburg", "Munich", 60), ("Stuttgart", "Munich", 190),
    ("Munich", "Passau", 190), ("Augsburg", "Regensburg", 140), ("Regensburg", "Passau", 120),
    ("Stuttgart", "Nuremberg", 160), ("Nuremberg", "Regensburg", 110),
]  # fmt: skip
WAYS = """
    SELECT dst, km FROM (SELECT * FROM roads WHERE src == here) WHERE dst == 'Passau'
    START WITH here = 'Ulm' CONNECT BY COST km here = dst STOP WITH dst == 'Passau';
"""
WALKS = """
    SELECT [x + this[0], y + this[1]] FROM [[1, 0], [0, 1]] WHERE x + this[0] == 6 AND y + this[1] == 4
    START WITH x = 0, y = 0 CONNECT BY x = x + this[0], y = y + this[1]
    STOP WITH x + this[0] > 6 OR y + this[1] > 4;
"""
GROUND = """
    SELECT [x.this, y.this], to((x.this - 3) ^ 2 + (y.this - 2) ^ 2, height) FROM x = range(8), y = range(6)
    AS plane("XY", [0, 0], [8, 6, 1]);
"""


def save(axes: plt.Axes, name: str) -> None:
    axes.figure.savefig(HERE / f"{name}.png", dpi=80)
    plt.close(axes.figure)


def main() -> None:
    with ss2sql.connect() as ss:
        ss.set("roads", [{"src": src, "dst": dst, "km": km} for src, dst, km in ROADS])
        ways = ss.run(WAYS)
        save(ways.plot(), "graph")
        save(ways.plot(kind="tree"), "tree")
        save(ss.run(WALKS).plot(), "paths")
        ground = ss.run(GROUND).plot(title="routes over hilly ground")
        save(ss.run(WALKS, maximum=3).plot(ground, title="routes over hilly ground"), "map")
        save(ss.run("SELECT src, count(*) FROM roads GROUP BY src;").plot(), "bars")


if __name__ == "__main__":
    main()
