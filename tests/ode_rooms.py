"""What a plain loop over ODE's interface says of a scene."""

from __future__ import annotations

from body_queries import Plain

from ss2sql.scenes.ode_chaos import OdeChaos

KINDS = {
    "GeomSphere": "sphere", "GeomBox": "box", "GeomCapsule": "capsule", "GeomCylinder": "cylinder",
    "GeomPlane": "plane",
}  # fmt: skip


def loop(scene: OdeChaos) -> list[Plain]:
    """The geoms of a scene in the order of their births."""
    found = []
    for number, geom in enumerate([*scene.walls, *scene.particles], 1):
        body = geom.getBody()
        normal, offset = geom.getParams() if body is None else ((0, 0, 0), 0)
        place = tuple(part * offset for part in normal) if body is None else geom.getPosition()
        mass = 0.0 if body is None else body.getMass().mass
        found.append(Plain(number, geom.name, KINDS[type(geom).__name__], place, mass))
    return found
