"""MJCF, MuJoCo's XML, as MuJoCo compiles it: its bodies become a URDF, its `<equality>` the closures.

Read off the compiled model: bodies with hinge, slide, ball and free joints, what acts along joints, sites as
frames, primitive geoms as shapes, flags, motors on joints or fixed tendons with their gear, limits, armature
and damping, the first keyframe as the reference (else the zero pose). Of `<equality>`: connect is spherical,
weld is fixed, joint and tendon are couplings or hold a joint; MuJoCo resolves anchors at the zero pose. What
else acts (spatial tendons, muscles, compensation of gravity) is left out by name; contact, sensors, cameras
and shapes of meshes without a word. The file says nothing about the platform.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from framework.errors import RobotFileError
from framework.model.description import Coupling, JointDynamics, ParsedRobot, locked_axes
from framework.model.placement import from_quaternion, invert_placement, placement
from framework.model.readers.describe import Options, describe
from framework.model.readers.mujoco_model import compile_mjcf
from framework.model.readers.urdf_tree import MAX_LOOPS, Transmission, UnreadElement, UrdfTree
from framework.model.urdf_edits import (
    NewJoint,
    chain_elements,
    free_name,
    inertial_element,
    vector_text,
    visual_element,
)
from framework.model.urdf_elements import SEVERAL, coordinates_of
from framework.numerics.arrays import Array

WORLD = "world"
_KINDS = ("floating", "spherical", "prismatic", "continuous")  # by mjtJoint
_SHAPES = {2: "sphere", 3: "cylinder", 5: "cylinder", 6: "box"}  # by mjtGeom; a capsule is drawn without ends
_EQUALITIES = ("connect", "weld", "joint", "tendon")  # by mjtEq; more are of flexible bodies
_ACTING = ("armature", "damping", "frictionloss", "stiffness")  # of joints and tendons, as of JointDynamics
_JOINT_MOTORS = (0, 1)  # mjTRN_JOINT, mjTRN_JOINTINPARENT
_ON_TENDON, _OF_JOINT, _SITE = 3, 1, 6  # mjTRN_TENDON, mjWRAP_JOINT, mjOBJ_SITE
_DIRECT_GAINS = (0, 1, 6)  # mjtGain of motors: fixed, affine, and those of users
_DIRECT = (0, 1, 2, 3)  # mjtDyn of motors: none, integrator, filters; not muscles and those of users


def read_mjcf(file: Path, root: Element, options: Options) -> ParsedRobot:
    """Read the robot in an MJCF file.

    Raises:
        MissingPackage: MuJoCo is not installed.
        RobotFileError: names the element.
    """
    for element in root.iter():
        for key, value in element.attrib.items():
            if "nan" in value.lower().split():  # with which MuJoCo computes
                raise RobotFileError(f"<{element.tag}> {key}: needs finite numbers, got {value!r}")
    compiled, left_out, unused = compile_mjcf(file)
    if compiled.neq > MAX_LOOPS:
        raise RobotFileError(f"<equality>: at most {MAX_LOOPS} equalities are read")
    model = _Model(compiled, root.get("model") or "mjcf")
    model.tree.unused += unused
    model.tree.left_out += left_out
    model.read_joints()
    model.read_equalities()
    model.read_transmissions()
    model.name_unread_effects()
    return describe(model.tree, file, options, "mjcf")


def _placements(positions: Array, quaternions: Array) -> Iterator[Array]:
    """Yield the placement (4, 4) of each position (3,) and quaternion (4,)."""
    for position, quaternion in zip(positions, quaternions, strict=True):
        yield placement(from_quaternion(*quaternion), position)


class _Joint(NamedTuple):
    """A joint by name and kind of the URDF, with its part of the compiled model."""

    name: str
    kind: str
    view: Any

    @property
    def has_one_freedom(self) -> bool:
        """Whether the joint has one degree of freedom."""
        return self.kind not in SEVERAL

    def coordinates_at(self, qpos: Array) -> list[float]:
        """Convert the joint's part of MuJoCo's qpos to coordinates, 0 in MuJoCo's zero pose."""
        zero = self.view.qpos0
        if self.has_one_freedom:
            return list((qpos - zero).tolist())
        places = []
        for pose in (zero, qpos):
            x, y, z, *quaternion = np.append(np.zeros(3), pose)[-7:]  # of a ball only the quaternion is there
            places.append(placement(from_quaternion(*quaternion), (x, y, z)))
        motion = invert_placement(places[0]) @ places[1]
        values = [*motion[:3, 3].tolist(), *pin.log3(motion[:3, :3]).tolist()]
        return values[-len(SEVERAL[self.kind]) :]

    def urdf_joint(self, origin: Array) -> NewJoint:
        """Return the joint of the URDF at a placement (4, 4) in the link before."""
        view = self.view
        if not self.has_one_freedom:
            return NewJoint(self.name, self.kind, origin)
        limits = (view.range - view.qpos0).tolist() if view.limited[0] else None
        return NewJoint(self.name, self.kind, origin, view.axis, limits)


