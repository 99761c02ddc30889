"""`render`: pictures of simulations by cameras, without a window, with lines and dots over them."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import pairwise
from math import asin, degrees, dist, hypot, isfinite, log
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ss2sql.errors import SessionError, suggest_names
from ss2sql.fast_dataclasses import dataclass
from ss2sql.vtables.pybullet import PyBulletWorld
from ss2sql.vtables.pybullet.client import import_pybullet
from ss2sql.vtables.pybullet.environment import WIDE, measure_bounds
from ss2sql.vtables.pybullet.scene import Colour, Scene, Vector, View, make_corner_view

Floats = NDArray[np.float32]
LIGHT: Vector = (0.35, -0.5, 1.1)  # the direction from which it comes
TAPS = (-1.2, 0.0, 1.2)  # pixels of the light's picture around a point, for soft edges of shadows
SLACK = 0.08  # metres of tolerance for the depth of a surface in the light's picture


@dataclass(frozen=True, slots=True)
class Shot:
    """A camera's picture, per pixel: the colour from 0 to 1, the depth from 0 to 1, and the body, or -1."""

    colours: Floats
    depth: Floats
    bodies: NDArray[np.int64]


@dataclass(frozen=True)
class Camera:
    """A camera with a picture of `width` x `height` pixels that sees everything between `near` and `far`."""

    view: View
    width: int
    height: int
    near: float
    far: float

    @cached_property
    def _matrices(self) -> tuple[list[float], list[float]]:
        view, bullet = self.view, import_pybullet()
        return (
            list(bullet.computeViewMatrix(view.eye, view.target, view.up)),
            list(bullet.computeProjectionMatrixFOV(view.angle, self.width / self.height, self.near, self.far)),
        )

    @cached_property
    def _matrix(self) -> NDArray[np.float64]:
        looking, seeing = (np.reshape(matrix, (4, 4)).T for matrix in self._matrices)  # Bullet writes columns
        return np.asarray(seeing @ looking, np.float64)

    def take_picture(self, client: Any) -> Shot:
        looking, seeing = self._matrices
        _, _, colours, depth, bodies = client.getCameraImage(
            self.width, self.height, looking, seeing,
            shadow=0, lightDirection=LIGHT, lightColor=(1, 1, 1), lightDistance=1,
            lightAmbientCoeff=0.65, lightDiffuseCoeff=0.42, lightSpecularCoeff=0.05,
            renderer=import_pybullet().ER_TINY_RENDERER,
        )  # fmt: skip
        shape = (self.height, self.width)  # a build without NumPy gives flat tuples
        return Shot(
            np.reshape(colours, (*shape, 4))[..., :3].astype(np.float32) / np.float32(255),
            np.asarray(np.reshape(depth, shape), np.float32),
            np.asarray(np.reshape(bodies, shape), np.int64),
        )

    def project_points(self, points: NDArray[Any]) -> tuple[Floats, Floats, Floats]:
        """Column and row of points (n x 3) in the picture, and their distance, which is negative behind the camera."""
        matrix = self._matrix.astype(points.dtype)
        x, y, distance = (points @ matrix[row, :3] + matrix[row, 3] for row in (0, 1, 3))
        away = np.maximum(distance, self.near)
        return (x / away + 1) / 2 * self.width, (1 - y / away) / 2 * self.height, distance

    def convert_depths(self, depth: Floats) -> Floats:
        """Metres along the line of sight, from the depths of a shot."""
        return self.near * self.far / (self.far - depth * (self.far - self.near))

    def locate_pixels(self, depth: Floats) -> Floats:
        """The points in space of all pixels, from their depths."""
        back = np.linalg.inv(self._matrix).astype(np.float32)
        x = (np.arange(self.width, dtype=np.float32) + 0.5) / self.width * 2 - 1
        y = 1 - (np.arange(self.height, dtype=np.float32) + 0.5) / self.height * 2
        z = depth * 2 - 1
        found = [back[k, 0] * x[None, :] + back[k, 1] * y[:, None] + back[k, 2] * z + back[k, 3] for k in range(4)]
        return np.stack([part / found[3] for part in found[:3]], axis=-1)


