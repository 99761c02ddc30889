"""The tables of MuJoCo: columns are fetched for all elements at once, since MuJoCo has everything in arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ss2sql.vtables.body_functions import (  # fmt: skip
    FAR,
    PAIR,
    PLACES,
    POSITION,
    ROTATION,
    SHAPE,
    SPIN,
    VECTOR,
    VELOCITY,
    RequestedPairs,
    compute_euler_angles,
    list_body_shape_columns,
    make_body_columns,
    make_gone_error,
)
from ss2sql.vtables.contract import Column, Table, TableFunction, Where

if TYPE_CHECKING:
    from ss2sql.vtables.mujoco import MuJoCoWorld


Array = NDArray[Any]

PLANE, HFIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = range(8)
KINDS: Array = np.array(
    ["plane", "terrain", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf"], dtype=object
)


class MuJoCoShapes:
    """The shapes of a model, where they are now."""

    def __init__(self, model: Any, data: Any) -> None:
        self.model = model
        self.data = data

        self._partners: dict[int, Array] = {}

    @cached_property
    def touchable_shapes(self) -> Array:
        """Whether anything can collide with a shape."""
        model = self.model
        touches: Array = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        touches[model.pair_geom1] = touches[model.pair_geom2] = True
        return touches

    @cached_property
    def touchable_bodies(self) -> Array:
        """Whether anything can collide with a body."""
        owners = self.model.geom_bodyid[self.touchable_shapes]
        return np.asarray(np.bincount(owners, minlength=self.model.nbody) > 0)

    @cached_property
    def solid_shapes(self) -> Array:
        """Whether a shape counts for its body: it can touch others, or the body has none that can."""
        return np.asarray(self.touchable_shapes | ~self.touchable_bodies[self.model.geom_bodyid])

    @cached_property
    def radii(self) -> Array:
        """Those of the spheres around the shapes, which MuJoCo gives as 0 for planes."""
        return np.where(self.model.geom_type == PLANE, np.inf, self.model.geom_rbound)

    def list_partners(self, shape: int) -> Array:
        """Whether each shape may touch this one: by MuJoCo's own filters, except that what stands still may touch."""
        if shape not in self._partners:
            model, bodies = self.model, self.model.geom_bodyid
            kinds, wanted, body = model.geom_contype, model.geom_conaffinity, bodies[shape]
            may = ((kinds & wanted[shape]) | (kinds[shape] & wanted)) != 0
            weld = model.body_weldid[bodies]  # 0 of all that stands still
            piece = np.where(weld == 0, model.body_rootid[bodies], weld)
            may &= piece != piece[shape]
            if weld[shape] and not model.opt.disableflags & import_module("mujoco").mjtDisableBit.mjDSBL_FILTERPARENT:
                parent = model.body_weldid[model.body_parentid[weld]]
                may &= (weld == 0) | ((weld != parent[shape]) & (parent != weld[shape]))
            may &= ~np.isin((np.minimum(bodies, body) << 16) + np.maximum(bodies, body), model.exclude_signature)
            for one, other in ((model.pair_geom1, model.pair_geom2), (model.pair_geom2, model.pair_geom1)):
                may[other[one == shape]] = True
            self._partners[shape] = may
        return self._partners[shape]

    def list_body_kinds(self) -> Array:
        """The kind of the only shape of each body, else `compound` or `ghost`."""
        model, solid = self.model, self.solid_shapes
        counts = np.bincount(model.geom_bodyid[solid], minlength=model.nbody)
        kinds = np.where(counts > 1, "compound", "ghost").astype(object)
        single = solid & (counts[model.geom_bodyid] == 1)
        kinds[model.geom_bodyid[single]] = KINDS[model.geom_type[single]]
        return kinds

    def measure_volumes(self) -> Array:
        """In m³; NaN for shapes without an end."""
        kind = self.model.geom_type
        a, b, c = self.model.geom_size.T
        ball, rod = 4 / 3 * np.pi * a**3, np.pi * a**2 * 2 * b
        known: Array = np.select(
            [kind == SPHERE, kind == BOX, kind == CAPSULE, kind == CYLINDER, kind == ELLIPSOID],
            [ball, 8 * a * b * c, ball + rod, rod, 4 / 3 * np.pi * a * b * c],
            np.nan,
        )
        meshes = np.flatnonzero(kind == MESH)
        known[meshes] = [self.mesh_volumes[mesh] for mesh in self.model.geom_dataid[meshes]]
        return known

    @cached_property
    def mesh_volumes(self) -> list[float]:
        """The volume of each mesh: the sum of the pyramids from the origin to its faces."""
        model, found = self.model, []
        for mesh in range(model.nmesh):
            points, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
            corners = model.mesh_vert[points : points + model.mesh_vertnum[mesh]].astype(float)
            first, second, third = corners[model.mesh_face[faces : faces + model.mesh_facenum[mesh]]].transpose(1, 0, 2)
            found.append(abs(float(np.einsum("ij,ij->", first, np.cross(second, third)))) / 6)
        return found

    @cached_property
    def mesh_corners(self) -> list[Array]:
        """The outermost points of each mesh: its convex hull, where MuJoCo has computed one for collisions."""
        model, found = self.model, []
        for mesh in range(model.nmesh):
            start, hull = model.mesh_vertadr[mesh], model.mesh_graphadr[mesh]
            chosen = np.arange(model.mesh_vertnum[mesh])
            if hull >= 0:  # MuJoCo's numbers: of points, of faces, an address for each point, the points
                first = hull + 2 + model.mesh_graph[hull]
                chosen = model.mesh_graph[first : first + model.mesh_graph[hull]]
            found.append(model.mesh_vert[start + chosen].astype(float))
        return found

    def measure_body_volumes(self) -> Array:
        model, solid = self.model, self.solid_shapes
        return np.bincount(model.geom_bodyid[solid], weights=self.measure_volumes()[solid], minlength=model.nbody)

    def measure_boxes(self) -> Array:
        """The two corners of the box around each shape: an array of (shape, corner, axis)."""
        model, data = self.model, self.data
        kind, size = model.geom_type, model.geom_size
        axes = data.geom_xmat.reshape(-1, 3, 3)
        local = model.geom_aabb
        centre = data.geom_xpos + np.einsum("gij,gj->gi", axes, local[:, :3])
        upright = axes[:, :, 2]
        radius, length = size[:, :1], size[:, 1:2] * np.abs(upright)
        half = np.select(
            [(kind == wanted)[:, None] for wanted in (SPHERE, CAPSULE, CYLINDER, ELLIPSOID, PLANE)],
            [
                radius, radius + length, radius * np.sqrt(np.clip(1 - upright**2, 0, None)) + length,
                np.linalg.norm(axes * size[:, None, :], axis=2), np.full_like(centre, FAR),
            ],
            np.einsum("gij,gj->gi", np.abs(axes), local[:, 3:]),
        )  # fmt: skip
        middle = np.where((kind == PLANE)[:, None], data.geom_xpos, centre)
        boxes = np.stack((middle - half, middle + half), axis=1)
        for mesh in np.flatnonzero(kind == MESH):
            corners = self.mesh_corners[model.geom_dataid[mesh]] @ axes[mesh].T + data.geom_xpos[mesh]
            boxes[mesh] = corners.min(axis=0), corners.max(axis=0)
        for plane in np.flatnonzero(kind == PLANE):  # that of a plane along two axes ends at its front
            normal = upright[plane]
            axis = int(np.argmax(np.abs(normal)))
            if abs(normal[axis]) > 1 - 1e-12:
                boxes[plane, 1 if normal[axis] > 0 else 0, axis] = data.geom_xpos[plane, axis]
        return np.asarray(np.clip(boxes, -FAR, FAR))

    def measure_body_boxes(self) -> Array:
        """The boxes around the shapes of bodies and of all that hangs on them; where there are none, their origin."""
        model, solid = self.model, self.solid_shapes
        low, high = np.full_like(self.data.xpos, FAR), np.full_like(self.data.xpos, -FAR)
        boxes, owners = self.measure_boxes()[solid], model.geom_bodyid[solid]
        np.minimum.at(low, owners, boxes[:, 0])
        np.maximum.at(high, owners, boxes[:, 1])
        for body in np.flatnonzero(model.body_parentid)[::-1]:  # what hangs on a body has a higher number
            parent = model.body_parentid[body]
            np.minimum(low[parent], low[body], out=low[parent])
            np.maximum(high[parent], high[body], out=high[parent])
        bare = low[:, 0] > high[:, 0]
        low[bare] = high[bare] = self.data.xpos[bare]
        return np.stack((low, high), axis=1)

    def read_quaternions(self, index: Array) -> Array:
        """The orientations of shapes, the real part first."""
        turn = import_module("mujoco").mju_mat2Quat
        found = np.empty((len(index), 4))
        for place, matrix in enumerate(self.data.geom_xmat[index]):
            turn(found[place], matrix)
        return found


