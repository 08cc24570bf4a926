"""The pose and the motor torques of a rigid robot once a millisecond, from its encoders.

    cycle = ControlCycle(robot)
    cycle.update(q_a, dq_a)                     # joint side of the gears
    torque = cycle.torque(ddq_a)                # motor side

A cycle predicts the pose from the tangents T = dq/dq_a of the last three cycles, by the formula of Adams and
Bashforth. Newton's method then closes the loops with the passive joints, P dq_p = -residual. Its first step
takes P^-1 of the last cycle, which leaves so little that at the usual speeds of motors one linearisation is
enough. With the joint accelerations a_0 at ddq_a = 0,

    torque = mass ddq_a + bias,     mass = T' (M + rotors) T / n,     bias = T' (RNEA(q, v, a_0) + ...) / n,

where T' eliminates the loop forces, and damping and joint springs are added to RNEA. A step is accepted by
the criteria of `predictor_corrector`. If a step is refused, `forward_kinematics` follows the motors in short
steps, or reports the singularity at which the assembly mode ends.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from framework.dynamics.forces import all_spring_forces, damping_forces, mass_matrices
from framework.dynamics.pointwise_dynamics import type2_pose
from framework.errors import finite_numbers
from framework.kinematics.assembly import Configuration
from framework.kinematics.attitude import RotationVector
from framework.kinematics.closures import row_factors
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
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.platform import FramePlatform, JointPlatform
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.ordered_sums import cross, singular_values
from framework.tolerances import BRANCHES_MEET, DETERMINANT_LOST

# [rad, robot lengths]: the last Newton step is smaller. It is the error of the rates, since T is computed
# before the step; the error of the pose is its square
LAST_STEP = 1e-10
# of an angular velocity w (3,): w @ CROSS_ROWS is the transposed matrix (9,) of w x, by rows
CROSS_ROWS = np.array(
    [[0, 0, 0, 0, 0, 1, 0, -1, 0], [0, 0, -1, 0, 0, 0, 1, 0, 0], [0, 1, 0, -1, 0, 0, 0, 0, 0]], dtype=float
)
SECOND_DERIVATIVE = np.array([1.0, 2.0, 1.0])  # of a product, by the rule of Leibniz


class ControlCycle:
    """The state and the dynamics of a robot along its motors, updated once a cycle.

    The cycle starts at an assembled configuration, the reference by default. It stays in its assembly mode or
    raises an error. Springs keep the deflections of the start, as in `forward_kinematics`. The next `update`
    overwrites all arrays. One object serves one thread.

    q, v: all joints (nq,) and their rates (nv,).
    x, dx: platform coordinates (n,), continuous over full turns from the start, and their rates.
    T: joint rates (nv, n_a) for unit rates of the motors' joints.
    """

    def __init__(self, robot: ParallelRobot, *, near: ArrayLike | Configuration | None = None) -> None:
        """Start the cycle of a robot at the pose `near`.

        Raises:
            InvalidInput: motors depend on one another; the platform does not determine the joints; damping or
                armature of balls drives an idle turn; `near` is not assembled.
            SingularPose: the start is at a Type 2 singularity.
        """
        expect_robot(robot)
        require_square(robot)
        check_motors_are_free(robot)
        require_turns_at_rest(robot)
        start = start_pose(robot, near)
        self.robot = robot
        self._equations = SinglePose(robot)
        self._data = robot.model.createData()
        self._has_springs = bool(robot.joint_stiffness.any() or robot.line_springs.names)
        self._names = ", ".join(robot.actuator_names)
        # computed once, not in every cycle
        self._actuated, self._following = robot.actuated, robot.following
        # independent loop equations, None for all; all rows are combined if `_bases`
        independent = robot.structure.independent
        self._independent = None if len(independent) == len(robot.rows.names) else independent
        self._has_no_balls = robot.model.nq == robot.model.nv  # then q + step is the next configuration
        # scales that make P, its unknowns and its right-hand sides dimensionless
        self._scale = robot.passive_scale  # (n_p, n_p) of the entries of P, for n_p passive joints
        self._passive_lengths = robot.column_scale[robot.following]  # (n_p,) of the unknowns
        row_sizes = robot.loop_lengths * robot.structure.row_sizes
        self._solver_scale = -self._passive_lengths[:, None] / row_sizes  # of -P^-1, back to units
        # columns of `SinglePose.table`: the residual, then the actuated joints
        self._right_sides = np.append(robot.nv, robot.actuated)
        self._identity = np.eye(len(robot.following))
        self._bases: Array | None = None  # (1, R, m) of the range of the loops' Jacobian, along the motion
        if robot.structure.varies:
            self._span_sizes = robot.equations.span_scale[:, None]
            combination = linearised_at(robot, start.q[None]).combination  # (1, R, m)
            self._bases = None if combination is None else combination * self._span_sizes

        self.q = start.q.copy()
        self.x = start.x.copy()
        self.T = np.zeros((robot.nv, robot.n_a))
        self.T[robot.actuated] = np.eye(robot.n_a)
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
            self._former_tangents = (self.T.copy(),) * 2
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
        robot = self.robot
        acceleration = finite_numbers(f"ddq_a ({self._names})", ddq_a, robot.n_a)
        a = self._drift_acceleration() + self.T @ acceleration
        return self._motor_torque(a) + robot.rotor_inertia * robot.gear_ratio * acceleration

    @property
    def residual(self) -> float:
        """Largest residual of all loop equations at q, redundant ones included [m or rad]."""
        return float(np.abs(self._equations.residual_of_frames(self.q)).max(initial=0.0))

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
        norm = float(np.abs(self._inverse).sum(axis=0).max(initial=0.0))
        return 1.0 / norm if norm else np.inf

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
        """Compute P^-1, T and the Newton step (n_p,) at q (nq,); return the size of the step.

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
        table = self._select_rows(equations.table)  # (n_p, nv + 1)
        self._P = table.take(self._following, axis=1) * self._scale  # dimensionless
        try:
            self._inverse = np.asarray(np.linalg.inv(self._P), dtype=float)
        except np.linalg.LinAlgError:
            self._inverse = np.full_like(self._P, np.inf)  # so that `type2` is 0
            return np.inf
        self._solver = self._inverse * self._solver_scale
        solution = self._solver @ table.take(self._right_sides, axis=1)  # (n_p, 1 + n_a) dq_p, T_p
        self._step = solution[:, 0]
        self.T[self._following] = solution[:, 1:]
        return float(np.abs(self._step / self._passive_lengths).max(initial=0.0))

    def _select_rows(self, values: Array) -> Array:
        """Return values (m, ...) of the independent equations, or of the combinations by the bases."""
        if self._bases is None:
            return values if self._independent is None else values.take(self._independent, axis=0)
        return (self._bases[0] / self._span_sizes).T @ values

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
        last_P, last_inverse = self._P, self._inverse
        robot = self.robot
        former, last, T = *self._former_tangents, self.T.copy()  # of the last three cycles
        motor_step = target - self._motors  # (n_a,)
        tangent_step = T @ motor_step
        # T + (T - last) / 2 + 5/12 (T - 2 last + former), the mean tangent of equal steps to third order
        prediction = (23.0 * T - 16.0 * last + 5.0 * former) @ motor_step / 12.0
        q = self._integrate(self.q, prediction)
        if self._has_no_balls:
            q[self._actuated] = target  # exactly, without the rounding of the sum

        # correct with P^-1 of the last cycle, then by Newton steps, each smaller than the one before it
        self._equations.evaluate_residual(q)
        correction = np.zeros(robot.nv)  # sum of all steps
        correction[self._following] = self._solver @ self._select_rows(self._equations.residual)
        q = self._integrate(q, correction)
        previous_size = MAX_PREDICTOR_MOVE
        for _ in range(max_iterations):
            size = self._linearise(q)
            if not size < previous_size:  # Newton's method diverges, or P is singular
                return None
            if size > 0.0:
                step = np.zeros(robot.nv)
                step[self._following] = self._step  # set by `_linearise`
                q = self._integrate(q, step)
                correction += step
                previous_size = size
            if size < LAST_STEP:
                break
        else:  # too many iterations
            return None

        # judge the step along the last tangent by the largest motion of a joint [rad, robot lengths]
        motions = [correction + prediction - tangent_step, tangent_step, self.T @ motor_step - tangent_step]
        largest = np.abs(np.array(motions) / robot.column_scale).max(axis=1)
        corrected, predicted, tangent_change = largest.tolist()
        is_accepted = (
            is_small(corrected, predicted)
            and is_straight(tangent_change, corrected, predicted)
            and self._keeps_sign(last_P, last_inverse)
            and self.type2 > BRANCHES_MEET
        )
        if not is_accepted:
            return None
        self._former_tangents = (last, T)
        return q

    def _keeps_sign(self, last_P: Array, last_inverse: Array) -> bool:
        """Return whether det P has kept its sign since the last P (n_p, n_p), of this inverse."""
        ratio = last_inverse @ self._P  # its determinant is det P over the last one
        change = np.abs(ratio - self._identity).sum(axis=0).max(initial=0.0)
        if change < 0.5:  # then no eigenvalue of the ratio is below 1/2
            return True
        last_determinant = np.linalg.det(last_P)
        # a determinant far below the last one is rounding, so its sign says nothing
        return bool(np.linalg.det(self._P) * last_determinant > DETERMINANT_LOST * last_determinant**2)

    def _integrate(self, q: Array, step: Array) -> Array:
        """Return the configuration (nq,) after a step (nv,) from q."""
        return q + step if self._has_no_balls else pin.integrate(self.robot.model, q, step)

    def _rest_at(self, q: Array) -> None:
        """Set the state of rest at q (nq,)."""
        self._motors = self.robot.actuated_coordinates(q[None])[0].copy()
        self._former_tangents = (self.T.copy(),) * 2  # T of the last but one and of the last cycle
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
        linear, w = self._equations.platform_twist()  # velocity and angular velocity, (3,) each
        attitude = platform.attitude
        position = self._equations.platform_origin
        if platform.is_point:  # its coordinates are positions along base axes
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
            dx[platform.turning] = attitude.couples(frames.platform_rotation).reshape(-1, 3) @ w
        return x, dx

    def _drift_acceleration(self) -> Array:
        """Compute joint accelerations a_0 (nv,) at zero motor accelerations.

        With the drift dJ/dt v of the loops, the accelerations a_p of passive joints solve P a_p = -drift.
        """
        if self._drift is None:
            self._drift = np.zeros(len(self.v))
            loop_drift = self._select_rows(self._equations.drift(self.q, self.v))
            self._drift[self._following] = self._solver @ loop_drift
        return self._drift

    def _motor_torque(self, a: Array) -> Array:
        """Compute motor torques (n_a,) [N m, N] for joint accelerations a (nv,), rotors left out.

        The generalised forces of the open tree are projected by T', which eliminates the loop forces.
        """
        robot = self.robot
        force = pin.rnea(robot.model, self._data, self.q, self.v, a)
        if robot.is_damped:
            force = force + damping_forces(robot, self.q[None], self.v[None])[0]
        if self._has_springs:
            force = force + all_spring_forces(robot, self.q[None], robot.joint_stiffness)[0]
        return force @ self.T / robot.gear_ratio


