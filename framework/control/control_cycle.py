"""The pose and the motor torques of a rigid robot once a millisecond, from its encoders.

    cycle = ControlCycle(robot)
    cycle.update(q_a, dq_a)                     # joint side of the gears
    torque = cycle.torque(ddq_a)                # motor side

A cycle predicts the pose from the tangents T = dq/dq_a of the last three cycles, by the formula of Adams and
Bashforth. Newton's method then closes the loops with the passive joints, P dq_p = -residual. Its first step
takes P^-1 of the last cycle, which leaves so little that at the usual speeds of motors one linearisation is
enough. P is factorised by LAPACK itself: the checks of `np.linalg.inv` take longer than a small inverse.
With the joint accelerations a_0 at ddq_a = 0,

    torque = mass ddq_a + bias,     mass = T' (M + rotors) T / n,     bias = T' (RNEA(q, v, a_0) + ...) / n,

where T' eliminates the loop forces, and damping and joint springs are added to RNEA. A step is accepted by
the criteria of `predictor_corrector`. If a step is refused, `forward_kinematics` follows the motors in short
steps, or reports the singularity at which the assembly mode ends.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from framework.argument_errors import explain_errors
from framework.dynamics.forces import all_spring_forces, damping_forces, mass_matrices
from framework.dynamics.pointwise_dynamics import type2_pose
from framework.errors import finite_numbers
from framework.kinematics.assembly import Configuration
from framework.kinematics.attitude import RotationVector
from framework.kinematics.closures import loop_wrenches, row_factors
from framework.kinematics.continuation.forward_kinematics import (
    check_motors_are_free,
    forward_kinematics,
    start_pose,
)
from framework.kinematics.continuation.pose_search import NearestPose, PoseSearch
from framework.kinematics.continuation.predictor_corrector import MAX_PREDICTOR_MOVE, is_small, is_straight
from framework.kinematics.couplings import coupling_derivatives, coupling_drift, coupling_jacobian
from framework.kinematics.frames import FrameStack, Scratch
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.loop_ranges import align_bases
from framework.kinematics.motion_rates import require_turns_at_rest
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import FramePlatform, JointPlatform
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.ordered_sums import cross, singular_values
from framework.tolerances import BRANCHES_MEET, DETERMINANT_LOST

# [rad, robot lengths]: the last Newton step is smaller. It is the error of the rates, since T is computed
# before the step; the error of the pose is its square
LAST_STEP = 1e-10
# of a twist (v, w) (6,): twist @ TWIST_ROWS is the matrix (16,), by rows, of [[w x transposed, 0], [v, 0]]
TWIST_ROWS = np.zeros((6, 16))
TWIST_ROWS[range(6), [12, 13, 14, 6, 8, 1]] = 1.0  # v in the last row; and of w x transposed
TWIST_ROWS[[3, 4, 5], [9, 2, 4]] = -1.0
SECOND_DERIVATIVE = np.array([1.0, 2.0, 1.0])  # of a product, by the rule of Leibniz
# T + (T - last) / 2 + 5/12 (T - 2 last + former), the mean tangent of equal steps to third order
ADAMS_BASHFORTH = np.array([23.0, -16.0, 5.0]) / 12.0


class ControlCycle:
    """The state and the dynamics of a robot along its motors, updated once a cycle.

    The cycle starts at an assembled configuration, the reference by default. It stays in its assembly mode or
    raises an error. Springs keep the deflections of the start, as in `forward_kinematics`. The next `update`
    overwrites all arrays. One object serves one thread.

    q, v: all joints (nq,) and their rates (nv,).
    x, dx: platform coordinates (n,), continuous over full turns from the start, and their rates.
    T: joint rates (nv, n_a) for unit rates of the motors' joints.
    """

    @explain_errors
    def __init__(self, robot: ParallelRobot, *, near: ArrayLike | Configuration | None = None) -> None:
        """Start the cycle of a robot at the pose `near`.

        Raises:
            InvalidInput: motors depend on one another; the platform does not determine the joints; damping or
                armature of balls drives an idle turn; `near` is not assembled.
            SingularPose: the start is at a Type 2 singularity.
        """
        from scipy.linalg import lapack

        require_square(robot)
        check_motors_are_free(robot)
        require_turns_at_rest(robot)
        start = start_pose(robot, near)
        self.robot = robot
        self._equations = SinglePose(robot)
        self._data = self._equations.model.createData()
        self._has_springs = bool(robot.joint_stiffness.any() or robot.line_springs.names)
        self._names = ", ".join(robot.actuator_names)
        # computed once, not in every cycle
        self._factorise, self._invert, self._norm = lapack.dgetrf, lapack.dgetri, lapack.dlange
        self._actuated, self._following = robot.actuated, robot.following
        self._pivot_order = np.arange(len(robot.following))
        self._has_no_balls = robot.model.nq == robot.model.nv  # then q + step is the next configuration
        # scales that make P, its unknowns and its right-hand sides dimensionless
        self._scale = robot.passive_scale  # (n_p, n_p) of the entries of P, for n_p passive joints
        self._passive_lengths = robot.column_scale[robot.following]  # (n_p,) of the unknowns
        row_sizes = robot.loop_lengths * robot.structure.row_sizes  # of the independent equations
        self._solver_scale = -self._passive_lengths[:, None] / row_sizes  # of -P^-1, back to units
        self._rotors = robot.rotor_inertia * robot.gear_ratio  # (n_a,) of motor torques
        # columns of `SinglePose.table`: the residual, then the actuated joints
        self._right_sides = np.append(robot.nv, robot.actuated)
        self._bases: Array | None = None  # (1, R, m) of the range of the loops' Jacobian, along the motion
        if robot.structure.varies:
            self._span_sizes = robot.equations.span_scale[:, None]
            combination = linearised_at(robot, start.q[None]).combination  # (1, R, m)
            self._bases = None if combination is None else combination * self._span_sizes

        self.q = start.q.copy()
        self.x = start.x.copy()
        self.T = np.zeros((robot.nv, robot.n_a))
        self.T[robot.actuated] = np.eye(robot.n_a)
        self._tangents = np.empty((3, *self.T.shape))  # T of the last three cycles, the last one first
        self._step = np.zeros(robot.nv)  # of Newton's method; motors rest
        if self._linearise(self.q) == np.inf:
            raise type2_pose(robot, start.x, "is unbounded there: start elsewhere")
        self._search: PoseSearch | None = None  # made when needed
        self._rest_at(self.q)

    def update(self, q_a: ArrayLike, dq_a: ArrayLike) -> None:
        """Follow the motors to q_a (n_a,) with rates dq_a (n_a,), on the joint side of the gears.

        Raises:
            InvalidInput: not n_a finite numbers each.
            Type2Singularity: the assembly mode ends at a singularity between the last cycle and q_a; the
                error describes the singularity. The state remains that of the last cycle.
            NotAssembled: the motors cannot be followed for another reason.
        """
        target = finite_numbers(f"q_a ({self._names})", q_a, self.robot.n_a)
        rates = finite_numbers(f"dq_a ({self._names})", dq_a, self.robot.n_a)
        q = self._predict_and_correct(target)
        if q is None:
            # the refused step has changed T and P: restore them first, because
            # `forward_kinematics` may raise an error and the state must remain that of the last cycle
            self._linearise(self.q)
            q = forward_kinematics(self.robot, target, near=self.q).q.copy()
            self._linearise(q)
            self._tangents[:] = self.T
        self._motors = target.copy() if self._has_no_balls else self.robot.actuated_coordinates(q[None])[0]
        self._set_state(q, rates)

    def approach(self, x: ArrayLike) -> NearestPose:
        """Move to platform coordinates x (n,), or to the nearest pose found, and rest.

        The search starts at the pose of the last cycle and stays in its working and assembly mode. It ends at
        x, at the end of a joint's range, at stretched legs (Type 1) or at Type 2. The next `update` or
        `approach` continues from the pose found. A search takes some 10 to 80 ms.

        Raises:
            InvalidInput: not n finite numbers.
        """
        target = finite_numbers(f"x ({', '.join(self.robot.axis_names)})", x, self.robot.n)
        self._search = self._search or PoseSearch(self.robot, motors_hold=True)
        nearest = self._search.find(self.q, self.x, target)
        q = nearest.q.copy()
        self.x = nearest.x.copy()  # from now on full turns are counted from this x
        self._linearise(q)
        self._rest_at(q)
        return nearest

    def torque(self, ddq_a: ArrayLike) -> Array:
        """Compute motor torques (n_a,) [N m, N] for motor accelerations ddq_a (n_a,).

        Torques are on the motor side of the gears, accelerations on the joint side. The torques include
        rotors, armature, damping and joint springs, but neither dry friction nor external wrenches.

        Raises:
            InvalidInput: not n_a finite numbers.
        """
        acceleration = finite_numbers(f"ddq_a ({self._names})", ddq_a, self.robot.n_a)
        a = self._drift_acceleration() + self.T @ acceleration
        return self._motor_torque(a) + self._rotors * acceleration

    @property
    def residual(self) -> float:
        """Largest residual of all loop equations at q, redundant ones included [m or rad]."""
        residual = loop_wrenches(self.robot.rows, self._equations.frame_stack(self.q)).residual
        return float(np.abs(residual).max(initial=0.0))

    @property
    def mass(self) -> Array:
        """Motor torques (n_a, n_a) for unit accelerations: torque = mass ddq_a + bias."""
        M = mass_matrices(self.robot, self.q[None])[0] + np.diag(self.robot.rotors)  # (nv, nv), joint side
        return self.T.T @ M @ self.T / self.robot.gear_ratio[:, None]

    @property
    def bias(self) -> Array:
        """Motor torques (n_a,) at zero accelerations of the motors."""
        return self._motor_torque(self._drift_acceleration())

    @property
    def type2(self) -> float:
        """Distance from Type 2, 1 / |P^-1| in the 1-norm [rad, robot lengths].

        With P (n_p, n_p) the passive columns of the loops and sigma their least singular value, the distance
        lies in [sigma / sqrt(n_p), sigma sqrt(n_p)]. It is never negative, as the cycle stays in its assembly
        mode, and infinite without passive joints.
        """
        return 1.0 / self._inverse_norm if self._inverse_norm else np.inf

    @property
    def type1(self) -> float:
        """Signed distance from Type 1: least singular value of dx/dq_a [rad, robot lengths].

        The sign is that of the determinant, which changes at Type 1.
        """
        robot = self.robot
        X = robot.platform.jacobian(self._equations.frame_stack(self.q))[0]  # (n, nv)
        dx_dq_a = X @ self.T * robot.column_scale[robot.actuated] / robot.platform_scale[:, None]
        least = singular_values(dx_dq_a)[-1]
        return float(np.copysign(least, np.linalg.det(dx_dq_a)))

    def _linearise(self, q: Array) -> float:
        """Compute P^-1, T and the Newton step (nv,) at q (nq,); return the size of the step.

        P and J_a are the passive and the actuated columns of the independent loop equations. The step dq_p
        and the passive rows T_p of T solve P [dq_p, T_p] = -[residual, J_a]; `_solver` is -P^-1. The size of
        the step is its largest entry [rad, robot lengths]; it is infinite if P is singular.
        """
        equations = self._equations
        equations.evaluate_pose(q)
        if self._bases is not None:
            moving = self.robot.moving
            J = equations.jacobian[:, moving] * self.robot.column_scale[moving] / self._span_sizes
            self._bases = align_bases(J[None], self._bases)
        table = self._combine_rows(equations.table)  # (n_p, nv + 1)
        P = table.take(self._following, axis=1) * self._scale  # dimensionless
        if len(P):
            factors, pivots, first_zero = self._factorise(P)
            if first_zero:  # P is singular
                self._inverse_norm = np.inf
                return np.inf
            inverse, _ = self._invert(factors, pivots)
            self._inverse_norm = self._norm("1", inverse)
            swaps = np.count_nonzero(pivots != self._pivot_order)
            self._determinant = math.prod(factors.diagonal().tolist()) * (-1.0) ** swaps
        else:  # the motors are all joints
            inverse, self._inverse_norm, self._determinant = P, 0.0, 1.0
        self._solver = inverse * self._solver_scale
        solution = self._solver @ table.take(self._right_sides, axis=1)  # (n_p, 1 + n_a) dq_p, T_p
        step = solution[:, 0]
        self._step[self._following] = step
        self.T[self._following] = solution[:, 1:]
        return float(np.abs(step / self._passive_lengths).max(initial=0.0))

    def _combine_rows(self, values: Array) -> Array:
        """Return values (m, ...) of the equations, or of their combinations by the bases."""
        return values if self._bases is None else (self._bases[0] / self._span_sizes).T @ values

    def _predict_and_correct(
        self,
        target: Array,
        *,
        max_iterations: int = 5,  # of Newton's method; a prediction that needs more is refused
    ) -> Array | None:
        """Return the configuration (nq,) at motor joints `target` (n_a,); None if refused.

        The step from the last cycle is accepted if its correction is small compared with the prediction, the
        tangent turns little along the step, and the pose stays in the assembly mode, away from Type 2. P and
        T of the last cycle predict the step; afterwards they are those of the new configuration, even of a
        refused one.
        """
        last_determinant = self._determinant
        motor_step = target - self._motors  # (n_a,)
        tangent_steps = self._tangents @ motor_step  # (3, nv) by T of the last three cycles
        tangent_step = tangent_steps[0]
        change = ADAMS_BASHFORTH @ tangent_steps  # (nv,) sum of all steps
        q = self._integrate(self.q, change)
        if self._has_no_balls:
            q[self._actuated] = target  # exactly, without the rounding of the sum

        # correct with P^-1 of the last cycle, then by Newton steps, each smaller than the one before it
        self._equations.evaluate_residual(q)
        self._step[self._following] = self._solver @ self._combine_rows(self._equations.residual)
        previous_size = MAX_PREDICTOR_MOVE
        for _ in range(max_iterations):
            q = self._integrate(q, self._step)
            change += self._step
            size = self._linearise(q)  # which sets the next step
            if not size < previous_size:  # Newton's method diverges, or P is singular
                return None
            if size < LAST_STEP:
                break
            previous_size = size
        else:  # too many iterations
            return None
        q = self._integrate(q, self._step)
        change += self._step

        # judge the step along the last tangent by the largest motion of a joint [rad, robot lengths]
        correction = change - tangent_step  # (nv,)
        turn = self.T @ motor_step - tangent_step  # (nv,) of the tangent, along the step
        sizes = np.abs(np.array([correction, tangent_step, turn]) / self.robot.column_scale)  # (3, nv)
        corrected, predicted, tangent_change = sizes.max(axis=1).tolist()
        is_accepted = (
            is_small(corrected, predicted)
            and is_straight(tangent_change, corrected, predicted)
            # a determinant far below the last one is rounding, so its sign says nothing
            and self._determinant * last_determinant > DETERMINANT_LOST * last_determinant**2
            and self.type2 > BRANCHES_MEET
        )
        if not is_accepted:
            return None
        self._tangents[1:] = self._tangents[:-1]
        self._tangents[0] = self.T
        return q

    def _integrate(self, q: Array, step: Array) -> Array:
        """Return the configuration (nq,) after a step (nv,) from q."""
        return q + step if self._has_no_balls else pin.integrate(self.robot.model, q, step)

    def _rest_at(self, q: Array) -> None:
        """Set the state of rest at q (nq,)."""
        self._motors = self.robot.actuated_coordinates(q[None])[0].copy()
        self._tangents[:] = self.T
        self._set_state(q, np.zeros(self.robot.n_a))

    def _set_state(self, q: Array, rates: Array) -> None:
        """Set the state at q (nq,) for `rates` (n_a,) of the motors' joints; T must belong to q already."""
        self.q = q
        self.v = self.T @ rates
        self._drift: Array | None = None  # a_0, computed when needed
        self._equations.evaluate_motion(q, self.v)
        platform = self.robot.platform
        if isinstance(platform, JointPlatform):
            self.x = q[platform.q_indices]
            self.dx = self.v[platform.columns]
        elif isinstance(platform, FramePlatform):
            self.x, self.dx = self._platform_motion(platform)

    def _platform_motion(self, platform: FramePlatform) -> tuple[Array, Array]:
        """Compute x and dx (n,) of a platform that is a frame.

        The rates of the attitude follow from the angular velocity w. A rotation vector r has the rates
        dr = Jexp(-r)^-1 w. For the other kinds of attitude the matrix `couples` takes w to the rates.
        """
        position, linear = self._equations.platform_motion()
        if platform.is_point:  # its coordinates are positions along base axes
            return position[platform.along], linear[platform.along]
        scratch = self._equations.scratch
        w = scratch.velocities[scratch.bodies[0], 3:]  # (3,) at the last `evaluate_motion`
        attitude = platform.attitude
        frames = self._equations.frame_stack(self.q)
        x = platform.unwrap(platform.coordinates(frames), self.x[None])[0]
        dx = np.empty(platform.n)
        dx[platform.sliding] = linear[platform.along]
        if isinstance(attitude, RotationVector):
            r = np.empty(3)
            r[attitude.axes] = x[platform.turning]
            dx[platform.turning] = np.linalg.solve(pin.Jexp3(-r), w)[attitude.axes]
        else:
            dx[platform.turning] = attitude.couples(frames.platform_rotation).reshape(-1, 3) @ w
        return x, dx

    def _drift_acceleration(self) -> Array:
        """Compute joint accelerations a_0 (nv,) at zero motor accelerations.

        With the drift dJ/dt v of the loops, the accelerations a_p of passive joints solve P a_p = -drift.
        """
        if self._drift is None:
            self._drift = np.zeros(len(self.v))
            loop_drift = self._combine_rows(self._equations.drift(self.q, self.v))
            self._drift[self._following] = self._solver @ loop_drift
        return self._drift

    def _motor_torque(self, a: Array) -> Array:
        """Compute motor torques (n_a,) [N m, N] for joint accelerations a (nv,), rotors left out.

        The generalised forces of the open tree are projected by T', which eliminates the loop forces.
        """
        robot = self.robot
        force = pin.rnea(self._equations.model, self._data, self.q, self.v, a)
        if robot.is_damped:
            force = force + damping_forces(robot, self.q[None], self.v[None])[0]
        if self._has_springs:
            force = force + all_spring_forces(robot, self.q[None], robot.joint_stiffness)[0]
        return force @ self.T / robot.gear_ratio


