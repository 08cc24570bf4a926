"""Motor torques along a path under a given motion law, through Type 2 singularities, with proof.

Torques, motor angles and deflections are functions of time on Chebyshev nodes. Where the motion meets
a Type 2 singularity they are a quotient 0/0 if the law respects condition (8), t_s . W_p = 0, and have
a pole if it does not. The first is no event for interpolation between nodes; the second is found on the
singular instant itself, and by coefficients that do not fall.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from framework.dynamics.elastic_pass import Pass
from framework.dynamics.elasticity import (
    DeflectionSolution,
    LawChoice,
    assess_deflections,
    solve_deflections,
)
from framework.dynamics.forces import motor_torque
from framework.dynamics.known_deflections import KnownDeflections
from framework.dynamics.motor_friction import FRICTIONS, PlannedFriction, motor_friction
from framework.dynamics.near_misses import unseen_near_miss
from framework.dynamics.refusals import unresolved_error, unsettled_error
from framework.dynamics.residuals import check_idle_joints, measure_residuals
from framework.dynamics.restoration import deflections_of
from framework.dynamics.result import Certificate, InverseDynamics, SingularityCrossing
from framework.dynamics.singularity_crossings import (
    check_bounded,
    check_crossings,
    deformed_crossing,
    panel_edges,
    rigid_crossings,
)
from framework.errors import (
    InvalidInput,
    NoAnswer,
    NotAssembled,
    NotConverged,
    UnboundedTorque,
    choose_from,
    expect_call,
)
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.frames import difference
from framework.kinematics.inverse_kinematics import remove_idle_spin
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.laws.law import ExactLaw, MotionLaw, edges_of, is_number
from framework.laws.path import Path
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from framework.singularity.points_on_path import SearchedPath, search_path
from framework.tolerances import (
    CONDITION_RESIDUAL,
    LOOP_GAP,
    OVERSHOOT,
    RESOLVABLE_TAIL,
    SAME_PLACE,
    TORQUE_TAIL,
    WRONG_DERIVATIVE,
)

GEOMETRIES = ("rigid", "deformed")
SIZES = (64, 128, 256, 512)  # nodes a panel, tried in turn
FEW = 20  # nodes of a panel of the law's own, tried first
UNSETTLED = 1e-2  # change of the deflections over the largest one, from which on they are not used
STALLED = 0.5  # change of the deflections over that of the grid before, from which on a finer grid is no help


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
        law: `law(t, order)` with `duration` [s] and values in [0, 1]; smooth between path knots.
        geometry: "rigid" (small displacements: forces of the undeformed robot) or "deformed", the
            default for elastic robots.
        tolerance: tail of the torques that counts as resolved.
        friction: "driven" adds the dry friction of driven joints by the sign of their speed, "none" does not.
        wrenches: of the world, by URDF link or joint, see `plan_crossing`.

    Raises:
        InvalidInput: geometry, friction or a frame unknown, law leaves [0, 1] or is not finite, path does not
            fit.
        UnboundedTorque: the law violates condition (8) at a singular instant: no torque is returned.
        NoLaw: the motion stops on the locus, or meets a singularity that no law can cross.
        NotConverged: torques or deflections cannot be resolved to the tolerance.
        LoadedJoint: the motion would load a joint that nothing holds.
        NotAssembled: it would tear a loop equation that was dropped at the reference as redundant.
        OutOfReach, Type1Singularity, SingularPath: see `locate_singularities`.
    """
    geometry = checked_geometry(robot, geometry)
    check_law(law)
    if friction not in FRICTIONS:
        raise InvalidInput(choose_from("friction", friction, FRICTIONS))
    searched = search_path(robot, path).under(ExternalWrenches.of(wrenches))
    return resolve_law(searched, law, geometry=geometry, tolerance=tolerance, friction=friction)


