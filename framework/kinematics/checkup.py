"""What a robot looks like before anything is planned: mobility, rank, masses, closure, mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.kinematics.assembly import independent_rows, reference_configuration
from framework.kinematics.inverse_kinematics import mode_signs, moving_columns, reference_system
from framework.kinematics.singularity import passive_matrix
from framework.model import ParallelRobot


@dataclass(frozen=True)
class Checkup:
    """Findings on one robot; `advice` says what to do about what is wrong or remarkable."""

    robot: str
    flexibility: str
    platform_axes: tuple[str, ...]
    actuators: tuple[str, ...]
    passive_joints: tuple[str, ...]
    springs: tuple[str, ...]
    mobility: int  # with all springs locked
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
    smallest_singular_value: float  # of P, without dimension
    square: bool  # platform axes, actuators and mobility agree
    advice: tuple[str, ...]


def check_robot(robot: ParallelRobot) -> Checkup:
    """Examine a robot at its assembled reference.

    Raises:
        NotAssembled: the loops do not close near the reference.
    """
    reference = reference_configuration(robot)
    kept = independent_rows(robot)
    names = robot.rows.names
    mobility = len(moving_columns(robot)) - len(kept)
    square = robot.n == mobility <= robot.n_a
    system = reference_system(robot)
    working, assembly, smallest = 0, 0, float("nan")
    if square:
        working, assembly = (int(sign[0]) for sign in mode_signs(robot, system))
        smallest = float(np.linalg.svd(passive_matrix(robot, system)[0], compute_uv=False)[-1])
    masses = _link_masses(robot)
    massless = tuple(name for name, mass in masses.items() if mass == 0.0)
    advice = []
    if not square:
        advice.append(
            f"{robot.n} platform axes, {robot.n_a} actuators and {mobility} degrees of freedom differ: "
            f"planning needs them equal; change platform axes, actuators or closures"
        )
    if sum(masses.values()) == 0.0:
        advice.append("no link has a mass: all torques will be those of the rotors; add <inertial>")
    if square and smallest < 1e-6:
        advice.append("the reference is itself singular; give one away from the locus")
    return Checkup(
        robot=robot.name,
        flexibility=robot.flexibility,
        platform_axes=robot.axis_names,
        actuators=robot.actuator_names,
        passive_joints=tuple(robot.joint_of(int(column)) for column in robot.passive),
        springs=robot.elastic_names,
        mobility=mobility,
        loop_equations=len(names),
        rank=len(kept),
        redundant_rows=tuple(name for i, name in enumerate(names) if i not in kept),
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


def _link_masses(robot: ParallelRobot) -> dict[str, float]:
    """Mass [kg] of what each moving joint carries, under the joint's name."""
    model = ParallelRobot.from_description(robot.description).model  # springs part a joint from its mass
    return {str(model.names[j]): float(model.inertias[j].mass) for j in range(1, model.njoints)}
