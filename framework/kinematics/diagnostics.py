"""What a robot looks like before anything is planned: mobility, rank, masses, closure, mode."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from framework.kinematics.assembly import (
    idle_columns,
    independent_at_reference,
    independent_rows,
    nearby_configurations,
    passive_columns,
    reference_configuration,
    rows_of_springs_alone,
    singular_reference,
)
from framework.kinematics.inverse_kinematics import mode_signs, moving_columns, reference_system
from framework.kinematics.joint_limits import positions_beyond_limits
from framework.kinematics.loop_matrices import passive_matrix
from framework.model import ParallelRobot


@dataclass(frozen=True)
class Checkup:
    """Findings on one robot; `advice` says what to do about what is wrong or remarkable."""

    robot: str
    flexibility: str
    platform_axes: tuple[str, ...]
    actuators: tuple[str, ...]
    passive_joints: tuple[str, ...]
    idle_joints: tuple[str, ...]  # passive joints held still because their motion moves nothing
    springs: tuple[str, ...]
    mobility: int  # with all springs locked, without the idle joints
    redundant_motors: int  # actuators beyond the mobility
    loop_equations: int
    rank: int
    redundant_rows: tuple[str, ...]  # closure.axis
    mass: float  # [kg]
    massless_joints: tuple[str, ...]  # joints that carry no mass of their own
    closure_error: float  # [m or rad] at the reference
    reference: dict[str, float]  # joint angles of the assembled reference [rad, m]
    platform: tuple[float, ...]
    working_mode: int  # sign; changes at Type 1
    assembly_mode: int  # sign; changes at Type 2
    smallest_singular_value: float | None  # of P, without dimension; None without square A or passive joints
    square: bool  # as many platform axes as degrees of freedom, and no fewer actuators
    advice: tuple[str, ...]


def check_robot(robot: ParallelRobot) -> Checkup:
    """Examine a robot at its assembled reference, or beside it where that is on a singularity of its loops.

    Raises:
        NotAssembled: the loops do not close near the reference.
        SingularReference: they are nearly singular there and beside it, too.
    """
    singular = singular_reference(robot)
    if singular is not None:
        moved = replace(robot, q_near=nearby_configurations(robot)[0])
        if singular_reference(moved) is not None:
            raise singular
        beside = check_robot(moved)
        return replace(beside, advice=(f"said of a pose beside the reference: {singular}", *beside.advice))
    reference = reference_configuration(robot)
    kept = independent_rows(robot)
    names = robot.rows.names
    mobility = len(moving_columns(robot)) - len(kept)
    square = robot.n == mobility <= robot.n_a
    system = reference_system(robot)
    working, assembly, smallest = 0, 0, None
    if square:
        working, assembly = (int(sign[0]) for sign in mode_signs(robot, system))
        values = np.linalg.svd(passive_matrix(robot, system)[0], compute_uv=False)
        smallest = float(values[-1]) if len(values) else None
    masses = _link_masses(robot)
    massless = tuple(name for name, mass in masses.items() if mass == 0.0)
    idle = tuple(robot.joint_of(int(column)) for column in idle_columns(robot))
    redundant = tuple(name for i, name in enumerate(names) if i not in kept)
    advice = _advice(robot, mobility, idle, redundant, masses)
    beyond = positions_beyond_limits(robot, reference.q[None])
    if beyond:
        listed = "; ".join(f"{joint}: {position}" for joint, position in beyond.items())
        advice.append(f"the reference leaves the URDF's limits ({listed}): change the pose or the limits")
    if smallest is not None and smallest < 1e-6:
        advice.append("the reference is itself singular: give one away from the locus")
    return Checkup(
        robot=robot.name,
        flexibility=robot.flexibility,
        platform_axes=robot.axis_names,
        actuators=robot.actuator_names,
        passive_joints=tuple(robot.joint_of(int(column)) for column in passive_columns(robot)),
        idle_joints=idle,
        springs=robot.elastic_names,
        mobility=mobility,
        redundant_motors=max(robot.n_a - mobility, 0),
        loop_equations=len(names),
        rank=len(kept),
        redundant_rows=redundant,
        mass=float(sum(masses.values())),
        massless_joints=massless,
        closure_error=reference.residual,
        reference={
            robot.joint_of(column): float(value)
            for column, value in enumerate(reference.q)
            if column not in robot.elastic
        },
        platform=tuple(map(float, reference.x)),
        working_mode=working,
        assembly_mode=assembly,
        smallest_singular_value=smallest,
        square=square,
        advice=tuple(advice),
    )


def _advice(
    robot: ParallelRobot,
    mobility: int,
    idle: tuple[str, ...],
    redundant: tuple[str, ...],
    masses: dict[str, float],
) -> list[str]:
    """What is wrong or remarkable about a robot, each with what to do."""
    found = []
    if robot.n != mobility:
        found.append(
            f"{robot.n} platform axes for {mobility} degrees of freedom: planning needs as many; change the "
            f"platform's axes or the closures{_suspects(robot, mobility)}"
        )
    if robot.n_a < mobility:
        found.append(
            f"{robot.n_a} actuators for {mobility} degrees of freedom: nothing holds the rest; add actuators"
        )
    if robot.n_a > mobility:
        found.append(
            f"{robot.n_a} actuators for {mobility} degrees of freedom: torques will be those of least norm; "
            f"drop actuators if that is not meant"
        )
    if idle:
        found.append(
            f"{', '.join(idle)} may turn without moving anything else and is held still: fine if what it "
            f"turns is balanced about it; else lock it by a closure"
        )
    if redundant:
        found.append(
            f"{', '.join(redundant)}: other loop equations say the same at the reference, as it should be in "
            f"a planar or overconstrained mechanism; where they are needed elsewhere, lock only what it "
            f"takes (axes: [...])"
        )
    alone = rows_of_springs_alone(robot)
    if alone:
        found.append(
            f"{', '.join(alone)} can only be closed by springs, which planning refuses: lock fewer axes "
            f"there (axes: [...]) or leave those axes out of the springs' motion"
        )
    if "<dynamics" in robot.description.urdf_text:
        found.append("damping and friction of the URDF (<dynamics>) are not part of the torques")
    if sum(masses.values()) == 0.0:
        found.append("no link has a mass: all torques will be those of the rotors; add <inertial>")
    heaviest = max(masses.values(), default=0.0)
    for name, mass in masses.items():
        if 0 < mass < 1e-6 * heaviest:
            found.append(
                f"what {name} carries weighs {mass:g} kg, a millionth of the heaviest part: is it in the "
                f"wrong unit? Leave <inertial> out for a massless part"
            )
    if heaviest > 1e5:
        found.append(f"a part weighs {heaviest:g} kg: masses are in kg; check the URDF's unit")
    return found


def _suspects(robot: ParallelRobot, mobility: int) -> str:
    """The closures without any one of which the platform would have as many axes as freedoms."""
    if mobility >= robot.n:
        return ""
    found = []
    for closure in robot.description.closures:
        others = [k for k, name in enumerate(robot.rows.names) if not name.startswith(f"{closure.name}.")]
        without = replace(robot, rows=robot.rows.take(np.array(others, dtype=np.intp)))
        rank = len(independent_at_reference(without)) if others else 0
        if mobility + len(independent_rows(robot)) - rank >= robot.n:
            found.append(closure.name)
    return f" (look at {', '.join(found)} first: without one of them the freedom is there)" if found else ""


def _link_masses(robot: ParallelRobot) -> dict[str, float]:
    """Mass [kg] of what each moving joint carries, under the joint's name."""
    model = ParallelRobot.from_description(robot.description).model  # springs part a joint from its mass
    return {str(model.names[j]): float(model.inertias[j].mass) for j in range(1, model.njoints)}
