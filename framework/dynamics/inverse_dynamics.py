"""Certified motor torques along a path under a given motion law, through Type 2 singularities.

Torques, motor angles and deflections are Chebyshev series in time. At a Type 2 singularity the motors do not
control the platform's twist t_s, along which the motion requires the force t_s . W_p. The torques are a
quotient 0/0 if the law meets condition (8), t_s . W_p = 0, and have a pole if it does not. The quotient is
smooth, and no node lies at the singular instant, so the series interpolate the quotient without special
treatment. Two tests detect a pole: t_s . W_p at the singular instant, and coefficients that do not decay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from framework.dynamics.deflection_splines import KnownDeflections
from framework.dynamics.elasticity import (
    LawChoice,
    Pass,
    assess_deflections,
    pass_at_rest,
    solve_deflections,
)
from framework.dynamics.forces import motor_torque
from framework.dynamics.motion_checks import (
    MissingForces,
    check_idle_joints,
    measure_residuals,
    unresolved_error,
    unseen_near_miss,
    unsettled_error,
)
from framework.dynamics.motor_friction import FRICTIONS, PlannedFriction, motor_friction
from framework.dynamics.restoration import deflections_of
from framework.dynamics.result import Certificate, InverseDynamics, SingularityCrossing
from framework.dynamics.singularity_crossings import (
    CrossedPoint,
    check_bounded,
    check_crossings,
    deformed_crossings,
    find_crossed_points,
    measure_crossings,
    panel_edges,
)
from framework.errors import (
    InvalidInput,
    NoAnswer,
    NotAssembled,
    NotConverged,
    SpringsTooSoft,
    UnboundedTorque,
    check_choice,
    expect_call,
)
from framework.kinematics.continuation.branch import Branch
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.frames import difference
from framework.kinematics.inverse_kinematics import remove_idle_spin
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import ExactLaw, MotionLaw, edges_of, is_number
from framework.laws.path import Path
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction, TimeGrid, tail
from framework.numerics.time_limit import SearchEnded
from framework.singularity.points_on_path import SearchedPath, search_path
from framework.singularity.rank_deficiency import NearMiss
from framework.tolerances import (
    CONDITION_RESIDUAL,
    LOOP_GAP,
    OVERSHOOT,
    RESOLVABLE_TAIL,
    SAME_PLACE,
    STRICTEST_TAIL,
    TORQUE_TAIL,
    WRONG_DERIVATIVE,
)

GEOMETRIES = ("rigid", "deformed")
# numbers of nodes per panel, tried in turn; the first one is for laws that have panels of their own
SIZES = (20, 64, 128, 256, 512)


def inverse_dynamics(
    robot: ParallelRobot,
    path: Path,
    law: MotionLaw,
    *,
    geometry: str | None = None,
    tolerance: float = TORQUE_TAIL,
    friction: str = FRICTIONS[0],
    wrenches: Mapping[str, Any] | None = None,
) -> InverseDynamics:
    """Compute the torques along a path under any motion law, with their certificate.

    Args:
        law: a function `law(t, order)` with an attribute `duration` [s] and values in [0, 1]; it must be
            smooth between the knots of the path.
        geometry: "rigid" (small displacements: forces of the undeformed robot) or "deformed", the default for
            elastic robots.
        tolerance: tail of the torques that counts as resolved.
        friction: "driven" adds the dry friction of driven joints by the sign of their speed, "none" does not.
        wrenches: external wrenches along the path by URDF link or joint, in the forms of `plan_crossing`.

    Raises:
        InvalidInput: geometry, friction or a frame is unknown; the law leaves [0, 1] or is not finite; the
            path does not fit the robot.
        UnboundedTorque: the law violates condition (8), t_s . W_p = 0, at a singular instant.
        NoLaw: the motion stops on the locus, or meets a singularity that no law can cross.
        NotConverged: torques or deflections cannot be resolved to the tolerance.
        LoadedJoint: the motion would load a joint that nothing holds.
        NotAssembled: the motion would open a loop equation that was dropped at the reference as redundant.
        OutOfReach, Type1Singularity, SingularPath: see `locate_singularities`.
    """
    geometry = checked_geometry(robot, geometry)
    check_law(law)
    check_choice("friction", friction, FRICTIONS)
    searched = search_path(robot, path).under(ExternalWrenches.of(wrenches))
    return resolve_law(searched, law, geometry=geometry, tolerance=tolerance, friction=friction)


def resolve_law(
    searched: SearchedPath, law: MotionLaw, *, geometry: str, tolerance: float, friction: str
) -> InverseDynamics:
    """Compute the torques of a fixed law.

    Deflections are found by passes or, if these do not converge, by Gauss-Newton (`restoration`). Arguments
    and errors are those of `resolve`.
    """
    return resolve(
        searched,
        lambda _: law,
        geometry=geometry,
        tolerance=tolerance,
        friction=friction,
        find_balance=lambda: (law, deflections_of(searched.branch, law)),
    )


def checked_geometry(robot: ParallelRobot, geometry: str | None) -> str:
    """Return the geometry to use: "deformed" by default, "rigid" for a robot without springs.

    Raises:
        InvalidInput: the geometry is unknown.
    """
    geometry = "deformed" if geometry is None else geometry
    check_choice("geometry", geometry, GEOMETRIES)
    return geometry if robot.n_e else "rigid"


def check_tolerance(tolerance: float) -> None:
    """Raise InvalidInput unless STRICTEST_TAIL <= tolerance <= RESOLVABLE_TAIL.

    Series with a smaller tail than RESOLVABLE_TAIL have no pole.
    """
    if not (is_number(tolerance) and STRICTEST_TAIL <= tolerance <= RESOLVABLE_TAIL):
        limits = f"[{STRICTEST_TAIL:g}, {RESOLVABLE_TAIL:g}]"
        raise InvalidInput(f"tolerance: must lie in {limits}, got {tolerance!r}")


def resolve(
    searched: SearchedPath,
    choose_law: LawChoice,
    *,
    geometry: str,
    tolerance: float,
    friction: str,
    known: KnownDeflections | None = None,
    find_balance: Callable[[], tuple[MotionLaw, KnownDeflections]] | None = None,
) -> InverseDynamics:
    """Compute torques under known deflections, or under those that passes or Gauss-Newton find.

    If passes do not converge, the deflections that `find_balance` returns are taken. If these do not lead to
    torques either, one of both errors is raised. Of two errors of convergence, the one with the smaller
    residual says more. Any other error of the passes, such as a pole of the torques or springs that are too
    soft, is raised itself. So is an error of the passes if the second computation failed for another reason
    than convergence.

    Args:
        choose_law: a function of the deflections that returns the law to follow; for None that for springs
            at rest.
        geometry: "rigid" or "deformed".
        tolerance: tail of the torques that counts as resolved.
        friction: "driven" adds the dry friction of driven joints by the sign of their speed, "none" does not.
        known: known deflections; None to solve for the deflections.
        find_balance: returns a law and deflections in balance (`restoration`); None to rely on passes.

    Raises:
        NoAnswer: as `inverse_dynamics`.
    """
    check_tolerance(tolerance)
    resolve_with = partial(
        _resolve_on_grids, searched, geometry=geometry, tolerance=tolerance, friction=friction
    )
    if known is not None or find_balance is None or geometry == "rigid":
        return resolve_with(choose_law, known=known)
    try:
        return resolve_with(choose_law, known=None)
    except (NotConverged, UnboundedTorque) as of_passes:
        try:
            law, deflections = find_balance()
            return resolve_with(lambda _: law, known=deflections)
        except SearchEnded:
            raise
        except NotConverged as of_balance:
            if isinstance(of_passes, SpringsTooSoft | UnboundedTorque):
                raise of_passes from None
            raise min(of_passes, of_balance, key=lambda failure: failure.residual) from None
        except NoAnswer:
            raise of_passes from None


def _resolve_on_grids(
    searched: SearchedPath,
    choose_law: LawChoice,
    *,
    geometry: str,
    tolerance: float,
    friction: str,
    known: KnownDeflections | None,
) -> InverseDynamics:
    """Compute torques on finer and finer grids until their series are resolved, as `resolve`.

    A grid that does not resolve torques or deflections is followed by a finer one, unless finer grids are
    known not to help. A resolved motion must pass all checks.
    """
    # relative, of the deflections by one more pass; above, they are discarded
    max_usable_change = 1e-2
    robot = searched.branch.robot
    law = choose_law(None)  # for springs at rest
    crossed = find_crossed_points(searched.branch, searched.points, law)
    refinement = _Refinement(searched, choose_law, geometry, tolerance, known, law, crossed)
    unseen: NearMiss | None = None  # near miss that the last grid did not resolve
    sizes = SIZES if len(edges_of(law)) else SIZES[1:]
    for size in sizes:
        # motion and forces on the grid; without usable deflections there is no result
        solution = refinement.solve(size)
        if solution.change > max_usable_change:
            if not solution.is_settled:
                break
            continue

        # series of torques and deflections, with the tail that decides whether the grid is fine enough
        result = refinement.evaluate(solution)
        is_resolved = result.certificate.unresolved <= tolerance
        if not is_resolved and size < SIZES[-1]:
            if refinement.is_hopeless:
                break
            continue

        # on a grid that is fine enough, or the finest: check the equations between the nodes
        result, missing = measure_residuals(searched.branch, solution, result)
        is_closed = result.certificate.max_closure_error <= LOOP_GAP * max(robot.length, 1.0)
        if is_resolved and is_closed and _law_is_resolved(solution.law, solution.grid):
            unseen = unseen_near_miss(searched, solution, result)
            if unseen is None:
                return _check_result(searched.branch, solution, result, missing, friction)

    # no grid resolves the motion: raise the error that says most about the reason
    least = min((certificate.unresolved for certificate in refinement.certificates), default=np.inf)
    if known is None:  # a pole with known deflections proves nothing: others may have bounded torques
        check_bounded(searched.branch, refinement.crossings, refinement.allowed_residual)
    if min(solution.change, least) > RESOLVABLE_TAIL:
        raise unsettled_error(robot, solution)
    raise unresolved_error(searched, result, tolerance, size=size, enough=least, unseen=unseen)


@dataclass
class _Refinement:
    """The solution of the computation between grids: the results so far.

    The first five fields are arguments of `resolve`.
    """

    searched: SearchedPath
    choose_law: LawChoice
    geometry: str
    tolerance: float
    known: KnownDeflections | None  # None: the deflections are solved for
    law: MotionLaw  # for springs at rest
    crossed: list[CrossedPoint]  # of the undeformed robot
    has_pole: bool = False  # whether the torques of the undeformed robot have a pole
    crossings: tuple[SingularityCrossing, ...] = ()  # with t_s . W_p, and the deflections of the last grid
    passes: int = 0  # on all grids together
    certificates: list[Certificate] = field(default_factory=list)  # one for each grid with a result

    @property
    def allowed_residual(self) -> float:
        """The residual of condition (8), t_s . W_p = 0, that errors of the deflections may cause.

        Torques with a larger residual have a pole.
        """
        change = self.certificates[-1].change if self.certificates and self.geometry != "rigid" else 0.0
        return max(RESOLVABLE_TAIL, change)

    @property
    def is_hopeless(self) -> bool:
        """Whether finer grids will not reduce the change of the deflections to the tolerance.

        With known deflections no grid changes them. Otherwise the change has stalled if neither of the last
        two grids has halved it.
        """
        changes = [certificate.change for certificate in self.certificates]
        if changes[-1] <= self.tolerance:
            return False
        has_stalled = len(changes) > 2 and 2.0 * min(changes[-2:]) > changes[-3]
        return self.known is not None or has_stalled

    def solve(self, size: int) -> Pass:
        """Solve for motion, forces and deflections on a grid of `size` nodes per panel.

        No node is at a crossing. The crossings are those of the undeformed robot, because the passes begin
        with springs at rest; with known deflections they are those that the last grid has found. The first
        grid measures t_s . W_p of the undeformed robot.

        Raises:
            UnboundedTorque: the law violates condition (8).
            NotConverged: the springs are too soft for the motion.
        """
        branch = self.searched.branch
        instants = np.array([time for time, *_ in self.crossed])
        if self.known is not None and self.crossings:
            instants = np.array([crossing.time for crossing in self.crossings])
        grid = TimeGrid.clear_of(instants, panel_edges(branch, self.law, instants), size)
        try:
            if self.known is not None:
                if self.crossed and not self.crossings:
                    self._pass_at_rest(grid, instants)
                solution = assess_deflections(branch, grid, self.law, self.known)
            else:
                solution = solve_deflections(
                    branch,
                    self._pass_at_rest(grid, instants),
                    self.choose_law,
                    self.geometry,
                    tolerance=min(self.tolerance, TORQUE_TAIL),
                    is_fine=self._is_fine,
                )
        except (NotAssembled, NotConverged) as failure:
            if self.known is None:  # a pole of the torques is the better explanation
                check_bounded(branch, self.crossings, self.allowed_residual)
            if isinstance(failure, NotConverged):
                raise
            raise NotConverged(
                f"the deflections tear the loops open: the springs are too soft for this motion "
                f"({failure.sentence})",
                name=branch.robot.name,
                residual=failure.residual,
            ) from None
        self.passes += solution.passes
        return solution

    def _pass_at_rest(self, grid: TimeGrid, instants: Array) -> Pass:
        """Compute the pass with springs at rest; measure the crossings at `instants` (k,) on the first grid.

        Raises:
            UnboundedTorque: the law violates condition (8), and the geometry is rigid.
        """
        branch = self.searched.branch
        if self.crossings:  # measured on the first grid
            instants = instants[:0]
        at_rest, forces = pass_at_rest(branch, grid, self.law, instants)
        if len(instants):
            self.crossings = measure_crossings(branch.robot, self.law.duration, self.crossed, forces)
            self.has_pole = any(crossing.residual > CONDITION_RESIDUAL for crossing in self.crossings)
            if self.geometry == "rigid":
                check_bounded(branch, self.crossings, CONDITION_RESIDUAL)
        return at_rest

    def _is_fine(self, at_rest: Pass) -> bool:
        """Return whether a grid resolves the torques of the undeformed robot, or no grid does."""
        grid = at_rest.grid
        if grid.size >= SIZES[-1] or self.has_pole:  # which no grid resolves
            return True
        robot = self.searched.branch.robot
        torques = grid.fit(motor_torque(robot, at_rest.motion, at_rest.forces.joint_torque))
        return _largest_tail(robot, at_rest, torques) <= self.tolerance

    def evaluate(self, solution: Pass) -> InverseDynamics:
        """Return the result on one grid, and store its certificate and crossings for the next grid.

        Residuals, closure errors, held torques and friction are filled in later, for the last grid alone.
        Configurations are stored as tangent offsets from the branch's origin, which are smooth functions of
        time.
        """
        branch = self.searched.branch
        grid = solution.grid
        motion = solution.motion
        robot = branch.robot
        torques = grid.fit(motor_torque(robot, motion, solution.forces.joint_torque))
        q = motion.q
        s = solution.law(grid.times)
        if not branch.is_continued(s).any():  # continued configurations already spin smoothly
            q = remove_idle_spin(robot, branch.origin, q, branch.path(s))
        offsets = difference(robot, branch.origin, q)
        # (T, nv) coordinates of all joints, counted from the neutral configuration
        joint_positions = difference(robot, robot.neutral, branch.origin[None]) + offsets
        motor_speeds = np.abs(robot.gear_ratio * motion.v[:, robot.actuated])
        certificate = Certificate(
            nodes=len(grid.times),
            tail=_largest_tail(robot, solution, torques),
            passes=self.passes,
            change=solution.change,
            end_speed=float(motor_speeds[[0, -1]].max(initial=0.0) / (motor_speeds.max(initial=0.0) or 1.0)),
            monotone=bool(np.all(np.diff(s) > -1e-14)),  # but for rounding of s
        )
        result = InverseDynamics(
            robot=robot,
            path=branch.path,
            law=solution.law,
            geometry=self.geometry,
            torques=torques,
            motor_angles=grid.fit(robot.gear_ratio * joint_positions[:, robot.actuated]),
            deflections=solution.deflections,
            deflection_rates=(grid.fit(motion.v[:, robot.elastic]), grid.fit(motion.a[:, robot.elastic])),
            offsets=grid.fit(offsets),
            origin=branch.origin,
            crossings=self.crossings,
            wrenches=branch.wrenches,
            certificate=certificate,
        )
        self.certificates.append(certificate)
        if self.geometry == "rigid":
            return result
        self.crossings = deformed_crossings(result, self.crossings)
        return replace(result, crossings=self.crossings)


def _check_result(
    branch: Branch, solution: Pass, result: InverseDynamics, missing: MissingForces, friction: str
) -> InverseDynamics:
    """Check crossings and idle joints of a resolved motion; return the result with dry friction added.

    Args:
        friction: "driven" or "none".
    """
    robot = branch.robot
    check_bounded(branch, result.crossings, CONDITION_RESIDUAL)
    check_crossings(robot, solution, result)
    max_held_torque = check_idle_joints(robot, missing)
    if max_held_torque:
        result = replace(result, certificate=replace(result.certificate, max_held_torque=max_held_torque))
    planned_friction = PlannedFriction.from_speed(
        motor_friction(robot, friction), partial(result.motor_angle, order=1), result.duration
    )
    return result if planned_friction is None else replace(result, friction=planned_friction)


def check_law(law: MotionLaw) -> None:
    """Raise InvalidInput unless a law has a positive duration and stays on the path."""
    expect_call("law", law, ("duration",), "a Law")
    duration = law.duration
    if not (np.isfinite(duration) and duration > 0):
        raise InvalidInput(f"law: duration must be a positive number of seconds, got {duration!r}")
    s = np.asarray(law(np.linspace(0.0, duration, 257)), dtype=float)  # enough to see a law leave the path
    if s.shape != (257,) or not np.all(np.isfinite(s)):
        raise InvalidInput("law: must give one finite s for each t")
    if s.min() < -OVERSHOOT or s.max() > 1 + OVERSHOOT:
        raise InvalidInput(f"law: s must stay in [0, 1], got values from {s.min():.6g} to {s.max():.6g}")


def _law_is_resolved(law: MotionLaw, grid: TimeGrid) -> bool:
    """Return whether the series through the law's values at the nodes of a grid agrees with the law.

    If it does, the derivatives of a user's own law are compared with those of the series.
    """
    if isinstance(law, ExactLaw):
        return True  # a law of this package; the closure error between nodes checks it, too
    times = np.linspace(0.0, law.duration, 16 * len(grid.times))  # also between the nodes
    values = np.asarray(law(grid.times))[:, None]
    series_values = grid.fit(values)(times)[:, 0]
    if np.abs(law(times) - series_values).max() > SAME_PLACE:
        return False
    _, *derivatives = grid.values(grid.fit(values))
    for order, derivative in enumerate(derivatives, start=1):
        error = np.abs(np.asarray(law(grid.times, order)) - derivative[:, 0]).max()
        # if the derivative vanishes, its scale is that of a mean value
        scale = max(np.abs(derivative).max(), law.duration**-order)
        if not error <= WRONG_DERIVATIVE * scale:  # also for NaN
            raise InvalidInput(f"law: law(t, {order}) is not the derivative of law(t) of that order")
    return True


def _largest_tail(robot: ParallelRobot, solution: Pass, torques: TimeFunction) -> float:
    """Compute the larger of the tails of the motor torques and of the caused deflections.

    Args:
        torques: motor torques (n_a) [N m] as a function of time.
    """
    # Torques may vanish, as at constant speed: their rounding (n_a,) [N m] is relative to the kinetic energy.
    # Both factors are a few units of double precision.
    kinetic_energy = robot.mass * (robot.length / solution.law.duration) ** 2
    torque_rounding = 1e-15 * kinetic_energy / np.abs(robot.gear_ratio)
    checked = [(torques, torque_rounding)]
    if robot.n_e:
        checked.append((solution.grid.fit(solution.caused), 1e-14 * robot.column_scale[robot.elastic]))
    tails = []
    for function, rounding in checked:
        size = np.abs(function.coefficients).max(axis=(0, 1))  # of each component, from (panels, nodes, k)
        tails.append(tail(function.coefficients[..., size > rounding]))
    return max(tails)


__all__ = ["InverseDynamics", "SingularityCrossing", "inverse_dynamics"]
