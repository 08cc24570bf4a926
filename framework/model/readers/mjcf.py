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
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.errors import RobotFileError
from framework.model.description import Closure, Coupling, JointDynamics, ParsedRobot, locked_axes
from framework.model.placement import from_quaternion, placement
from framework.model.readers.describe import describe
from framework.model.readers.left_out import LeftOut
from framework.model.readers.missing_fields import Options
from framework.model.readers.mujoco_model import mujoco_model
from framework.model.readers.transmissions import Motor, Pull
from framework.model.readers.urdf_tree import MAX_LOOPS, UrdfTree
from framework.model.urdf_elements import coordinates_of
from framework.model.urdf_writing import inertial_element, joint_element, origin_element, vector_text

WORLD = "world"
# by mjtJoint, and the width of each in qpos
_KINDS = (("floating", 7), ("spherical", 4), ("prismatic", 1), ("continuous", 1))
_SHAPES = {2: "sphere", 3: "cylinder", 5: "cylinder", 6: "box"}  # by mjtGeom; a capsule is drawn without ends
_JOINT_MOTORS = (0, 1)  # mjTRN_JOINT, mjTRN_JOINTINPARENT
_ON_TENDON, _OF_JOINT, _FIXED_GAIN, _NO_BIAS, _AFFINE_GAIN = 3, 1, 0, 0, 1
_DIRECT = (0, 1, 2, 3)  # mjtDyn of motors: none, integrator, filters; not muscles and those of users