def resolve_law(
    searched: SearchedPath, law: MotionLaw, *, geometry: str, tolerance: float, friction: str
) -> InverseDynamics:
    """Call `resolve` with a given law, and again with deflections of `restoration` if passes fail."""

    def with_deflections(known: KnownDeflections | None) -> InverseDynamics:
        """Resolve the law with known deflections; if None, with deflections that passes find."""
        return resolve(
            searched, lambda *_: law, geometry=geometry, tolerance=tolerance, friction=friction, known=known
        )

    try:
        return with_deflections(None)
    except (NotConverged, UnboundedTorque):
        if geometry == "rigid":
            raise
        try:
            return with_deflections(deflections_of(searched.branch, law))
        except NoAnswer:
            pass  # the first error tells more
        raise


def checked_geometry(robot: ParallelRobot, geometry: str | None) -> str:
    """Return the geometry to use: "deformed" by default, "rigid" for a robot without springs.

    Raises:
        InvalidInput: the geometry is unknown.
    """
    expect_robot(robot)
    if geometry is None:
        return "deformed" if robot.n_e else "rigid"
    if geometry not in GEOMETRIES:
        raise InvalidInput(choose_from("geometry", geometry, GEOMETRIES))
    return geometry if robot.n_e else "rigid"


def check_tolerance(tolerance: float) -> None:
    """Raise InvalidInput unless a tail below the tolerance excludes a pole (at most RESOLVABLE_TAIL)."""
    if not (is_number(tolerance) and 0 < tolerance <= RESOLVABLE_TAIL):
        raise InvalidInput(f"tolerance: must lie in (0, {RESOLVABLE_TAIL:g}], got {tolerance!r}")


def resolve(
    searched: SearchedPath,
    choose_law: LawChoice,
    *,
    geometry: str,
    tolerance: float,
    friction: str,
    known: KnownDeflections | None = None,
) -> InverseDynamics:
    """Double the nodes until the torques are resolved, or tell why they never are.

    With the deflections that are `known`, if any; else they are sought.
    """
    check_tolerance(tolerance)
    branch = searched.branch
    law = choose_law(None, None)
    crossings = rigid_crossings(branch, searched.points, law)
    fixed_geometry = geometry == "rigid"
    if fixed_geometry:
        check_bounded(branch.robot, crossings, CONDITION_RESIDUAL)
    instants = np.array([crossing.time for crossing in crossings])
    start: TimeFunction | None = None
    at_rest, passes, obstacles, pole = law, 0, 0, RESOLVABLE_TAIL
    changes: list[float] = []
    enough, unseen = np.inf, None
    own_panels = len(edges_of(law)) > 0
    regular_at_rest = all(crossing.residual <= CONDITION_RESIDUAL for crossing in crossings)
    for size in (FEW, *SIZES) if own_panels else SIZES:
        grid = TimeGrid.clear_of(instants, panel_edges(branch, law, instants), size)

        def is_fine(here: Pass, grid: TimeGrid = grid) -> bool:
            """Whether what the undeformed robot asks for is resolved, or beyond resolution on any grid."""
            if grid.size >= SIZES[-1] or not regular_at_rest:
                return True
            torques = grid.fit(motor_torque(branch.robot, here.motion, here.forces.joint_torque))
            return _tails(branch.robot, grid, here, torques) <= tolerance

        try:
            if known is not None:
                state = assess_deflections(branch, grid, law, known)
            else:
                state = solve_deflections(
                    branch,
                    grid,
                    choose_law,
                    geometry,
                    start,
                    law,
                    tolerance=min(tolerance, TORQUE_TAIL),
                    is_fine=is_fine,
                )
        except NotAssembled as failure:
            if known is None:
                check_bounded(branch.robot, crossings, pole)
            raise NotConverged(
                f"{branch.robot.name}: the deflections tear the loops open: the springs are too soft for "
                f"this motion; use stiffer springs or geometry rigid ({failure})",
                residual=failure.residual,
            ) from None
        except NotConverged:
            check_bounded(branch.robot, crossings, pole)
            raise
        passes += state.passes
        obstacles += bool(state.obstacle)
        if state.change > UNSETTLED:  # nothing to build on: once more on the next grid
            if obstacles > 1:
                break
            start, law = None, at_rest
            continue
        result = _result(branch, state, geometry, crossings, passes)
        certificate = result.certificate
        if not state.plain:  # plain passes are as quick from rest, and free of what this grid leaves
            start, law = result.deflections, state.law
        if not fixed_geometry:
            crossings = tuple(deformed_crossing(result, crossing) for crossing in crossings)
            pole = max(RESOLVABLE_TAIL, certificate.change)
        if known is not None:
            instants = np.array([crossing.time for crossing in crossings])
        left = max(certificate.tail, certificate.change)
        enough = min(enough, left)
        changes.append(certificate.change)
        if left > tolerance and size < SIZES[-1]:
            if certificate.change > tolerance and (known is not None or is_stalled(changes)):
                break
            continue
        result = replace(result, certificate=measure_residuals(branch, state, result))
        closed = result.certificate.max_closure_error <= LOOP_GAP * max(branch.robot.length, 1.0)
        if left <= tolerance and closed and _law_is_resolved(state.law, grid):
            unseen = unseen_near_miss(searched, state, result)
            if unseen is not None:
                continue
            check_bounded(branch.robot, crossings, CONDITION_RESIDUAL)
            check_crossings(branch.robot, state, geometry, crossings)
            held = check_idle_joints(branch, state, result)
            certificate = replace(result.certificate, max_held_torque=held)
            planned = _planned_friction(result, friction)
            return replace(result, crossings=crossings, certificate=certificate, friction=planned)
    if known is None:  # else a law that is bounded with others
        check_bounded(branch.robot, crossings, pole)
    if state.change > RESOLVABLE_TAIL < enough:
        raise unsettled_error(branch.robot, state)
    raise unresolved_error(searched, result, tolerance, size=grid.size, enough=enough, unseen=unseen)


