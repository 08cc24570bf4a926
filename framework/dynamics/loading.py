"""Equilibria of many configurations under a growing load with locked motors, by continuation.

The equilibria under a growing share of weight and wrench form a curve. The curve is followed by
pseudo-arclength continuation (Keller 1977): a predictor step along the tangent, then a correction to the
curve by Newton's method with the share among the unknowns. So curves may be flat or steep in the share.

A step is accepted if the correction is small, if the gain of the share agrees with the tangents at both ends,
and if the tangent stiffness stays positive definite. So the equilibrium reached is connected with the
unloaded configuration without a jump. Where the share turns back (a fold: snap-through) the turning point is
solved for directly. A bifurcation (buckling) is bracketed by halving the steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.dynamics.forces import all_spring_forces
from framework.dynamics.stiffness import (
    MAX_STEP,
    CompliantMotions,
    compliant_motions,
    deflects_little,
    require_springs,
)
from framework.dynamics.tangent_stiffness import (
    EquilibriumResiduals,
    Load,
    check_wrench,
    evaluate_equilibrium,
    tangent_stiffness,
)
from framework.kinematics.continuation.predictor_corrector import CurveEnds, CurveEquations, Curves
from framework.kinematics.frames import integrate_columns
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays, assign, select
from framework.numerics.ordered_sums import dot, matmul, matvec, solve
from framework.tolerances import BRANCH_STEP_SHARE, EIGENVALUE_ROUNDING, NEWTON_STEP

# Largest error of the gain in share predicted from the tangents, divided by the gain along the steeper
# tangent. Two folds of a cubic between the ends of a step leave an error of 1 / 6.
MAX_SHARE_GAP = 0.1
UNCHECKED_MOTION = 1e-7  # [rad, robot lengths] shorter steps are too short for a fold, and are not halved
MAX_STEPS = 1000  # along the curve; most robots take one, and steps of 0.1 rad soon exceed any deflection


class LoadReason(IntEnum):
    """The outcome for one configuration: the load is carried, or the reason for failure."""

    CARRIED = 0
    GIVES_WAY = 1  # snaps through or buckles: the stiffness is lost before the whole load is applied
    TOO_SOFT = 2  # deflections beyond `MAX_DEFLECTION`
    OTHER_MODE = 3  # carried, but in another assembly mode, reached through Type 2
    NOT_CONVERGED = 4


LOAD_WORDS = {
    LoadReason.CARRIED: "carries the load",
    LoadReason.GIVES_WAY: "gives way: snaps through or buckles under the load",
    LoadReason.TOO_SOFT: "deflects by more than linear springs mean",
    LoadReason.OTHER_MODE: "led through Type 2 by the load",
    LoadReason.NOT_CONVERGED: "not converged",
}


@dataclass(frozen=True, eq=False)
class LoadedStack(ReadOnlyArrays):
    """T configurations under the load, or under a share where the reason is not `CARRIED`."""

    q: Array  # (T, nq)
    reason: NDArray[np.uint8]  # (T,) `LoadReason`
    share: Array  # (T,) largest share of the load that was reached
    free: CompliantMotions  # at q, but K is the stiffness under load, not that of the springs alone


class _Points(NamedTuple):
    """T equilibria on the curve, with their tangents."""

    q: Array  # (T, nq)
    share: Array  # (T,) of the load
    rate: Array  # (T, f) derivative of the moving joints by the share [rad, lengths]


class _Prediction(NamedTuple):
    """T predictor steps along the tangents."""

    step: Array  # (T, f) [rad, lengths]
    tangent: Array  # (T, f) unit vector
    share: Array  # (T,) of the load after the step
    is_whole: BoolArray  # (T,) whether that is the whole load
    size: Array  # (T,) [rad, lengths] largest entry of the step


class _Corrected(NamedTuple):
    """T steps corrected to the curve by Newton's method."""

    points: _Points
    length: Array  # (T,) [rad, lengths] of the corrected step along the tangent
    converged: BoolArray  # (T,)
    is_stable: BoolArray  # (T,) whether the stiffness is positive definite


class _StepEnds(NamedTuple):
    """The ends of T steps along the curve."""

    points: _Points
    size: Array  # (T,) [rad, lengths] of the predicted step
    accepted: BoolArray  # (T,)
    is_unstable: BoolArray  # (T,) whether a stiffness that is not positive definite is the only fault
    has_fold: BoolArray  # (T,) whether, in addition, the share turns back within the step


