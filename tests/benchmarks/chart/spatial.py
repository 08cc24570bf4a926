"""Stage: motor torques of robots in space, the delta and the Gough-Stewart platform, of five loops each.

Along a crossing, legs without mass, against virtual work in mpmath (chart/spatial_form.py). The times of the
5R's stage cannot be carried over: here poses cost more, and all loops are closed in every one of them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
import pinocchio as pin
from scipy.interpolate import make_interp_spline

from framework.arrays import Array
from framework.crossing.scenes import scene_path
from framework.dynamics.elasticity import solve_deflections
from framework.dynamics.forces import motor_torque, tree_forces
from framework.dynamics.inverse_dynamics import inverse_dynamics
from framework.kinematics.continuation.tracking import Branch, track_path
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.motion_rates import motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.chebyshev import TimeGrid
from framework.motion.law import Condition, Law
from framework.motion.path import along
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.measure import Judged, Method, Setting, Stage, pairs, singles
from tests.benchmarks.chart.spatial_form import SpatialCrossing, spatial_crossing

SCENES = {"delta": "cross", "gough_stewart": "turn"}
PANELS = {"delta": "delta", "gough_stewart": "Gough-Stewart"}
TABLES = pairs(tuple(2**k + 1 for k in range(4, 11)), (3, 5, 7, 9))
NODES = singles(16, 24, 32, 40, 48, 64, 80, 96, 128, 192)
AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
SETTLED, MOST = 1e-8, 20  # a step of Newton's method whose successor is below rounding; steps at most

Torque = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Crossing:
    """A robot of the catalogue without mass in its legs, its path and the law of the reference."""

    name: str

    @cached_property
    def exact(self) -> SpatialCrossing:
        return spatial_crossing(self.name)

    @cached_property
    def robot(self) -> ParallelRobot:
        description = given.robot(self.name).description
        root = ElementTree.fromstring(description.urdf_text)
        for link in root.iter("link"):
            inertial = link.find("inertial")
            if inertial is not None and link.get("name") != "platform":
                link.remove(inertial)
        text = ElementTree.tostring(root, encoding="unicode")
        return ParallelRobot.from_description(replace(description, urdf_text=text))

    @cached_property
    def branch(self) -> Branch:
        return track_path(self.robot, scene_path(self.robot.description.scenes[SCENES[self.name]]))

    @property
    def time(self) -> float:
        return float(self.exact.time)

    @property
    def duration(self) -> float:
        return float(self.exact.duration)

    @cached_property
    def law(self) -> Law:
        inner = [
            Condition(self.time, order, float(value)) for order, value in enumerate(self.exact.at_crossing)
        ]
        return Law.rest_to_rest(self.duration, 2, inner)

    @cached_property
    def checked(self) -> tuple[Array, Array]:
        """Instants (T,), also as near to the singular one as 1 us, and the exact torques there."""
        near = [self.time + side * 10.0**-k for k in range(1, 7) for side in (-1, 1)]
        times = np.sort(np.concatenate([np.linspace(0.0, self.duration, 24), near]))
        return times, self.exact.torque(times)

    def along(self, times: Array) -> tuple[Array, Array, Array]:
        """The platform and its derivatives at times (T,)."""
        x, dx, ddx = along(self.branch.path, [self.law(times, order) for order in range(3)])
        return x, dx, ddx


@cache
def crossing(name: str) -> Crossing:
    return Crossing(name)


def _chebyshev(case: Crossing, setting: Setting) -> Torque:
    grid = TimeGrid.clear_of(np.array([case.time]), np.array([0.0, case.duration]), round(setting[0]))
    state = solve_deflections(case.branch, grid, lambda *_: case.law, "rigid", None, case.law)
    return grid.fit(motor_torque(case.robot, state.motion, state.forces.joint_torque))


def _pointwise(case: Crossing, times: Array) -> Array:
    robot, branch = case.robot, case.branch
    x, dx, ddx = case.along(times)
    motion = motion_at(robot, close_loops(robot, x, branch.guess(case.law(times))), dx, ddx)
    r, rows = tree_forces(robot, motion), motion.linearised.closures
    passive = rows[:, :, robot.following].transpose(0, 2, 1)
    multipliers = np.linalg.solve(passive, r[:, robot.following][..., None])[..., 0]
    joint = r[:, robot.actuated] - np.einsum("tma,tm->ta", rows[:, :, robot.actuated], multipliers)
    return motor_torque(robot, motion, joint)


class BareRobot:
    """Loops of balls with pinocchio and numpy alone: Newton from pose to pose, rnea, stacked solves."""

    def __init__(self, case: Crossing) -> None:
        robot = case.robot
        self.model, self.data = robot.model, robot.model.createData()
        self.pairs = [tuple(map(robot.model.getFrameId, c.frames)) for c in robot.description.closures]
        self.platform = robot.model.getFrameId(robot.description.platform.frame)
        self.motors, self.gear = np.array(robot.actuated), robot.gear_ratio
        self.others = np.setdiff1d(np.arange(robot.model.nv), self.motors)
        self.rotor = robot.rotor_inertia
        self.start = case.branch.guess(np.zeros(1))[0]
        self.size = robot.n

    def rows(self) -> Array:
        """Derivatives of the loops, then of the platform (nv, nv), after computeJointJacobians."""

        def jacobian(frame: int) -> Array:
            return np.asarray(pin.getFrameJacobian(self.model, self.data, frame, AXES))

        loops = [(jacobian(one) - jacobian(other))[:3] for one, other in self.pairs]
        return np.vstack([*loops, jacobian(self.platform)[: self.size]])

    def close(self, place: Array, turn: Array, q: Array) -> tuple[Array, Array]:
        """Joints with the platform there, from q, and the derivatives."""
        settled = False
        for _ in range(MOST):
            pin.computeJointJacobians(self.model, self.data, q)
            pin.updateFramePlacements(self.model, self.data)
            rows, at = self.rows(), self.data.oMf
            if settled:
                return q, rows
            gaps = [at[one].translation - at[other].translation for one, other in self.pairs]
            here = at[self.platform]
            lacking = [here.translation - place, -pin.log3(turn @ here.rotation.T)]
            step = np.linalg.solve(rows, np.concatenate([*gaps, *lacking])[: len(rows)])
            q, settled = q - step, bool(np.abs(step).max() < SETTLED)
        raise ArithmeticError("the loops do not close")

    def torques(self, case: Crossing, times: Array) -> Array:
        """Motor torques (T, n) [N m]."""
        x, dx, ddx = case.along(times)
        count, nv, q_k = len(times), self.model.nv, self.start
        turns, spins, spun = _turned(x[:, 3:], dx[:, 3:], ddx[:, 3:])
        q, rows, drift = np.empty((count, nv)), np.empty((count, nv, nv)), np.empty((count, nv))
        for k in range(count):
            q_k, rows[k] = self.close(x[k, :3], turns[k], q_k)
            q[k] = q_k
        asked = np.zeros((2, count, nv))
        asked[0, :, -self.size :] = np.concatenate([dx[:, :3], spins], axis=1)[:, : self.size]
        asked[1, :, -self.size :] = np.concatenate([ddx[:, :3], spun], axis=1)[:, : self.size]
        v = np.linalg.solve(rows, asked[0][..., None])[..., 0]
        for k in range(count):
            pin.forwardKinematics(self.model, self.data, q[k], v[k], np.zeros(nv))
            rates = [
                pin.getFrameClassicalAcceleration(self.model, self.data, frame, AXES).vector
                for pair in self.pairs
                for frame in pair
            ]
            loops = [(one - other)[:3] for one, other in zip(rates[::2], rates[1::2], strict=True)]
            platform = pin.getFrameClassicalAcceleration(self.model, self.data, self.platform, AXES).vector
            drift[k] = np.concatenate([*loops, platform[: self.size]])
        a = np.linalg.solve(rows, (asked[1] - drift)[..., None])[..., 0]
        r = np.array([pin.rnea(self.model, self.data, *motion) for motion in zip(q, v, a, strict=True)])
        closed = rows[:, : -self.size].transpose(0, 2, 1)
        forces = np.linalg.solve(closed[:, self.others], r[:, self.others][..., None])
        joint = r[:, self.motors] - (closed[:, self.motors] @ forces)[..., 0]
        return np.asarray(self.rotor * self.gear * a[:, self.motors] + joint / self.gear)


def _turned(w: Array, dw: Array, ddw: Array) -> tuple[Array, Array, Array]:
    """Rotations (T, 3, 3), angular velocities and accelerations (T, 3) of rotation vectors along a line."""
    if not w.shape[1]:
        still = np.zeros((len(w), 3))
        return np.tile(np.eye(3), (len(w), 1, 1)), still, still
    turns = np.array([pin.exp3(value) for value in w])
    angle = np.linalg.norm(w, axis=1)[:, None]
    # omega = dw + (1 - cos)/a^2 w x dw + (a - sin)/a^3 w x (w x dw), and its derivative with d2w || dw
    rate = (w * dw).sum(axis=1)[:, None] / angle
    f, g = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    df = (np.sin(angle) - 2 * angle * f) / angle**2 * rate
    dg = (1 - np.cos(angle) - 3 * angle**2 * g) / angle**3 * rate

    def spin(v: Array) -> Array:
        return np.asarray(v + f * np.cross(w, v) + g * np.cross(w, np.cross(w, v)))

    inner = np.cross(w, dw)
    spun = spin(ddw) + df * inner + dg * np.cross(w, inner) + g * np.cross(dw, inner)
    return turns, spin(dw), spun


def judge(method: Method, setting: Setting, result: Torque) -> Judged:
    """The largest error over the largest torque."""
    times, exact = crossing(method.name.rpartition("-")[0]).checked
    return Judged(float(np.abs(result(times) - exact).max() / np.abs(exact).max()))


def _table(case: Crossing, torque: Callable[[Array], Array], setting: Setting) -> Torque:
    samples, degree = map(round, setting)
    times = np.linspace(0.0, case.duration, samples)
    return make_interp_spline(times, torque(times), k=degree)


def _methods(name: str) -> tuple[Method, ...]:
    case = crossing(name)
    law_given, table = "path followed; s, s', s\" exact", "samples, degree"

    def bare(setting: Setting) -> Callable[[], Torque]:
        robot = BareRobot(case)
        return lambda: _table(case, lambda t: robot.torques(case, t), setting)

    def stacked(setting: Setting) -> Callable[[], Torque]:
        return lambda: _table(case, lambda t: _pointwise(case, t), setting)

    def nodes(setting: Setting) -> Callable[[], Torque]:
        return lambda: _chebyshev(case, setting)

    def proved(setting: Setting) -> Callable[[], Torque]:
        return lambda: inverse_dynamics(case.robot, case.branch.path, case.law, tolerance=setting[0]).torque

    panel = PANELS[name]
    return (
        Method(
            f"{name}-nodes", "ours, Chebyshev nodes", law_given, "nodes", NODES, nodes, "ours", panel=panel
        ),
        Method(
            f"{name}-proved",
            "ours, located and proved",
            "path and law",
            "tolerance",
            singles(1e-6, 1e-10),
            proved,
            "ours",
            panel=panel,
        ),
        Method(
            f"{name}-stacks",
            "pointwise in stacks, our kinematics",
            law_given,
            table,
            TABLES,
            stacked,
            source="poses closed in one stack by the framework, everything else numpy; table by spline",
            panel=panel,
        ),
        Method(
            f"{name}-pinocchio",
            "pointwise, Pinocchio and numpy alone",
            "path; s, s', s\" exact",
            table,
            TABLES,
            bare,
            source="chart/spatial.py: Newton from pose to pose, rnea, stacked solves; table by spline",
            panel=panel,
        ),
    )


STAGE = Stage(
    name="spatial",
    title="Motor torques of robots in space",
    reference="virtual work in mpmath, legs without mass (chart/spatial_form.py)",
    error="largest error over the largest torque",
    methods=(*_methods("delta"), *_methods("gough_stewart")),
    judge=judge,
    goals=(1e-6, 1e-10),
)
