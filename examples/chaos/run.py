"""Analysis of a chaos: questions to a running simulation."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from maps import draw, shaded
from page import Page

import ss2sql

LEAD = """A closed box of 10 x 10 x 10 m, in which bodies fly around, bounce, and explode: a simulation in PyBullet that
somebody wants to know something about. The program attaches it under a name, `ss.attach("space", world)`, and asks."""
STEPS = 240  # one second


def main(lines: int | None = None) -> Page:
    page = Page("Analysis of a chaos", LEAD, lines)
    with ss2sql.scenes.chaos(seed=18, bodies=150) as world, ss2sql.connect() as ss:
        ss.attach("space", world)
        world.step(STEPS)
        page.run(ss, HERE / "1_heavy.ss", rows=5)
        heaviest = page.run(ss, HERE / "2_heaviest.ss")
        file = page.file("heaviest.png")
        ss2sql.scenes.render(world, file, highlight=[row["id"] for row in heaviest.value])
        page.say(f"The picture shows it, the others faded: {file}")
        planes = page.run(ss, HERE / "3_planes.ss", drawn=shaded)
        if find_spec("matplotlib"):
            file = page.file("planes.png")
            draw(planes.value, file)
            page.say(f"On the left masses, on the right velocities upwards; in colours: {file}")
        else:
            page.say("On the left masses, on the right velocities; in colours with Matplotlib: pip install matplotlib")
        before = world.births, world.deaths
        page.run(ss, HERE / "4_kinds.ss")
        world.step(2 * STEPS)
        births, deaths = world.births - before[0], world.deaths - before[1]
        page.say(f"The same after {2 * STEPS} steps, {births} births and {deaths} deaths:")
        ss.run(HERE / "4_kinds.ss").show(console=page.console)
    return page


if __name__ == "__main__":
    main()