class SinglePose:
    """Loop equations, Jacobian and drift of one configuration at a time, in few calls of numpy.

    The equations are those of `closures`, which works on stacks. For a single configuration its calls on a
    dozen small arrays take longer than pinocchio. Here the arrays are allocated once and overwritten by each
    evaluation. So one object serves one thread.
    """

    def __init__(self, robot: ParallelRobot) -> None:
        """Allocate the memory of one pose: its frames, m loop equations and their Jacobian (m, nv)."""
        rows = robot.spanning_loops if robot.structure.varies else robot.rows
        scratch = Scratch.of(robot.model, robot.frames)
        count = len(rows.names)
        self.robot = robot
        self.rows = rows
        self.scratch = scratch
        # three axes and the origin of each frame, their velocities and their accelerations
        self._rates = np.empty((3, len(scratch.frames), 4, 3))
        self._placements = self._rates[0]
        self._is_rotation = rows.rotation[:, None]
        self._weight = rows.derivative_weight[:, None]
        self._signs = rows.joint_signs(scratch.carried)  # (m, nv)
        self._wrench = np.empty((count, 6))  # of each row of the Jacobian
        self.table = np.empty((count, robot.nv + 1))
        self.jacobian = self.table[:, : robot.nv]  # of all loop equations
        self.residual = self.table[:, robot.nv]  # [m, rad]
        self._no_acceleration = np.zeros(robot.nv)

    def evaluate_residual(self, q: Array) -> None:
        """Compute the residual (m,) of all loop equations at q (nq,)."""
        pin.framesForwardKinematics(self.robot.model, self.scratch.data, q)
        self._update_residual(q)

    def evaluate_pose(self, q: Array) -> None:
        """Compute residual (m,) and Jacobian (m, nv) of all loop equations at q (nq,).

        Each row of the Jacobian is a wrench times the screws of the joints: a force a at the second frame's
        origin, or for a rotation the couple b x a, with a and b of `_update_residual`.
        """
        scratch = self.scratch
        rows = self.rows
        wrench = self._wrench
        pin.computeJointJacobians(self.robot.model, scratch.data, q)
        pin.updateFramePlacements(self.robot.model, scratch.data)
        force, second = self._update_residual(q)  # a and b
        # origins (m, 3) of the second frames: `vectors` are indices into all axes and origins of the frames
        lever = self._placements.reshape(-1, 3).take(rows.vectors[3], axis=0)
        if rows.only_translations:
            wrench[:, :3] = force
        else:
            force = self._weight * force
            lever = np.where(self._is_rotation, second, lever)
            wrench[:, :3] = np.where(self._is_rotation, 0.0, force)
        wrench[:, 3:] = cross(lever, force)
        np.matmul(wrench, scratch.screws.T, out=self.jacobian)
        # 1 for joints that carry only the second frame, -1 for those that carry only the first, else 0
        self.jacobian *= self._signs
        if rows.has_couplings:
            self.jacobian += coupling_jacobian(rows, q[None], self.robot.nv)[0]

    def evaluate_motion(self, q: Array, v: Array) -> None:
        """Compute frames and twists of bodies at q (nq,) for joint rates v (nv,).

        The twists are stored in `scratch`, together with their rates at zero joint accelerations, from which
        `drift` is computed.
        """
        scratch = self.scratch
        pin.computeForwardKinematicsDerivatives(self.robot.model, scratch.data, q, v, self._no_acceleration)
        pin.updateFramePlacements(self.robot.model, scratch.data)
        self._update_frames()

    def drift(self, q: Array, v: Array) -> Array:
        """Compute the drift dJ/dt v (m,) of the loop equations at the q, v of `evaluate_motion`.

        Axes and origins c of the frames have c' = w x c and c" = dw/dt x c + w x c'; origins also the linear
        parts of the twists. Vectors are rows here: w x c is c times the transposed matrix of w x.
        """
        scratch = self.scratch
        # (2, F, 6) twists of the frames' bodies, and their rates
        twists = np.array([scratch.velocities, scratch.accelerations]).take(scratch.bodies, axis=1)
        turns = (twists[..., 3:] @ CROSS_ROWS).reshape(2, -1, 3, 3)  # transposed matrices of w x and dw/dt x
        np.matmul(self._placements, turns, out=self._rates[1:])
        self._rates[1:, :, 3] += twists[..., :3]
        self._rates[2] += self._rates[1] @ turns[0]
        a, b = row_factors(self.rows, self._rates)  # (3, m, 3) each: vectors, velocities, accelerations
        # (a . b)" = a . b" + 2 a' . b' + a" . b
        drift: Array = SECOND_DERIVATIVE @ np.vecdot(a, b[::-1]) * self.rows.weight
        if self.rows.has_couplings:
            drift[self.rows.coupled] = coupling_drift(self.rows, q[None], v[None])[0]
        return drift

    def frame_stack(self, q: Array) -> FrameStack:
        """Return the frames of the last `evaluate_pose` or `evaluate_motion` at q (nq,), T = 1."""
        return FrameStack(self._placements[None], self.scratch.screws[None], self.scratch.carried, q[None])

    def platform_twist(self) -> tuple[Array, Array]:
        """Return velocity and angular velocity (3,) of the platform's frame at the last `evaluate_motion`.

        Pinocchio has the twist of the platform's body at the base's origin: velocity, then angular velocity.
        """
        twist = self.scratch.velocities[self.scratch.bodies[0]]
        return twist[:3] + cross(twist[3:], self.platform_origin), twist[3:]

    @property
    def platform_origin(self) -> Array:
        """The origin (3,) of the platform's frame at the last `evaluate_pose` or `evaluate_motion`."""
        return self._placements[0, 3]

    def residual_of_frames(self, q: Array) -> Array:
        """Compute the residual (m,) of all loop equations at the q (nq,) of the last evaluation."""
        self._residual_factors(q)
        return self.residual

    def _update_frames(self) -> None:
        """Copy axes and origins of the frames from pinocchio."""
        placements = self.scratch.placements.reshape(-1, 4, 3)
        placements.take(self.scratch.frames, axis=0, out=self._placements)

    def _update_residual(self, q: Array) -> tuple[Array, Array]:
        """Update frames and residual at q (nq,) from pinocchio's results; return vectors a, b (m, 3)."""
        self._update_frames()
        return self._residual_factors(q)

    def _residual_factors(self, q: Array) -> tuple[Array, Array]:
        """Update the residual at q (nq,) from the frames; return vectors a, b (m, 3).

        The residual of a loop equation is weight a . b - constant. The vectors a and b are axes of its two
        frames or the offset between their origins, see `row_factors`.
        """
        rows = self.rows
        a, b = row_factors(rows, self._placements)
        np.vecdot(a, b, out=self.residual)
        if not rows.only_translations:  # translations have the weight 1 and the constant 0
            self.residual *= rows.weight
            self.residual -= rows.constant
        if rows.has_couplings:
            self.residual[rows.coupled] = coupling_derivatives(rows, q[None], 0)[0]
        return a, b
