"""MJCF, MuJoCo's XML, as MuJoCo compiles it: its bodies become a URDF, its `<equality>` the closures.

Read off the compiled model: bodies with hinge, slide, ball and free joints, what acts along joints, sites as
frames, primitive geoms as shapes, flags, motors on joints or fixed tendons with their gear, limits, armature
and damping, the first keyframe as the reference (else the zero pose). Of `<equality>`: connect is spherical,
weld is fixed, joint and tendon are couplings or hold a joint; MuJoCo resolves anchors at the zero pose. What
else acts (spatial tendons, muscles, compensation of gravity) is left out by name; contact, sensors, cameras
and shapes of meshes without a word. The file says nothing about the platform.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import RobotFileError
from framework.model.description import Closure, Coupling, JointDynamics, ParsedRobot, locked_axes
from framework.model.placement import from_quaternion, inverse, placement
from framework.model.readers.describe import LeftOut, Options, Pull, describe
from framework.model.readers.mujoco_model import mujoco_model
from framework.model.readers.urdf_tree import MAX_LOOPS, UrdfTree
from framework.model.urdf_elements import SEVERAL, coordinates_of
from framework.model.urdf_writing import (
    ChainJoint,
    chain_elements,
    free_name,
    inertial_element,
    vector_text,
    visual_element,
)
from framework.numerics.arrays import Array

WORLD = "world"
_KINDS = ("floating", "spherical", "prismatic", "continuous")  # by mjtJoint
_SHAPES = {2: "sphere", 3: "cylinder", 5: "cylinder", 6: "box"}  # by mjtGeom; a capsule is drawn without ends
_EQUALITIES = ("connect", "weld", "joint", "tendon")  # by mjtEq; more are of flexible bodies
_JOINT_MOTORS = (0, 1)  # mjTRN_JOINT, mjTRN_JOINTINPARENT
_ON_TENDON, _OF_JOINT, _SITE = 3, 1, 6  # mjTRN_TENDON, mjWRAP_JOINT, mjOBJ_SITE
_DIRECT_GAINS = (0, 1, 6)  # mjtGain of motors: fixed, affine, and those of users
_DIRECT = (0, 1, 2, 3)  # mjtDyn of motors: none, integrator, filters; not muscles and those of users


def read_mjcf(file: Path, root: ElementTree.Element, options: Options) -> ParsedRobot:
    """Read the description in an MJCF file.

    Raises:
        MissingPackage: MuJoCo is not installed.
        RobotFileError: names the element.
    """
    _refuse_nan(root)
    compiled, left_out, unused = mujoco_model(file)
    if compiled.neq > MAX_LOOPS:
        raise RobotFileError(f"<equality>: at most {MAX_LOOPS} equalities are read")
    model = _Model(compiled)
    tree = UrdfTree(model.urdf(root.get("model") or "mjcf"))
    tree.unused += unused
    sites = [
        tree.add_frame(model.name("site", k) or f"site_{k}", model.bodies[compiled.site_bodyid[k]], place)
        for k, place in enumerate(_places(compiled.site_pos, compiled.site_quat))
    ]
    closures = list(model.loops(tree, sites))
    pulls = [*model.motors(), *model.tendons()]
    model.name_unread_effects()
    reference = model.reference()
    return describe(
        tree,
        file,
        options,
        closures,
        couplings=model.couplings,
        pulls=pulls,
        joints=model.acting(),
        gravity=tuple(compiled.opt.gravity.tolist()),
        reference={name: value for name, value in reference.items() if name in tree.coordinates},
        left_out=[*left_out, *model.left_out],
    )._replace(dialect="mjcf")


def _refuse_nan(root: ElementTree.Element) -> None:
    """Refuse numbers that are none, which MuJoCo computes with."""
    for element in root.iter():
        for key, value in element.attrib.items():
            if "nan" in value.lower().split():
                raise RobotFileError(f"<{element.tag}> {key}: needs finite numbers, got {value!r}")


def _places(positions: Array, quaternions: Array) -> Iterator[Array]:
    """Yield a placement (4, 4) for each position (3,) and quaternion (4,)."""
    for position, quaternion in zip(positions, quaternions, strict=True):
        yield placement(from_quaternion(*quaternion), position)


class _Joint(NamedTuple):
    """A joint by name and kind, with MuJoCo's view."""

    name: str
    kind: str
    view: Any

    @property
    def has_one(self) -> bool:
        """Whether the joint has one degree of freedom."""
        return self.kind in ("prismatic", "continuous")

    def coordinates_at(self, qpos: Array) -> list[float]:
        """Return the coordinates [rad, m] at the joint's part of MuJoCo's qpos, from the zero pose."""
        zero = self.view.qpos0
        if self.has_one:
            return list((qpos - zero).tolist())
        places = []
        for pose in (zero, qpos):
            x, y, z, *quaternion = np.append(np.zeros(3), pose)[-7:]  # of a ball only the quaternion is there
            places.append(placement(from_quaternion(*quaternion), (x, y, z)))
        motion = inverse(places[0]) @ places[1]
        turn = pin.log3(motion[:3, :3]).tolist()
        return [*turn] if self.kind == "spherical" else [*motion[:3, 3].tolist(), *turn]


