"""`render`: pictures of simulations, without a window."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from math import dist, hypot, radians, tan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ss2sql.errors import SessionError, suggest_names
from ss2sql.scenes.camera import Camera, Floats, Shot, compute_light, make_sun_camera
from ss2sql.scenes.overlay_lines import Point, draw_dots, draw_lines
from ss2sql.vtables.pybullet.scene import Scene, View
from ss2sql.vtables.pybullet.solids import Colour, Vector

Pixels = NDArray[np.uint8]  # height x width x (red, green, blue)


def write_png(path: Path, pixels: Pixels) -> None:
    height, width, _ = pixels.shape
    # Each row is stored as its difference to the row above, which PNG calls filter 2: half the size of plain rows.
    rows = np.empty((height, 1 + 3 * width), np.uint8)
    rows[:, 0] = 2
    flat = pixels.reshape(height, 3 * width)
    rows[0, 1:] = flat[0]
    rows[1:, 1:] = flat[1:] - flat[:-1]
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b""))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(_make_chunk(kind, data) for kind, data in parts))


def _make_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


FINER = 2  # pictures are made twice as large and scaled down, against jagged edges
SUN_PIXELS = (768, 2048)  # of the light's picture, at least and at most
SHADE = 0.7  # the brightness of shadows
RED: Colour = (0.86, 0.07, 0.1)
YELLOW: Colour = (1.0, 0.8, 0.05)
DARK: Colour = (0.2, 0.25, 0.35)
SKY: tuple[Colour, Colour] = ((0.99, 0.99, 1.0), (0.86, 0.89, 0.93))  # above, below
PALE = 0.74  # how much of a faded colour is white
LARGEST = 2048


def render(
    world: Any,
    path: str | Path | None,
    paths: Iterable[Sequence[Point]] | None = None,
    highlight: Collection[int] | None = None,
    size: tuple[int, int] = (960, 720),
    view: str | View | None = None,
    visited: Iterable[Point] | None = None,
) -> Pixels:
    """Writes a picture of a scene, or of any PyBullet client, to a PNG file; gives its pixels as well.

    `paths` are lists of points (x, y) or (x, y, z), drawn in red, `visited` are points, drawn in yellow. The bodies
    whose ids are in `highlight` keep their colours while the others fade, and are seen through them. `view` is one of
    the scene's views, by name, or a `View`. Without a path nothing is written.
    """
    client = getattr(world, "client", world)
    _check_highlight(world, client, highlight, size)
    low, high = _measure_bounds(world, client)
    camera = _make_camera(_choose_view(world, view, low, high), size, low, high)
    shot = camera.take_picture(client)
    source = make_sun_camera(low, high, min(SUN_PIXELS[1], max(SUN_PIXELS[0], FINER * max(size))))
    shade = compute_light(shot, camera, source.take_picture(client), source)
    colours = _shade_picture(shot, shade)
    distance = camera.convert_depths(shot.depth)
    outlines = world.outlines if isinstance(world, Scene) else ()
    colours = _blend_color(colours, draw_lines(distance, camera, outlines, FINER, 0.0), DARK, 0.22)
    if highlight is not None:
        with _hide_others(client, set(highlight)):
            colours = _fade_others(colours, shot, camera.take_picture(client), highlight)
    thick = FINER * max(1.5, size[1] / 240)
    colours = _blend_color(
        colours, draw_dots(distance, camera, () if visited is None else visited, thick * 2.2), YELLOW, 0.95
    )
    colours = _blend_color(colours, draw_lines(distance, camera, () if paths is None else paths, thick), RED, 0.95)
    width, height = size
    smooth = colours.reshape(height, FINER, width, FINER, 3).mean(axis=(1, 3))
    pixels = np.asarray(np.clip(smooth * 255 + 0.5, 0, 255), np.uint8)
    if path is not None:
        _write_picture(Path(path), pixels)
    return pixels


def _check_highlight(world: Any, client: Any, highlight: Collection[int] | None, size: tuple[int, int]) -> None:
    if not hasattr(client, "getCameraImage"):
        raise SessionError(
            "S002", f"a {type(world).__name__} is no scene that can be pictured",
            hints=("give a scene, or a pybullet_utils.bullet_client.BulletClient",),
        )  # fmt: skip
    if not client.isConnected():
        raise SessionError("S001", "the scene is closed", hints=("build it anew",))
    if len(size) != 2 or not all(isinstance(length, int) and 1 <= length <= LARGEST for length in size):
        raise SessionError(
            "S002", f"a picture cannot have the size {size}",
            hints=(f"give width and height in pixels, each up to {LARGEST}",),
        )  # fmt: skip
    there = {client.getBodyUniqueId(number) for number in range(client.getNumBodies())}
    for body in () if highlight is None else highlight:
        if body not in there:
            raise SessionError(
                "S002", f"there is no body {body} to highlight", hints=("give ids of bodies of this scene",)
            )


def _measure_bounds(world: Any, client: Any) -> tuple[Vector, Vector]:
    if isinstance(world, Scene):
        return world.bounds
    bodies = [client.getBodyUniqueId(number) for number in range(client.getNumBodies())]
    boxes = [client.getAABB(body) for body in bodies]
    boxes = [box for box in boxes if dist(*box) < 1000]  # endless planes are left out
    if not boxes:
        return (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)
    low, high = (np.array(corners) for corners in zip(*boxes, strict=True))
    return tuple(low.min(axis=0).tolist()), tuple(high.max(axis=0).tolist())


def _choose_view(world: Any, view: str | View | None, low: Vector, high: Vector) -> View:
    if isinstance(view, View):
        return view
    if isinstance(world, Scene):
        if view is None:
            return next(iter(world.views.values()))
        if view in world.views:
            return world.views[view]
        raise SessionError("S002", f"the scene has no view '{view}'", hints=suggest_names(view, world.views))
    if view is not None:
        raise SessionError("S002", "only scenes have views with names", hints=("give a View: eye, target, angle",))
    x, y, z = ((a + b) / 2 for a, b in zip(low, high, strict=True))
    away = 1.1 * dist(low, high) / 2 / tan(radians(20))
    return View((x + 0.4 * away, y - 0.75 * away, z + 0.55 * away), (x, y, z))


def _make_camera(view: View, size: tuple[int, int], low: Vector, high: Vector) -> Camera:
    """A camera whose range of depths is that of the scene, which keeps depths exact."""
    ahead = np.subtract(view.target, view.eye)
    if hypot(*np.cross(ahead, view.up)) < 1e-9:
        raise SessionError(
            "S002",
            "a camera cannot look straight along its own up",
            hints=("give the view another eye, or another up",),
        )
    ahead = ahead / hypot(*ahead)
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    depths = [float(np.dot(np.subtract(corner, view.eye), ahead)) for corner in corners]
    near = max(0.1, 0.9 * min(depths))
    return Camera(view, size[0] * FINER, size[1] * FINER, near, max(2 * near, 1.1 * max(depths)))


def _shade_picture(shot: Shot, shade: Floats) -> Floats:
    """The colours of a shot with its shadows, before a pale sky."""
    light = (SHADE + (1 - SHADE) * shade)[..., None]
    above, below = (np.array(colour, np.float32) for colour in SKY)
    down = np.linspace(0, 1, shot.depth.shape[0], dtype=np.float32)[:, None, None]
    sky = np.broadcast_to(above + (below - above) * down, shot.colours.shape)
    return np.where((shot.bodies < 0)[..., None], sky, shot.colours * light).astype(np.float32)


def _blend_color(colours: Floats, cover: Floats, colour: Colour, strength: float) -> Floats:
    part = (cover * strength)[..., None]
    return np.asarray(colours * (1 - part) + np.array(colour, np.float32) * part, np.float32)


def _fade_others(colours: Floats, shot: Shot, alone: Shot, highlight: Collection[int]) -> Floats:
    """Everything pale except the highlighted bodies, which shine through others."""
    grey = colours.mean(axis=-1, keepdims=True)
    pale = (0.5 * colours + 0.5 * grey) * (1 - PALE) + PALE
    kept = np.isin(shot.bodies, list(highlight))[..., None]
    background = np.isin(alone.bodies, list(highlight))[..., None] & ~kept
    through = 0.55 * alone.colours + 0.45 * pale
    return np.where(kept, colours, np.where(background, through, pale)).astype(np.float32)


@contextmanager
def _hide_others(client: Any, highlight: set[int]) -> Iterator[None]:
    """Hides all other bodies in the block; TinyRenderer has no partial transparency."""
    before: list[tuple[int, int, int, tuple[float, ...]]] = []
    for number in range(client.getNumBodies()):
        body = client.getBodyUniqueId(number)
        parts: dict[int, int] = {}  # how many shapes of each link came before
        if body in highlight:
            continue
        for shape in client.getVisualShapeData(body):
            link, colour = shape[1], shape[7]
            parts[link] = parts.get(link, -1) + 1
            before.append((body, link, parts[link], colour))
    try:
        for body, link, part, colour in before:
            client.changeVisualShape(body, link, shapeIndex=part, rgbaColor=(*colour[:3], 0.0))
        yield
    finally:
        for body, link, part, colour in before:
            client.changeVisualShape(body, link, shapeIndex=part, rgbaColor=colour)


def _write_picture(path: Path, pixels: Pixels) -> None:
    try:
        write_png(path, pixels)
    except (OSError, ValueError) as reason:  # ValueError: a path with a character that no file has
        raise SessionError(
            "S002",
            f"the picture {str(path)!r} cannot be written: {getattr(reason, 'strerror', None) or reason}",
            hints=("name a file in a folder that exists and may be written to",),
        ) from reason