def make_sun_camera(low: Vector, high: Vector, pixels: int) -> Camera:
    """The camera at the light's position, far away, so that the rays are almost parallel."""
    middle = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
    around = max(0.1, dist(low, high) / 2)
    away = 8 * around
    scale = away / dist((0, 0, 0), LIGHT)
    eye = (middle[0] + LIGHT[0] * scale, middle[1] + LIGHT[1] * scale, middle[2] + LIGHT[2] * scale)
    view = View(eye, (middle[0], middle[1], middle[2]), 2 * degrees(asin(around / away)), (0.0, 1.0, 0.0))
    return Camera(view, pixels, pixels, away - around, away + around)


def compute_light(shot: Shot, seen: Camera, light: Shot, source: Camera) -> Floats:
    """The light of each pixel: 1, or 0 in the shadow, with soft edges."""
    height, width = shot.depth.shape
    column, row, distance = source.project_points(seen.locate_pixels(shot.depth).reshape(-1, 3))
    surface = source.convert_depths(light.depth)
    total = np.zeros(column.shape, np.float32)
    for across in TAPS:
        x = np.clip((column + across).astype(np.int32), 0, source.width - 1)
        for up in TAPS:
            y = np.clip((row + up).astype(np.int32), 0, source.height - 1)
            total += surface[y, x] > distance - SLACK
    return (total / np.float32(len(TAPS) ** 2)).reshape(height, width)


# --- lines and dots over a picture, hidden by what stands before them
Point = Sequence[float]  # x and y, or x, y and z
ABOVE = 0.06  # metres over the floor, for points without z
HIDDEN = 0.3  # the strength of a hidden line
LINE_SLACK = 0.08  # metres of tolerance before a surface hides a line


def make_picture_point(point: Point) -> tuple[float, float, float]:
    try:
        x, y, z = (*map(float, point), ABOVE)[:3]
        if not isfinite(x + y + z):
            raise ValueError
    except (TypeError, ValueError) as reason:
        raise SessionError(
            "S002", f"{point!r} is not a point", hints=("points are lists of x and y, or of x, y and z",)
        ) from reason
    return x, y, z


def draw_lines(
    distance: Floats, camera: Camera, paths: Iterable[Sequence[Point]], width: float, hidden: float = HIDDEN
) -> Floats:
    """The coverage of each pixel by paths. Segments that many paths share are drawn once, and stronger."""
    pieces: Counter[tuple[tuple[float, float, float], ...]] = Counter()
    for path in paths:
        points = [make_picture_point(point) for point in path]
        pieces.update(tuple(sorted(pair)) for pair in pairwise(points) if pair[0] != pair[1])
    if not pieces:
        return np.zeros(distance.shape, np.float32)
    ends = np.array(list(pieces))
    most = max(pieces.values())
    strength = np.array([1.0 if most == 1 else 0.6 + 0.4 * log(n) / log(most) for n in pieces.values()])
    along, strengths = _sample_picture_lines(ends, strength, camera)
    return _widen_pixels(_draw_picture_points(distance, camera, along, strengths, hidden), width)


def draw_dots(distance: Floats, camera: Camera, points: Iterable[Point], width: float) -> Floats:
    """The coverage of each pixel by round dots at points."""
    places = {make_picture_point(point) for point in points}
    if not places:
        return np.zeros(distance.shape, np.float32)
    return _widen_pixels(
        _draw_picture_points(distance, camera, np.array(sorted(places)), np.ones(len(places)), HIDDEN), width
    )