class _Model:
    """A compiled model with a name for each body and joint.

    Couplings and unread elements are gathered while the loops and what acts are read.
    """

    def __init__(self, compiled: Any) -> None:
        """Name all bodies and joints: unnamed ones body_<k> and <body>_joint, <body>_joint_2."""
        self.compiled = compiled
        self.couplings: list[Coupling] = []
        self.left_out: list[LeftOut] = []
        names = [self.name("body", k) for k in range(compiled.nbody)]
        self.taken = {*names, ""}
        unnamed = (names[k] or free_name(f"body_{k}", self.taken) for k in range(1, compiled.nbody))
        self.bodies = [WORLD, *unnamed]
        self.joints: list[_Joint] = []
        for j, kind in enumerate(compiled.jnt_type):
            k = compiled.jnt_bodyid[j]
            rank = j - compiled.body_jntadr[k]
            name = self.name("joint", j) or f"{self.bodies[k]}_joint" + (f"_{rank + 1}" if rank else "")
            self.joints.append(_Joint(name, _KINDS[kind], compiled.joint(j)))
        self.all_joints = tuple(joint.name for joint in self.joints)

    def name(self, kind: str, number: int) -> str:
        return str(getattr(self.compiled, kind)(number).name)

    def leave_out(self, text: str, acts_on: Iterable[str], *, is_decisive: bool = False) -> None:
        self.left_out.append(LeftOut(text, tuple(acts_on), is_decisive))

    # -------------------------------------------------------------- the tree

    def urdf(self, name: str) -> ElementTree.Element:
        """Return the bodies as a URDF: a link for each, and one between the joints of a body."""
        model, root = self.compiled, ElementTree.Element("robot", name=name)
        links = [ElementTree.SubElement(root, "link", name=body) for body in self.bodies]
        for k, place in enumerate(_places(model.body_pos, model.body_quat)):
            if k == 0:
                continue  # the world
            root.extend(self._joint_elements(k, place))
            if model.body_mass[k] or model.body_inertia[k].any():
                turn = from_quaternion(*model.body_iquat[k])
                inertia = turn @ np.diag(model.body_inertia[k]) @ turn.T
                links[k].append(inertial_element(model.body_mass[k], model.body_ipos[k], inertia))
        for k, place in enumerate(_places(model.geom_pos, model.geom_quat)):
            if model.geom_type[k] in _SHAPES:
                shape = _visual(_SHAPES[model.geom_type[k]], model.geom_size[k], place)
                links[model.geom_bodyid[k]].append(shape)
        return root

    def _joint_elements(self, k: int, place: Array) -> Iterator[ElementTree.Element]:
        """Yield the joints and links that carry body k, at `place` (4, 4) in its parent.

        A joint turns about a point of the body: its link stands in that point, and the body's own behind it.
        """
        model, motions, end = self.compiled, list[ChainJoint](), place
        for joint in self.joints[model.body_jntadr[k] :][: model.body_jntnum[k]]:
            point = joint.view.pos if joint.kind != "floating" else np.zeros(3)
            motions.append(_motion(joint, end @ placement(None, point)))
            end = placement(None, -point)
        parent = self.bodies[model.body_parentid[k]]
        yield from chain_elements(parent, motions, self.bodies[k], end, self.taken)

    def reference(self) -> dict[str, float]:
        """Return joint angles of the first key, from the zero pose; empty without one."""
        model, reference = self.compiled, dict[str, float]()
        for joint in self.joints if model.nkey else ():
            start = joint.view.qposadr.item()
            qpos = model.key_qpos[0, start : start + joint.view.qpos0.size]
            names = coordinates_of(joint.name, joint.kind)
            reference.update(zip(names, joint.coordinates_at(qpos), strict=True))
        return reference

    # -------------------------------------------------------------- loops

    def loops(self, tree: UrdfTree, sites: list[str]) -> Iterator[Closure]:
        """Yield the closures of the equalities; gather couplings, and equalities that are not read.

        Joints that an equality holds become fixed in the tree.
        """
        model = self.compiled
        for k in np.flatnonzero(model.eq_active0).tolist():
            kind = _EQUALITIES[model.eq_type[k]] if model.eq_type[k] < len(_EQUALITIES) else "flex"
            ends = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
            name = self.name("equality", k) or f"{kind}_{k + 1}"
            if kind == "flex":
                self.leave_out(f"equality {name!r}: of flexible bodies", tree.coordinates, is_decisive=True)
            elif kind in ("joint", "tendon"):
                yield from self._joint_equality(tree, name, kind, ends, model.eq_data[k])
            elif model.eq_objtype[k] == _SITE:
                axes = locked_axes(_closure_kind(kind, model.eq_data[k]))
                yield Closure(name, (sites[ends[0]], sites[ends[1]]), axes)
            else:
                yield self._body_equality(tree, name, kind, ends, model.eq_data[k])

    def _body_equality(
        self, tree: UrdfTree, name: str, kind: str, ends: tuple[int, int], data: Array
    ) -> Closure:
        """Return the closure of two bodies at coinciding placements."""
        places = [placement(None, data[:3]), placement(None, data[3:6])]
        if kind == "weld":
            places = [placement(from_quaternion(*data[6:10]), data[3:6]), placement(None, data[:3])]
        bodies = [self.bodies[end] for end in ends]
        return tree.close(name, _closure_kind(kind, data), zip("12", bodies, places, strict=True))

    def _joint_equality(
        self, tree: UrdfTree, name: str, kind: str, ends: tuple[int, int], data: Array
    ) -> Iterator[Closure]:
        """Gather the coupling of an equality of joints or tendons; a joint that is held alone becomes fixed.

        Equal turns about parallel axes of one body are a closure, which all proofs know. MuJoCo's polynomial
        is between ways from the zero pose, as ours is.
        """
        where = f"{kind} equality {name!r}"
        offset, ratio = data[:2].tolist()
        first, second = (self._shares(kind, end) for end in ends)
        if first is None or second is None:
            where += ": of a spatial tendon, which is not read"
            return self.leave_out(where, tree.coordinates, is_decisive=True)
        differences = {
            joint: first.get(joint, 0.0) - ratio * second.get(joint, 0.0) for joint in first | second
        }
        shares = {joint: share for joint, share in differences.items() if share}
        if second and data[2:5].any():
            polynomial = " ".join(map("{:g}".format, data[:5]))
            where += (
                f": polycoef {polynomial} couples {' and '.join(differences)}: only linear couplings are read"
            )
            self.leave_out(where, differences, is_decisive=True)
        elif len(shares) > 2:
            where += f": couples {', '.join(shares)}: only couplings of two joints are read"
            self.leave_out(where, shares, is_decisive=True)
        elif len(shares) == 2:
            yield from self._couple(tree, name, shares, offset)
        for joint, share in shares.items() if len(shares) == 1 else ():
            if tree.joints[joint].moves:
                tree.fix(tree.joints[joint], offset / share)

    def _couple(
        self, tree: UrdfTree, name: str, shares: Mapping[str, float], offset: float
    ) -> Iterator[Closure]:
        """Gather the coupling of two joints, or yield the closure of equal turns."""
        (driven, share), (of, other) = shares.items()
        is_equal = (offset, share, other) == (0.0, 1.0, -1.0)
        if is_equal and (closure := _parallel_turns(tree, name, driven, of)):
            yield closure
        else:
            self.couplings.append(Coupling(driven, of, -other / share, offset / share))

    def _shares(self, kind: str, number: int) -> dict[str, float] | None:
        """Return the joints of a joint or a fixed tendon with their shares; None of a spatial tendon."""
        model = self.compiled
        if number < 0:
            return {}
        if kind == "joint":
            return {self.joints[number].name: 1.0}
        parts = slice(model.tendon_adr[number], model.tendon_adr[number] + model.tendon_num[number])
        if (model.wrap_type[parts] != _OF_JOINT).any():
            return None
        names = [self.joints[j].name for j in model.wrap_objid[parts]]
        return dict(zip(names, model.wrap_prm[parts].tolist(), strict=True))

    # -------------------------------------------------------------- what acts

    def acting(self) -> dict[str, JointDynamics]:
        """Return armature, damping, friction and springs by coordinate."""
        joints = dict[str, JointDynamics]()
        for joint in self.joints:
            view = joint.view
            stiffness = float(view.stiffness[0]) if joint.has_one else 0.0
            acting = JointDynamics(
                armature=float(view.armature[0]),
                damping=float(view.damping[0]),
                friction=float(view.frictionloss[0]),
                stiffness=stiffness,
                rest=float(view.qpos_spring[0] - view.qpos0[0]) if stiffness else 0.0,
            )
            if acting != JointDynamics():
                joints.update(dict.fromkeys(coordinates_of(joint.name, joint.kind), acting))
        return joints

    def tendons(self) -> Iterator[Pull]:
        """Yield the fixed tendons with their dynamics."""
        model = self.compiled
        for k, (low, high) in enumerate(model.tendon_lengthspring):
            shares = self._shares("tendon", k)
            acting = JointDynamics(
                armature=float(model.tendon_armature[k]),
                damping=float(model.tendon_damping[k]),
                friction=float(model.tendon_frictionloss[k]),
                stiffness=float(model.tendon_stiffness[k]) if low == high else 0.0,
                rest=float(low - model.tendon_length0[k]),
            )
            if shares is not None:
                yield Pull(f"tendon {self.name('tendon', k)!r}", shares, acting=acting, is_motor=False)

    def motors(self) -> Iterator[Pull]:
        """Yield motors on hinges, slides and their fixed tendons; gather other motors as left out."""
        model = self.compiled
        for k in range(model.nactuator):
            target, kind, gear = int(model.actuator_trnid[k, 0]), model.actuator_trntype[k], self._gear(k)
            shares: Mapping[str, float] | None = None
            acts_on, name = self.all_joints, self.name("actuator", k)
            if kind in _JOINT_MOTORS:
                joint = self.joints[target]
                acts_on, name = (joint.name,), name or joint.name
                shares = {joint.name: 1.0} if joint.has_one else None
            elif kind == _ON_TENDON:
                shares = self._shares("tendon", target)
                acts_on = tuple(shares or acts_on)
            where = f"motor {name or f'actuator_{k + 1}'!r}"
            if model.actuator_gaintype[k] not in _DIRECT_GAINS or model.actuator_dyntype[k] not in _DIRECT:
                self.leave_out(f"{where}: a muscle, or an actuator of another program", acts_on)
            elif not shares or not gear:
                self.leave_out(f"{where}: no motor on a hinge or a slide", acts_on)
            else:
                acting = JointDynamics(float(model.actuator_armature[k]), float(model.actuator_damping[k]))
                yield Pull(where, shares, gear, acting, self._force_limit(k))

    def _gear(self, k: int) -> float:
        return float(self.compiled.actuator_gear[k, 0])

    def _force_limit(self, k: int) -> float | None:
        """Return the least symmetric limit of a motor [N m, N]."""
        model = self.compiled
        joint = int(model.actuator_trnid[k, 0])
        ranges = [model.actuator_forcerange[k]] if model.actuator_forcelimited[k] else []
        is_plain = not (model.actuator_gaintype[k] or model.actuator_biastype[k] or model.actuator_dyntype[k])
        if model.actuator_ctrllimited[k] and is_plain:
            ranges.append(model.actuator_ctrlrange[k] * model.actuator_gainprm[k, 0])
        if model.actuator_trntype[k] in _JOINT_MOTORS and model.jnt_actfrclimited[joint]:
            ranges.append(model.jnt_actfrcrange[joint] / abs(self._gear(k)))
        return min((float(abs(high)) for low, high in ranges if high and low == -high), default=None)

    def name_unread_effects(self) -> None:
        """Gather unread effects of joints, bodies, tendons and the fluid, with their sizes."""
        model = self.compiled
        for joint in self.joints:
            for effect in _unread_effects(joint):
                self.leave_out(f"joint {joint.name!r}{effect}", [joint.name])
        for k, body in enumerate(self.bodies):
            if model.body_mocapid[k] >= 0:
                self.leave_out(f"body {body!r}: mocap, so it stands still", [body])
            if model.body_gravcomp[k]:
                weight = model.body_gravcomp[k] * model.body_mass[k] * np.linalg.norm(model.opt.gravity)
                self.leave_out(f"body {body!r} gravcomp {model.body_gravcomp[k]:g}: {weight:.3g} N", [body])
        for k in range(model.ntendon):
            if acting := self._left_out_of_tendon(k):
                touched = self._shares("tendon", k) or self.all_joints  # a spatial one may touch any body
                self.leave_out(f"tendon {self.name('tendon', k)!r}: {', '.join(acting)}", touched)
        if model.opt.density or model.opt.viscosity:
            around = f"density {model.opt.density:g}, viscosity {model.opt.viscosity:g}"
            self.leave_out(f"<option> {around}: the drag of the fluid", self.all_joints)

    def _left_out_of_tendon(self, k: int) -> list[str]:
        """Return the unread effects of a tendon: all of a spatial one, slack springs, ranges."""
        model, acting = self.compiled, list[str]()
        if self._shares("tendon", k) is None:
            for key in ("stiffness", "damping", "frictionloss", "armature"):
                value = getattr(model, f"tendon_{key}")[k]
                acting += [f"{key} {value:g}"] if value else []
        elif model.tendon_stiffness[k] and np.ptp(model.tendon_lengthspring[k]):
            acting.append("a spring with slack")
        if model.tendon_limited[k]:
            acting.append("range {:g} {:g}".format(*model.tendon_range[k]))
        return acting


