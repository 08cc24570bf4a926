"""The pose and the motor torques of a rigid robot once a millisecond, from its encoders.

    cycle = ControlCycle(robot)
    cycle.update(q_a, dq_a)                     # joint side of the gears
    torque = cycle.torque(ddq_a)                # motor side

With the motors given the loops are closed by Newton's method on the passive joints, P dq_p = -(residual),
from where the tangent of the last cycle leads. With T = dq/dq_a and a_0 the accelerations at ddq_a = 0,

    torque = mass ddq_a + bias,     mass = T' (M + rotors) T / n,     bias = T' RNEA(q, v, a_0) / n + ...,

in which the loop forces have no part. A step counts by the same measures as in `predictor_corrector`; where
it does not, `forward_kinematics` follows the motors in short steps, or says at which singularity the way
ends.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from framework.arrays import Array, ArrayLike
from framework.dynamics.forces import spring_torques
from framework.dynamics.pointwise_dynamics import type2_pose
from framework.errors import finite_numbers
from framework.kinematics.assembly import Configuration
from framework.kinematics.attitude import RotationVector
from framework.kinematics.continuation.forward_kinematics import (
    check_motors_are_free,
    forward_kinematics,
    start_pose,
)
from framework.kinematics.continuation.predictor_corrector import MAX_PREDICTOR_MOVE, is_small, is_straight
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.motion_changes import require_turns_at_rest
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.platform import FramePlatform, JointPlatform
from framework.kinematics.single_pose import SinglePose
from framework.linalg.ordered_sums import singular_values
from framework.statics.stiffness import mass_matrices
from framework.tolerances import BRANCHES_MEET, DETERMINANT_LOST

MAX_ITERATIONS = 5  # of Newton's method in a cycle; a prediction that needs more is none
LAST_STEP = 1e-10  # [rad, robot lengths] of the joints: rates are as exact, the pose as its square


class ControlCycle:
    """The state and the dynamics of a robot along its motors, brought up to date once a cycle.

    It starts at an assembled configuration, the reference by default, and goes on in its assembly mode or
    raises; springs keep the deflections of it, as in `forward_kinematics`. All arrays are written over by the
    next `update`; one object serves one thread.

    q, v: all joints (nq,) and their rates (nv,).
    x, dx: the platform's coordinates (n,), turns counted on from the start, and their rates.
    T: joint rates for unit rates of the motors' joints (nv, n_a).
    residual: the largest of all loop equations at q, those dropped as redundant included [m or rad].
    """

    def __init__(self, robot: ParallelRobot, *, near: ArrayLike | Configuration | None = None) -> None:
        """Make the cycle of a robot.

        Raises:
            InvalidInput: motors that depend on one another, or a platform that does not determine the joints;
                damping or armature of balls that drives an idle turn; near is not assembled.
            SingularPose: the start is on a Type 2 singularity.
        """
        expect_robot(robot)
        require_square(robot)
        check_motors_are_free(robot)
        require_turns_at_rest(robot)
        start = start_pose(robot, near)
        self.robot, self._equations, self._data = robot, SinglePose(robot), robot.model.createData()
        self._names = ", ".join(robot.actuator_names)
        self._actuated, self._following = robot.actuated, robot.following
        self._independent = robot.structure.independent
        self._all_rows = len(self._independent) == len(robot.rows.names)
        self._scale = np.asfortranarray(robot.passive_scale)
        self._size = robot.column_scale[robot.following]
        self._row_sizes = robot.row_lengths[self._independent] * robot.structure.row_sizes
        self._flat = robot.model.nq == robot.model.nv
        self._motors = robot.actuated_coordinates(start.q[None])[0].copy()
        self.q, self.x, self.dx = start.q.copy(), start.x.copy(), np.zeros(robot.n)
        self.v, self.T = np.zeros(robot.model.nv), np.zeros((robot.model.nv, robot.n_a))
        self.residual = 0.0
        self._determinant, self._type2 = 0.0, 0.0
        self._linearise(self.q)
        if not abs(self._determinant) > 0.0:
            raise type2_pose(robot, start.x, "is unbounded there: start elsewhere")
        self._bias: Array | None = None
        self._sprung = bool(robot.joint_stiffness.any())
        self._set_state(self.q, np.zeros(robot.n_a))

    def update(self, q_a: ArrayLike, dq_a: ArrayLike) -> None:
        """Take the pose to motor joints q_a (n_a,) with rates dq_a (n_a,), joint side of the gears.

        Raises:
            InvalidInput: not n_a finite numbers each.
            Type2Singularity: the way of the motors from the last cycle leads to one, where this assembly mode
                ends; it carries where. The cycle stays where it was.
            NotAssembled: the way cannot be followed for another reason.
        """
        target = finite_numbers(f"q_a ({self._names})", q_a, self.robot.n_a)
        rates = finite_numbers(f"dq_a ({self._names})", dq_a, self.robot.n_a)
        q = self._close_loops(target)
        if q is None:
            self._linearise(self.q)  # back to the last cycle, if the way ends
            q = forward_kinematics(self.robot, target, near=self.q).q.copy()
            self._linearise(q)
        self._motors = target.copy() if self._flat else self.robot.actuated_coordinates(q[None])[0]
        self._set_state(q, rates)

    def torque(self, ddq_a: ArrayLike) -> Array:
        """Compute motor torques (n_a,) [N m, N], motor side, for accelerations ddq_a (n_a,), joint side.

        Rotors, armature, damping and joint springs included; dry friction and wrenches of the world not.

        Raises:
            InvalidInput: not n_a finite numbers.
        """
        robot = self.robot
        acceleration = finite_numbers(f"ddq_a ({self._names})", ddq_a, robot.n_a)
        a = self._drift_acceleration() + self.T @ acceleration
        return self._motor_torque(a) + robot.rotor_inertia * robot.gear_ratio * acceleration

    @property
    def mass(self) -> Array:
        """Motor torques (n_a, n_a) for unit accelerations of the motors: torque = mass ddq_a + bias."""
        whole = mass_matrices(self.robot, self.q[None])[0] + np.diag(self.robot.rotors)
        return self.T.T @ whole @ self.T / self.robot.gear_ratio[:, None]

    @property
    def bias(self) -> Array:
        """Motor torques (n_a,) at zero accelerations of the motors."""
        return self._motor_torque(self._drift_acceleration())

    @property
    def type2(self) -> float:
        """Distance from Type 2: 1 / |P^-1|, columns summed, in radians and lengths of the robot.

        P are the passive columns of the loops. The distance is 0 at Type 2, and lies between the least
        singular value of P divided by and times the square root of its size. The sign never changes, as the
        cycle never leaves the assembly mode. Infinite without passive joints.
        """
        return self._type2

    @property
    def type1(self) -> float:
        """Distance from Type 1: the least singular value of dx/dq_a, in radians and robot lengths.

        It is 0 at Type 1; the sign is that of the determinant, which changes at Type 1.
        """
        robot = self.robot
        platform = robot.platform.jacobian(self._equations.frame_stack(self.q))[0]
        matrix = platform @ self.T * robot.column_scale[robot.actuated] / robot.platform_scale[:, None]
        least = singular_values(matrix)[-1]
        return float(np.copysign(least, np.linalg.det(matrix)))

    def _linearise(self, q: Array) -> float:
        """Compute T and Newton's step (n_p,) at q (nq,); return the size of the step."""
        equations, columns = self._equations, self._following
        equations.place(q)
        jacobian, residual = equations.jacobian, equations.residual
        if not self._all_rows:
            jacobian, residual = jacobian.take(self._independent, axis=0), residual.take(self._independent)
        self.T[:] = 0.0
        self.T[self._actuated, range(len(self._actuated))] = 1.0
        if not len(columns):
            self._determinant, self._type2, self._step = 1.0, np.inf, np.empty(0)
            return 0.0
        P = np.multiply(jacobian.take(columns, axis=1), self._scale, order="F")
        size = np.abs(P).sum(axis=0).max()
        self._lu, self._pivots, singular = dgetrf(P, overwrite_a=1)
        diagonal = self._lu.diagonal()
        swaps = np.count_nonzero(self._pivots != np.arange(len(diagonal)))
        self._determinant = float(diagonal.prod()) * (-1.0 if swaps % 2 else 1.0)
        if singular:
            self._determinant, self._type2 = 0.0, 0.0
            return np.inf
        self._type2 = float(dgecon(self._lu, size)[0]) * size
        right = np.empty((len(columns), 1 + len(self._actuated)), order="F")
        right[:, 0] = residual / self._row_sizes
        right[:, 1:] = jacobian.take(self._actuated, axis=1) / self._row_sizes[:, None]
        solution = dgetrs(self._lu, self._pivots, right, overwrite_b=1)[0]
        solution *= -1.0
        self._step = solution[:, 0] * self._size
        self.T[columns] = solution[:, 1:] * self._size[:, None]
        return float(np.abs(solution[:, 0]).max())

    def _close_loops(self, target: Array) -> Array | None:
        """Close the loops at motor joints (n_a,) along the tangent; None if the step does not count."""
        columns, determinant = self._following, self._determinant
        turn = target - self._motors
        along = self.T @ turn
        q, correction = self._integrate(self.q, along), np.zeros(len(columns))
        if self._flat:
            q[self._actuated] = target
        largest = MAX_PREDICTOR_MOVE
        for _ in range(MAX_ITERATIONS):
            size = self._linearise(q)
            if not size < largest:
                return None
            if size > 0.0:
                step = np.zeros(len(along))
                step[columns] = self._step
                q, correction, largest = self._integrate(q, step), correction + self._step, size
            if size < LAST_STEP:
                break
        else:
            return None
        corrected = np.abs(correction / self._size).max(initial=0.0)
        lengths = self.robot.column_scale
        advance = np.abs(along / lengths).max()
        turned = np.abs((self.T @ turn - along) / lengths).max()
        counts = (
            is_small(corrected, advance)
            and is_straight(turned, corrected, advance)
            and self._determinant * determinant > DETERMINANT_LOST * determinant**2
            and self.type2 > BRANCHES_MEET
        )
        return q if counts else None

    def _integrate(self, q: Array, step: Array) -> Array:
        """Return the configuration (nq,) after a step (nv,) from q."""
        return q + step if self._flat else pin.integrate(self.robot.model, q, step)

    def _set_state(self, q: Array, rates: Array) -> None:
        """Set q (nq,), at which T is computed, with rates of the motors (n_a,), residual and platform."""
        self.q, self.v, self._bias = q, self.T @ rates, None
        self._equations.move(q, self.v)
        self.residual = float(np.abs(self._equations.residual).max(initial=0.0))
        platform = self.robot.platform
        if isinstance(platform, JointPlatform):
            self.x, self.dx = q[platform.places], self.v[platform.columns]
        elif isinstance(platform, FramePlatform):
            self.x, self.dx = self._frame_platform(platform)

    def _frame_platform(self, platform: FramePlatform) -> tuple[Array, Array]:
        """Return x and dx (n,) of a platform that is a frame."""
        linear, w = self._equations.platform_twist()
        attitude, position = platform.attitude, self._equations.platform_origin
        if platform.is_point:
            return position[platform.along], linear[platform.along]
        frames = self._equations.frame_stack(self.q)
        x = platform.unwrap(platform.coordinates(frames), self.x[None])[0]
        dx = np.empty(platform.n)
        dx[platform.sliding] = linear[platform.along]
        turning = attitude.couples(frames.rotation[:, 0]).reshape(-1, 3) @ w
        if isinstance(attitude, RotationVector):
            r = np.empty(3)
            r[attitude.axes] = x[platform.turning]
            turning = np.linalg.solve(pin.Jexp3(-r), w)[attitude.axes]
        dx[platform.turning] = turning
        return x, dx

    def _drift_acceleration(self) -> Array:
        """Return the joint accelerations a_0 (nv,) at zero accelerations of the motors."""
        if self._bias is None:
            columns = self._following
            self._bias = np.zeros(len(self.v))
            if len(columns):
                drift = self._equations.drift()
                drift = drift.take(self._independent) / self._row_sizes
                self._bias[columns] = -dgetrs(self._lu, self._pivots, drift)[0] * self._size
        return self._bias

    def _motor_torque(self, a: Array) -> Array:
        """Compute motor torques (n_a,) for accelerations a (nv,), without the rotors' own, motor side."""
        robot = self.robot
        force = pin.rnea(robot.model, self._data, self.q, self.v, a)
        if robot.is_damped:
            force = force + robot.joint_damping * self.v
        if self._sprung:
            force = force + spring_torques(robot, self.q[None], robot.joint_stiffness)[0]
        return force @ self.T / robot.gear_ratio
