"""Planes as text, and as a picture made by Matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

SHADES = " .:-=+*#%@"
ROWS, COLUMNS = 25, 50  # a letter is about twice as high as wide


def shaded(planes: list[Any]) -> str:
    """Planes side by side: the larger the value, the darker; of negative values the size counts."""
    texts = [_shades(np.abs(plane)) for plane in planes]
    return "\n".join("   ".join(lines) for lines in zip(*texts, strict=True))


def _shades(plane: Any) -> list[str]:
    """The lines of a plane from its upper end, each letter the mean of its cells."""
    rows, columns = plane.shape
    pieces = plane.reshape(ROWS, rows // ROWS, COLUMNS, columns // COLUMNS).mean(axis=(1, 3))
    steps = np.rint(pieces / max(pieces.max(), 1e-9) * (len(SHADES) - 1)).astype(int)
    return ["".join(SHADES[step] for step in line) for line in steps[::-1]]


def draw(planes: list[Any], file: Path) -> None:
    """Writes a heat map of the first and a spectral map of the second plane."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.4), layout="constrained")
    mass, velocity = planes
    most = np.abs(velocity).max()
    looks = (("mass in kg", mass, "hot", None), ("velocity upwards in m/s", velocity, "nipy_spectral", (-most, most)))
    for axes, (title, plane, colours, limits) in zip(figure.subplots(1, 2), looks, strict=True):
        shown = axes.imshow(plane, origin="lower", extent=plane.extent, cmap=colours, clim=limits)
        axes.set(title=title, xlabel="x in m", ylabel="y in m")
        figure.colorbar(shown, ax=axes)
    figure.savefig(file, dpi=90)