def loaded_stack(robot: ParallelRobot, q: Array, *, wrench: ArrayLike | None = None) -> LoadedStack:
    """Follow equilibria under growing weight and wrench from unloaded assembled configurations q (T, nq).

    Each configuration takes steps of its own. An accepted step doubles the next one, a refused step is
    halved and tried again. A configuration is followed until it has a reason to stop, or until a refused step
    is too short to be halved.

    Args:
        wrench: external wrench (n,) [N, N m] ON the platform, on its axes; None for weight alone.

    Raises:
        InvalidInput: the robot has no springs, or the wrench has no potential.
    """
    require_springs(robot)
    load = Load(
        check_wrench(robot, wrench),
        share=np.zeros(len(q)),
        preload=all_spring_forces(robot, q, robot.all_stiffness),  # in balance without load
    )
    unloaded = evaluate_equilibrium(robot, q, load)
    rate, _ = _curve_tangents(unloaded.H, unloaded.slope_by_share, unloaded.null_space)
    current = _Points(q.copy(), load.share, rate)
    step = np.full(len(q), MAX_STEP)
    reason = np.full(len(q), LoadReason.NOT_CONVERGED, dtype=np.uint8)
    live = np.arange(len(q))  # indices of the configurations still followed
    for _ in range(MAX_STEPS):
        if not len(live):
            break
        # a step of each configuration; accepted ones move on
        start = select(current, live)
        live_load = load.select(live)
        ends = _take_steps(robot, start, live_load, step[live])
        step[live] = np.where(ends.accepted, np.minimum(2.0 * ends.size, MAX_STEP), 0.5 * ends.size)
        assign(current, live[ends.accepted], select(ends.points, ends.accepted))
        reason[live] = _stop_reasons(robot, ends)

        folding = np.flatnonzero(ends.has_fold)
        if len(folding):  # solve for the turning point of the share, where the robot snaps through
            folds = _find_folds(robot, select(start, folding), live_load.select(folding))
            rows = live[folding[folds.found]]
            current.q[rows] = folds.q[folds.found]
            current.share[rows] = folds.share[folds.found]
            reason[rows] = LoadReason.GIVES_WAY

        can_halve = ~(ends.size <= UNCHECKED_MOTION)  # also for NaN
        live = live[(ends.accepted | can_halve) & (reason[live] == LoadReason.NOT_CONVERGED)]
    return _loaded_stack(robot, q, current, reason, load)


def _stop_reasons(robot: ParallelRobot, ends: _StepEnds) -> NDArray[np.uint8]:
    """Return the reason (T,) to stop at the end of each step; NOT_CONVERGED to continue.

    If a step has several reasons, the last of those below counts.

    Args:
        ends: the ends of the steps, accepted or not.
    """
    reasons = np.full(len(ends.size), LoadReason.NOT_CONVERGED, dtype=np.uint8)
    share = ends.points.share
    reasons[ends.accepted & (share == 1.0)] = LoadReason.CARRIED
    reasons[ends.accepted & (share <= 1.0) & ~deflects_little(robot, ends.points.q)] = LoadReason.TOO_SOFT
    reasons[ends.is_unstable & (ends.size <= UNCHECKED_MOTION)] = LoadReason.GIVES_WAY
    return reasons


def _loaded_stack(
    robot: ParallelRobot, q: Array, reached: _Points, reason: NDArray[np.uint8], load: Load
) -> LoadedStack:
    """Return the stack reached from q (T, nq), with stiffness under load.

    Where the assembly mode at the end differs from that of q, `reason` (T,) is changed in place from CARRIED
    to OTHER_MODE.
    """
    end = linearised_at(robot, reached.q)
    _, start_sign = mode_signs(robot, linearised_at(robot, q))  # (T,) of the assembly mode
    _, end_sign = mode_signs(robot, end)
    is_other_mode = end_sign != start_sign
    reason[is_other_mode & (reason == LoadReason.CARRIED)] = LoadReason.OTHER_MODE
    free = compliant_motions(robot, end, reached.q)
    free = free._replace(K=tangent_stiffness(robot, end, reached.q, free.Z, load))
    return LoadedStack(reached.q, reason, reached.share, free)


