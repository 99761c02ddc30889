"""MuJoCo as a world: `ss.attach("space", data)` for a `mujoco.MjData`, or `MuJoCoWorld(model, data)`.

Columns are MuJoCo's latest results: after `mj_step` positions are those at the beginning of the step, as everywhere in
MuJoCo, and `mj_forward` updates them. Reading computes nothing anew, because that would change contacts and sensors.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from importlib import import_module
from itertools import product
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ss2sql.errors import ExecutionError, SessionError
from ss2sql.vtables.body_functions import BodyWorld, Closest, Near, Overlaps, Quaternion, Vector
from ss2sql.vtables.mujoco.mujoco_tables import (
    MuJoCoBodies,
    MuJoCoContacts,
    MuJoCoGeoms,
    MuJoCoJoints,
    MuJoCoSensors,
    MuJoCoShapes,
)

Array = NDArray[Any]
FURTHEST = 1e9  # m, the greatest measured distance
_FREE = 0  # of mjtJoint


class MuJoCoWorld(BodyWorld):
    """MuJoCo: bodies, geoms, joints, contacts and sensors of a model and its data.

    Args:
        model: the `mujoco.MjModel`; optional, since data know their model: `MuJoCoWorld(data)`.
        data: the `mujoco.MjData`.
    """

    tables = (MuJoCoBodies, MuJoCoGeoms, MuJoCoJoints, MuJoCoSensors, MuJoCoContacts, Closest, Near, Overlaps)

    def __init__(self, model: Any, data: Any = None) -> None:
        data = model if data is None else data
        super().__init__(data)
        if not hasattr(data, "qpos"):
            message = f"a {type(data).__name__} is no data of MuJoCo"
            raise SessionError("S002", message, hints=("attach a mujoco.MjData",))
        self.data = data
        self.model = data.model if model is data else model
        self.shapes = MuJoCoShapes(self.model, self.data)
        self._names: dict[str, list[str]] = {}
        self._parts: dict[int, range] = {}
        self._solids: dict[int, frozenset[int]] = {}

    @property
    def time(self) -> float:
        return float(self.data.time)

    def check(self) -> None:
        """Raises where MuJoCo has computed nothing yet, and all positions would be 0."""
        if not self.data.xquat[0, 0]:
            message = "MuJoCo has not computed these data yet: call mujoco.mj_forward(model, data)"
            raise ExecutionError("X011", message)

    def list_names(self, kind: str, count: int) -> list[str]:
        """The names of all elements of a kind; those without one have an empty name."""
        if kind not in self._names:
            mujoco = import_module("mujoco")
            known = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
            self._names[kind] = [mujoco.mj_id2name(self.model, known, number) or "" for number in range(count)]
        return self._names[kind]

    def measure_force(self, contact: int) -> float:
        """The force of a contact along its normal."""
        found = np.zeros(6)
        import_module("mujoco").mj_contactForce(self.model, self.data, contact, found)
        return float(found[0])

    @cached_property
    def driven_bodies(self) -> Array:
        """The bodies that actuators drive directly."""
        model, kinds = self.model, import_module("mujoco").mjtTrn
        owners = {
            int(kinds.mjTRN_JOINT): model.jnt_bodyid,
            int(kinds.mjTRN_JOINTINPARENT): model.jnt_bodyid,
            int(kinds.mjTRN_SITE): model.site_bodyid,
            int(kinds.mjTRN_BODY): np.arange(model.nbody),
        }
        return _list_owners(owners, model.actuator_trntype, model.actuator_trnid[:, 0])

    @cached_property
    def sensing_bodies(self) -> Array:
        """The bodies that sensors are mounted on."""
        model, kinds = self.model, import_module("mujoco").mjtObj
        owners = {
            int(kinds.mjOBJ_BODY): np.arange(model.nbody),
            int(kinds.mjOBJ_XBODY): np.arange(model.nbody),
            int(kinds.mjOBJ_GEOM): model.geom_bodyid,
            int(kinds.mjOBJ_SITE): model.site_bodyid,
            int(kinds.mjOBJ_CAMERA): model.cam_bodyid,
            int(kinds.mjOBJ_JOINT): model.jnt_bodyid,
        }
        return _list_owners(owners, model.sensor_objtype, model.sensor_objid)

    def read_positions(self) -> tuple[list[int], Array]:
        return list(range(self.model.nbody)), self.data.xpos

    def list_ids(self) -> range:
        return range(self.model.nbody)

    def name_of(self, body: int) -> str:
        return self.list_names("body", self.model.nbody)[body]

    def read_point(self, value: Any) -> Sequence[float]:
        """A body's position by its id takes 1 us, by its column 20 us; joins read two for each pair."""
        if type(value) is int and 0 <= value < self.model.nbody:
            return tuple(self.data.xpos[value].tolist())
        return super().read_point(value)

    def measure_gap(self, one: int, other: int) -> float:
        """To the tolerance of MuJoCo's own `mj_geomDistance`, between the nearest shapes of both.

        Of a body and a part of it the gap is that between the part and the rest. Infinite without shapes, and between
        planes or to a terrain, which have no distance in MuJoCo.
        """
        measure = import_module("mujoco").mj_geomDistance
        pairs = product(*self._list_opposed(one, other))
        least = min((measure(self.model, self.data, a, b, FURTHEST, None) for a, b in pairs), default=FURTHEST)
        return inf if least >= FURTHEST else float(least)

    def _list_opposed(self, one: int, other: int) -> tuple[frozenset[int], frozenset[int]]:
        """The shapes of two bodies, none of them in both."""
        first, second = self._list_solids(one), self._list_solids(other)
        return (first - second, second) if second <= first else (first, second - first)

    def list_parts(self, body: int) -> range:
        """A body and all that hangs on it; of `world` nothing does. MuJoCo numbers bodies depth first."""
        if body not in self._parts:
            self.read_column(body, "name")  # raises the error of a body that does not exist
            parents, end = self.model.body_parentid, body + 1
            while body and end < self.model.nbody and parents[end] >= body:
                end += 1
            self._parts[body] = range(body, end)
        return self._parts[body]

    def _are_parts(self, body: int, bodies: Array) -> Array:
        parts = self.list_parts(body)
        return (bodies >= parts.start) & (bodies < parts.stop)

    def _list_solids(self, body: int) -> frozenset[int]:
        """The shapes of a body and its parts that count for it."""
        if body not in self._solids:
            own = self._are_parts(body, self.model.geom_bodyid) & self.shapes.solid_shapes
            self._solids[body] = frozenset(np.flatnonzero(own).tolist())
        return self._solids[body]

    def do_touch(self, one: int, other: int, margin: float = 0.0) -> bool:
        first, second = self._list_opposed(one, other)
        pairs = ((a, b) for a in first for b in second if self.shapes.list_partners(a)[b])
        return self._do_shapes_touch(self.data, pairs, margin)

    def is_touching(self, body: int, margin: float = 0.0) -> bool:
        return self._do_shapes_touch(self.data, self._iterate_near(self.data, body, margin), margin)

    def would_touch(self, body: int, position: Vector, turn: Quaternion, margin: float = 0.0) -> bool:
        """Tests the pose in a copy of the data."""
        data = self._data_copy
        for name in ("qpos", "mocap_pos", "mocap_quat"):
            getattr(data, name)[:] = getattr(self.data, name)
        self._move_body(data, body, position, turn)
        import_module("mujoco").mj_kinematics(self.model, data)
        return self._do_shapes_touch(data, self._iterate_near(data, body, margin), margin)

    def _iterate_near(self, data: Any, body: int, margin: float) -> Iterator[tuple[int, int]]:
        """The shapes of a body with those of others that they may touch, where the spheres around them are so near."""
        others = np.flatnonzero(~self._are_parts(body, self.model.geom_bodyid))
        centres, radii = data.geom_xpos, self.shapes.radii
        for shape in self._list_solids(body):
            near = others[self.shapes.list_partners(shape)[others]]
            gaps = np.linalg.norm(centres[near] - centres[shape], axis=1) - radii[near] - radii[shape]
            yield from product((shape,), near[gaps < margin + 1e-6].tolist())

    def _do_shapes_touch(self, data: Any, pairs: Iterable[tuple[int, int]], margin: float) -> bool:
        """Whether two shapes come nearer to each other than a margin.

        By `mj_geomDistance`, since `mj_collision` leaves out what stands still, mocap bodies among it. Farther than a
        margin it need not look: told to, it finds no terrain.
        """
        measure, furthest = import_module("mujoco").mj_geomDistance, max(margin, 0.0) + 0.01
        return any(measure(self.model, data, a, b, furthest, None) <= margin for a, b in pairs)

    @cached_property
    def _data_copy(self) -> Any:
        return import_module("mujoco").MjData(self.model)

    def put_body(self, body: int, position: Vector, turn: Quaternion) -> None:
        """Moves a body that has a free joint, or is a mocap body, and computes what follows."""
        self._move_body(self.data, body, position, turn)
        import_module("mujoco").mj_forward(self.model, self.data)

    def _move_body(self, data: Any, body: int, position: Vector, turn: Quaternion) -> None:
        model = self.model
        joint, mocap = int(model.body_jntadr[body]), int(model.body_mocapid[body])
        pose = (*position, turn[3], *turn[:3])
        if joint >= 0 and model.jnt_type[joint] == _FREE:
            start = int(model.jnt_qposadr[joint])
            data.qpos[start : start + 7] = pose
        elif mocap >= 0:
            data.mocap_pos[mocap], data.mocap_quat[mocap] = pose[:3], pose[3:]
        else:
            hints = ("give it a free joint, or make it a mocap body",)
            raise ExecutionError("X007", f"the body '{self.name_of(body)}' cannot be moved freely", hints=hints)


def _list_owners(owners: dict[int, Any], kinds: Array, numbers: Array) -> Array:
    """The bodies of things with these kinds and numbers; `owners` has those of each kind by number."""
    pairs = zip(kinds.tolist(), numbers.tolist(), strict=True)
    return np.array([owners[kind][number] for kind, number in pairs if kind in owners], int)