def read_mjcf(file: Path, root: ElementTree.Element, options: Options) -> ParsedRobot:
    """Read the description in an MJCF file.

    Raises:
        MissingPackage: MuJoCo is not installed.
        RobotFileError: names the element.
    """
    _refuse_nan(root)
    compiled, left_out = mujoco_model(file)
    model = _Model(compiled)
    if compiled.neq > MAX_LOOPS:
        raise RobotFileError(f"<equality>: at most {MAX_LOOPS} equalities are read")
    tree = UrdfTree(model.urdf(root.get("model") or "mjcf"))
    sites = [
        tree.add_frame(model.name("site", k) or f"site_{k}", model.bodies[compiled.site_bodyid[k]], place)
        for k, place in enumerate(_places(compiled.site_pos, compiled.site_quat))
    ]
    loops = list(model.loops(tree, sites))
    motors = [motor for motor in model.motors() if isinstance(motor, Motor)]
    reference = model.reference()
    return describe(
        tree,
        file,
        options,
        [loop for loop in loops if isinstance(loop, Closure)],
        couplings=[loop for loop in loops if isinstance(loop, Coupling)],
        motors=motors,
        pulls=model.pulls(),
        joints=model.acting(),
        gravity=(0.0, 0.0, 0.0) if model.is_off("GRAVITY") else tuple(compiled.opt.gravity.tolist()),
        reference={name: value for name, value in reference.items() if name in tree.coordinates},
        left_out=[*left_out, *(loop for loop in loops if isinstance(loop, LeftOut)), *model.left_out()],
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


class _Model:
    """A compiled model with a name for each body and joint."""

    def __init__(self, compiled: Any) -> None:
        self.compiled = compiled
        self.taken = {self.name("body", k) for k in range(compiled.nbody)} - {""}
        self.bodies = [
            self.name("body", k) or self._free_name(f"body_{k}") if k else WORLD
            for k in range(compiled.nbody)
        ]
        self.joints: list[str] = []
        for body, number in zip(self.bodies, compiled.body_jntnum, strict=True):
            first = len(self.joints)
            self.joints += [
                self.name("joint", first + k) or f"{body}_joint" + (f"_{k + 1}" if k else "")
                for k in range(number)
            ]
        self.kinds = [_KINDS[kind][0] for kind in compiled.jnt_type]

    def name(self, kind: str, number: int) -> str:
        return str(getattr(self.compiled, kind)(number).name)

    def is_off(self, flag: str) -> bool:
        """Whether the file disables a flag of MuJoCo's."""
        import mujoco

        return bool(self.compiled.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))

    def _free_name(self, wanted: str) -> str:
        name = wanted
        while name in self.taken:
            name += "_"
        self.taken.add(name)
        return name

    # -------------------------------------------------------------- the tree

    def urdf(self, name: str) -> ElementTree.Element:
        """Return the bodies as a URDF: a link for each, and one between the joints of a body."""
        model, root = self.compiled, ElementTree.Element("robot", name=name)
        places = list(_places(model.body_pos, model.body_quat))
        links = {}
        for k, body in enumerate(self.bodies):
            parent, offset = self.bodies[model.body_parentid[k]], places[k]
            # a joint turns about a point of the body; its link stands in that point, the body's own behind it
            for j in range(model.body_jntadr[k], model.body_jntadr[k] + model.body_jntnum[k]):
                point = model.jnt_pos[j] if self.kinds[j] != "floating" else np.zeros(3)
                is_last = j + 1 == model.body_jntadr[k] + model.body_jntnum[k] and not point.any()
                child = body if is_last else self._free_name(f"{self.joints[j]}_link")
                root.append(self._joint(j, parent, child, offset @ placement(None, point)))
                links[child] = ElementTree.SubElement(root, "link", name=child)
                parent, offset = child, placement(None, -point)
            if body not in links:
                links[body] = ElementTree.SubElement(root, "link", name=body)
                if k:
                    mount = self._free_name(f"{body}_mount")
                    root.append(joint_element(mount, "fixed", parent, body, origin=origin_element(offset)))
            if k and (model.body_mass[k] or model.body_inertia[k].any()):
                turn = from_quaternion(*model.body_iquat[k])
                inertia = turn @ np.diag(model.body_inertia[k]) @ turn.T
                links[body].append(inertial_element(model.body_mass[k], model.body_ipos[k], inertia))
        for k, place in enumerate(_places(model.geom_pos, model.geom_quat)):
            if model.geom_type[k] in _SHAPES:
                shape = _visual(_SHAPES[model.geom_type[k]], model.geom_size[k], place)
                links[self.bodies[model.geom_bodyid[k]]].append(shape)
        return root

    def _joint(self, j: int, parent: str, child: str, origin: Array) -> ElementTree.Element:
        model, kind = self.compiled, self.kinds[j]
        limited = model.jnt_limited[j] and kind in ("prismatic", "continuous") and not self.is_off("LIMIT")
        axis = None if kind in ("spherical", "floating") else vector_text(model.jnt_axis[j])
        element = joint_element(
            self.joints[j],
            "revolute" if limited and kind == "continuous" else kind,
            parent,
            child,
            origin=origin_element(origin),
            axis=axis,
        )
        limit = element.find("limit")
        if limited and limit is not None:
            lower, upper = (model.jnt_range[j] - model.qpos0[model.jnt_qposadr[j]]).tolist()
            limit.attrib |= {"lower": repr(lower), "upper": repr(upper)}
        return element

    def reference(self) -> dict[str, float]:
        """Return joint angles of the first key, from the zero pose; empty without one."""
        model, reference = self.compiled, dict[str, float]()
        for j in range(model.njnt if model.nkey else 0):
            start, kind = model.jnt_qposadr[j], self.kinds[j]
            entries = slice(start, start + _KINDS[model.jnt_type[j]][1])
            qpos, zero = model.key_qpos[0][entries], model.qpos0[entries]
            values = (qpos - zero).tolist()
            if len(values) > 1:
                turns = [from_quaternion(*each[-4:]) for each in (zero, qpos)]
                if kind == "floating":  # its qpos is the pose of the body, not the way from the zero pose
                    slides = (turns[0].T @ (qpos[:3] - zero[:3])).tolist()
                    values = [*slides, *pin.log3(turns[0].T @ turns[1]).tolist()]
                else:
                    values = pin.log3(turns[1]).tolist()
            reference.update(zip(coordinates_of(self.joints[j], kind), values, strict=True))
        return reference

    # -------------------------------------------------------------- loops

    def loops(self, tree: UrdfTree, sites: list[str]) -> Iterator[Closure | Coupling | LeftOut]:
        """Yield the loops of the equalities, and what decides how joints move and is not read.

        Joints that an equality holds become fixed in the tree.
        """
        model = self.compiled
        off = [flag for flag in ("EQUALITY", "CONSTRAINT") if self.is_off(flag)]
        for k in range(model.neq):
            if not model.eq_active0[k]:
                continue
            if off:
                raise RobotFileError(f"<flag> {off[0].lower()}: disabled, so there would be no loop")
            kind = ("connect", "weld", "joint", "tendon")[min(int(model.eq_type[k]), 4) % 4]
            ends = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
            name = self.name("equality", k) or f"{kind}_{k + 1}"
            if model.eq_type[k] > 3:
                yield LeftOut(f"equality {name!r}: of flexible bodies", tuple(tree.coordinates), True)
            elif kind in ("joint", "tendon"):
                loop = self._joint_equality(tree, name, kind, ends, model.eq_data[k])
                if loop is not None:
                    yield loop
            else:
                yield self._body_equality(tree, sites, name, kind, k)

    def _body_equality(self, tree: UrdfTree, sites: list[str], name: str, kind: str, k: int) -> Closure:
        """Return the closure of two sites, or of two bodies with the placements in them that coincide."""
        import mujoco

        model, data = self.compiled, self.compiled.eq_data[k]
        axes = locked_axes("fixed" if kind == "weld" and data[10] else "spherical")
        first, second = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        if model.eq_objtype[k] == mujoco.mjtObj.mjOBJ_SITE:
            return Closure(name, (sites[first], sites[second]), axes)
        places = [placement(None, data[:3]), placement(None, data[3:6])]
        if kind == "weld":
            places = [placement(from_quaternion(*data[6:10]), data[3:6]), placement(None, data[:3])]
        frames = [
            tree.frame_at(f"{name}_{end + 1}", self.bodies[body], places[end])
            for end, body in enumerate((first, second))
        ]
        return Closure(name, (frames[0], frames[1]), axes)

    def _joint_equality(
        self, tree: UrdfTree, name: str, kind: str, ends: tuple[int, int], data: Array
    ) -> Closure | Coupling | LeftOut | None:
        """Return the coupling of an equality of joints or tendons; a joint that is held alone becomes fixed.

        Equal turns about parallel axes of one body are a closure, which all proofs know. MuJoCo's polynomial
        is between ways from the zero pose, as ours is.
        """
        first, second = (self._shares(kind, end) for end in ends)
        offset, ratio, *higher = data[:5].tolist()
        where = f"{kind} equality {name!r}"
        joints = tuple(dict.fromkeys([*(first or {}), *(second or {})]))
        if first is None or second is None:
            return LeftOut(f"{where}: of a spatial tendon", tuple(tree.coordinates), is_decisive=True)
        if second and any(higher[:3]):
            text = (
                f"{where}: polycoef {' '.join(map('{:g}'.format, data[:5]))} couples {' and '.join(joints)}"
            )
            return LeftOut(f"{text}: only linear couplings are read", joints, is_decisive=True)
        shares = {joint: first.get(joint, 0.0) - ratio * second.get(joint, 0.0) for joint in joints}
        shares = {joint: share for joint, share in shares.items() if share}
        if len(shares) > 2:
            text = f"{where}: couples {', '.join(shares)}: only couplings of two joints are read"
            return LeftOut(text, tuple(shares), is_decisive=True)
        (driven, share), *others = shares.items() or [("", 0.0)]
        if not driven or (not tree.joints[driven].moves and not others):
            return None
        if not others:
            tree.fix(tree.joints[driven], offset / share)
            return None
        ((of, other),) = others
        if (offset, share, other) == (0.0, 1.0, -1.0):
            children = tree.joints[driven].child, tree.joints[of].child
            chains = tree.moving_chains(*children)
            if [[part.name for part in chain] for chain in chains] == [[driven], [of]]:
                closure = tree.same_turning(name, *children)
                if closure is not None:
                    return closure
        return Coupling(driven, of, -other / share, offset / share)

    def _shares(self, kind: str, number: int) -> dict[str, float] | None:
        """Return the joints of a joint or a fixed tendon with their shares; None of a spatial tendon."""
        model = self.compiled
        if number < 0:
            return {}
        if kind == "joint":
            return {self.joints[number]: 1.0}
        parts = slice(model.tendon_adr[number], model.tendon_adr[number] + model.tendon_num[number])
        if (model.wrap_type[parts] != _OF_JOINT).any():
            return None
        names = [self.joints[j] for j in model.wrap_objid[parts]]
        return dict(zip(names, model.wrap_prm[parts].tolist(), strict=True))

    # -------------------------------------------------------------- what acts

    def acting(self) -> dict[str, JointDynamics]:
        """Return what acts along the coordinates; what flags disable is zero."""
        model, joints = self.compiled, dict[str, JointDynamics]()
        for j, (name, kind) in enumerate(zip(self.joints, self.kinds, strict=True)):
            dof, place = model.jnt_dofadr[j], model.jnt_qposadr[j]
            springs = kind in ("prismatic", "continuous") and not self.is_off("SPRING")
            stiffness = float(model.jnt_stiffness[j]) if springs else 0.0
            acting = JointDynamics(
                armature=float(model.dof_armature[dof]),
                damping=0.0 if self.is_off("DAMPER") else float(model.dof_damping[dof]),
                friction=0.0 if self.is_off("FRICTIONLOSS") else float(model.dof_frictionloss[dof]),
                stiffness=stiffness,
                rest=float(model.qpos_spring[place] - model.qpos0[place]) if stiffness else 0.0,
            )
            if min(acting.armature, acting.damping, acting.friction, acting.stiffness) < 0.0:
                raise RobotFileError(
                    f"joint {name!r}: armature, damping, friction and stiffness must not be negative"
                )
            if acting != JointDynamics():
                joints.update(dict.fromkeys(coordinates_of(name, kind), acting))
        return joints

    def pulls(self) -> Iterator[Pull]:
        """Yield what acts along motors and fixed tendons."""
        model, damped = self.compiled, not self.is_off("DAMPER")
        for motor in self.motors():
            if isinstance(motor, Motor):
                yield Pull(f"motor {motor.name!r}", motor.shares, motor.gear, motor.acting)
        for k in range(model.ntendon):
            shares = self._shares("tendon", k)
            springs = not self.is_off("SPRING") and np.ptp(model.tendon_lengthspring[k]) == 0.0
            acting = JointDynamics(
                armature=float(model.tendon_armature[k]),
                damping=float(model.tendon_damping[k]) * damped,
                friction=float(model.tendon_frictionloss[k]) * (not self.is_off("FRICTIONLOSS")),
                stiffness=float(model.tendon_stiffness[k]) * springs,
                rest=float(model.tendon_lengthspring[k, 0] - model.tendon_length0[k]),
            )
            if shares is not None:
                yield Pull(f"tendon {self.name('tendon', k)!r}", shares, 1.0, acting)

    def motors(self) -> Iterator[Motor | LeftOut]:
        """Yield the motors on hinges, slides and fixed tendons of them, and others as left out."""
        model = self.compiled
        for k in range(model.nactuator):
            target, (kind, gear) = int(model.actuator_trnid[k, 0]), self._pull_of(k)
            shares: Mapping[str, float] | None = None
            acts_on = tuple(self.joints)
            if kind in _JOINT_MOTORS:
                acts_on = (self.joints[target],)
                shares = {acts_on[0]: 1.0} if self.kinds[target] in ("prismatic", "continuous") else None
            elif kind == _ON_TENDON:
                shares = self._shares("tendon", target)
                acts_on = tuple(shares or self.joints)
            name = self.name("actuator", k) or (acts_on[0] if kind in _JOINT_MOTORS else f"actuator_{k + 1}")
            direct = model.actuator_gaintype[k] in (_FIXED_GAIN, _AFFINE_GAIN, 6)
            if not shares or not gear or not direct or model.actuator_dyntype[k] not in _DIRECT:
                yield LeftOut(f"motor {name!r}: no motor on a hinge or a slide", acts_on)
                continue
            damping = 0.0 if self.is_off("DAMPER") else float(model.actuator_damping[k])
            acting = JointDynamics(armature=float(model.actuator_armature[k]), damping=damping)
            yield Motor(name, shares, gear, self._force_limit(k, shares), acting)

    def _pull_of(self, k: int) -> tuple[int, float]:
        return int(self.compiled.actuator_trntype[k]), float(self.compiled.actuator_gear[k, 0])

    def _force_limit(self, k: int, shares: Mapping[str, float]) -> float | None:
        """Return the least limit of a motor [N m, N], of those that are alike both ways."""
        model, (kind, gear) = self.compiled, self._pull_of(k)
        ranges = [model.actuator_forcerange[k]] if model.actuator_forcelimited[k] else []
        plain = (model.actuator_gaintype[k], model.actuator_biastype[k], model.actuator_dyntype[k]) == (
            0,
            0,
            0,
        )
        if model.actuator_ctrllimited[k] and plain:
            ranges.append(model.actuator_ctrlrange[k] * model.actuator_gainprm[k, 0])
        joint = self.joints.index(next(iter(shares)))
        if kind in _JOINT_MOTORS and model.jnt_actfrclimited[joint]:
            ranges.append(model.jnt_actfrcrange[joint] / abs(gear))
        return min((float(abs(high)) for low, high in ranges if high and low == -high), default=None)

    def left_out(self) -> Iterator[LeftOut]:
        """Yield what acts by the model and is not read, with its size."""
        model = self.compiled
        yield from (motor for motor in self.motors() if isinstance(motor, LeftOut))
        for j, (name, kind) in enumerate(zip(self.joints, self.kinds, strict=True)):
            dof = model.jnt_dofadr[j]
            if kind in ("spherical", "floating") and model.jnt_stiffness[j] and not self.is_off("SPRING"):
                yield LeftOut(
                    f"joint {name!r}: spring of a ball, {model.jnt_stiffness[j]:g} N m/rad", (name,)
                )
            for what, flag, values in (
                ("damping", "DAMPER", model.dof_dampingpoly[dof]),
                ("stiffness", "SPRING", model.jnt_stiffnesspoly[j]),
            ):
                if values.any() and not self.is_off(flag):
                    powers = " ".join(map("{:g}".format, values))
                    yield LeftOut(f"joint {name!r} {what}: higher powers {powers}", (name,))
        for k, body in enumerate(self.bodies):
            if model.body_mocapid[k] >= 0:
                yield LeftOut(f"body {body!r}: mocap, so it stands still", (body,))
            if model.body_gravcomp[k] and not self.is_off("GRAVITY"):
                weight = model.body_gravcomp[k] * model.body_mass[k] * np.linalg.norm(model.opt.gravity)
                yield LeftOut(f"body {body!r} gravcomp {model.body_gravcomp[k]:g}: {weight:.3g} N", (body,))
        for k in range(model.ntendon):
            yield from self._left_out_of_tendon(k)
        around = [f"{key} {getattr(model.opt, key):g}" for key in ("density", "viscosity")]
        if model.opt.density or model.opt.viscosity:
            yield LeftOut(f"<option> {', '.join(around)}: the drag of the fluid", tuple(self.joints))

    def _left_out_of_tendon(self, k: int) -> Iterator[LeftOut]:
        model, shares = self.compiled, self._shares("tendon", k)
        values = {key: getattr(model, f"tendon_{key}")[k] for key in ("stiffness", "damping", "frictionloss")}
        values["armature"] = model.tendon_armature[k]
        acting = [f"{key} {value:g}" for key, value in values.items() if value]
        if shares is not None:  # what acts along these is read, but for springs with a slack range
            slack = (
                model.tendon_stiffness[k]
                and np.ptp(model.tendon_lengthspring[k])
                and not self.is_off("SPRING")
            )
            acting = ["a spring with slack"] if slack else []
        if model.tendon_limited[k] and not self.is_off("LIMIT"):
            low, high = model.tendon_range[k]
            acting.append(f"range {low:g} {high:g}")
        if acting:
            text = f"tendon {self.name('tendon', k)!r}: {', '.join(acting)}"
            yield LeftOut(text, tuple(shares or self.joints))  # a spatial one may touch any body


def _visual(shape: str, size: Array, place: Array) -> ElementTree.Element:
    """Return the URDF's `<visual>` of a primitive geom."""
    visual = ElementTree.Element("visual")
    visual.append(origin_element(place))
    radius, half, _ = map(float, size)
    words = {"radius": repr(radius)} if shape != "box" else {"size": vector_text(2 * size)}
    if shape == "cylinder":
        words["length"] = repr(2 * half)
    ElementTree.SubElement(ElementTree.SubElement(visual, "geometry"), shape, words)
    return visual