def _sample_picture_lines(
    ends: NDArray[np.float64], strength: NDArray[np.float64], camera: Camera
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points along segments (n x 2 x 3), close enough for every pixel, and the strength of each."""
    column, row, distance = camera.project_points(ends.reshape(-1, 3))
    seen = (distance > camera.near).reshape(-1, 2).all(axis=1)
    ends, strength = ends[seen], strength[seen]
    length = np.hypot(np.diff(column.reshape(-1, 2)[seen]), np.diff(row.reshape(-1, 2)[seen]))[:, 0]
    counts = np.ceil(length * 1.5).astype(int) + 1
    piece = np.repeat(np.arange(len(counts)), counts)
    part = (np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)) / np.maximum(counts[piece] - 1, 1)
    start, end = ends[piece, 0], ends[piece, 1]
    return start + (end - start) * part[:, None], strength[piece]


def _draw_picture_points(
    distance: Floats, camera: Camera, points: NDArray[np.float64], strength: NDArray[np.float64], hidden: float
) -> Floats:
    """One pixel for each point, weaker where something stands before it."""
    height, width = distance.shape
    column, row, away = camera.project_points(points)
    inside = (away > camera.near) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    x, y = column[inside].astype(int), row[inside].astype(int)
    occluded = away[inside] > distance[y, x] + LINE_SLACK
    covered = np.zeros(distance.shape, np.float32)
    np.maximum.at(covered, (y, x), np.where(occluded, hidden, 1.0) * strength[inside])
    return covered


def _widen_pixels(covered: Floats, width: float) -> Floats:
    radius = int(width / 2)
    padded = np.pad(covered, radius)
    height, across = covered.shape
    wide = covered.copy()
    for down in range(-radius, radius + 1):
        for right in range(-radius, radius + 1):
            if down * down + right * right <= width * width / 4:
                part = padded[radius + down : radius + down + height, radius + right : radius + right + across]
                np.maximum(wide, part, out=wide)
    return wide


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
    try:
        path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(_make_chunk(kind, data) for kind, data in parts))
    except (OSError, ValueError) as reason:  # ValueError: a path with a character that no file has
        message = f"the picture {str(path)!r} cannot be written: {getattr(reason, 'strerror', None) or reason}"
        hints = ("name a file in a folder that exists and may be written to",)
        raise SessionError("S002", message, hints=hints) from reason


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
    _check_picture_of_scene(world, client, highlight, size)
    low, high = measure_bounds(PyBulletWorld(world), WIDE)
    camera = _make_camera(_choose_camera_view(world, view, low, high), size, low, high)
    shot = camera.take_picture(client)
    source = make_sun_camera(low, high, min(SUN_PIXELS[1], max(SUN_PIXELS[0], FINER * max(size))))
    shade = compute_light(shot, camera, source.take_picture(client), source)
    colours = _shade_picture(shot, shade)
    distance = camera.convert_depths(shot.depth)
    outlines = world.outlines if isinstance(world, Scene) else ()
    colours = _blend_color(colours, draw_lines(distance, camera, outlines, FINER, 0.0), DARK, 0.22)
    if highlight is not None:
        with _hide_in_picture(client, set(highlight)):
            colours = _fade_in_picture(colours, shot, camera.take_picture(client), highlight)
    thick = FINER * max(1.5, size[1] / 240)
    colours = _blend_color(
        colours, draw_dots(distance, camera, () if visited is None else visited, thick * 2.2), YELLOW, 0.95
    )
    colours = _blend_color(colours, draw_lines(distance, camera, () if paths is None else paths, thick), RED, 0.95)
    width, height = size
    smooth = colours.reshape(height, FINER, width, FINER, 3).mean(axis=(1, 3))
    pixels = np.asarray(np.clip(smooth * 255 + 0.5, 0, 255), np.uint8)
    if path is not None:
        write_png(Path(path), pixels)
    return pixels


def _check_picture_of_scene(world: Any, client: Any, highlight: Collection[int] | None, size: tuple[int, int]) -> None:
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
            hints = ("give ids of bodies of this scene",)
            raise SessionError("S002", f"there is no body {body} to highlight", hints=hints)


def _choose_camera_view(world: Any, view: str | View | None, low: Vector, high: Vector) -> View:
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
    return make_corner_view(low, high)


def _make_camera(view: View, size: tuple[int, int], low: Vector, high: Vector) -> Camera:
    """A camera whose range of depths is that of the scene, which keeps depths exact."""
    ahead = np.subtract(view.target, view.eye)
    if hypot(*np.cross(ahead, view.up)) < 1e-9:
        hints = ("give the view another eye, or another up",)
        raise SessionError("S002", "a camera cannot look straight along its own up", hints=hints)
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


def _fade_in_picture(colours: Floats, shot: Shot, alone: Shot, highlight: Collection[int]) -> Floats:
    """Everything pale except the highlighted bodies, which shine through others."""
    grey = colours.mean(axis=-1, keepdims=True)
    pale = (0.5 * colours + 0.5 * grey) * (1 - PALE) + PALE
    kept = np.isin(shot.bodies, list(highlight))[..., None]
    background = np.isin(alone.bodies, list(highlight))[..., None] & ~kept
    through = 0.55 * alone.colours + 0.45 * pale
    return np.where(kept, colours, np.where(background, through, pale)).astype(np.float32)


@contextmanager
def _hide_in_picture(client: Any, highlight: set[int]) -> Iterator[None]:
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