class SinglePose:
    """Spanning loop equations, Jacobian and drift of one configuration, in few calls of numpy.

    The equations are those of `closures`, which works on stacks. For a single configuration its calls on a
    dozen small arrays take longer than pinocchio. Here the arrays are allocated once and overwritten by each
    evaluation. So one object serves one thread.

    An axis or an origin c of a frame is a row (c, 0) or (c, 1). The two vectors a and b of each loop equation
    (`row_factors`) are differences of such rows, so one constant matrix selects them from all rows.
    """

    def __init__(self, robot: ParallelRobot) -> None:
        """Allocate the memory of one pose: its frames, m loop equations and their Jacobian (m, nv)."""
        rows = robot.spanning_loops
        self.model = robot.model.copy()  # pinocchio writes beyond `scratch` once a caller adds frames
        scratch = Scratch.of(self.model, robot.frames)
        count = len(rows.names)
        frames = len(scratch.frames)
        self.robot = robot
        self.rows = rows
        self.scratch = scratch
        # (F, 4, 12) rows of each frame, with their velocities and accelerations behind them
        self._motion = np.zeros((frames, 4, 12))
        self._motion[:, 3, 3] = 1.0
        self._placements = self._motion[..., :3]
        self._all_rows = self._motion.reshape(-1, 12)  # (4 F, 12)
        # in `row_factors` of unit vectors: entry k of each of the vectors is the selector's column k
        units = np.repeat(np.eye(4 * frames).reshape(-1, frames, 4, 1), 3, axis=3)
        a, b = row_factors(rows, units)  # (4 F, m, 3) each
        # the arm p of a force at the second frame's origin, which has the moment p x a; a couple is b x a
        arms = np.where(rows.rotation, b[..., 0], np.eye(4 * frames)[:, rows.vectors[3]])
        self._selector = np.concatenate([a[..., 0], b[..., 0], arms], axis=1).T  # (3 m, 4 F) of a, b, arms
        self._force_weight = rows.force_weight[:, None]
        self._moment_weight = rows.derivative_weight[:, None]
        self._signs = rows.joint_signs(scratch.carried)  # (m, nv)
        self._wrench = np.empty((count, 6))  # of each row of the Jacobian
        self.table = np.empty((count, robot.nv + 1))
        self.jacobian = self.table[:, : robot.nv]
        self.residual = self.table[:, robot.nv]  # [m, rad]
        self._no_acceleration = np.zeros(robot.nv)

    def evaluate_residual(self, q: Array) -> None:
        """Compute the residual (m,) at q (nq,)."""
        pin.framesForwardKinematics(self.model, self.scratch.data, q)
        self._update_frames()
        self._update_residual(q)

    def evaluate_pose(self, q: Array) -> None:
        """Compute residual (m,) and Jacobian (m, nv) at q (nq,).

        Each row of the Jacobian is a wrench times the screws of the joints: a force along a at the second
        frame's origin, or for a rotation the couple b x a.
        """
        wrench = self._wrench
        pin.computeJointJacobians(self.model, self.scratch.data, q)
        pin.updateFramePlacements(self.model, self.scratch.data)
        self._update_frames()
        a, arms = self._update_residual(q)  # (m, 3) each
        np.multiply(self._force_weight, a, out=wrench[:, :3])
        np.multiply(self._moment_weight, cross(arms, a), out=wrench[:, 3:])
        np.matmul(wrench, self.scratch.screws.T, out=self.jacobian)
        # 1 for joints that carry only the second frame, -1 for those that carry only the first, else 0
        self.jacobian *= self._signs
        if self.rows.has_couplings:
            self.jacobian += coupling_jacobian(self.rows, q[None], self.robot.nv)[0]

    def evaluate_motion(self, q: Array, v: Array) -> None:
        """Compute placements and velocities of frames at q (nq,) for joint rates v (nv,).

        Axes have c' = w x c, origins c' = u + w x c, with the twist (u, w) of the frame's body. With rows,
        (c', 0) = (c, 1) [[w x transposed, 0], [u, 0]].
        """
        scratch = self.scratch
        pin.computeForwardKinematicsDerivatives(self.model, scratch.data, q, v, self._no_acceleration)
        pin.updateFramePlacements(self.model, scratch.data)
        self._update_frames()
        # (2, F, 6) rates of the twists of the frames' bodies without joint accelerations, and the twists
        twists = np.array([scratch.accelerations, scratch.velocities]).take(scratch.bodies, axis=1)
        self._twists = (twists.swapaxes(0, 1) @ TWIST_ROWS).reshape(-1, 8, 4)
        self._motion[..., 4:8] = self._motion[..., :4] @ self._twists[:, 4:]

    def drift(self, q: Array, v: Array) -> Array:
        """Compute the drift dJ/dt v (m,) of the loop equations at the q, v of `evaluate_motion`.

        With the matrix V of a twist, (c, 1)' = (c, 1) V and (c, 1)" = (c, 1) V' + (c, 1)' V.
        """
        self._motion[..., 8:] = self._motion[..., :8] @ self._twists
        factors = self._selector @ self._all_rows  # (3 m, 12)
        a, b, _arms = factors.reshape(3, -1, 3, 4)  # (m, 3, 4) vectors with two derivatives
        # (a . b)" = a . b" + 2 a' . b' + a" . b
        drift: Array = np.vecdot(a, b[:, ::-1]) @ SECOND_DERIVATIVE * self.rows.weight
        if self.rows.has_couplings:
            drift[self.rows.coupled] = coupling_drift(self.rows, q[None], v[None])[0]
        return drift

    def frame_stack(self, q: Array) -> FrameStack:
        """Return the frames of the last `evaluate_pose` or `evaluate_motion` at q (nq,), T = 1."""
        return FrameStack(self._placements[None], self.scratch.screws[None], self.scratch.carried, q[None])

    def platform_motion(self) -> tuple[Array, Array]:
        """Return position and velocity (3,) of the platform's origin at the last `evaluate_motion`."""
        origin = self._motion[0, 3]
        return origin[:3], origin[4:7]

    def _update_frames(self) -> None:
        """Copy axes and origins of the frames from pinocchio."""
        placements = self.scratch.placements.reshape(-1, 4, 3)
        self._placements[:] = placements.take(self.scratch.frames, axis=0)

    def _update_residual(self, q: Array) -> tuple[Array, Array]:
        """Update the residual at q (nq,) from the frames; return vectors a and arms (m, 3).

        The residual of a loop equation is weight a . b - constant.
        """
        rows = self.rows
        factors = self._selector @ self._all_rows[:, :4]  # (3 m, 4)
        a, b, arms = factors.reshape(3, -1, 4)[..., :3]  # (m, 3) each
        np.vecdot(a, b, out=self.residual)
        if not rows.only_translations:  # translations have the weight 1 and the constant 0
            self.residual *= rows.weight
            self.residual -= rows.constant
        if rows.has_couplings:
            self.residual[rows.coupled] = coupling_derivatives(rows, q[None], 0)[0]
        return a, arms
