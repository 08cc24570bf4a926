"""Diagnosis of a robot before anything is planned, and the description of one pose.

`check_robot` reports mobility, rank, masses, closure and modes; `describe_pose` reports joints, platform,
modes and exceeded limits by the names of the robot file.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from framework.errors import NotAssembled, SingularReference
from framework.kinematics.assembly import joint_loops_matrix, nearby_configurations, remark_on_turns
from framework.kinematics.assembly_search import find_closed_pose
from framework.kinematics.diagnostics.mistaken_units import moving_bodies, remarks_on_bodies
from framework.kinematics.diagnostics.mobility import (
    Mobility,
    PlatformAxes,
    count_freedoms,
    examine_platform_axes,
)
from framework.kinematics.frames import difference, integrate
from framework.kinematics.line_springs import lines_at
from framework.kinematics.linearised_loops import assembled_at, clearance, linearised_at_reference
from framework.kinematics.loop_structure import assemble_mechanism, numerical_rank, rounded_gap
from framework.kinematics.mechanism import Mechanism, velocity_columns
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import positions_beyond_limits
from framework.numerics.arrays import ArrayLike, Names
from framework.tolerances import BRANCHES_MEET, EXPORT_ROUNDING, HELD_IDLE, RANK_ROUNDING

# [rad, robot lengths] larger motions of a joint are not due to the rounding of drawings
MOVED_REFERENCE = 10 * EXPORT_ROUNDING


@dataclass(frozen=True)
class Diagnosis:
    """Findings on one robot, with `advice` on faults."""

    robot: str
    flexibility: str
    platform_axes: Names
    actuators: Names
    passive_joints: Names
    idle_joints: Names  # a passive joint for each motion that moves no centre of mass
    loose_joints: Names  # a joint for each motion that moves masses without any motor or platform axis
    springs: Names
    mobility: int  # degrees of freedom with all springs locked, idle ones included
    redundant_motors: int  # actuators beyond the mobility without idle freedoms
    loop_equations: int  # number of all loop equations
    rank: int  # number of independent loop equations
    redundant_rows: Names  # closure.axis
    mass: float  # [kg]
    massless_joints: Names  # joints whose own body has no mass
    closure_error: float  # [m or rad] at the reference
    reference: dict[str, float]  # positions of the assembled reference [rad, m]
    platform: tuple[float, ...]  # coordinates of the platform at the assembled reference
    working_mode: int  # sign, which changes at Type 1; 0 unless `square`
    assembly_mode: int  # sign, which changes at Type 2; 0 unless `square`
    smallest_singular_value: float | None  # of P, dimensionless; None unless `square` and P has columns
    square: bool  # as many platform axes as degrees of freedom, all able to move, and no fewer actuators
    stuck_axes: str  # axes along which the platform cannot move; empty without any
    axes_that_do: tuple[Names, ...]  # sets of sufficient platform axes, if the stated axes are not sufficient
    assembled: bool  # whether the loops close near the reference of the file, without a search
    gap_at_reference: float  # [m or rad] residual of the loops near the file's reference; 0 if `assembled`
    advice: tuple[str, ...]


def check_robot(mechanism: Mechanism) -> Diagnosis:
    """Examine a mechanism at its assembled reference, else at another closed pose.

    If the loops do not close near the reference, a search looks for another pose. If the reference is on a
    singularity of the loops, a pose beside it is examined. `advice` reports both.

    Raises:
        NotAssembled: the loops do not close near the reference, and `find_closed_pose` finds no other pose.
        SingularReference: the loops are nearly singular both at the reference and beside it.
    """
    robot, gap, remarks = _robot_to_examine(mechanism)
    mobility = count_freedoms(robot)
    axes = examine_platform_axes(robot, mobility.working - len(mobility.loose))
    square = robot.n == mobility.working <= robot.n_a and not axes.stuck_here
    working_sign, assembly_sign, least = 0, 0, np.inf
    if square:
        linearised = linearised_at_reference(robot)
        working_sign, assembly_sign = (int(sign[0]) for sign in mode_signs(robot, linearised))
        least = float(clearance(robot, linearised)[0])
    bodies = moving_bodies(robot)
    redundant = tuple(robot.rows.names[row] for row in robot.structure.dropped)
    advice = [
        *remarks,
        *_advice_on_motions(robot, mobility, axes),
        *_advice_on_loops(robot, redundant),
        *_advice_on_line_springs(robot),
        *remarks_on_bodies(robot),
        *_advice_on_reference(robot),
    ]
    if least < BRANCHES_MEET:
        advice.append("the reference is itself singular: give one away from the locus")
    return Diagnosis(
        robot=robot.name,
        flexibility=robot.flexibility,
        platform_axes=robot.axis_names,
        actuators=robot.actuator_names,
        passive_joints=tuple(
            name for name in map(robot.coordinates.name_of, robot.passive) if name not in mobility.idle
        ),
        idle_joints=mobility.idle,
        loose_joints=mobility.loose,
        springs=robot.spring_names,
        mobility=mobility.freedoms,
        redundant_motors=max(robot.n_a - mobility.working, 0),
        loop_equations=len(robot.rows.names),
        rank=len(robot.structure.independent),
        redundant_rows=redundant,
        mass=float(sum(body.mass for body in bodies.values())),
        massless_joints=tuple(name for name, body in bodies.items() if body.mass == 0.0),
        closure_error=robot.reference.residual,
        reference=robot.reference_values(robot.reference.q),
        platform=tuple(robot.reference.x.tolist()),
        working_mode=working_sign,
        assembly_mode=assembly_sign,
        smallest_singular_value=least if least < np.inf else None,
        square=square,
        stuck_axes=axes.stuck,
        axes_that_do=axes.proposals,
        assembled=gap is None,
        gap_at_reference=gap or 0.0,
        advice=tuple(advice),
    )


def _robot_to_examine(mechanism: Mechanism) -> tuple[ParallelRobot, float | None, list[str]]:
    """Return the robot at a closed pose, the gap at its reference, and remarks.

    The pose is the closed reference of the file. If the loops do not close near it, a search finds another
    pose. If the pose is on a singularity of the loops, a regular pose beside it is taken.

    Returns:
        The robot; the residual [m or rad] near the file's reference, None if the loops close there; the
        remarks on the pose.
    """
    gap = None
    remarks = list[str]()
    try:
        closed, closing = assemble_mechanism(mechanism)
    except NotAssembled as failure:
        if remark_on_turns(mechanism, mechanism.description.reference):
            raise  # the angles seem to be in degrees: a search would only hide this
        gap = failure.residual
        pose = find_closed_pose(mechanism)
        remarks.append(
            f"the loops do not close near {reference_in_words(mechanism)}; a search within the joints' "
            f"limits has found the one that is printed, {pose.farthest} away: give it as "
            f"`reference` if the robot is meant to be assembled that way"
        )
        description = replace(mechanism.description, reference=mechanism.reference_values(pose.q))
        posed = Mechanism.from_description(description, flexibility=mechanism.flexibility)
        closed, closing = assemble_mechanism(posed)
    moved_in = not np.array_equal(closed.q_near, mechanism.q_near)
    if gap is None and moved_in and not mechanism.description.reference:
        remarks.append(
            "no reference is given, and from zero the loops close beyond the joints' limits; a search "
            "within them has found the one that is printed: give it as `reference`"
        )
    mechanism = closed
    try:
        return ParallelRobot.of(mechanism), gap, remarks
    except SingularReference as singular:
        # a singular reference is one with nearby poses of higher rank, so one exists
        beside = replace(mechanism, q_near=nearby_configurations(mechanism, closing.q)[0])
        try:
            robot = ParallelRobot.of(beside)
        except SingularReference:
            raise singular from None
        return robot, gap, [*remarks, f"said of a pose beside the reference: {singular}"]


def reference_in_words(mechanism: Mechanism) -> str:
    """Name the reference of a mechanism in words: the one in its file or the default."""
    stated = mechanism.description.reference
    return "the reference that is given" if stated else "the default reference (all zero)"


def _advice_on_motions(robot: ParallelRobot, mobility: Mobility, axes: PlatformAxes) -> Iterator[str]:
    """Yield advice on a robot's freedoms and its platform's axes."""
    freedoms = mobility.working
    listed = " or ".join(f"[{', '.join(proposal)}]" for proposal in axes.proposals)
    instead = f"; axes that would do: {listed}" if listed else ""
    if axes.stuck:
        yield (
            f"the platform's frame {robot.description.platform.frame} cannot move along {axes.stuck}: it has "
            f"{axes.twist_rank} independent velocit{'y' if axes.twist_rank == 1 else 'ies'}"
            f"{instead or '; choose another frame'}"
        )
    elif axes.stuck_here:
        yield (
            f"at the reference the platform cannot move along {axes.stuck_here}, but it can beside it: a "
            f"Type 1 singularity; give another reference"
        )
    if robot.n != freedoms:
        yield (
            f"{robot.n} platform axes for {freedoms} degrees of freedom: planning needs as many; change the "
            f"platform's axes or the closures{_name_suspect_closures(robot, freedoms)}"
            f"{'' if axes.stuck else instead}"
        )
    if robot.n_a < freedoms:
        yield (
            f"{robot.n_a} actuators for {freedoms} degrees of freedom: nothing holds the rest; add actuators"
        )
    if robot.n_a > freedoms:
        yield (
            f"{robot.n_a} actuators for {freedoms} degrees of freedom: torques will be those of least norm, "
            f"or others within the limits (torque_sharing); drop actuators if that is not meant"
        )
    if mobility.loose:
        yield (
            f"{', '.join(mobility.loose)}: masses move there by themselves, without a motor and without the "
            f"platform's axes: add a motor, or lock them (locked, a closure)"
        )
    if mobility.idle:
        yield (
            f"{', '.join(mobility.idle)} may turn and hardly moves a centre of mass; planning holds it "
            f"still, or turns it as its balls' damping or armature does, says what torque is left to hold "
            f"it, and refuses more than {HELD_IDLE:g} of the motors' peak"
        )


def _advice_on_loops(robot: ParallelRobot, redundant: Names) -> Iterator[str]:
    """Yield advice on loops, springs and dry friction.

    `redundant` are the names of loop equations that follow from others.
    """
    for closure in robot.description.closures:
        if closure.omits_axis:
            yield f"closure {closure.name}: no axis is given: it is z of {closure.frames[0]}"
    if robot.rounded.names:
        gap = rounded_gap(robot, robot.reference.q[None])
        yield (
            f"rounded and overconstrained by {gap:.2g} m or rad: {', '.join(robot.rounded.names)} repeat "
            f"other loop equations but for that; they stay open by it, all others close"
        )
    if redundant:
        yield (
            f"{', '.join(redundant)}: other loop equations say the same at the reference, as it should be in "
            f"a planar or overconstrained mechanism; where they are needed elsewhere, lock only what it "
            f"takes (axes: [...])"
        )
    alone = robot.structure.spring_only_rows
    if alone:
        yield (
            f"{', '.join(alone)} can only be closed by springs, which planning refuses: lock fewer axes "
            f"there (axes: [...]) or leave those axes out of the springs' motion"
        )
    friction = robot.friction_sizes(robot.passive)
    if friction:
        yield (f"dry friction, which no plan counts with: {friction}")


def _advice_on_line_springs(robot: ParallelRobot) -> Iterator[str]:
    """Yield advice on springs between two points whose lengths no joint changes."""
    if not robot.line_springs.names:
        return
    offsets = np.random.default_rng(0).uniform(-1.0, 1.0, (3, robot.nv))
    q = integrate(robot, np.tile(robot.reference.q, (len(offsets), 1)), offsets)
    slope = np.abs(lines_at(robot, q).J).max(axis=(0, 2), initial=0.0)
    still = [name for name, size in zip(robot.line_springs.names, slope, strict=True) if size < RANK_ROUNDING]
    if still:
        yield (
            f"{', '.join(still)}: as long in all poses, so without effect: the origin of a link is at its "
            f"joint; add frames where springs are hooked in"
        )


def _advice_on_reference(robot: ParallelRobot) -> Iterator[str]:
    """Yield advice on a closed reference that differs from the file's, or exceeds joint limits.

    Only joints whose positions the file states are compared; the others are found by closing the loops.
    """
    offset = difference(robot, robot.q_near, robot.reference.q)  # (nv,) from the file's to the closed one
    stated_columns = velocity_columns(robot.model, robot.description.reference)
    sizes = np.abs(offset / robot.column_scale)[stated_columns]
    if sizes.max(initial=0.0) > MOVED_REFERENCE:
        farthest = stated_columns[sizes.argmax()]
        yield (
            f"the loops close beside the reference that is given, {robot.coordinates.name_of(farthest)} by "
            f"{offset[farthest]:+.3g} {robot.unit_of(farthest)}"
        )
    excesses = positions_beyond_limits(robot.limits, robot.reference.q[None])
    if excesses:
        listed = "; ".join(f"{joint}: {position}" for joint, position in excesses.items())
        yield (f"the reference leaves the URDF's limits ({listed}): change the pose or the limits")


def _name_suspect_closures(robot: ParallelRobot, mobility: int) -> str:
    """Name closures without one of which the freedoms, now `mobility`, suffice for the platform's axes.

    Empty if the freedoms suffice, or without such closures.
    """
    if mobility >= robot.n:
        return ""
    names = []
    loops = joint_loops_matrix(robot, robot.reference.q)
    for closure in robot.description.closures:
        # rows are named CLOSURE.AXIS
        others = [k for k, name in enumerate(robot.rows.names) if not name.startswith(f"{closure.name}.")]
        rank = numerical_rank(loops[others]) if others else 0
        gained = len(robot.structure.independent) - rank  # freedoms gained without the closure
        if mobility + gained >= robot.n:
            names.append(closure.name)
    return f" (look at {', '.join(names)} first: without one of them the freedom is there)" if names else ""


@dataclass(frozen=True)
class Pose:
    """An assembled pose: angles [rad] with whole turns of hinges, slides [m]."""

    robot: str
    flexibility: str
    platform: dict[str, float]  # by axis
    motor_joints: dict[str, float]  # joint side of the gears
    motor_angles: dict[str, float]  # motor side: gear ratio times joint position
    joints: dict[str, float]  # all joints of the URDF, actuated ones included
    working_mode: int  # sign, which changes at Type 1
    assembly_mode: int  # sign, which changes at Type 2
    closure_error: float  # largest residual of all loop equations, redundant ones included [m or rad]
    exceeded: dict[str, str]  # joints beyond their limits in the URDF, with position and limit


def describe_pose(robot: ParallelRobot, q: ArrayLike) -> Pose:
    """Describe an assembled configuration q (nq,): coordinates by name, modes, exceeded limits.

    Raises:
        InvalidInput: q has the wrong length, is not finite, or leaves the loops open.
    """
    closed = assembled_at(robot, q)
    working_sign, assembly_sign = (int(sign[0]) for sign in mode_signs(robot, closed))
    motors = robot.actuated_coordinates(closed.q)[0]
    return Pose(
        robot=robot.name,
        flexibility=robot.flexibility,
        platform=dict(zip(robot.axis_names, closed.x[0].tolist(), strict=True)),
        motor_joints=dict(zip(robot.actuator_names, motors.tolist(), strict=True)),
        motor_angles=dict(zip(robot.actuator_names, (robot.gear_ratio * motors).tolist(), strict=True)),
        joints=robot.reference_values(closed.q[0]),
        working_mode=working_sign,
        assembly_mode=assembly_sign,
        closure_error=float(closed.gap[0]),
        exceeded=positions_beyond_limits(robot.limits, closed.q),
    )
