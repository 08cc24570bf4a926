"""The 5R in Exudyn, motors driven by torques. Without mass

- a rod is what it is in the paper: a spring, or a constant distance, between elbow and payload;
- a crank behind an elastic drive keeps a mass of zero, and its angle is an algebraic unknown; a rigid drive
  gives it the rotor's inertia.

With mass, rods are rigid bodies too; an elastic one has a massless slider at its tip.
"""

from collections.abc import Callable

import numpy as np

from framework.numerics import Array
from tests.benchmarks.chart.peers.exudyn_parts import ANGLE, Body, Marker, Mechanism
from tests.benchmarks.chart.peers.five_bar import GEAR_RATIO, FiveBar, Run, start_angles


def prepared(
    robot: FiveBar,
    torque: Callable[[Array], Array],
    start: Array,
    *,
    step: float,
    duration: float,
    solver: str = "GeneralizedAlpha",
    rotor_speeds: tuple[float, float] = (0.0, 0.0),
) -> Callable[[], Run]:
    """A run under motor torques from rest at `start` (2,) [m], with system and loads made ready.

    `torque` maps times (T,) [s] to torques (T, 2) [N m] on the motor side; `step` [s] is made to divide
    the duration. `solver`, and the ArithmeticError that is raised: as `Mechanism.prepared`.
    `rotor_speeds` [rad/s], on the joint side, are those of the rotors of elastic drives at the start.
    """
    steps = round(duration / step)
    step = duration / steps
    joint_torque = GEAR_RATIO * torque(np.linspace(0.0, duration, steps + 1))  # (steps + 1, 2)
    mechanism, payload, motors = _assemble(robot, start, rotor_speeds)
    for leg, motor in enumerate(motors):
        mechanism.drive(motor, joint_torque[:, leg], step)
    solve = mechanism.prepared(payload, steps=steps, duration=duration, solver=solver)

    def run() -> Run:
        times, moved, seconds = solve()
        return Run(times, start + moved, seconds)

    return run


def _assemble(
    robot: FiveBar, start: Array, rotor_speeds: tuple[float, float]
) -> tuple[Mechanism, Body, list[Marker]]:
    """The mechanism, its payload, and the coordinates of its motors."""
    mechanism = Mechanism()
    payload = mechanism.mass_point(robot.payload, start)
    motors = []
    for leg, angles in enumerate(start_angles(np.asarray(start) / robot.size)):
        crank, motor = _crank(mechanism, robot, leg, angles[0], rotor_speeds[leg])
        _rod(mechanism, robot, crank, payload, leg, angles)
        motors.append(motor)
    return mechanism, payload, motors


def _half(length: float, angle: float) -> Array:
    return np.array([0.5 * length * np.cos(angle), 0.5 * length * np.sin(angle)])


def _crank(
    mechanism: Mechanism, robot: FiveBar, leg: int, angle: float, rotor_speed: float
) -> tuple[Body, Marker]:
    """The body of a crank, and the coordinate on which its motor acts."""
    foot = np.array([robot.bases[leg], 0.0])
    stiffness = robot.drive_stiffness
    inertia = robot.link_mass * robot.length**2 / 12 + (robot.rotor_inertia if stiffness is None else 0.0)
    crank = mechanism.link(robot.link_mass, inertia, foot + _half(robot.length, angle), angle)
    mechanism.pin(mechanism.point(mechanism.ground(foot)), mechanism.point(crank, -robot.length / 2))
    turn = mechanism.coordinate(crank, ANGLE)
    if stiffness is None:
        return crank, turn
    return crank, mechanism.rotor(robot.rotor_inertia, turn, stiffness, rotor_speed)


def _rod(mechanism: Mechanism, robot: FiveBar, crank: Body, payload: Body, leg: int, angles: Array) -> None:
    elbow, tip = mechanism.point(crank, robot.length / 2), mechanism.point(payload)
    if robot.rod_stiffness is not None:
        mechanism.spring([elbow, tip], robot.length, robot.rod_stiffness)
    if robot.link_mass > 0:
        start = np.array([robot.bases[leg], 0.0]) + 2 * _half(robot.length, angles[0])
        inertia = robot.link_mass * robot.length**2 / 12
        rod = mechanism.link(robot.link_mass, inertia, start + _half(robot.length, angles[1]), angles[1])
        mechanism.pin(elbow, mechanism.point(rod, -robot.length / 2))
        end = mechanism.point(rod, robot.length / 2)
        if robot.rod_stiffness is not None:
            slider = mechanism.link(0.0, 0.0, start + 2 * _half(robot.length, angles[1]), angles[1])
            mechanism.slide(rod, robot.length / 2, slider)
            end = mechanism.point(slider)
        mechanism.pin(end, tip)
    elif robot.rod_stiffness is None:
        mechanism.distance([elbow, tip], robot.length)
