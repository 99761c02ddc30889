"""Makes the pictures of the pages anew: `python docs/images/make.py`, or with the names of some, `make.py roads`."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from contextlib import chdir
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, ListedColormap

import ss2sql
from ss2sql import scenes
from ss2sql.language.area_grid import Grid
from ss2sql.scenes import Scene

HERE = Path(__file__).parent
SIZE = (960, 720)
WAY = [(4, 3), (5, 3), (6, 4), (6, 8), (7, 9), (10, 9)]


def chaos() -> None:
    with scenes.chaos(seed=18, bodies=150) as world:
        world.step(2400)
        scenes.render(world, HERE / "chaos.png", size=SIZE)
        spheres = [body for body, name in world.names.items() if name.startswith("sphere")]
        heaviest = max(spheres, key=lambda body: world.client.getDynamicsInfo(body, -1)[0])
        scenes.render(world, HERE / "heaviest.png", size=SIZE, highlight=[heaviest])


def hall() -> None:
    with scenes.hall(seed=0) as world:
        scenes.render(world, HERE / "hall.png", size=SIZE, paths=[WAY])


# --- maps of representations.md ------------------------------------------------------------------------

PLANES = """
    Mass     = SELECT mass FROM space WHERE hasBody(this)
               AS plane("XY", [-5, -5], [100, 100, 0.1], 3);
    Velocity = SELECT linearVelocity(this, 2) FROM space WHERE hasBody(this)
               AS plane("XY", [-5, -5], [100, 100, 0.1], 3);
    [Mass, Velocity];
