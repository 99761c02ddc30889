"""Makes the pictures of scenes.md anew: `python docs/images/make.py`."""

from __future__ import annotations

from pathlib import Path

from ss2sql import scenes

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


if __name__ == "__main__":
    chaos()
    hall()
