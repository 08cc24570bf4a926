"""Search for the pose nearest to platform coordinates that may be out of reach, within the joints' ranges.

Sequential quadratic programming minimises half the squared distance, |e|^2 / 2 with e = (x - target) / scale,
over the joints. Let dx and d2x be the first and second derivatives of x along the joints, c the loop
equations with multipliers lambda, and Z a basis of the motions that keep the loops closed. A step Z z solves

    min  g . z + z' H z / 2,    g = Z' dx' e,    H = Z' (dx' dx + d2x . e - d2c . lambda) Z,

within the ranges of the joints. Two determinants, det(dx Z), zero at Type 1, and det(dq_a Z), zero at Type 2,
keep the sign that they have at the start, and at least a small share of their size at the reference. Finite
differences of gradients along Z give H. After a step Newton's method closes the loops, and holds joints that
the step has moved beyond their range at its end. A step is accepted if its correction is as small as one
branch allows and every leg stays in its working mode. A start beyond ranges is led into them first.

The search is local: no pose near the result is nearer to the target, but a pose elsewhere may be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.kinematics.assembly import MAX_ITERATIONS, MAX_NEWTON_STEP, Configuration
from framework.kinematics.continuation.predictor_corrector import is_small
from framework.kinematics.frames import difference, full_motion, integrate, integrate_columns, largest_motion
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    independent_loops_matrix,
    linearised_at,
)
from framework.kinematics.modes import keeps_sign, keeps_working_mode, passive_determinants
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import LEAST_DIVISOR, Array
from framework.numerics.ordered_sums import solve
from framework.tolerances import (
    BRANCH_CORRECTION,
    CLOSED_LOOP,
    LEAST_TYPE1_SHARE,
    LEAST_TYPE2_SHARE,
    RANK_ROUNDING,
    REACHED_PLATFORM,
)

# least sizes of the determinants of Type 1 and Type 2, over their sizes at the reference
LEAST_DETERMINANTS = np.array([LEAST_TYPE1_SHARE, LEAST_TYPE2_SHARE])
MAX_STEPS = 30  # of the search
DIFFERENCE_STEP = 1e-6  # [rad, lengths] of the joints, for differences of gradients
# share of the squared distance; the search ends if the decrease predicted for the next step is below it
LEAST_DECREASE = 1e-8
UNCONVERGED = "the search has not converged"
LEAST_DAMPING = 1e-2  # first damping after a step that does not lead nearer


@dataclass(frozen=True, eq=False)
class NearestPose(Configuration):
    """The nearest pose to a target that a local search finds, with its distance."""

    distance: float  # from the target, in `unit`
    unit: str  # m if all coordinates are translations, rad if all are turns, else robot lengths and rad
    # what keeps the pose from the target: ranges of joints, stretched legs (Type 1), motors that lose hold
    # (Type 2), or a search that has not converged; empty if the target is reached
    stops: tuple[str, ...]


def distance_unit(robot: ParallelRobot) -> tuple[float, str]:
    """Return the size of the unit of the platform's distances, and its name.

    Distances in robot lengths and radians become distances in this unit if multiplied by its size.
    """
    if robot.translations.all():
        return robot.length, "m"
    return 1.0, "robot lengths and rad" if robot.translations.any() else "rad"


class _Iterate(NamedTuple):
    """A pose with closed loops and its quadratic model [rad, robot lengths], for f moving joints."""

    q: Array  # (nq,)
    x: Array  # (n,)
    value: float  # |e|^2 / 2
    basis: Array  # Z (f, n)
    gradient: Array  # g (n,)
    hessian: Array  # H (n, n), made definite
    # (2 f + 2,) distances from the bounds, not negative inside: of f joints from the lower ends of their
    # ranges, then from the upper ends; of both determinants, over their sizes at the reference, from their
    # least values
    margins: Array
    margin_slopes: Array  # (2 f + 2, n) derivatives of `margins` along Z
    loops: LinearisedLoops  # at q, T = 1


class _Step(NamedTuple):
    """A step of the search."""

    z: Array  # (n,) amplitudes of the motions Z
    decrease: float  # of the value, predicted by the quadratic model
    forces: Array  # (2 f + 2,) multipliers of the bounds; zero for inactive ones


class PoseSearch:
    """The search for nearest poses of one robot."""

    def __init__(self, robot: ParallelRobot, *, motors_hold: bool = False) -> None:
        """Prepare the search for poses of a robot.

        Args:
            motors_hold: whether Type 2 singularities stop the search, because only motors move the robot.

        Raises:
            InvalidInput: the platform does not determine the joints.
        """
        require_square(robot)
        self.robot, self._motors_hold = robot, motors_hold
        # (f,) units of the moving joints, by which they become dimensionless: [m] of slides, 1 of turns
        self._units = robot.column_scale[robot.moving]
        self._row_sizes = robot.equation_sizes[robot.n :]  # (m,) by which the loop equations do
        self._unit_size, self._unit = distance_unit(robot)
        self._lower, self._upper = robot.joint_ranges[:, robot.moving] / self._units
        self._determinant_sizes = np.ones(2)  # until the determinants at the reference are known
        reference = robot.reference
        iterate = self._evaluate(reference.q, reference.x, reference.x)
        # with sizes of 1 a margin is the determinant less its least value
        self._determinant_sizes = iterate.margins[-2:] + LEAST_DETERMINANTS

    def find(self, q: Array, x: Array, target: Array, *, earlier: Sequence[NearestPose] = ()) -> NearestPose:
        """Find the nearest pose to a target (n,), starting from the pose q (nq,) at x (n,).

        Args:
            earlier: results of searches from other starts. The search ends early if it is unlikely to find a
                nearer pose, or if it arrives at one of these poses.
        """
        inside = self.enter_ranges(q)
        iterate = self._evaluate(q if inside is None else inside, x, target)
        least = min((pose.distance for pose in earlier), default=np.inf)
        least_value = 0.5 * (least / self._unit_size) ** 2
        ends = np.array([pose.q for pose in earlier if UNCONVERGED not in pose.stops]).reshape(-1, len(q))
        # least decrease by the next step, over the excess of |e|^2 / 2 over that of the best other search
        least_progress = 0.1

        damping = 0.0  # of Levenberg and Marquardt
        for count in range(MAX_STEPS + 1):
            step = self._bounded_step(iterate, damping)
            is_reached = iterate.value < 0.5 * REACHED_PLATFORM**2
            is_flat = step.decrease < LEAST_DECREASE * iterate.value
            is_behind = step.decrease < least_progress * (iterate.value - least_value)
            distances = largest_motion(self.robot, difference(self.robot, iterate.q, ends))  # (k,)
            is_on_their_branch = distances.min(initial=np.inf) < BRANCH_CORRECTION
            repeats = is_on_their_branch and iterate.value > least_value
            if count == MAX_STEPS or is_reached or is_flat or is_behind or repeats:
                break

            next_iterate = self._follow(iterate, step, target)
            if next_iterate is not None and next_iterate.value < iterate.value:
                iterate = next_iterate
                damping = damping / 4.0 if damping > LEAST_DAMPING else 0.0  # relax, at last to Newton's step
            else:  # refused, or no nearer to the target
                damping = max(4.0 * damping, LEAST_DAMPING)
        return self._result(iterate, step, count)

    def enter_ranges(self, q: Array) -> Array | None:
        """Lead the joints of a pose q (nq,) into their ranges; None if a singularity stops them.

        The ranges are widened until they contain q. Then they shrink to their true size, and the pose follows
        on its branch, as long as each step is longer than `least_step` of the way.
        """
        least_step = 1e-4
        beyond = np.maximum(-self._range_margins(q), 0.0)  # (2 f,) by which the ranges are widened
        share, step = float(beyond.any()), 1.0  # of `beyond`
        loops = linearised_at(self.robot, q[None])
        while share > 0.0:
            next_q = self._close(q, beyond * max(share - step, 0.0))
            is_near = False
            if next_q is not None:
                next_loops = linearised_at(self.robot, next_q[None])
                motion = largest_motion(self.robot, difference(self.robot, q, next_q)[None])[0]
                is_near = motion <= BRANCH_CORRECTION and self._keeps_modes(loops, next_loops)
            if is_near and next_q is not None:
                q, loops, share = next_q, next_loops, max(share - step, 0.0)
            elif (step := 0.5 * step) < least_step:
                return None
        return q

    def _keeps_modes(self, start: LinearisedLoops, end: LinearisedLoops) -> bool:
        """Return whether a step keeps its working mode and, if motors hold the robot, its assembly mode."""
        if not keeps_working_mode(self.robot, start, end)[0]:
            return False
        determinants = map(passive_determinants, (start, end))
        return not self._motors_hold or bool(keeps_sign(*determinants)[0])

    def _result(self, iterate: _Iterate, step: _Step, count: int) -> NearestPose:
        """Return the pose after `count` steps, with its stops by the forces of the next `step`."""
        distance = float(np.sqrt(2.0 * iterate.value))
        names = map(self.robot.coordinates.name_of, self.robot.moving)
        ranges = [f"{name} ends its range" for name in names]
        # in the order of `_Iterate.margins`: lower ends, upper ends, determinants
        bounds = [*ranges, *ranges, "a leg is stretched or folded (Type 1)", "the motors lose hold (Type 2)"]
        rounding = np.append(np.full(2 * len(ranges), REACHED_PLATFORM), LEAST_DETERMINANTS)
        # a bound stops the search if no margin is left; after convergence all bounds with a force do
        is_met = (iterate.margins < rounding) | (step.decrease < LEAST_DECREASE * iterate.value)
        active = np.flatnonzero(is_met & (step.forces > 0.0))
        stops = [bounds[k] for k in active] or [UNCONVERGED]
        return NearestPose(
            q=iterate.q,
            x=iterate.x,
            residual=float(iterate.loops.gap[0]),
            iterations=count,
            distance=distance * self._unit_size,
            unit=self._unit,
            stops=() if distance <= REACHED_PLATFORM else tuple(stops),
        )

    def _bounded_step(self, iterate: _Iterate, damping: float) -> _Step:
        """Solve the quadratic program of a step from an iterate within the bounds.

        `damping` is that of Levenberg and Marquardt. Let H + damping I = R' R, w = R'^-1 g and y = R z + w.
        The program minimises |y| subject to G y >= G w - margins, with G the slopes of the margins along y.
        Lawson and Hanson (1974, chapter 23) solve this least-distance problem by nonnegative least squares:
        y = -r / r_0 with the residual (r, r_0) of [G' ; (G w - margins)'] multipliers = [0 ; 1].
        """
        from scipy.optimize import nnls

        g, H = iterate.gradient, iterate.hessian
        # bounds that a step can reach; the others would only slow down the solver. The factor 2 is for
        # safety: the largest joint motion is limited, but |z| may be longer
        in_reach = np.linalg.norm(iterate.margin_slopes, axis=1) * 2.0 * MAX_NEWTON_STEP > iterate.margins
        inverse = np.linalg.inv(np.linalg.cholesky(H + damping * np.eye(len(g)))).T  # R^-1
        w = inverse.T @ g
        G = iterate.margin_slopes[in_reach] @ inverse  # slopes along y

        # the least distance by nonnegative least squares
        matrix = np.vstack([G.T, G @ w - iterate.margins[in_reach]])
        right = np.append(np.zeros(len(g)), 1.0)
        multipliers = nnls(matrix, right)[0] if in_reach.any() else np.zeros(0)
        residual = matrix @ multipliers - right  # (r, r_0)
        y = -residual[:-1] / residual[-1]

        # back to amplitudes z, scaled down to the largest step
        z = inverse @ (y - w)
        z *= min(1.0, MAX_NEWTON_STEP / max(np.abs(iterate.basis @ z).max(), LEAST_DIVISOR))
        forces = np.zeros(len(in_reach))
        forces[in_reach] = multipliers
        return _Step(z, decrease=float(-g @ z - 0.5 * z @ H @ z), forces=forces)

    def _follow(self, iterate: _Iterate, step: _Step, target: Array) -> _Iterate | None:
        """Return the iterate after a step towards the target (n,); None if the step is refused.

        A step is refused if its loops do not close, or if it leads to another branch or mode.
        """
        motion = full_motion(self.robot, self.robot.moving, iterate.basis @ step.z * self._units)
        predicted = integrate(self.robot, iterate.q, motion)
        q = self._close(predicted)
        if q is None:
            return None

        correction = difference(self.robot, predicted, q)
        largest = largest_motion(self.robot, np.array([correction, motion]))  # (2,)
        corrected, advance = largest[:, None]  # (1,) each, as `is_small` takes stacks
        if not is_small(corrected, advance)[0]:
            return None

        lower_forces, upper_forces = step.forces[:-2].reshape(2, -1)  # (f,) from the ends of the ranges
        next_iterate = self._evaluate(q, iterate.x, target, upper_forces - lower_forces)
        # the determinants may fall to half their least values, and no lower unless they were lower before
        least_margins = np.minimum(iterate.margins[-2:], -0.5 * LEAST_DETERMINANTS)
        if (next_iterate.margins[-2:] < least_margins).any():
            return None
        return next_iterate if self._keeps_modes(iterate.loops, next_iterate.loops) else None

    def _close(self, q: Array, widening: Array | float = 0.0) -> Array | None:
        """Close the loops near q (nq,) by Newton steps of least norm; None without success.

        An additional equation holds a joint that has left its range at the end of the range. The ranges are
        widened by `widening` (2 f,).
        """
        identity = np.eye(len(self._units))
        margin_slopes = np.vstack([identity, -identity])  # (2 f, f) derivatives of margins along the joints
        is_beyond = np.zeros(2 * len(identity), dtype=bool)  # whether a joint has passed an end of its range
        for _ in range(MAX_ITERATIONS):
            linearised = linearised_at(self.robot, q[None])
            residual = linearised.residual[0, self.robot.n :] / self._row_sizes  # (m,)
            margins = self._range_margins(q) + widening
            is_beyond |= margins < 0.0
            gap = np.append(residual, margins[is_beyond])
            K = np.vstack([self._loop_slopes(linearised)[0], margin_slopes[is_beyond]])  # of the gap
            if np.abs(gap).max(initial=0.0) < CLOSED_LOOP:
                return q
            # the small multiple of the identity allows dependent rows
            step = -K.T @ np.linalg.solve(K @ K.T + CLOSED_LOOP * np.eye(len(K)), gap)
            if not np.abs(step).max() < MAX_NEWTON_STEP:
                return None
            q = integrate_columns(self.robot, q, self.robot.moving, step * self._units)
        return None

    def _range_margins(self, q: Array) -> Array:
        """Compute the distances (2 f,) of joints at q (nq,) from the lower, then the upper ends of ranges."""
        position = difference(self.robot, self.robot.neutral, q)[self.robot.moving] / self._units
        return np.append(position - self._lower, self._upper - position)

    def _loop_slopes(self, linearised: LinearisedLoops) -> Array:
        """Compute the derivatives (T, m, f) of the dimensionless loop equations along the joints."""
        return independent_loops_matrix(self.robot, linearised)[..., self.robot.moving]

    def _evaluate(self, q: Array, near: Array, target: Array, range_forces: Array | float = 0.0) -> _Iterate:
        """Compute the quadratic model of |e|^2 / 2 at a pose q (nq,) with closed loops.

        e (n,) is the error of x over its scale. The columns of Z (f, n) are the motions of the f moving
        joints that the m linearised loops allow. The Hessian needs derivatives of x and of the loops also at
        the poses one `DIFFERENCE_STEP` away along each motion of Z; with q these are T = 1 + n poses.

        Args:
            near: (n,) platform coordinates; angles of x are taken within half a turn of them.
            target: (n,) platform coordinates to reach.
            range_forces: (f,) forces of joints at the ends of their ranges in the last step. They affect the
                multipliers of the loops.
        """
        J = self._loop_slopes(linearised_at(self.robot, q[None]))[0]  # (m, f)
        Q, R = np.linalg.qr(J.T, mode="complete")
        Z = Q[:, len(J) :]  # (f, n) the null space of J
        steps = DIFFERENCE_STEP * np.vstack([np.zeros(len(Z)), Z.T]) * self._units  # (T, f)
        poses = integrate_columns(self.robot, q, self.robot.moving, steps)  # (T, nq), q first
        linearised = linearised_at(self.robot, poses)
        dc = self._loop_slopes(linearised)  # (T, m, f)
        platform = self.robot.platform
        x = platform.unwrap(platform.coordinates(linearised.frames), near)  # (T, n)
        twists = linearised.platform[..., self.robot.moving] * self._units  # (T, n, f)
        dx = solve(platform.rate_matrix(x) * self.robot.platform_scale, twists)  # of x / scale, v = E dx
        e = (x[0] - target) / self.robot.platform_scale

        # the multipliers lambda (m,) that balance the gradient of the error best: the solution of
        # J' lambda = gradient by least squares, with J' = Q R
        multipliers = np.linalg.solve(R[: len(J)], Q[:, : len(J)].T @ (e @ dx[0] + range_forces))
        gradients = e @ dx - multipliers @ dc  # (1 + n, f) of the Lagrangian
        curvature = (gradients[1:] - gradients[0]) @ Z / DIFFERENCE_STEP  # (n, n), without dx' dx

        dx_along_Z = dx[0] @ Z  # (n, n)
        margins, margin_slopes = self._linearise_margins(q, dx, dc, Z)
        # the Hessian (n, n) is made definite: its eigenvalues become their sizes, at least RANK_ROUNDING
        values, vectors = np.linalg.eigh(dx_along_Z.T @ dx_along_Z + 0.5 * (curvature + curvature.T))
        return _Iterate(
            q=q,
            x=x[0],
            value=float(0.5 * e @ e),
            basis=Z,
            gradient=dx_along_Z.T @ e,
            # differences leave the curvature slightly asymmetric
            hessian=(vectors * np.maximum(np.abs(values), RANK_ROUNDING)) @ vectors.T,
            margins=margins,
            margin_slopes=margin_slopes,
            loops=linearised.select(0),
        )

    def _linearise_margins(self, q: Array, dx: Array, dc: Array, Z: Array) -> tuple[Array, Array]:
        """Compute `margins` (2 f + 2,) and `margin_slopes` (2 f + 2, n) of an `_Iterate`.

        Each of the f moving joints has a margin to the lower and one to the upper end of its range; along the
        n columns of Z (f, n) they have the slopes Z and -Z. Finite differences along Z give the slopes of the
        two determinants.

        Args:
            dx: (T, n, f) derivatives of x at q and at the poses one step away along each motion of Z.
            dc: (T, m, f) derivatives of the loops at the same poses.
        """
        # Determinants (T, 2) of dx and of dq_a along the motions that the loops allow, in bases with the
        # orientation of Z. The first is 0 at Type 1, and keeps its sign where the loops lose rank; the second
        # is 0 at Type 2, and 1 if Type 2 does not matter.
        Q, _ = np.linalg.qr(dc.swapaxes(1, 2), mode="complete")  # Q (T, f, f)
        bases = Q[..., dc.shape[1] :]  # (T, f, n) orthogonal to the loops' derivatives
        orientations = np.sign(np.linalg.det(Z.T @ bases))  # (T,)
        bases[..., 0] *= orientations[:, None]
        values = np.ones((len(dx), 2))
        values[:, 0] = np.linalg.det(dx @ bases)
        if self._motors_hold and self.robot.n_a == self.robot.n:
            values[:, 1] = np.linalg.det(bases[:, : self.robot.n])  # the motors are the first rows
        determinants = values / self._determinant_sizes  # (T, 2), at q first
        determinants *= np.where(determinants[0] < 0.0, -1.0, 1.0)  # the sign depends on the basis Z
        slopes = (determinants[1:] - determinants[0]).T / DIFFERENCE_STEP  # (2, n)
        margins = np.append(self._range_margins(q), determinants[0] - LEAST_DETERMINANTS)
        return margins, np.vstack([Z, -Z, slopes])