Keys = Sequence[int]
_ALL = slice(None)
_REAL_LAST = [1, 2, 3, 0]
_JOINTS = ("free", "ball", "slide", "hinge")
_GEOM_COLUMNS = f"{POSITION} {ROTATION} {SHAPE} rot volume aabb".split()


class _Numbered(Table):
    """A table whose keys are the numbers that MuJoCo gives to its elements."""

    key = "id"
    as_elements = True  # but for bodies: what functions get by its number is a body
    count: ClassVar[str]  # the attribute of the model with their number
    kind: ClassVar[str]  # of elements, as MuJoCo calls it
    short = ""  # the same in the names of the arrays that tell which of them a body has
    world: MuJoCoWorld

    def keys(self, where: Where) -> Iterable[int]:
        number, name, body, model = where.equal("id"), where.equal("name"), where.equal("body"), self.world.model
        if number is not None:
            return [int(number)] if number % 1 == 0 and 0 <= number < self.size else []
        if body is not None:
            if body % 1 != 0 or not 0 <= body < model.nbody:
                return []
            first = getattr(model, f"body_{self.short}adr")[int(body)]
            return range(first, first + getattr(model, f"body_{self.short}num")[int(body)])
        return range(self.size) if name is None else [n for n, known in enumerate(self.names) if known == name]

    @property
    def size(self) -> int:
        return int(getattr(self.world.model, self.count))

    @property
    def names(self) -> Sequence[str]:
        return self.world.list_names(self.kind, self.size)

    def check_keys(self, keys: Keys) -> Array:
        """The keys as an index of arrays."""
        index = np.asarray(keys, int)
        if len(index) and (index.min() < 0 or index.max() >= self.size):
            raise make_gone_error(self.kind, next(int(key) for key in keys if not 0 <= key < self.size))
        return index

    def read_names(self, keys: Keys) -> list[str]:
        names = self.names
        return [names[key] for key in self.check_keys(keys)]