"""
STANDS = "SELECT obj FROM space WHERE NOT name IN ['floor', 'YouBot'] AS occupancygrid(0.3, 0.05);"
SEES = "SELECT obj FROM space WHERE isSensor(this) AS sensorgrid(0.1, 0.05);"

DARK = "#334"
HEAT = LinearSegmentedColormap.from_list("heat", ["#fffdf6", "#ffd98a", "#f5803e", "#b3203c", "#3b0f3a"])
SPECTRAL = LinearSegmentedColormap.from_list("spectral", ["#2b4ea8", "#58b5e1", "#f8f8f8", "#f4b13f", "#c22326"])


def map_of(axes: Axes, grid: Grid, title: str, unit: str = "", **look: object) -> None:
    """A grid as a picture with its axes in metres."""
    image = axes.imshow(grid, origin="lower", extent=grid.extent, **look)
    axes.set_title(title, fontsize=11, color=DARK)
    axes.set_xlabel("x in m", fontsize=9, color=DARK)
    axes.set_ylabel("y in m", fontsize=9, color=DARK)
    axes.tick_params(labelsize=8, colors=DARK, length=3)
    for side in axes.spines.values():
        side.set_color("#99a")
    if unit:
        bar = axes.figure.colorbar(image, ax=axes, fraction=0.046, pad=0.03)
        bar.set_label(unit, fontsize=9, color=DARK)
        bar.ax.tick_params(labelsize=8, colors=DARK, length=3)
        bar.outline.set_visible(False)


def planes() -> None:
    with scenes.chaos(seed=18, bodies=150) as world, ss2sql.connect() as ss:
        world.step(2400)
        ss.attach("space", world)
        mass, velocity = ss.eval(PLANES)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.4, 4.4), layout="constrained")
    map_of(left, mass, "mass", "kg in a cell", cmap=HEAT, vmin=0)
    most = float(np.abs(velocity).max())
    map_of(right, velocity, "velocity along z", "m/s in a cell", cmap=SPECTRAL, vmin=-most, vmax=most)
    figure.savefig(HERE / "planes.png", dpi=100)
    plt.close(figure)


def grids() -> None:
    with scenes.hall(seed=0) as world, ss2sql.connect() as ss:
        ss.attach("space", world)
        stands, sees = ss.eval(STANDS), ss.eval(SEES)
        figure, (left, right) = plt.subplots(1, 2, figsize=(10.4, 3.75), layout="constrained")
        map_of(left, stands, "what stands 0.3 m above the floor", cmap=ListedColormap(["#f7f7f4", "#3c5a80"]))
        look = ListedColormap(["#f7f7f4", "#bfe3b4", "#4fae6a", "#17703f"])
        map_of(right, sees, "how many sensors see the floor", cmap=look, norm=BoundaryNorm(range(5), 4))
        outline(right, stands)
        sensors(right, world)
    handles = [plt.Rectangle((0, 0), 1, 1, facecolor=look(n), edgecolor="#99a") for n in range(int(sees.max()) + 1)]
    labels = ["none", "one", "two", "three"][: len(handles)]
    right.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False)
    figure.savefig(HERE / "grids.png", dpi=100)
    plt.close(figure)


def outline(axes: Axes, grid: Grid) -> None:
    """Bodies over another map."""
    shown = np.ma.masked_equal(grid, False)
    axes.imshow(shown, origin="lower", extent=grid.extent, cmap=ListedColormap(["#8a95a8"]), alpha=0.9)


def sensors(axes: Axes, world: Scene) -> None:
    """Where the sensors hang, and where they look."""
    for sensor in world.sensors.values():
        x, y, _ = sensor.position
        axes.plot(x, y, "o", color="#c22326", markersize=4)
        axes.annotate(
            "", (x + 0.9 * sensor.direction[0], y + 0.9 * sensor.direction[1]), (x, y),
            arrowprops={"arrowstyle": "->", "color": "#c22326", "linewidth": 1.2},
        )  # fmt: skip


def environment() -> None:
    with scenes.hall(seed=0) as world, ss2sql.connect() as ss:
        ss.attach("space", world)
        script = "SELECT obj FROM space WHERE mass > 0 OR name IN ['floor', 'conveyor_1'] AS environment;"
        with ss.eval(script) as copy:
            scenes.render(copy, HERE / "environment.png", size=(800, 560))


# --- strategies/index.md -------------------------------------------------------------------------------

TOWNS = {"A": (0.0, 0.0), "B": (2.0, 0.8), "C": (2.0, -0.8), "D": (4.0, 0.0)}
ROADS = (
    ("A", "B", 4, 0.12), ("B", "A", 4, 0.12), ("A", "C", 1, 0), ("C", "B", 2, 0), ("B", "D", 5, 0), ("C", "D", 8, 0),
)  # fmt: skip


def roads() -> None:
    """The roads as arrows with their lengths; two between the same towns are bent apart."""
    figure, axes = plt.subplots(figsize=(6, 2.9), layout="constrained")
    for start, end, km, bend in ROADS:
        (x, y), (u, v) = TOWNS[start], TOWNS[end]
        look = {"arrowstyle": "-|>", "color": "#3c5a80", "shrinkA": 15, "shrinkB": 15, "linewidth": 1.5,
                "connectionstyle": f"arc3,rad={bend}", "mutation_scale": 14}  # fmt: skip
        axes.annotate("", (u, v), (x, y), arrowprops=look)
        aside = bend / np.hypot(u - x, v - y)
        middle = ((x + u) / 2 + aside * (v - y), (y + v) / 2 - aside * (u - x))
        axes.text(*middle, f"{km} km", ha="center", va="center", fontsize=9, color=DARK,
                  bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5})  # fmt: skip
    for town, place in TOWNS.items():
        axes.text(*place, town, ha="center", va="center", fontsize=13, color="white",
                  bbox={"boxstyle": "circle,pad=0.35", "facecolor": "#b3203c", "edgecolor": "none"})  # fmt: skip
    axes.set(xlim=(-0.4, 4.4), ylim=(-1.15, 1.15))
    axes.axis("off")
    figure.savefig(HERE / "roads.png", dpi=100)
    plt.close(figure)


# --- README.md -----------------------------------------------------------------------------------------


def examples() -> None:
    """What the examples write, for the first pages."""
    with TemporaryDirectory() as folder, chdir(folder):
        for name in ("navigation", "chaos", "sensors"):
            for picture in runpy.run_path(str(HERE.parent.parent / "examples" / name / "run.py"))["main"](24).pictures:
                copyfile(picture, HERE / "examples" / picture.name)


# --- watching.md ---------------------------------------------------------------------------------------

AT = 300  # the event at which its page is shown


def watching() -> None:
    """What the page writes when its code runs, and its page of a grid as Chromium shows it."""
    blocks = re.findall(r"^```python\n(.*?)^```", (HERE.parent / "watching.md").read_text("utf-8"), re.M | re.S)
    with TemporaryDirectory() as folder, chdir(folder):
        Path("page.py").write_text("\n".join(blocks), encoding="utf-8")
        runpy.run_path("page.py")
        for name, picture in {"hanoi": "search_tree", "grid": "search_map"}.items():
            copyfile(f"{name}.png", HERE / "plots" / f"{picture}.png")
        address = f"{Path('grid.html').resolve().as_uri()}#{AT}"
        command = ["chromium", "--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1400,900"]
        subprocess.run([*command, f"--screenshot={HERE / 'watching.png'}", address], check=True)


PICTURES = {
    "chaos": chaos,
    "hall": hall,
    "planes": planes,
    "grids": grids,
    "environment": environment,
    "roads": roads,
    "watching": watching,
    "examples": examples,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or PICTURES:
        PICTURES[name]()
