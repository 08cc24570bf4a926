"""The 5R in Exudyn: planar bodies in redundant coordinates, motors driven by torques.

J. Gerstmayr, "Exudyn - a C++-based Python package for flexible multibody systems", Multibody System
Dynamics 60, 2024, DOI 10.1007/s11044-023-09937-1. Every crank is a rigid body with three coordinates held
by a revolute joint, the payload a point mass; the joints enter by Lagrange multipliers. Without mass

- a rod is what it is in the paper: a spring, or a constant distance, between elbow and payload;
- a crank keeps a mass of exactly zero. Its angle is then an algebraic unknown, found by the balance of
  drive spring and rod force in every step of the implicit generalised-alpha method: nothing is regularised.
  A rigid drive gives the crank the rotor's inertia instead.

With mass, the rods are rigid bodies as well. The torque is read at the end of each step, where this
method (in Newmark's form, index 3) balances the forces; its error falls with the square of the step.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    LoadCoordinate,
    MarkerBodyPosition,
    MarkerBodyRigid,
    MarkerNodeCoordinate,
    Node1D,
    NodePoint2D,
    NodeRigidBody2D,
    ObjectConnectorCoordinateSpringDamper,
    ObjectConnectorDistance,
    ObjectConnectorSpringDamper,
    ObjectGround,
    ObjectJointPrismatic2D,
    ObjectJointRevolute2D,
    ObjectMass1D,
    ObjectMassPoint2D,
    ObjectRigidBody2D,
    SensorMarker,
)

from tests.witness.five_bar import (
    BASES,
    GEAR_RATIO,
    LENGTH,
    PAYLOAD,
    ROTOR_INERTIA,
    FiveBar,
    Run,
    start_angles,
)

SPECTRAL_RADIUS = 0.9  # a little numerical damping, for the algebraic unknowns
NEWTON = 1e-10  # tolerance, relative and absolute; with 1e-12 Newton's method stalls on rounding
ANGLE = 2  # number of the angle among the coordinates x, y, angle of a planar body


def simulate(
    robot: FiveBar,
    torque: Callable[[np.ndarray], np.ndarray],
    start,
    *,
    step: float,
    duration: float,
    solver: str = "GeneralizedAlpha",
) -> Run:
    """Drive the robot by motor torques from rest at `start` (2,) [m].

    `torque` maps times (T,) [s] to torques (T, 2) [N m] on the motor side; `step` [s] is made to divide
    the duration. `solver` is one of Exudyn's DynamicSolverType. Raises ArithmeticError when Exudyn gives up.
    """
    steps = round(duration / step)
    step = duration / steps
    joint_torque = GEAR_RATIO * torque(step * np.arange(steps + 1))  # (steps + 1, 2)
    if not np.all(np.isfinite(joint_torque)):
        raise ValueError("torque: must be finite at every step")
    system = exu.SystemContainer().AddSystem()
    payload = _payload(system, start)
    angles = start_angles(start)
    for leg in range(2):
        crank, motor = _crank(system, robot, leg, angles[leg, 0])
        _rod(system, robot, crank, payload, leg, angles[leg])
        _drive(system, motor, joint_torque[:, leg].tolist(), step)
    place = system.AddSensor(
        SensorMarker(
            markerNumber=payload,
            outputVariableType=exu.OutputVariableType.Position,
            storeInternal=True,
            writeToFile=False,
        )
    )
    system.Assemble()
    settings = _settings(steps, duration)
    begun = time.perf_counter()
    try:
        system.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, solver))
    except exu.SolverError as failure:
        raise ArithmeticError(f"Exudyn, step {step} s: {failure}") from None
    seconds = time.perf_counter() - begun
    rows = system.GetSensorStoredData(place)  # (steps + 1, 4): time, x, y, z
    return Run(rows[:, 0], rows[:, 1:3], seconds)


def _settings(steps: int, duration: float):
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps = steps
    integration.endTime = duration
    integration.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
    integration.generalizedAlpha.computeInitialAccelerations = False  # at rest, and zero masses have none
    integration.newton.relativeTolerance = NEWTON
    integration.newton.absoluteTolerance = NEWTON
    integration.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = duration / steps
    return settings


def _point(system, body, along: float = 0.0):
    """A point of a body, `along` its x axis [m]."""
    return system.AddMarker(MarkerBodyPosition(bodyNumber=body, localPosition=[along, 0, 0]))


def _payload(system, start):
    node = system.AddNode(NodePoint2D(referenceCoordinates=list(map(float, start))))
    return _point(system, system.AddObject(ObjectMassPoint2D(mass=PAYLOAD, nodeNumber=node)))


def _link(system, mass: float, inertia: float, middle, angle: float):
    """A planar rigid body and its node; `middle` (2,) [m] is its centre of mass, `inertia` about it."""
    node = system.AddNode(NodeRigidBody2D(referenceCoordinates=[*map(float, middle), float(angle)]))
    return system.AddObject(ObjectRigidBody2D(nodeNumber=node, mass=mass, inertia=inertia)), node


def _half(angle: float) -> np.ndarray:
    return 0.5 * LENGTH * np.array([np.cos(angle), np.sin(angle)])


def _crank(system, robot: FiveBar, leg: int, angle: float):
    """The body of a crank, and the coordinate on which its motor acts."""
    foot = np.array([BASES[leg], 0.0])
    rigid_drive = robot.drive_stiffness is None
    inertia = robot.link_mass * LENGTH**2 / 12 + (ROTOR_INERTIA if rigid_drive else 0.0)
    crank, node = _link(system, robot.link_mass, inertia, foot + _half(angle), angle)
    base = system.AddObject(ObjectGround(referencePosition=[*foot, 0.0]))
    pins = [_point(system, base), _point(system, crank, -LENGTH / 2)]
    system.AddObject(ObjectJointRevolute2D(markerNumbers=pins))
    turn = system.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=ANGLE))
    if rigid_drive:
        return crank, turn
    shaft = system.AddNode(Node1D(referenceCoordinates=[angle]))
    system.AddObject(ObjectMass1D(mass=ROTOR_INERTIA, nodeNumber=shaft))
    rotor = system.AddMarker(MarkerNodeCoordinate(nodeNumber=shaft, coordinate=0))
    system.AddObject(
        ObjectConnectorCoordinateSpringDamper(markerNumbers=[rotor, turn], stiffness=robot.drive_stiffness)
    )
    return crank, rotor


def _rod(system, robot: FiveBar, crank, payload, leg: int, angles) -> None:
    elbow = _point(system, crank, LENGTH / 2)
    ends = [elbow, payload]
    if robot.rod_stiffness is not None:
        system.AddObject(
            ObjectConnectorSpringDamper(
                markerNumbers=ends, referenceLength=LENGTH, stiffness=robot.rod_stiffness
            )
        )
    if robot.link_mass > 0:
        _heavy_rod(system, robot, elbow, payload, leg, angles)
    elif robot.rod_stiffness is None:
        system.AddObject(ObjectConnectorDistance(markerNumbers=ends, distance=LENGTH))


def _heavy_rod(system, robot: FiveBar, elbow, payload, leg: int, angles) -> None:
    """A rigid body from the elbow on; an elastic one is that body with a massless slider at its tip."""
    start = np.array([BASES[leg], 0.0]) + 2 * _half(angles[0])
    inertia = robot.link_mass * LENGTH**2 / 12
    rod, _ = _link(system, robot.link_mass, inertia, start + _half(angles[1]), angles[1])
    pins = [[elbow, _point(system, rod, -LENGTH / 2)]]
    if robot.rod_stiffness is None:
        pins.append([_point(system, rod, LENGTH / 2), payload])
    else:
        slider, _ = _link(system, 0.0, 0.0, start + 2 * _half(angles[1]), angles[1])
        pins.append([_point(system, slider), payload])
        places = [(rod, LENGTH / 2), (slider, 0.0)]
        markers = [
            system.AddMarker(MarkerBodyRigid(bodyNumber=body, localPosition=[along, 0, 0]))
            for body, along in places
        ]
        system.AddObject(ObjectJointPrismatic2D(markerNumbers=markers))
    for pair in pins:
        system.AddObject(ObjectJointRevolute2D(markerNumbers=pair))


def _drive(system, motor, joint_torque: list[float], step: float) -> None:
    """A motor: the joint torque at the end of every step."""

    def torque_at(_system, t: float, _load: float) -> float:
        return joint_torque[round(t / step)]

    system.AddLoad(LoadCoordinate(markerNumber=motor, loadUserFunction=torque_at))