class _Oriented(_Numbered, ABC):
    """Elements with an orientation."""

    @abstractmethod
    def read_quaternions(self, keys: Keys) -> Array:
        """Their orientations; MuJoCo's quaternions begin with the real part."""

    def read_turns(self, keys: Keys) -> tuple[Array, ...]:
        quaternions = self.read_quaternions(keys)
        w, x, y, z = quaternions.T
        return x, y, z, w, quaternions[:, _REAL_LAST]

    def read_angles(self, keys: Keys) -> Array:
        return np.array([compute_euler_angles(x, y, z, w) for w, x, y, z in self.read_quaternions(keys).tolist()])


def _read_array(owner: str, name: str, part: slice = _ALL) -> Callable[[Any, Keys], Array]:
    """A group that is an array of the `model` or the `data`, or some columns of one."""

    def read_array(table: _Numbered, keys: Keys) -> Array:
        found: Array = getattr(getattr(table.world, owner), name)[table.check_keys(keys)]
        return found if part is _ALL else found[:, part]

    return read_array


class MuJoCoBodies(_Oriented):
    name, count, kind = "bodies", "nbody", "body"
    text = "the bodies of the model; the first is `world`, which all that stands still belongs to"
    columns = make_body_columns()
    as_elements = False
    places = PLACES
    arrays: ClassVar[Mapping[str, str]] = {
        "read_names": "name", "read_elements": "obj", "read_places": POSITION, "read_turns": ROTATION,
        "read_angles": "rot", "read_velocities": VELOCITY, "read_spins": SPIN, "pushed": "force", "turned": "torque",
        "weight": "mass", "read_shapes": SHAPE, "read_volumes": "volume", "read_boxes": "aabb", "are_driven": "isRobot",
        "are_sensing": "isSensor", "are_touchable": "isEnabled", "are_movable": "hasBody", "read_poses": "pose",
    }  # fmt: skip

    def keys(self, where: Where) -> Iterable[int]:
        return self.world.filter_bodies(where)

    def read_elements(self, keys: Keys) -> list[Any]:
        return [self.element(int(key)) for key in self.check_keys(keys)]

    def read_quaternions(self, keys: Keys) -> Array:
        return np.asarray(self.world.data.xquat[self.check_keys(keys)])

    def read_places(self, keys: Keys) -> tuple[Array, ...]:
        points = self.world.data.xpos[self.check_keys(keys)]
        return *points.T, *points.T, points

    def read_velocities(self, keys: Keys) -> tuple[Array, ...]:
        model, data, index = self.world.model, self.world.data, self.check_keys(keys)
        known = data.cvel[index]  # of the point that is now at the centre of mass of the whole kinematic tree
        lever = data.xpos[index] - data.subtree_com[model.body_rootid[index]]
        linear: Array = known[:, 3:] + np.cross(known[:, :3], lever)
        return *linear.T, linear, linear

    def read_spins(self, keys: Keys) -> tuple[Array, ...]:
        angular = self.world.data.cvel[self.check_keys(keys), :3]
        return (*angular.T, angular)

    pushed = _read_array("data", "xfrc_applied", slice(3))
    turned = _read_array("data", "xfrc_applied", slice(3, 6))
    weight = _read_array("model", "body_mass")

    def read_shapes(self, keys: Keys) -> tuple[Any, ...]:
        return list_body_shape_columns(self.world.shapes.list_body_kinds()[self.check_keys(keys)])

    def read_volumes(self, keys: Keys) -> list[float | None]:
        return _list_mujoco_bounds(self.world.shapes.measure_body_volumes()[self.check_keys(keys)])

    def read_boxes(self, keys: Keys) -> Array:
        return self.world.shapes.measure_body_boxes()[self.check_keys(keys)]

    def are_driven(self, keys: Keys) -> Array:
        roots = self.world.model.body_rootid
        return np.isin(roots[self.check_keys(keys)], roots[self.world.driven_bodies])

    def are_sensing(self, keys: Keys) -> Array:
        return np.isin(self.check_keys(keys), self.world.sensing_bodies)

    def are_touchable(self, keys: Keys) -> Array:
        return np.asarray(self.world.shapes.touchable_bodies[self.check_keys(keys)])

    def are_movable(self, keys: Keys) -> Array:
        model = self.world.model
        return np.asarray(model.body_dofnum[model.body_weldid[self.check_keys(keys)]] > 0)

    def read_poses(self, keys: Keys) -> Array:
        return np.hstack((self.world.data.xpos[self.check_keys(keys)], self.read_quaternions(keys)[:, _REAL_LAST]))