def _curve_tangents(H: Array, slope_by_share: Array, null_space: Array) -> tuple[Array, BoolArray]:
    """Compute the tangents (T, f), and whether the stiffness H is positive definite (T,).

    A tangent is the derivative dq/dshare = Z dz/dshare of the moving joints, where z solves
    H dz/dshare = -slope_by_share. Eigenvalues of H below rounding are replaced by rounding, which keeps the
    tangents finite at folds.

    Args:
        H: (T, d, d) tangent stiffness along the steps Z.
        slope_by_share: (T, d) derivative by the share of the energy's slope along Z.
        null_space: (T, f, d) orthonormal steps Z that keep the loops closed.
    """
    values, vectors = np.linalg.eigh(H)  # (T, d) ascending, (T, d, d)
    rounding = EIGENVALUE_ROUNDING * np.abs(values).max(axis=1, keepdims=True, initial=0.0)
    divisors = np.where(np.abs(values) > rounding, values, rounding)
    components = matvec(vectors.swapaxes(1, 2), slope_by_share) / divisors
    z_rate = -matvec(vectors, components)  # dz/dshare
    return matvec(null_space, z_rate), (values > rounding).all(axis=1)


def _take_steps(robot: ParallelRobot, start: _Points, load: Load, step: Array) -> _StepEnds:
    """Find the equilibria one step (T,) [rad, lengths] further on the curve.

    A step ends at the whole load if that is nearer. If the corrected share exceeds 1, the next step leads
    back to 1. A step is straight, without a fold, if the gain of the share agrees with the mean of the slopes
    at both ends, times the length of the step. The slope is that of the share along the tangent.

    Args:
        start: the points at which the steps begin.
        load: the load on these configurations.
        step: largest entry of each step.
    """
    ahead = _predict_steps(start, step)
    end = _correct_steps(robot, start, ahead, load)

    # slopes (T,) of the share along the tangent at both ends, and the gain that their mean predicts
    with np.errstate(divide="ignore", invalid="ignore"):
        start_slope = 1.0 / dot(ahead.tangent, start.rate)
        end_slope = 1.0 / dot(ahead.tangent, end.points.rate)
        mean_gain = 0.5 * end.length * (start_slope + end_slope)
        largest_gain = np.abs(end.length * np.maximum(np.abs(start_slope), np.abs(end_slope)))
        gap = np.abs(end.points.share - start.share - mean_gain)
        is_straight = gap <= MAX_SHARE_GAP * largest_gain
        turns_back = start_slope * end_slope < 0.0

    # steps that reach the curve without a fold in between; the shortest ones have no room for a fold
    on_curve = end.converged & (is_straight | (ahead.size <= UNCHECKED_MOTION))
    is_unstable = on_curve & ~end.is_stable
    return _StepEnds(
        end.points,
        ahead.size,
        accepted=on_curve & end.is_stable,
        is_unstable=is_unstable,
        has_fold=is_unstable & turns_back,
    )


def _predict_steps(start: _Points, step: Array) -> _Prediction:
    """Compute steps of at most `step` (T,) [rad, lengths] from `start` along the tangents.

    A step ends at the whole load if that is nearer.
    """
    remaining = 1.0 - start.share
    size_to_end = np.abs(start.rate * remaining[:, None]).max(axis=1)  # of a step to the whole load
    fraction = np.minimum(1.0, step / np.maximum(size_to_end, step))  # of the remaining share; no 0 / 0
    motion = start.rate * (remaining * fraction)[:, None]
    length = np.linalg.norm(motion, axis=1, keepdims=True)
    tangent = motion / np.where(length > 0.0, length, 1.0)
    is_whole = fraction == 1.0
    share = np.where(is_whole, 1.0, start.share + fraction * remaining)
    return _Prediction(motion, tangent, share, is_whole, size=size_to_end * fraction)


