"""Planar mechanisms in Exudyn: bodies in redundant coordinates, joints by Lagrange multipliers.

J. Gerstmayr, "Exudyn - a C++-based Python package for flexible multibody systems", Multibody System
Dynamics 60, 2024, DOI 10.1007/s11044-023-09937-1. Bodies without mass keep a mass of exactly zero: what their
joints leave free is an algebraic unknown, found by the balance of forces in every step of the implicit
method. Nothing is regularised.

Forces are read at the end of each step, where the generalised-alpha method (in Newmark's form, index 3)
balances them. Its error falls with the square of the step.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

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
    SensorNode,
)

from framework.numerics import Array

exu.config.printToConsole = False  # a failure is an error, and no report in the figures' notebook
SPECTRAL_RADIUS = 0.9  # a little numerical damping, for the algebraic unknowns
NEWTON = 1e-10  # tolerance, relative and absolute; with 1e-12 Newton's method stalls on rounding
Body = tuple[Any, Any]  # object, node
Marker = Any
ANGLE = 2  # of the coordinates of a planar body


class Mechanism:
    """An Exudyn system under construction. Bodies are (object, node); points and coordinates are markers.

    The plane is horizontal.
    """

    def __init__(self) -> None:
        self.system = exu.SystemContainer().AddSystem()

    def ground(self, place: Sequence[float] | Array) -> Body:
        """A body that stays where it is; its x axis is that of the world."""
        return self.system.AddObject(ObjectGround(referencePosition=[*map(float, place), 0.0])), None

    def mass_point(self, mass: float, place: Sequence[float] | Array) -> Body:
        """A body with two coordinates, x and y [m]."""
        node = self.system.AddNode(NodePoint2D(referenceCoordinates=list(map(float, place))))
        return self.system.AddObject(ObjectMassPoint2D(mass=mass, nodeNumber=node)), node

    def link(self, mass: float, inertia: float, middle: Sequence[float] | Array, angle: float) -> Body:
        """A body with three coordinates; `middle` (2,) [m] is its centre of mass, `inertia` about it."""
        place = [*map(float, middle), float(angle)]
        node = self.system.AddNode(NodeRigidBody2D(referenceCoordinates=place))
        body = self.system.AddObject(ObjectRigidBody2D(nodeNumber=node, mass=mass, inertia=inertia))
        return body, node

    def point(self, body: Body, along: float = 0.0) -> Marker:
        """The point of a body `along` [m] its x axis from the centre of mass."""
        return self.system.AddMarker(MarkerBodyPosition(bodyNumber=body[0], localPosition=[along, 0, 0]))

    def pin(self, *points: Marker) -> None:
        """One point, free to turn."""
        self.system.AddObject(ObjectJointRevolute2D(markerNumbers=list(points)))

    def slide(self, body: Body, along: float, other: Body) -> None:
        """`other` keeps its angle to `body` and moves along its x axis through the point `along` [m]."""
        markers = [
            self.system.AddMarker(MarkerBodyRigid(bodyNumber=part[0], localPosition=[place, 0, 0]))
            for part, place in ((body, along), (other, 0.0))
        ]
        self.system.AddObject(ObjectJointPrismatic2D(markerNumbers=markers))

    def distance(self, points: Sequence[Marker], length: float) -> None:
        """A rigid rod without mass."""
        self.system.AddObject(ObjectConnectorDistance(markerNumbers=list(points), distance=length))

    def spring(self, points: Sequence[Marker], length: float, stiffness: float) -> None:
        """An elastic rod without mass, `length` [m] unloaded, `stiffness` [N/m]."""
        self.system.AddObject(
            ObjectConnectorSpringDamper(
                markerNumbers=list(points), referenceLength=length, stiffness=stiffness
            )
        )

    def coordinate(self, body: Body, number: int) -> Marker:
        """One of the coordinates of a body."""
        return self.system.AddMarker(MarkerNodeCoordinate(nodeNumber=body[1], coordinate=number))

    def rotor(self, inertia: float, driven: Marker, stiffness: float, speed: float) -> Marker:
        """A coordinate with inertia and a speed behind a spring to the coordinate `driven`."""
        node = self.system.AddNode(Node1D(referenceCoordinates=[0.0], initialVelocities=[speed]))
        self.system.AddObject(ObjectMass1D(mass=inertia, nodeNumber=node))
        turn = self.system.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
        self.system.AddObject(
            ObjectConnectorCoordinateSpringDamper(markerNumbers=[turn, driven], stiffness=stiffness)
        )
        return turn

    def drive(self, coordinate: Marker, forces: Array, step: float) -> None:
        """A motor: forces (steps + 1,) on a coordinate, one for the end of every step."""
        if not np.all(np.isfinite(forces)):
            raise ValueError("forces: must be finite at every step")
        table, per_step = forces.tolist(), 1 / step

        def force_at(_system: Any, t: float, _load: float) -> Any:
            return table[round(t * per_step)]

        self.system.AddLoad(LoadCoordinate(markerNumber=coordinate, loadUserFunction=force_at))

    def prepared(
        self, watched: Body, *, steps: int, duration: float, solver: str = "GeneralizedAlpha"
    ) -> Callable[[], tuple[Array, Array, float]]:
        """A run from the initial state: times (T,), displacements of the watched body (T, ...), time [s].

        `solver` is one of Exudyn's DynamicSolverType. Raises ArithmeticError when Exudyn gives up.
        """
        sensor = self.system.AddSensor(
            SensorNode(
                nodeNumber=watched[1],
                outputVariableType=exu.OutputVariableType.Coordinates,
                storeInternal=True,
                writeToFile=False,
            )
        )
        self.system.Assemble()
        settings = exu.SimulationSettings()
        integration = settings.timeIntegration
        integration.numberOfSteps = steps
        integration.endTime = duration
        integration.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
        integration.generalizedAlpha.computeInitialAccelerations = False  # of massless bodies: none
        integration.newton.relativeTolerance = NEWTON
        integration.newton.absoluteTolerance = NEWTON
        integration.newton.useModifiedNewton = True  # the Jacobian is kept while Newton converges
        integration.verboseMode = 0
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = duration / steps

        def run() -> tuple[Array, Array, float]:
            began = time.perf_counter()
            try:
                self.system.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, solver))
            except (exu.SolverError, exu.InternalError) as failure:
                raise ArithmeticError(f"Exudyn, step {duration / steps} s: {failure}") from None
            seconds = time.perf_counter() - began
            rows = np.asarray(self.system.GetSensorStoredData(sensor), dtype=float)
            return rows[:, 0], rows[:, 1:], seconds

        return run
