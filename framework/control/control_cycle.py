"""The pose and the motor torques of a rigid robot once a millisecond, from its encoders.

    cycle = ControlCycle(robot)
    cycle.update(q_a, dq_a)                     # joint side of the gears
    torque = cycle.torque(ddq_a)                # motor side

A cycle predicts the pose along the tangent T = dq/dq_a of the last cycle and closes the loops by Newton's
method on the passive joints, P dq_p = -(residual). With a_0 the accelerations at ddq_a = 0,

    torque = mass ddq_a + bias,     mass = T' (M + rotors) T / n,     bias = T' RNEA(q, v, a_0) / n + ...,

without loop forces. A step is accepted by the same measures as in `predictor_corrector`. Where it is not,
`forward_kinematics` follows the motors in short steps, or reports the singularity where the assembly mode
ends.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from framework.dynamics.forces import mass_matrices, spring_torques
from framework.dynamics.pointwise_dynamics import type2_pose
from framework.errors import finite_numbers
from framework.kinematics.assembly import Configuration
from framework.kinematics.attitude import RotationVector
from framework.kinematics.continuation.forward_kinematics import (
    check_motors_are_free,
    forward_kinematics,
    start_pose,
)
from framework.kinematics.continuation.pose_search import NearestPose, PoseSearch
from framework.kinematics.continuation.predictor_corrector import MAX_PREDICTOR_MOVE, is_small, is_straight
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.motion_changes import require_turns_at_rest
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.platform import FramePlatform, JointPlatform
from framework.kinematics.single_pose import SinglePose
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.ordered_sums import singular_values
from framework.tolerances import BRANCHES_MEET, DETERMINANT_LOST

MAX_ITERATIONS = 5  # of Newton's method in a cycle; a prediction that needs more is not accepted
# [rad, robot lengths] of the joints: the error of the rates; that of the pose is its square
LAST_STEP = 1e-10


class ControlCycle:
    """The state and the dynamics of a robot along its motors, updated once a cycle.

    It starts at an assembled configuration, the reference by default, and stays in its assembly mode or
    raises. Springs keep the deflections of the start, as in `forward_kinematics`. The next `update`
    overwrites all arrays; one object serves one thread.

    q, v: all joints (nq,) and their rates (nv,).
    x, dx: the platform's coordinates (n,), continuous from the start over full turns, and their rates.
    T: joint rates for unit rates of the motors' joints (nv, n_a).
    residual: the largest of all loop equations at q, those dropped as redundant included [m or rad].
    type2: distance from Type 2, 1 / |P^-1| in the 1-norm [rad, robot lengths]. P (m, m) are the passive
        columns of the loops, with least singular value sigma: it lies in [sigma / sqrt(m), sigma sqrt(m)].
        Never negative, as the cycle stays in its assembly mode; infinite without passive joints.
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
        self._passive_lengths = robot.column_scale[robot.following]
        self._row_sizes = robot.row_lengths[self._independent] * robot.structure.row_sizes
        self._steps_add = robot.model.nq == robot.model.nv  # no balls: q + step is the next configuration
        self._motors = robot.actuated_coordinates(start.q[None])[0].copy()
        self.q, self.x, self.dx = start.q.copy(), start.x.copy(), np.zeros(robot.n)
        self.v, self.T = np.zeros(robot.model.nv), np.zeros((robot.model.nv, robot.n_a))
        self.residual = 0.0
        self._determinant, self.type2 = 0.0, 0.0
        self._factor_loops(self.q)
        if not abs(self._determinant) > 0.0:
            raise type2_pose(robot, start.x, "is unbounded there: start elsewhere")
        self._drift: Array | None = None  # a_0, computed when needed
        self._search: PoseSearch | None = None
        self._has_joint_springs = bool(robot.joint_stiffness.any())
        self._set_state(self.q, np.zeros(robot.n_a))

    def update(self, q_a: ArrayLike, dq_a: ArrayLike) -> None:
        """Move the pose to motor joints q_a (n_a,) with rates dq_a (n_a,).

        Joint side of the gears.

        Raises:
            InvalidInput: not n_a finite numbers each.
            Type2Singularity: between the last cycle and q_a this assembly mode ends at a singularity, which
                the error describes. The state remains that of the last cycle.
            NotAssembled: the motors cannot be followed for another reason.
        """
        target = finite_numbers(f"q_a ({self._names})", q_a, self.robot.n_a)
        rates = finite_numbers(f"dq_a ({self._names})", dq_a, self.robot.n_a)
        q = self._predict_and_correct(target)
        if q is None:
            self._factor_loops(self.q)  # restore the last cycle, as `forward_kinematics` may raise
            q = forward_kinematics(self.robot, target, near=self.q).q.copy()
            self._factor_loops(q)
        self._motors = target.copy() if self._steps_add else self.robot.actuated_coordinates(q[None])[0]
        self._set_state(q, rates)

    def approach(self, x: ArrayLike) -> NearestPose:
        """Move the pose to platform coordinates x (n,), or as near as found, and rest.

        The search starts from the pose of the last cycle and keeps its modes. It ends at the ranges of
        joints, at stretched legs (Type 1) and just before Type 2. `update` and `approach` go on from there.
        A search takes some 10 to 80 ms.

        Raises:
            InvalidInput: not n finite numbers.
        """
        target = finite_numbers(f"x ({', '.join(self.robot.axis_names)})", x, self.robot.n)
        self._search = self._search or PoseSearch(self.robot, motors_hold=True)
        nearest = self._search.find(self.q, self.x, target)
        q, self.x = nearest.q.copy(), nearest.x.copy()  # from which turns are counted on
        self._factor_loops(q)
        self._motors = self.robot.actuated_coordinates(q[None])[0].copy()
        self._set_state(q, np.zeros(self.robot.n_a))
        return nearest

    def torque(self, ddq_a: ArrayLike) -> Array:
        """Compute motor torques (n_a,) [N m, N] for motor accelerations ddq_a (n_a,).

        Torques are on the motor side of the gears, accelerations on the joint side. Rotors, armature, damping
        and joint springs count, but no dry friction and no wrenches of the world.

        Raises:
            InvalidInput: not n_a finite numbers.
        """
        robot = self.robot
        acceleration = finite_numbers(f"ddq_a ({self._names})", ddq_a, robot.n_a)
        a = self._drift_acceleration() + self.T @ acceleration
        return self._motor_torque(a) + robot.rotor_inertia * robot.gear_ratio * acceleration

    @property
    def mass(self) -> Array:
        """Motor torques (n_a, n_a) for unit accelerations of the motors.

        torque = mass ddq_a + bias.
        """
        M = mass_matrices(self.robot, self.q[None])[0] + np.diag(self.robot.rotors)
        return self.T.T @ M @ self.T / self.robot.gear_ratio[:, None]

    @property
    def bias(self) -> Array:
        """Motor torques (n_a,) at zero accelerations of the motors."""
        return self._motor_torque(self._drift_acceleration())

    @property
    def type1(self) -> float:
        """Distance from Type 1: least singular value of dx/dq_a, with a sign.

        In radians and robot lengths. The sign is that of the determinant, which changes at Type 1.
        """
        robot = self.robot
        X = robot.platform.jacobian(self._equations.frame_stack(self.q))[0]
        dx_dq_a = X @ self.T * robot.column_scale[robot.actuated] / robot.platform_scale[:, None]
        least = singular_values(dx_dq_a)[-1]
        return float(np.copysign(least, np.linalg.det(dx_dq_a)))

    def _factor_loops(self, q: Array) -> float:
        """Decompose P at q (nq,); set T, Newton's step and distance; return the step's size.

        P [dq_p, T_p] = -[residual, J_a] gives the step dq_p (n_p,) and the passive rows of T in one solution.
        """
        equations, columns = self._equations, self._following
        equations.place(q)
        jacobian, residual = equations.jacobian, equations.residual
        if not self._all_rows:
            jacobian, residual = jacobian.take(self._independent, axis=0), residual.take(self._independent)
        self.T[:] = 0.0
        self.T[self._actuated, range(len(self._actuated))] = 1.0
        if not len(columns):
            self._determinant, self.type2, self._step = 1.0, np.inf, np.empty(0)
            return 0.0
        P = np.multiply(jacobian.take(columns, axis=1), self._scale, order="F")
        if not self._factor(P):
            return np.inf
        right_sides = np.empty((len(columns), 1 + len(self._actuated)), order="F")
        right_sides[:, 0] = residual / self._row_sizes
        right_sides[:, 1:] = jacobian.take(self._actuated, axis=1) / self._row_sizes[:, None]
        solution = dgetrs(self._lu, self._pivots, right_sides, overwrite_b=1)[0]
        solution *= -1.0
        self._step = solution[:, 0] * self._passive_lengths
        self.T[columns] = solution[:, 1:] * self._passive_lengths[:, None]
        return float(np.abs(solution[:, 0]).max())

    def _factor(self, P: Array) -> bool:
        """Factor P (m, m) as L U, with determinant and `type2`; return whether P is regular."""
        norm = np.abs(P).sum(axis=0).max()  # 1-norm
        self._lu, self._pivots, is_singular = dgetrf(P, overwrite_a=1)
        if is_singular:
            self._determinant, self.type2 = 0.0, 0.0
            return False
        diagonal = self._lu.diagonal()
        swaps = np.count_nonzero(self._pivots != np.arange(len(diagonal)))
        self._determinant = float(diagonal.prod()) * (-1.0 if swaps % 2 else 1.0)
        self.type2 = float(dgecon(self._lu, norm)[0]) * norm
        return True

    def _predict_and_correct(self, target: Array) -> Array | None:
        """Close the loops at motor joints (n_a,) from the tangent; None if refused.

        Accepted are steps whose correction is small beside the prediction, along which the tangent turns
        little, and which stay in the assembly mode, away from Type 2.
        """
        columns, determinant = self._following, self._determinant
        motor_step = target - self._motors
        prediction = self.T @ motor_step
        q, correction = self._integrate(self.q, prediction), np.zeros(len(columns))
        if self._steps_add:
            q[self._actuated] = target  # to the last bit
        previous_size = MAX_PREDICTOR_MOVE
        for _ in range(MAX_ITERATIONS):
            size = self._factor_loops(q)
            if not size < previous_size:
                return None
            if size > 0.0:
                step = np.zeros(len(prediction))
                step[columns] = self._step
                q, correction, previous_size = self._integrate(q, step), correction + self._step, size
            if size < LAST_STEP:
                break
        else:
            return None
        lengths = self.robot.column_scale
        corrected = np.abs(correction / self._passive_lengths).max(initial=0.0)
        predicted = np.abs(prediction / lengths).max()
        tangent_change = np.abs((self.T @ motor_step - prediction) / lengths).max()
        is_accepted = (
            is_small(corrected, predicted)
            and is_straight(tangent_change, corrected, predicted)
            and self._determinant * determinant > DETERMINANT_LOST * determinant**2
            and self.type2 > BRANCHES_MEET
        )
        return q if is_accepted else None

    def _integrate(self, q: Array, step: Array) -> Array:
        """Return the configuration (nq,) after a step (nv,) from q."""
        return q + step if self._steps_add else pin.integrate(self.robot.model, q, step)

    def _set_state(self, q: Array, rates: Array) -> None:
        """Set q (nq,), the joint rates at motor rates (n_a,), residual and platform.

        T is computed at q already.
        """
        self.q, self.v, self._drift = q, self.T @ rates, None
        self._equations.move(q, self.v)
        self.residual = float(np.abs(self._equations.residual).max(initial=0.0))
        platform = self.robot.platform
        if isinstance(platform, JointPlatform):
            self.x, self.dx = q[platform.places], self.v[platform.columns]
        elif isinstance(platform, FramePlatform):
            self.x, self.dx = self._platform_motion(platform)

    def _platform_motion(self, platform: FramePlatform) -> tuple[Array, Array]:
        """Compute x and dx (n,) of a platform that is a frame.

        Rates of its attitude follow from the angular velocity w: of a rotation vector r by dr = Jexp(-r)^-1
        w, of other attitudes by their own matrix.
        """
        linear, w = self._equations.platform_twist()
        attitude, position = platform.attitude, self._equations.platform_origin
        if platform.is_point:
            return position[platform.along], linear[platform.along]
        frames = self._equations.frame_stack(self.q)
        x = platform.unwrap(platform.coordinates(frames), self.x[None])[0]
        dx = np.empty(platform.n)
        dx[platform.sliding] = linear[platform.along]
        if isinstance(attitude, RotationVector):
            r = np.empty(3)
            r[attitude.axes] = x[platform.turning]
            dx[platform.turning] = np.linalg.solve(pin.Jexp3(-r), w)[attitude.axes]
        else:
            dx[platform.turning] = attitude.couples(frames.rotation[:, 0]).reshape(-1, 3) @ w
        return x, dx

    def _drift_acceleration(self) -> Array:
        """Compute joint accelerations a_0 (nv,) at motor accelerations 0.

        P a_p = -drift.
        """
        if self._drift is None:
            columns = self._following
            self._drift = np.zeros(len(self.v))
            if len(columns):
                loop_drift = self._equations.drift().take(self._independent) / self._row_sizes
                passive = -dgetrs(self._lu, self._pivots, loop_drift)[0]
                self._drift[columns] = passive * self._passive_lengths
        return self._drift

    def _motor_torque(self, a: Array) -> Array:
        """Compute motor torques (n_a,) for joint accelerations a (nv,), without rotors."""
        robot = self.robot
        force = pin.rnea(robot.model, self._data, self.q, self.v, a)
        if robot.is_damped:
            force = force + robot.joint_damping * self.v
        if self._has_joint_springs:
            force = force + spring_torques(robot, self.q[None], robot.joint_stiffness)[0]
        return force @ self.T / robot.gear_ratio