class MuJoCoGeoms(_Oriented):
    name, count, kind, short = "geoms", "ngeom", "geom", "geom"
    text = "the shapes of the bodies"
    columns = (
        Column("id", int, "", "the number of the shape", "="),
        Column("name", str, "", "its name", "="),
        Column("body", int, "", "the id of its body", "="),
        Column("size", VECTOR, "m", "its size as MuJoCo has it: half edges; radius and half length"),
        *(replace(c, filter="") for c in make_body_columns() if c.name in _GEOM_COLUMNS),
    )
    arrays: ClassVar[Mapping[str, str]] = {
        "read_names": "name", "owner": "body", "read_places": POSITION, "read_turns": ROTATION, "read_angles": "rot",
        "read_shapes": SHAPE, "extent": "size", "read_volumes": "volume", "read_boxes": "aabb",
    }  # fmt: skip

    owner = _read_array("model", "geom_bodyid")
    extent = _read_array("model", "geom_size")

    def read_places(self, keys: Keys) -> tuple[Array, ...]:
        points = self.world.data.geom_xpos[self.check_keys(keys)]
        return *points.T, *points.T, points

    def read_quaternions(self, keys: Keys) -> Array:
        return self.world.shapes.read_quaternions(self.check_keys(keys))

    def read_shapes(self, keys: Keys) -> tuple[Any, ...]:
        return list_body_shape_columns(KINDS[self.world.model.geom_type[self.check_keys(keys)]])

    def read_volumes(self, keys: Keys) -> list[float | None]:
        return _list_mujoco_bounds(self.world.shapes.measure_volumes()[self.check_keys(keys)])

    def read_boxes(self, keys: Keys) -> Array:
        return self.world.shapes.measure_boxes()[self.check_keys(keys)]