def _parallel_turns(tree: UrdfTree, name: str, *joints: str) -> Closure | None:
    """Return the closure of two joints' equal turns about parallel axes of one body, or None."""
    children = [tree.joints[joint].child for joint in joints]
    chains = tree.moving_chains(*children)
    if [[part.name for part in chain] for chain in chains] != [[joint] for joint in joints]:
        return None
    return tree.same_turning(name, *children)


def _unread_effects(joint: _Joint) -> Iterator[str]:
    """Yield the unread effects of a joint: springs of balls, powers of damping and stiffness."""
    view = joint.view
    if joint.kind in SEVERAL and view.stiffness[0]:
        yield f": spring of a ball, {view.stiffness[0]:g} N m/rad"
    for effect, rows in (("damping", view.dampingpoly), ("stiffness", view.stiffnesspoly)):
        values = np.atleast_2d(rows)[0]
        if values.any():
            yield f" {effect}: higher powers {' '.join(map('{:g}'.format, values))}"


def _closure_kind(kind: str, data: Array) -> str:
    """Return the closure kind of a connect or a weld; a weld of no turn holds a point."""
    return "fixed" if kind == "weld" and data[10] else "spherical"


def _motion(joint: _Joint, place: Array) -> ChainJoint:
    """Return a joint of the URDF at a placement (4, 4) in the link before."""
    view = joint.view
    limits = (view.range - view.qpos0).tolist() if joint.has_one and view.limited[0] else None
    return ChainJoint(joint.name, joint.kind, place, view.axis if joint.has_one else None, limits)


def _visual(shape: str, size: Array, place: Array) -> ElementTree.Element:
    """Return the URDF's `<visual>` of a primitive geom."""
    radius, half, _ = map(float, size)
    words = {"radius": repr(radius)} if shape != "box" else {"size": vector_text(2 * size)}
    if shape == "cylinder":
        words["length"] = repr(2 * half)
    return visual_element(shape, words, place)