class _Model:
    """A compiled model with named bodies and joints, and its URDF tree."""

    def __init__(self, compiled: Any, name: str) -> None:
        """Name all bodies and joints: unnamed ones body_<k> and <body>_joint, <body>_joint_2."""
        self.compiled = compiled
        names = [self.name("body", k) for k in range(compiled.nbody)]
        taken = {*names, ""}
        unnamed = (names[k] or free_name(f"body_{k}", taken) for k in range(1, compiled.nbody))
        self.bodies = [WORLD, *unnamed]
        self.joints: list[_Joint] = []
        for j, kind in enumerate(compiled.jnt_type):
            k = compiled.jnt_bodyid[j]
            rank = j - compiled.body_jntadr[k]
            by_body = f"{self.bodies[k]}_joint" + (f"_{rank + 1}" if rank else "")
            self.joints.append(_Joint(self.name("joint", j) or by_body, _KINDS[kind], compiled.joint(j)))
        self.all_joints = tuple(joint.name for joint in self.joints)
        self.tree = UrdfTree(self._make_urdf(name, taken))
        self.tree.gravity = tuple(compiled.opt.gravity.tolist())
        self.sites = [
            self.tree.add_frame(
                self.name("site", k) or f"site_{k}", self.bodies[compiled.site_bodyid[k]], origin
            )
            for k, origin in enumerate(_placements(compiled.site_pos, compiled.site_quat))
        ]

    def name(self, kind: str, number: int) -> str:
        """Return the name of an element of a kind; "" without one."""
        return str(getattr(self.compiled, kind)(number).name)

    def leave_out(self, text: str, acts_on: Iterable[str], *, is_decisive: bool = False) -> None:
        """Report an unread element and the bodies or joints under its action."""
        self.tree.left_out.append(UnreadElement(text, tuple(acts_on), is_decisive))

    def _make_urdf(self, name: str, taken: set[str]) -> Element:
        """Return the URDF: a link for each body, and one between joints of one body.

        A joint turns about a point of the body: its link stands in that point, and the body's own behind it.
        """
        model, root = self.compiled, Element("robot", name=name)
        links = [SubElement(root, "link", name=body) for body in self.bodies]
        for k, origin in enumerate(_placements(model.body_pos, model.body_quat)):
            if k == 0:
                continue  # the world
            motions, end = list[NewJoint](), origin
            for joint in self.joints[model.body_jntadr[k] :][: model.body_jntnum[k]]:
                point = joint.view.pos if joint.kind != "floating" else np.zeros(3)
                motions.append(joint.urdf_joint(end @ placement(None, point)))
                end = placement(None, -point)
            parent = self.bodies[model.body_parentid[k]]
            root.extend(chain_elements(parent, motions, self.bodies[k], end, taken))
            if model.body_mass[k] or model.body_inertia[k].any():
                turn = from_quaternion(*model.body_iquat[k])
                inertia = turn @ np.diag(model.body_inertia[k]) @ turn.T
                links[k].append(inertial_element(model.body_mass[k], model.body_ipos[k], inertia))
        for k, origin in enumerate(_placements(model.geom_pos, model.geom_quat)):
            if model.geom_type[k] in _SHAPES:
                shape = _make_visual(_SHAPES[model.geom_type[k]], model.geom_size[k], origin)
                links[model.geom_bodyid[k]].append(shape)
        return root

    def _moment_arms(self, kind: str, number: int) -> dict[str, float] | None:
        """Return d length / d q by joint, of a joint or tendon; None of a spatial tendon."""
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

    # -------------------------------------------------------------- loops

    def read_equalities(self) -> None:
        """Read closures and couplings into the tree; fix joints held by an equality."""
        model = self.compiled
        for k in np.flatnonzero(model.eq_active0).tolist():
            kind = _EQUALITIES[model.eq_type[k]] if model.eq_type[k] < len(_EQUALITIES) else "flex"
            name = self.name("equality", k) or f"{kind}_{k + 1}"
            if kind == "flex":
                self.leave_out(f"equality {name!r}: of flexible bodies", self.all_joints, is_decisive=True)
            elif kind in ("joint", "tendon"):
                self._read_joint_equality(k, name, kind)
            else:
                self._close_loop(k, name, kind)

    def _close_loop(self, k: int, name: str, kind: str) -> None:
        """Close a loop by a connect or a weld of sites or bodies."""
        model, data, places = self.compiled, self.compiled.eq_data[k], 2 * [np.eye(4)]
        frames = self.sites if model.eq_objtype[k] == _SITE else self.bodies
        if frames is self.bodies and kind == "connect":
            places = [placement(None, data[:3]), placement(None, data[3:6])]
        elif frames is self.bodies:
            places = [placement(from_quaternion(*data[6:10]), data[3:6]), placement(None, data[:3])]
        ends = frames[model.eq_obj1id[k]], frames[model.eq_obj2id[k]]
        holds_turn = kind == "weld" and data[10]
        closure_kind = "fixed" if holds_turn else "spherical"
        self.tree.close(name, locked_axes(closure_kind), zip("12", ends, places, strict=True))

    def _read_joint_equality(self, k: int, name: str, kind: str) -> None:
        """Read an equality of joints or tendons: a coupling, or a fixed joint.

        Lengths from the zero pose obey: first = offset + ratio * second.
        """
        model, where = self.compiled, f"{kind} equality {name!r}"
        offset, ratio = model.eq_data[k, :2].tolist()
        ends = model.eq_obj1id[k], model.eq_obj2id[k]
        first, second = (self._moment_arms(kind, int(end)) for end in ends)
        if first is None or second is None:
            where += ": of a spatial tendon, which is not read"
            self.leave_out(where, self.all_joints, is_decisive=True)
            return
        differences = {
            joint: first.get(joint, 0.0) - ratio * second.get(joint, 0.0) for joint in first | second
        }
        arms, problem = {joint: arm for joint, arm in differences.items() if arm}, ""
        if second and model.eq_data[k, 2:5].any():
            polynomial = " ".join(map("{:g}".format, model.eq_data[k, :5]))
            coupled = " and ".join(differences)
            problem = f"polycoef {polynomial} couples {coupled}: only linear couplings are read"
        elif len(arms) > 2:
            problem = f"couples {', '.join(arms)}: only couplings of two joints are read"
        if problem:
            self.leave_out(f"{where}: {problem}", differences, is_decisive=True)
        elif len(arms) == 2:
            self._couple(name, arms, offset)
        for joint, arm in arms.items() if len(arms) == 1 else ():
            if self.tree.joints[joint].moves:
                self.tree.fix(self.tree.joints[joint], offset / arm)

    def _couple(self, name: str, arms: Mapping[str, float], offset: float) -> None:
        """Couple two joints; by a closure, which all proofs know, if equal and parallel."""
        tree = self.tree
        (driven, arm), (of, other) = arms.items()
        children = [tree.joints[joint].child for joint in arms]
        chains = [[joint.name for joint in chain] for chain in tree.moving_chains(*children)]
        is_equal = (offset, arm, other) == (0.0, 1.0, -1.0) and chains == [[driven], [of]]
        if not (is_equal and tree.close_turns(name, *children)):
            tree.couplings.append(Coupling(driven, of, -other / arm, offset / arm))

    # -------------------------------------------------------------- what acts

    def read_joints(self) -> None:
        """Read armature, damping, friction and springs by coordinate, and the first key as the reference."""
        model = self.compiled
        for joint in self.joints:
            view, names = joint.view, coordinates_of(joint.name, joint.kind)
            rest = view.qpos_spring[0] - view.qpos0[0] if joint.has_one_freedom else None
            dynamics = _make_dynamics((getattr(view, key)[0] for key in _ACTING), rest)
            if dynamics != JointDynamics():
                self.tree.dynamics |= dict.fromkeys(names, dynamics)
            if model.nkey:
                start = view.qposadr.item()
                qpos = model.key_qpos[0, start : start + view.qpos0.size]
                self.tree.reference |= zip(names, joint.coordinates_at(qpos), strict=True)

    def read_transmissions(self) -> None:
        """Read motors on hinges, slides and fixed tendons, and the fixed tendons themselves."""
        for k in range(self.compiled.nactuator):
            self._read_motor(k)
        for k in range(self.compiled.ntendon):
            self._read_tendon(k)

    def _read_motor(self, k: int) -> None:
        """Read motor k on a hinge, slide or fixed tendon; report any other as unread."""
        model = self.compiled
        target, kind = int(model.actuator_trnid[k, 0]), model.actuator_trntype[k]
        gear = float(model.actuator_gear[k, 0])
        arms: Mapping[str, float] | None = None
        acts_on, name = self.all_joints, self.name("actuator", k)
        if kind in _JOINT_MOTORS:
            joint = self.joints[target]
            acts_on, name = (joint.name,), name or joint.name
            arms = {joint.name: 1.0} if joint.has_one_freedom else None
        elif kind == _ON_TENDON:
            arms = self._moment_arms("tendon", target)
            acts_on = tuple(arms or acts_on)
        where = f"motor {name or f'actuator_{k + 1}'!r}"
        if model.actuator_gaintype[k] not in _DIRECT_GAINS or model.actuator_dyntype[k] not in _DIRECT:
            self.leave_out(f"{where}: a muscle, or an actuator of another program", acts_on)
        elif not arms or not gear:
            self.leave_out(f"{where}: no motor on a hinge or a slide", acts_on)
        else:
            dynamics = JointDynamics(float(model.actuator_armature[k]), float(model.actuator_damping[k]))
            motor = Transmission(where, arms, gear, dynamics, self._force_limit(k, gear))
            self.tree.transmissions.append(motor)

    def _read_tendon(self, k: int) -> None:
        """Read inertia, damping, friction and spring of a fixed tendon k."""
        model, arms = self.compiled, self._moment_arms("tendon", k)
        if arms is None:
            return  # a spatial one
        low, high = model.tendon_lengthspring[k]
        rest = low - model.tendon_length0[k] if low == high else None
        dynamics = _make_dynamics((getattr(model, f"tendon_{key}")[k] for key in _ACTING), rest)
        where = f"tendon {self.name('tendon', k)!r}"
        self.tree.transmissions.append(Transmission(where, arms, 1.0, dynamics, is_motor=False))

    def _force_limit(self, k: int, gear: float) -> float | None:
        """Return the least symmetric limit [N m, N] of a motor; None without one."""
        model = self.compiled
        joint = int(model.actuator_trnid[k, 0])
        ranges = [model.actuator_forcerange[k]] if model.actuator_forcelimited[k] else []
        is_plain = not (model.actuator_gaintype[k] or model.actuator_biastype[k] or model.actuator_dyntype[k])
        if model.actuator_ctrllimited[k] and is_plain:
            ranges.append(model.actuator_ctrlrange[k] * model.actuator_gainprm[k, 0])
        if model.actuator_trntype[k] in _JOINT_MOTORS and model.jnt_actfrclimited[joint]:
            ranges.append(model.jnt_actfrcrange[joint] / abs(gear))
        return min((float(abs(high)) for low, high in ranges if high and low == -high), default=None)

    def name_unread_effects(self) -> None:
        """Report unread effects of joints, bodies, tendons and the fluid, with sizes."""
        model = self.compiled
        for joint in self.joints:
            view, where = joint.view, f"joint {joint.name!r}"
            if not joint.has_one_freedom and view.stiffness[0]:
                text = f"{where}: spring of a ball, {view.stiffness[0]:g} N m/rad"
                self.leave_out(text, [joint.name])
            for effect, rows in (("damping", view.dampingpoly), ("stiffness", view.stiffnesspoly)):
                if rows.any():
                    powers = " ".join(map("{:g}".format, np.atleast_2d(rows)[0]))
                    self.leave_out(f"{where} {effect}: higher powers {powers}", [joint.name])
        for k, body in enumerate(self.bodies):
            if model.body_mocapid[k] >= 0:
                self.leave_out(f"body {body!r}: mocap, so it stands still", [body])
            if model.body_gravcomp[k]:
                weight = model.body_gravcomp[k] * model.body_mass[k] * np.linalg.norm(model.opt.gravity)
                self.leave_out(f"body {body!r} gravcomp {model.body_gravcomp[k]:g}: {weight:.3g} N", [body])
        for k in range(model.ntendon):
            if effects := self._unread_effects_of_tendon(k):
                touched = self._moment_arms("tendon", k) or self.all_joints  # a spatial one: any body
                self.leave_out(f"tendon {self.name('tendon', k)!r}: {', '.join(effects)}", touched)
        if model.opt.density or model.opt.viscosity:
            around = f"density {model.opt.density:g}, viscosity {model.opt.viscosity:g}"
            self.leave_out(f"<option> {around}: the drag of the fluid", self.all_joints)

    def _unread_effects_of_tendon(self, k: int) -> list[str]:
        """List the unread effects of a tendon: all of a spatial one, slack, ranges."""
        model, effects = self.compiled, list[str]()
        if self._moment_arms("tendon", k) is None:
            for key in ("stiffness", "damping", "frictionloss", "armature"):
                value = getattr(model, f"tendon_{key}")[k]
                effects += [f"{key} {value:g}"] if value else []
        elif model.tendon_stiffness[k] and np.ptp(model.tendon_lengthspring[k]):
            effects.append("a spring with slack")
        if model.tendon_limited[k]:
            effects.append("range {:g} {:g}".format(*model.tendon_range[k]))
        return effects


def _make_dynamics(values: Iterable[float], rest: float | None) -> JointDynamics:
    """Return joint dynamics of values in the order of _ACTING; no spring without `rest`."""
    armature, damping, friction, stiffness = map(float, values)
    if rest is None or not stiffness:
        return JointDynamics(armature, damping, friction)
    return JointDynamics(armature, damping, friction, stiffness, float(rest))


def _make_visual(shape: str, size: Array, origin: Array) -> Element:
    """Return the URDF's `<visual>` of a primitive geom."""
    radius, half, _ = map(float, size)
    words = {"radius": repr(radius)} if shape != "box" else {"size": vector_text(2 * size)}
    if shape == "cylinder":
        words["length"] = repr(2 * half)
    return visual_element(shape, words, origin)