class MuJoCoJoints(_Numbered):
    name, count, kind, short = "joints", "njnt", "joint", "jnt"
    text = "the joints by which bodies move"
    columns = (
        Column("id", int, "", "the number of the joint", "="),
        Column("name", str, "", "its name", "="),
        Column("type", str, "", "free, ball, slide or hinge"),
        Column("body", int, "", "the id of the body that it moves", "="),
        Column("angle", float | None, "rad or m", "how far it is turned, or slid; None of others"),
        Column("speed", float | None, "rad/s or m/s", "how fast it turns or slides; None of others"),
        Column("lower", float | None, "rad or m", "how far it can go down; None without an end"),
        Column("upper", float | None, "rad or m", "how far it can go up; None without an end"),
        Column("axis", VECTOR, "", "around which it turns or along which it slides"),
    )
    arrays: ClassVar[Mapping[str, str]] = {
        "read_names": "name", "read_types": "type", "owner": "body", "read_states": "angle speed",
        "read_limits": "lower upper", "direction": "axis",
    }  # fmt: skip

    def read_types(self, keys: Keys) -> list[str]:
        return [_JOINTS[kind] for kind in self.world.model.jnt_type[self.check_keys(keys)]]

    owner = _read_array("model", "jnt_bodyid")
    direction = _read_array("data", "xaxis")

    def read_states(self, keys: Keys) -> tuple[list[float | None], list[float | None]]:
        model, data, index = self.world.model, self.world.data, self.check_keys(keys)
        simple = model.jnt_type[index] >= 2
        positions = data.qpos[model.jnt_qposadr[index]]
        velocities = data.qvel[model.jnt_dofadr[index]]
        return _replace_mujoco_unknown(simple, positions), _replace_mujoco_unknown(simple, velocities)

    def read_limits(self, keys: Keys) -> tuple[list[float | None], list[float | None]]:
        model, index = self.world.model, self.check_keys(keys)
        limited = model.jnt_limited[index].astype(bool)
        lower, upper = model.jnt_range[index].T
        return _replace_mujoco_unknown(limited, lower), _replace_mujoco_unknown(limited, upper)


class MuJoCoSensors(_Numbered):
    name, count, kind = "sensors", "nsensor", "sensor"
    text = "the sensors and what they measure"
    columns = (
        Column("id", int, "", "the number of the sensor", "="),
        Column("name", str, "", "its name", "="),
        Column("type", str, "", "as MuJoCo calls it: accelerometer, jointpos, rangefinder"),
        Column("value", float | None, "", "what it measures, if that is one number"),
        Column("values", list, "", "what it measures"),
    )
    arrays: ClassVar[Mapping[str, str]] = {
        "read_names": "name",
        "read_types": "type",
        "read_single_values": "value",
        "read_values": "values",
    }

    def read_types(self, keys: Keys) -> list[str]:
        kind, numbers = import_module("mujoco").mjtSensor, self.world.model.sensor_type[self.check_keys(keys)]
        return [kind(int(number)).name.removeprefix("mjSENS_").lower() for number in numbers]

    def read_single_values(self, keys: Keys) -> list[float | None]:
        return [values[0] if len(values) == 1 else None for values in self.read_values(keys)]

    def read_values(self, keys: Keys) -> list[list[float]]:
        model, index = self.world.model, self.check_keys(keys)
        measured = self.world.data.sensordata.tolist()
        starts, sizes = model.sensor_adr[index].tolist(), model.sensor_dim[index].tolist()
        return [measured[start : start + size] for start, size in zip(starts, sizes, strict=True)]


class MuJoCoContacts(TableFunction):
    name = "contacts"
    text = "where bodies touch, or nearly do: all, those of body a, or those between a and b"
    columns = (
        *PAIR,
        Column("pointA", VECTOR, "m", "the point on a"),
        Column("pointB", VECTOR, "m", "the point on b"),
        Column("normal", VECTOR, "", "the direction from b to a"),
        Column("distance", float, "m", "between the surfaces; below 0 where they reach into each other"),
        Column("normalForce", float, "N", "how strongly they press"),
    )
    world: MuJoCoWorld

    def rows(self, a: Any = None, b: Any = None) -> Iterator[tuple[Any, ...]]:
        world = self.world
        requested, element = RequestedPairs(world, a, b), world.bodies.element
        contacts = world.data.contact
        owners = world.model.geom_bodyid[contacts.geom].tolist()
        normals, places, gaps = -contacts.frame[:, :3], contacts.pos, contacts.dist
        for number, (one, other) in enumerate(owners):
            pair = requested.order_pair(one, other)
            if pair is not None:
                normal = normals[number] if pair == (one, other) else -normals[number]
                half = normal * gaps[number] / 2
                points = places[number] + half, places[number] - half
                yield (*map(element, pair), *pair, *points, normal, gaps[number], world.measure_force(number))


def _list_mujoco_bounds(values: Array) -> list[float | None]:
    return [None if value != value else value for value in values.tolist()]


def _replace_mujoco_unknown(known: Array, values: Array) -> list[float | None]:
    return [value if yes else None for yes, value in zip(known.tolist(), values.tolist(), strict=True)]