def _planned_friction(result: InverseDynamics, friction: str) -> PlannedFriction | None:
    """Return the dry friction of driven joints along a motion, None without friction."""
    actuated, size = result.robot.actuated, motor_friction(result.robot, friction)

    def speed(t: Array) -> Array:
        return result.robot.gear_ratio * result.velocity(t)[:, actuated]

    return PlannedFriction.from_speed(size, speed, result.duration)


def is_stalled(changes: list[float]) -> bool:
    """Return whether both last grids have changes above STALLED times the change before."""
    return len(changes) > 2 and min(changes[-2:]) > STALLED * changes[-3]


def check_law(law: MotionLaw) -> None:
    """Raise InvalidInput unless a law has a duration and stays on the path."""
    expect_call("law", law, ("duration",), "a Law")
    duration = law.duration
    if not (np.isfinite(duration) and duration > 0):
        raise InvalidInput(f"law: duration must be a positive number of seconds, got {duration!r}")
    s = np.asarray(law(np.linspace(0.0, duration, 257)), dtype=float)
    if s.shape != (257,) or not np.all(np.isfinite(s)):
        raise InvalidInput("law: must give one finite s for each t")
    if s.min() < -OVERSHOOT or s.max() > 1 + OVERSHOOT:
        raise InvalidInput(f"law: s must stay in [0, 1], got values from {s.min():.6g} to {s.max():.6g}")


