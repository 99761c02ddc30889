"""Railroad diagrams of rules of the grammar, for Sphinx: a block `railroad` that names rules.

A piece of a diagram is entered on the left at its line and left on the right at the same height. It reaches `up` above
the line and `down` below it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from grammar import plain, rules
from lark import Token, Tree

BEND, GAP, LETTER, HALF = 8, 10, 7.4, 12  # pixels: radius of bends, between pieces, of a letter, of a box's height


@dataclass(frozen=True)
class Piece:
    """A part of a diagram; `draw` gives its SVG at a place."""

    width: float
    up: float
    down: float
    draw: Callable[[float, float], str]


def box(text: str, keyword: bool) -> Piece:
    width = LETTER * len(text) + 18

    def draw(x: float, y: float) -> str:
        kind, round_ = ("keyword", HALF) if keyword else ("rule", 2)
        return (
            f'<rect class="{kind}" x="{x}" y="{y - HALF}" width="{width}" height="{2 * HALF}" rx="{round_}"/>'
            f'<text x="{x + width / 2}" y="{y + 4}">{escape(text)}</text>'
        )

    return Piece(width, HALF, HALF, draw)


def line(width: float = 0) -> Piece:
    return Piece(width, 0, 0, lambda x, y: path(f"M{x} {y}h{width}"))


def path(steps: str) -> str:
    return f'<path d="{steps}"/>'


def row(pieces: list[Piece]) -> Piece:
    """One after the other."""

    def draw(x: float, y: float) -> str:
        drawn = []
        for number, piece in enumerate(pieces):
            if number:
                drawn.append(path(f"M{x} {y}h{GAP}"))
                x += GAP
            drawn.append(piece.draw(x, y))
            x += piece.width
        return "".join(drawn)

    width = sum(piece.width for piece in pieces) + GAP * (len(pieces) - 1)
    return Piece(width, max(piece.up for piece in pieces), max(piece.down for piece in pieces), draw)


def choice(pieces: list[Piece]) -> Piece:
    """One of them: the first on the line, the others below."""
    inner = max(piece.width for piece in pieces)
    depths, depth = [0.0], pieces[0].down
    for piece in pieces[1:]:
        depths.append(depth + GAP + max(piece.up, 2 * BEND - depth - GAP))
        depth = depths[-1] + piece.down

    def draw(x: float, y: float) -> str:
        drawn, start, end = [], x + 2 * BEND, x + 2 * BEND + inner
        for piece, below in zip(pieces, depths, strict=True):
            place = y + below
            drawn += [piece.draw(start, place), path(f"M{start + piece.width} {place}H{end}")]
            if below:
                fall = below - 2 * BEND
                drawn += [
                    path(f"M{x} {y}q{BEND} 0 {BEND} {BEND}v{fall}q0 {BEND} {BEND} {BEND}"),
                    path(f"M{end} {place}q{BEND} 0 {BEND} {-BEND}v{-fall}q0 {-BEND} {BEND} {-BEND}"),
                ]
            else:
                drawn += [path(f"M{x} {y}H{start}"), path(f"M{end} {y}h{2 * BEND}")]
        return "".join(drawn)

    return Piece(inner + 4 * BEND, pieces[0].up, depth, draw)


def optional(piece: Piece) -> Piece:
    """The piece, or the way above it."""
    rise = piece.up + GAP

    def draw(x: float, y: float) -> str:
        start, end, climb = x + 2 * BEND, x + 2 * BEND + piece.width, rise - 2 * BEND
        over = path(
            f"M{x} {y}q{BEND} 0 {BEND} {-BEND}v{-climb}q0 {-BEND} {BEND} {-BEND}H{end}"
            f"q{BEND} 0 {BEND} {BEND}v{climb}q0 {BEND} {BEND} {BEND}"
        )
        return path(f"M{x} {y}H{start}") + piece.draw(start, y) + path(f"M{end} {y}h{2 * BEND}") + over

    return Piece(piece.width + 4 * BEND, rise, piece.down, draw)


def loop(piece: Piece, between: Piece) -> Piece:
    """The piece once or more, with another one on the way back."""
    inner = max(piece.width, between.width)
    fall = piece.down + GAP + max(between.up, 2 * BEND - piece.down - GAP)

    def draw(x: float, y: float) -> str:
        start, end = x + BEND, x + BEND + inner
        aside = (inner - between.width) / 2
        back = fall - 2 * BEND
        return "".join([
            path(f"M{x} {y}H{start}"),
            piece.draw(start, y),
            path(f"M{start + piece.width} {y}H{end + BEND}"),
            path(f"M{end} {y}q{BEND} 0 {BEND} {BEND}v{back}q0 {BEND} {-BEND} {BEND}h{-aside}"),
            between.draw(start + aside, y + fall),
            path(f"M{start + aside} {y + fall}H{start}q{-BEND} 0 {-BEND} {-BEND}v{-back}q0 {-BEND} {BEND} {-BEND}"),
        ])  # fmt: skip

    return Piece(inner + 2 * BEND, piece.up, fall + between.down, draw)


# --- from the grammar ----------------------------------------------------------------------------------


def piece_of(node: Any, rule: str = "") -> Piece:
    """The diagram of a part of the rule."""
    if isinstance(node, Token):
        text = str(node)
        keyword = text.startswith('"')
        return box(text.removesuffix("i").strip('"') if keyword else plain(text), keyword)
    parts = [child for child in node.children if child is not None]
    if node.data in ("name", "literal") or (node.data in ("alias", "expr") and len(parts) == 1):
        return piece_of(parts[0], rule)
    if node.data == "alias":
        return piece_of(parts[0], rule)
    if node.data == "expansions":
        return _choice(parts, rule)
    if node.data == "expr":
        inner = piece_of(parts[0], rule)
        return {"?": optional(inner), "*": optional(loop(inner, line())), "+": loop(inner, line())}[str(parts[1])]
    return row(_items(parts, rule))


def _choice(parts: list[Any], rule: str) -> Piece:
    """Alternatives; what begins with the rule itself, `sum: product | sum "+" product`, becomes a loop."""
    recursive = [_flat(part) for part in parts if rule and _name(_flat(part)[0]) == rule]
    if len(parts) == 2 and len(recursive) == 1 and _name(recursive[0][-1]) == _name(_flat(parts[0])[0]):
        return loop(piece_of(parts[0]), row([piece_of(part) for part in recursive[0][1:-1]]))
    return choice([piece_of(part) for part in parts])


def _items(parts: list[Any], rule: str) -> list[Piece]:
    """The pieces of a sequence, `x ("," x)*` as a loop."""
    found: list[Piece] = []
    for number, part in enumerate(parts):
        repeated = _flat(part.children[0]) if isinstance(part, Tree) and str(part.children[-1]) == "*" else []
        if number and len(repeated) > 1 and _name(repeated[-1]) == _name(parts[number - 1]) != "":
            found[-1] = loop(found[-1], row([piece_of(between) for between in repeated[:-1]]))
        else:
            found.append(piece_of(part, rule))
    return found


def _flat(node: Any) -> list[Any]:
    """The parts of a sequence."""
    while isinstance(node, Tree) and node.data in ("alias", "expr") and node.children[1:] in ([None], [None, None]):
        node = node.children[0]
    if isinstance(node, Tree) and node.data == "alias":
        return _flat(node.children[0])
    return list(node.children) if isinstance(node, Tree) and node.data == "expansion" else [node]


def _name(node: Any) -> str:
    """The name of the rule that a part consists of, or an empty text."""
    while isinstance(node, Tree) and len([child for child in node.children if child is not None]) == 1:
        node = node.children[0]
    return plain(str(node)) if isinstance(node, Token) else ""


def svg(rule: str) -> str:
    """The diagram of a rule."""
    piece = piece_of(rules()[rule], rule)
    width, height = piece.width + 44, piece.up + piece.down + 4
    middle = piece.up + 2
    ends = path(f"M2 {middle - 7}v14M8 {middle - 7}v14M8 {middle}h14") + path(
        f"M{width - 22} {middle}h14M{width - 8} {middle - 7}v14M{width - 2} {middle - 7}v14"
    )
    return (
        f'<svg class="railroad" width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'role="img" aria-label="the rule {rule}">{ends}{piece.draw(22, middle)}</svg>'
    )


class Railroad(Directive):
    """The diagrams of the rules that are named."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        drawn = [f'<p class="railroad-name">{rule}</p>{svg(rule)}' for rule in self.arguments[0].split()]
        return [nodes.raw("", f'<div class="railroads">{"".join(drawn)}</div>', format="html")]


def setup(app: Any) -> dict[str, bool]:
    app.add_directive("railroad", Railroad)
    return {"parallel_read_safe": True}
