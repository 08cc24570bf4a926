"""Read MJCF, MuJoCo's XML, as MuJoCo compiles it: bodies become a URDF, `<equality>` becomes closures.

The reader takes from the compiled model: bodies with hinge, slide, ball and free joints, and the forces along
these joints; sites as frames; primitive geoms as shapes; flags; motors on joints or fixed tendons, with gear,
limits, armature and damping; the first keyframe as the reference (else the zero pose). Of `<equality>`,
connect is a spherical closure, weld is a fixed one, joint and tendon are couplings (polynomials of joints)
or fix a joint, and a spatial tendon between two sites that is held at its length is a distance closure; one
with stiffness or damping is a spring between points. MuJoCo resolves anchors at the zero pose. Other forces
(other spatial tendons, muscles, gravity compensation) are reported by name; contact, sensors, cameras and the
shapes of meshes are ignored. The file says nothing about the platform.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations_with_replacement
from math import factorial, prod
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from framework.errors import RobotFileError
from framework.model.description import (
    MAX_TERMS,
    Closure,
    JointDynamics,
    LineSpring,
    Product,
    locked_axes,
)
from framework.model.placement import from_quaternion, invert_placement, placement
from framework.model.readers.describe import Options, describe
from framework.model.readers.mujoco_model import check_expansion, compile_mjcf, member_name
from framework.model.readers.urdf_tree import MAX_LOOPS, Transmission, UnreadElement, UrdfTree
from framework.model.urdf_edits import add_chain, free_name, inertial_element, vector_text, visual_element
from framework.model.urdf_elements import (
    COORDINATE_SUFFIXES,
    SIZES_OF_SHAPES,
    Joint,
    ParsedRobot,
    Tree,
    coordinates_of,
)
from framework.numerics.arrays import Array

# Members of MuJoCo's enumerations, by name. Joints in terms of a URDF:
_KIND_OF_JOINT = {
    "mjJNT_FREE": "floating",
    "mjJNT_BALL": "spherical",
    "mjJNT_SLIDE": "prismatic",
    "mjJNT_HINGE": "continuous",
}
# geoms in terms of a URDF; a capsule is drawn without its ends
_SHAPE_OF_GEOM = {
    "mjGEOM_SPHERE": "sphere",
    "mjGEOM_CAPSULE": "cylinder",
    "mjGEOM_CYLINDER": "cylinder",
    "mjGEOM_BOX": "box",
}
_EQUALITIES = ("connect", "weld", "joint", "tendon")  # behind mjEQ_; others are of flexible bodies
_JOINT_MOTORS = ("mjTRN_JOINT", "mjTRN_JOINTINPARENT")
_MOTOR_GAINS = ("mjGAIN_FIXED", "mjGAIN_AFFINE", "mjGAIN_USER")  # a muscle is no motor
_MOTOR_DYNAMICS = ("mjDYN_NONE", "mjDYN_INTEGRATOR", "mjDYN_FILTER", "mjDYN_FILTEREXACT")
# MuJoCo's fields of joints and tendons, in the order of JointDynamics
_DYNAMICS_FIELDS = ("armature", "damping", "frictionloss", "stiffness")


def read_mjcf(file: Path, root: Element, options: Options) -> ParsedRobot:
    """Read the robot in an MJCF file, whose parsed `root` is checked before MuJoCo compiles the file.

    Raises:
        MissingPackage: MuJoCo is not installed.
        RobotFileError: the file is malformed or cannot be read; the message names the element.
    """
    for element in root.iter():
        for key, value in element.attrib.items():
            if "nan" in value.lower().split():  # MuJoCo would accept it
                raise RobotFileError(f"<{element.tag}> {key}: needs finite numbers, got {value!r}")
    check_expansion(root, file.parent)
    # `left_out` names unread elements one by one; `unused` counts those that no motion needs
    compiled, left_out, unused = compile_mjcf(file)
    if compiled.neq > MAX_LOOPS:
        raise RobotFileError(f"<equality>: at most {MAX_LOOPS} equalities are read")
    model = _Model(compiled, root.get("model") or "mjcf")
    model.tree.unused += unused
    model.tree.left_out += left_out
    model.read_keyframe()
    model.read_equalities()
    for k in range(model.compiled.nactuator):  # motors on hinges, slides and fixed tendons
        model.read_motor(k)
    for k in range(model.compiled.ntendon):
        model.read_tendon(k)
    model.name_unread_effects()
    return describe(model.tree, file, options, "mjcf")


def _placements(positions: Array, quaternions: Array) -> Iterator[Array]:
    """Yield a placement (4, 4) for each position (3,) and quaternion w, x, y, z (4,)."""
    for position, quaternion in zip(positions, quaternions, strict=True):
        yield placement(from_quaternion(*quaternion), position)


class _Joint(NamedTuple):
    """A joint's name and kind in the URDF, and MuJoCo's view of the joint."""

    name: str
    kind: str  # one of the values of _KIND_OF_JOINT
    view: Any  # has the joint's part of each array of the compiled model

    @property
    def has_one_freedom(self) -> bool:
        """Whether the joint has one degree of freedom."""
        return self.kind not in COORDINATE_SUFFIXES

    def coordinates_at(self, qpos: Array) -> list[float]:
        """Convert the joint's part of qpos to coordinates of the URDF, [rad, m] from MuJoCo's zero pose."""
        zero = self.view.qpos0
        if self.has_one_freedom:
            return list((qpos - zero).tolist())
        motion = invert_placement(_placement_of_qpos(zero)) @ _placement_of_qpos(qpos)
        coordinates = np.append(motion[:3, 3], pin.log3(motion[:3, :3])).tolist()
        return list(coordinates[-len(COORDINATE_SUFFIXES[self.kind]) :])  # a ball has the rotation alone

    def urdf_joint(self, origin: Array) -> Joint:
        """Return the joint of the URDF at a placement (4, 4) in the parent link."""
        view = self.view
        rest = view.qpos_spring[0] - view.qpos0[0] if self.has_one_freedom else None
        dynamics = _make_dynamics((getattr(view, key)[0] for key in _DYNAMICS_FIELDS), rest)
        if not self.has_one_freedom:
            return Joint(self.name, self.kind, origin, dynamics=dynamics)
        limits = tuple((view.range - view.qpos0).tolist()) if view.limited[0] else None
        return Joint(self.name, self.kind, origin, view.axis, limits, dynamics=dynamics)


def _placement_of_qpos(qpos: Array) -> Array:
    """Return the placement (4, 4) of the qpos of a free joint (7,) or a ball (4,)."""
    *position, w, x, y, z = qpos.tolist()  # a ball has a quaternion alone
    return placement(from_quaternion(w, x, y, z), position or (0.0, 0.0, 0.0))


class _Model:
    """A compiled model with named bodies and joints, and the URDF tree that its `read_` methods fill.

    Numbers k of bodies, equalities, motors and tendons, and j of joints, are those of the compiled model.
    """

    def __init__(self, compiled: Any, name: str) -> None:
        """Name all bodies and joints: unnamed ones body_<k> and <body>_joint, <body>_joint_2.

        Args:
            compiled: the model as MuJoCo has compiled it (MjModel).
            name: of the robot.
        """
        self.compiled = compiled
        names = [self.name("body", k) for k in range(compiled.nbody)]  # the first is the world
        taken = {*names, ""}
        self.bodies = [body or free_name(f"body_{k}", taken) for k, body in enumerate(names)]

        self.joints: list[_Joint] = []
        for j, number in enumerate(compiled.jnt_type):
            k = compiled.jnt_bodyid[j]
            rank = j - compiled.body_jntadr[k]  # among the joints of the body, from 0
            default = f"{self.bodies[k]}_joint" + (f"_{rank + 1}" if rank else "")
            kind = _KIND_OF_JOINT[member_name("mjtJoint", number)]
            self.joints.append(_Joint(self.name("joint", j) or default, kind, compiled.joint(j)))
        self.all_joints = tuple(joint.name for joint in self.joints)

        self.tree = UrdfTree(self._make_tree(name, taken))
        self.tree.gravity = tuple(compiled.opt.gravity.tolist())
        self.sites: list[str] = []
        for k, origin in enumerate(_placements(compiled.site_pos, compiled.site_quat)):
            site = self.name("site", k) or f"site_{k}"
            self.sites.append(self.tree.add_frame(site, self.bodies[compiled.site_bodyid[k]], origin))

    def name(self, kind: str, number: int) -> str:
        """Return the name of the element of a kind, such as "body", with a number; "" without one."""
        return str(getattr(self.compiled, kind)(number).name)

    def leave_out(self, text: str, acts_on: Iterable[str], *, is_decisive: bool = False) -> None:
        """Report an unread element.

        Args:
            text: for messages: element, name, effect and its size.
            acts_on: names of the bodies and joints on which the element acts.
            is_decisive: whether the element decides how they move; the file is refused if one of them moves.
        """
        self.tree.left_out.append(UnreadElement(text, tuple(acts_on), is_decisive))

    def _make_tree(self, name: str, taken: set[str]) -> Tree:
        """Return the tree, with a link for each body and a massless link between joints of a body.

        `taken` are names in use, to which those of further links are added.
        """
        model = self.compiled
        links = [Element("link", name=body) for body in self.bodies]
        tree = Tree(name, dict(zip(self.bodies, links, strict=True)))
        origins = list(_placements(model.body_pos, model.body_quat))
        for k in range(1, model.nbody):  # without the world
            # MuJoCo's joint is at a point of the body, but a URDF's link has its origin in the joint before
            # it: the chain of joints leads to the point before each joint, and back to the origin after it
            motions = []
            end = origins[k]  # (4, 4) of the body in its parent, then behind the last joint
            first = model.body_jntadr[k]
            for joint in self.joints[first : first + model.body_jntnum[k]]:
                point = np.zeros(3) if joint.kind == "floating" else joint.view.pos
                motions.append(joint.urdf_joint(end @ placement(translation=point)))
                end = placement(translation=-point)
            add_chain(tree, self.bodies[model.body_parentid[k]], motions, self.bodies[k], end, taken)
            if model.body_mass[k] or model.body_inertia[k].any():
                axes = from_quaternion(*model.body_iquat[k])
                inertia = axes @ np.diag(model.body_inertia[k]) @ axes.T
                links[k].append(inertial_element(model.body_mass[k], model.body_ipos[k], inertia))
        for k, origin in enumerate(_placements(model.geom_pos, model.geom_quat)):
            if shape := _SHAPE_OF_GEOM.get(member_name("mjtGeom", model.geom_type[k])):
                size = model.geom_size[k]  # half edges of a box, else radius and half length
                texts = {"size": vector_text(2 * size), "radius": repr(float(size[0]))}
                texts["length"] = repr(2 * float(size[1]))
                sizes = {key: texts[key] for key in SIZES_OF_SHAPES[shape]}
                links[model.geom_bodyid[k]].append(visual_element(shape, sizes, origin))
        return tree

    def _moment_arms(self, kind: str, number: int) -> dict[str, float] | None:
        """Return the moment arms d length / d q of a joint or tendon, by joint.

        The result is None for a spatial tendon, whose moment arms change with the pose.

        Args:
            kind: "joint" or "tendon".
            number: index of the joint or tendon in the compiled model; negative for none.
        """
        model = self.compiled
        if number < 0:  # an equality of a single joint or tendon has no second one
            return {}
        if kind == "joint":
            return {self.joints[number].name: 1.0}
        # parts of the tendon (MuJoCo: wrap objects): joints of a fixed tendon, sites of a spatial one
        start = model.tendon_adr[number]
        parts = slice(start, start + model.tendon_num[number])
        if any(member_name("mjtWrap", part) != "mjWRAP_JOINT" for part in model.wrap_type[parts]):
            return None
        # in the part of a fixed tendon, wrap_objid is the joint and wrap_prm its constant moment arm
        names = [self.joints[j].name for j in model.wrap_objid[parts]]
        return dict(zip(names, model.wrap_prm[parts].tolist(), strict=True))

    def _ends_of_tendon(self, number: int) -> tuple[str, str] | None:
        """Return the frames of both sites that a tendon joins in a straight line; None for others."""
        model = self.compiled
        parts = slice(model.tendon_adr[number], model.tendon_adr[number] + model.tendon_num[number])
        if [member_name("mjtWrap", part) for part in model.wrap_type[parts]] != 2 * ["mjWRAP_SITE"]:
            return None
        first, second = model.wrap_objid[parts]
        return self.sites[first], self.sites[second]

    # -------------------------------------------------------------- loops

    def read_equalities(self) -> None:
        """Read closures and couplings into the tree; fix joints that an equality fixes."""
        model = self.compiled
        for k in np.flatnonzero(model.eq_active0).tolist():
            kind = member_name("mjtEq", model.eq_type[k]).removeprefix("mjEQ_").lower()
            name = self.name("equality", k) or f"{kind}_{k + 1}"
            if kind not in _EQUALITIES:
                self.leave_out(f"equality {name!r}: of flexible bodies", self.all_joints, is_decisive=True)
            elif kind in ("joint", "tendon"):
                self._read_joint_equality(k, name, kind)
            else:
                self._close_loop(k, name, kind)

    def _close_loop(self, k: int, name: str, kind: str) -> None:
        """Close a loop by equality k, a connect or a weld (`kind`) of two sites or two bodies."""
        model = self.compiled
        # MuJoCo's data are, of a connect: anchor in the first body, anchor in the second; of a weld: anchor
        # in the second body, position and quaternion of the second body in the first, torque scale
        points = model.eq_data[k, :6].reshape(2, 3)
        quaternion = model.eq_data[k, 6:10]
        torque_scale = model.eq_data[k, 10]
        is_of_sites = member_name("mjtObj", model.eq_objtype[k]) == "mjOBJ_SITE"
        frames = self.sites if is_of_sites else self.bodies
        if is_of_sites:
            first = second = np.eye(4)
        elif kind == "connect":
            first, second = (placement(translation=point) for point in points)
        else:
            first = placement(from_quaternion(*quaternion), points[1])
            second = placement(translation=points[0])
        ends = [("1", frames[model.eq_obj1id[k]], first), ("2", frames[model.eq_obj2id[k]], second)]
        locks_rotation = kind == "weld" and torque_scale  # with the torque scale 0 it does not
        self.tree.close(name, locked_axes("fixed" if locks_rotation else "spherical"), ends)

    def _read_joint_equality(self, k: int, name: str, kind: str) -> None:
        """Read equality k of joints or tendons (`kind`), as a coupling or a fixed joint.

        The lengths, measured from the zero pose, satisfy first = sum of coefficient times power of second. As
        lengths are sums of moment arm times coordinate q, this is the equation sum(arm q) = offset with the
        arms of first - ratio * second, and products of coordinates. An equation 0 = 0 is dropped.
        """
        model = self.compiled
        tree = self.tree
        where = f"{kind} equality {name!r}"
        polynomial = model.eq_data[k, :5]  # coefficients of the powers 0 to 4 of the second length
        offset, ratio = polynomial[:2].tolist()
        first = self._moment_arms(kind, model.eq_obj1id[k])
        second = self._moment_arms(kind, model.eq_obj2id[k])
        rod = self._ends_of_tendon(model.eq_obj1id[k]) if kind == "tendon" and second == {} else None
        if rod is not None:
            # held at its length in MuJoCo's zero pose, plus the offset
            length = float(model.tendon_length0[model.eq_obj1id[k]]) + offset
            tree.closures.append(Closure(name, rod, locked_axes("distance"), length))
            return
        if first is None or second is None:
            problem = "of a spatial tendon, which is only read between two sites, held at a length"
            self.leave_out(f"{where}: {problem}", self.all_joints, is_decisive=True)
            return
        all_arms = {joint: first.get(joint, 0.0) - ratio * second.get(joint, 0.0) for joint in first | second}
        arms = {joint: arm for joint, arm in all_arms.items() if arm}
        children = [tree.joints[joint].child for joint in all_arms]  # links, whose turns may be equal
        products = _expand_powers(second, (-polynomial).tolist()) if len(second) <= MAX_TERMS else {}
        if polynomial[2:].any() and (len(second) > MAX_TERMS or len(products) > MAX_TERMS):
            problem = f"powers of a length of {len(second)} joints; at most {MAX_TERMS} products are read"
            self.leave_out(f"{where}: {problem}", all_arms, is_decisive=True)
            return
        links = children[0], children[-1]
        if (arms or offset or products) and not tree.equate(name, arms, offset, links, products=products):
            coupled = dict.fromkeys([*arms, *(joint for product in products for joint in product)])
            problem = f"couples {', '.join(coupled) or 'no joint'}: only hinges and slides are coupled"
            if products:
                problem += ", and one of them must be in no product"
            self.leave_out(f"{where}: {problem}", all_arms, is_decisive=True)

    # -------------------------------------------------------------- forces

    def read_keyframe(self) -> None:
        """Read the first keyframe as the reference."""
        for joint in self.joints if self.compiled.nkey else ():
            start = joint.view.qposadr.item()
            qpos = self.compiled.key_qpos[0, start : start + joint.view.qpos0.size]
            names = coordinates_of(joint.name, joint.kind)
            self.tree.reference |= zip(names, joint.coordinates_at(qpos), strict=True)

    def read_motor(self, k: int) -> None:
        """Read motor k, or report an actuator of another kind as unread."""
        model = self.compiled
        target = model.actuator_trnid[k, 0]  # index of the joint or tendon
        gear = float(model.actuator_gear[k, 0])
        name = self.name("actuator", k)
        acts_on = self.all_joints
        arms: Mapping[str, float] | None = None
        transmission = member_name("mjtTrn", model.actuator_trntype[k])
        if transmission in _JOINT_MOTORS:
            joint = self.joints[target]
            name = name or joint.name
            acts_on = (joint.name,)
            arms = {joint.name: 1.0} if joint.has_one_freedom else None
        elif transmission == "mjTRN_TENDON":
            arms = self._moment_arms("tendon", target)
            acts_on = tuple(arms or acts_on)
        where = f"motor {name or f'actuator_{k + 1}'!r}"
        gain = member_name("mjtGain", model.actuator_gaintype[k])
        dynamics = member_name("mjtDyn", model.actuator_dyntype[k])
        if gain not in _MOTOR_GAINS or dynamics not in _MOTOR_DYNAMICS:
            self.leave_out(f"{where}: a muscle, or an actuator of another program", acts_on)
        elif arms is None and transmission == "mjTRN_TENDON":
            self.leave_out(
                f"{where}: acts along a spatial tendon (a cable, a gas spring), which no option reads",
                acts_on,
            )
        elif not arms or not gear:
            self.leave_out(f"{where}: no motor on a hinge or a slide", acts_on)
        else:
            acting = JointDynamics(float(model.actuator_armature[k]), float(model.actuator_damping[k]))
            motor = Transmission(where, arms, gear, acting, self._force_limit(k, gear))
            self.tree.transmissions.append(motor)

    def read_tendon(self, k: int) -> None:
        """Read the dynamics of tendon k; of a spatial one its spring and damper between two sites."""
        model = self.compiled
        arms = self._moment_arms("tendon", k)
        if arms is None:
            self.tree.line_springs += filter(None, [self._line_spring(k)])
            return
        low, high = model.tendon_lengthspring[k]
        rest = low - model.tendon_length0[k] if low == high else None  # slack from low to high: not read
        dynamics = _make_dynamics((getattr(model, f"tendon_{key}")[k] for key in _DYNAMICS_FIELDS), rest)
        where = f"tendon {self.name('tendon', k)!r}"
        self.tree.transmissions.append(Transmission(where, arms, 1.0, dynamics, is_motor=False))

    def _line_spring(self, k: int) -> LineSpring | None:
        """Return the spring of a spatial tendon k between two sites; None for others, and with slack."""
        model, ends = self.compiled, self._ends_of_tendon(k)
        stiffness, damping = float(model.tendon_stiffness[k]), float(model.tendon_damping[k])
        low, high = model.tendon_lengthspring[k].tolist()
        if ends is None or not (stiffness or damping) or (stiffness and low != high):
            return None
        return LineSpring(ends, stiffness, low if stiffness else 0.0, damping, self.name("tendon", k) or "")

    def _force_limit(self, k: int, gear: float) -> float | None:
        """Return the least symmetric force limit [N m, N] of motor k, before its gear; None without one."""
        model = self.compiled
        joint = model.actuator_trnid[k, 0]
        ranges = [model.actuator_forcerange[k]] if model.actuator_forcelimited[k] else []
        # the zeros of the enumerations: force = gain * control, without bias and without dynamics of its own
        is_plain = not (model.actuator_gaintype[k] or model.actuator_biastype[k] or model.actuator_dyntype[k])
        if model.actuator_ctrllimited[k] and is_plain:
            ranges.append(model.actuator_ctrlrange[k] * model.actuator_gainprm[k, 0])
        is_on_joint = member_name("mjtTrn", model.actuator_trntype[k]) in _JOINT_MOTORS
        if is_on_joint and model.jnt_actfrclimited[joint]:
            ranges.append(model.jnt_actfrcrange[joint] / abs(gear))  # this limit is behind the gear
        symmetric = [float(abs(high)) for low, high in ranges if high and low == -high]
        return min(symmetric, default=None)

    def name_unread_effects(self) -> None:
        """Report unread effects of joints, bodies, tendons and the fluid, with sizes."""
        model = self.compiled
        for joint in self.joints:
            view, where = joint.view, f"joint {joint.name!r}"
            if not joint.has_one_freedom and view.stiffness[0]:
                self.leave_out(f"{where}: spring of a ball, {view.stiffness[0]:g} N m/rad", [joint.name])
            for effect, rows in (("damping", view.dampingpoly), ("stiffness", view.stiffnesspoly)):
                if rows.any():
                    powers = " ".join(map("{:g}".format, np.atleast_2d(rows)[0]))
                    self.leave_out(f"{where} {effect}: higher powers {powers}", [joint.name])
        for k, body in enumerate(self.bodies):
            if model.body_mocapid[k] >= 0:
                self.leave_out(f"body {body!r}: mocap, so it stands still", [body])
            if share := model.body_gravcomp[k]:
                force = share * model.body_mass[k] * np.linalg.norm(model.opt.gravity)
                self.leave_out(f"body {body!r} gravcomp {share:g}: {force:.3g} N", [body])
        for k in range(model.ntendon):
            if effects := self._unread_effects_of_tendon(k):
                acts_on = self._moment_arms("tendon", k) or self.all_joints  # a spatial one may pull any body
                self.leave_out(f"tendon {self.name('tendon', k)!r}: {', '.join(effects)}", acts_on)
        density, viscosity = model.opt.density, model.opt.viscosity
        if density or viscosity:
            fluid = f"density {density:g}, viscosity {viscosity:g}"
            self.leave_out(f"<option> {fluid}: the drag of the fluid", self.all_joints)

    def _unread_effects_of_tendon(self, k: int) -> list[str]:
        """List the unread effects of tendon k: most of a spatial one, slack, ranges."""
        model = self.compiled
        effects = []
        if self._moment_arms("tendon", k) is None:
            read = ("stiffness", "damping") if self._line_spring(k) else ()
            for key in [field for field in _DYNAMICS_FIELDS if field not in read]:
                if value := getattr(model, f"tendon_{key}")[k]:
                    effects.append(f"{key} {value:g}")
        elif model.tendon_stiffness[k] and np.ptp(model.tendon_lengthspring[k]):
            effects.append("a spring with slack")
        if model.tendon_limited[k]:
            effects.append("range {:g} {:g}".format(*model.tendon_range[k]))
        return effects


def _expand_powers(arms: Mapping[str, float], coefficients: Sequence[float]) -> dict[Product, float]:
    """Expand the sum over k >= 2 of c_k L^k, with L = sum(arm q), by products of joint coordinates q.

    By the multinomial theorem a product of k coordinates stands in L^k as often as its factors have orders.

    Args:
        arms: arm of each joint.
        coefficients: c_0, c_1, ..., of which the first two are left out.

    Returns:
        The coefficient of each product, which is the sorted tuple of its joints.
    """
    expanded = {}
    for k, coefficient in enumerate(coefficients[2:], 2):
        for product in combinations_with_replacement(sorted(arms), k if coefficient else 0):
            orders = factorial(k) // prod(factorial(count) for count in Counter(product).values())
            expanded[product] = coefficient * orders * prod(arms[joint] for joint in product)
    return {product: value for product, value in expanded.items() if product and value}


def _make_dynamics(values: Iterable[float], rest: float | None) -> JointDynamics:
    """Return joint dynamics from values in the order of _DYNAMICS_FIELDS.

    `rest` is the position [rad, m] where a spring is at rest; without one (None) the stiffness is left out.
    """
    dynamics = JointDynamics(*map(float, values))
    if rest is None:
        return replace(dynamics, stiffness=0.0)
    return replace(dynamics, rest=float(rest)) if dynamics.stiffness else dynamics