def _correct_steps(robot: ParallelRobot, start: _Points, ahead: _Prediction, load: Load) -> _Corrected:
    """Correct predicted steps `ahead` of the points `start` to the curve by Newton's method.

    A step to the whole load is corrected at constant share. Any other step is corrected across the tangent.
    It gets one more iteration, to rounding, because the tangent of a soft robot needs this accuracy. A step
    whose corrections are large beside the step itself is given up, since it may lead to another branch.
    Each iteration changes the rows of the steps that are not yet finished in place.
    """
    max_iterations = 8
    end = _Points(_move_joints(robot, start.q, ahead.step), ahead.share, np.zeros_like(ahead.step))
    length = np.linalg.norm(ahead.step, axis=1)
    correction = np.zeros(len(length))  # largest entries of all Newton steps so far, [rad, lengths]
    was_small, converged, is_stable = np.zeros((3, len(length)), dtype=bool)
    live = np.arange(len(length))  # indices of the steps still corrected
    for _ in range(max_iterations):
        residuals = evaluate_equilibrium(
            robot, end.q[live], load.select(live)._replace(share=end.share[live])
        )
        step, gain = _newton_step(residuals, ahead.tangent[live], ahead.is_whole[live])

        size = np.abs(step).max(axis=1)
        correction[live] += size
        on_branch = correction[live] <= np.maximum(BRANCH_STEP_SHARE * ahead.size[live], UNCHECKED_MOTION)
        step = np.where(on_branch[:, None], step, 0.0)
        end.q[live] = _move_joints(robot, end.q[live], step)
        end.share[live] += np.where(on_branch, gain, 0.0)
        length[live] += dot(ahead.tangent[live], step)

        # store the steps that have converged, with their tangents
        is_small = size < NEWTON_STEP
        done = on_branch & is_small & (ahead.is_whole[live] | was_small[live])
        was_small[live] = is_small
        converged[live[done]] = True
        end.rate[live[done]], is_stable[live[done]] = _curve_tangents(
            residuals.H[done], residuals.slope_by_share[done], residuals.null_space[done]
        )
        live = live[on_branch & ~done]
        if not len(live):
            break
    return _Corrected(end, length, converged, is_stable)


def _newton_step(residuals: EquilibriumResiduals, tangent: Array, is_whole: BoolArray) -> tuple[Array, Array]:
    """Compute Newton's step (T, f) to the curve, and the change (T,) of the share.

    With steps Z that keep the loops closed, it solves H dz + slope_by_share dshare = -energy_slope and
    (Z' tangent) . dz = 0, a step across the tangent. For a step to the whole load the second equation is
    dshare = 0.

    Args:
        residuals: residuals and derivatives at the last iterate.
        tangent: unit vectors (T, f) along the curve.
        is_whole: whether (T,) the step leads to the whole load.
    """
    tangent_of_z = matvec(residuals.null_space.swapaxes(1, 2), tangent)  # (T, d) Z' tangent
    border = np.where(is_whole[:, None], 0.0, tangent_of_z)
    first_rows = [residuals.H, residuals.slope_by_share[:, :, None]]
    last_row = [border[:, None], is_whole[:, None, None]]  # [0 1] for the whole load
    right_side = np.append(-residuals.energy_slope, np.zeros((len(border), 1)), axis=1)
    with np.errstate(all="ignore"):  # a singular system gives infinite steps, which end the iteration
        solution = solve(np.block([first_rows, last_row]), right_side)
        dz, dshare = solution[:, :-1], solution[:, -1]
        return residuals.closing_step + matvec(residuals.null_space, dz), dshare


def _find_folds(robot: ParallelRobot, start: _Points, load: Load) -> CurveEnds:
    """Find the turning points of the share, where the robot snaps through, on the curves ahead of `start`.

    Args:
        start: points on the curves, in front of the turning points.
        load: the load that grows.
    """

    def evaluate(q: Array, share: Array) -> CurveEquations:
        """Evaluate F (T, f) at q and share: the energy's slope along Z, minus the closing step across Z.

        Z are the steps that keep the loops closed. Slope and stiffness H are divided by the largest entry of
        H. The Jacobian of F is the scaled stiffness along Z and the identity across Z: 1 + Z (H / largest -
        1) Z'.
        """
        residuals = evaluate_equilibrium(robot, q, load._replace(share=share))
        largest = np.abs(residuals.H).max(axis=(1, 2))[:, None]  # (T, 1)
        Z = residuals.null_space
        along_Z = residuals.H / largest[:, None] - np.eye(Z.shape[2])
        jacobian = np.eye(Z.shape[1]) + matmul(Z, matmul(along_Z, Z.swapaxes(1, 2)))
        by_share = matvec(Z, residuals.slope_by_share / largest)  # derivative of F by the share
        F = matvec(Z, residuals.energy_slope / largest) - residuals.closing_step
        return CurveEquations(jacobian, by_share, F, residuals.linearised)

    motors_at_rest = np.zeros((len(start.q), robot.nv))
    curves = Curves(robot, robot.unlocked, motors_at_rest, evaluate)
    return curves.find_turning_points(start.q, start.share)


def _move_joints(robot: ParallelRobot, q: Array, step: Array) -> Array:
    """Return configurations (T, nq) after steps (T, f) [rad, robot lengths] of the moving columns."""
    columns = robot.unlocked
    return integrate_columns(robot, q, columns, step * robot.column_scale[columns])