def _law_is_resolved(law: MotionLaw, grid: TimeGrid) -> bool:
    """Return whether the series through the law's values at nodes is the law, on 16 times as many instants.

    Raises:
        InvalidInput: a derivative of the law is not that of the series.
    """
    if isinstance(law, ExactLaw):
        return True  # a law of this package; the closure error between nodes checks the law, too
    times = np.linspace(0.0, law.duration, 16 * len(grid.times))
    values = np.asarray(law(grid.times))[:, None]
    series_values = grid.fit(values)(times)[:, 0]
    if np.abs(law(times) - series_values).max() > SAME_PLACE:
        return False
    for order, derivative in enumerate(grid.differentiate(values), start=1):
        difference = np.abs(np.asarray(law(grid.times, order)) - derivative[:, 0]).max()
        if not difference <= WRONG_DERIVATIVE * max(float(np.abs(derivative).max()), law.duration**-order):
            raise InvalidInput(f"law: law(t, {order}) is not the derivative of law(t) of that order")
    return True


def _result(
    branch: Branch,
    state: DeflectionSolution,
    geometry: str,
    crossings: tuple[SingularityCrossing, ...],
    passes: int,
) -> InverseDynamics:
    """Return the result of a motion on one grid, its residuals and friction not yet computed.

    Configurations are stored as tangent offsets from the branch's origin, smooth functions of time.
    """
    robot, grid = branch.robot, state.grid
    torques = grid.fit(motor_torque(robot, state.motion, state.forces.joint_torque))
    q, s = state.motion.q, state.law(grid.times)
    if not branch.is_continued(s).any():  # continued configurations have a smooth spin already
        q = remove_idle_spin(robot, branch.origin, q, branch.path(s))
    offsets = difference(robot, branch.origin, q)
    joint_positions = difference(robot, robot.neutral, branch.origin[None]) + offsets
    motor_angles = grid.fit(robot.gear_ratio * joint_positions[:, robot.actuated])
    return InverseDynamics(
        robot=robot,
        path=branch.path,
        law=state.law,
        geometry=geometry,
        torques=torques,
        motor_angles=motor_angles,
        deflections=state.deflections,
        deflection_rates=tuple(
            grid.fit(rates[:, robot.elastic]) for rates in (state.motion.v, state.motion.a)
        ),
        offsets=grid.fit(offsets),
        origin=branch.origin,
        crossings=crossings,
        wrenches=branch.wrenches,
        certificate=Certificate(
            nodes=len(grid.times),
            tail=_tails(robot, grid, state, torques),
            passes=passes,
            change=state.change,
            max_closure_error=0.0,
            max_residual_torque=0.0,
            max_held_torque=0.0,
            end_speed=_end_speed(robot, state),
            monotone=bool(np.all(np.diff(s) > -1e-14)),
        ),
    )


def _tail(function: TimeFunction, rounding: Array) -> float:
    """Return the tail of the components (k,) whose largest coefficient is above `rounding` (k,)."""
    size = np.abs(function.coefficients).max(axis=(0, 1))
    return TimeFunction(function.edges, function.coefficients[..., size > rounding]).tail


def _tails(
    robot: ParallelRobot, grid: TimeGrid, here: Pass | DeflectionSolution, torques: TimeFunction
) -> float:
    """Return the tail of motor torques, or of the deflections that forces cause if that is larger."""
    # rounding of motor torques (n_a,) [N m] that are zero, as at constant speed
    torque_rounding = 1e-15 * robot.mass * (robot.length / here.law.duration) ** 2 / np.abs(robot.gear_ratio)
    deflection_rounding = 1e-14 * robot.column_scale[robot.elastic]
    return max(_tail(torques, torque_rounding), _tail(grid.fit(here.caused), deflection_rounding))


def _end_speed(robot: ParallelRobot, state: DeflectionSolution) -> float:
    """Return the largest motor speed at both ends of the motion over the largest of the motion."""
    speeds = np.abs(robot.gear_ratio * state.motion.v[:, robot.actuated])
    peak = float(speeds.max(initial=0.0))
    return float(speeds[[0, -1]].max(initial=0.0)) / peak if peak > 0 else 0.0


__all__ = ["InverseDynamics", "SingularityCrossing", "inverse_dynamics"]
