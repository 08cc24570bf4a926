"""Pinocchio's own constraint dynamics of the 5R, turned round: which torques give the planned acceleration.

`constraintDynamics` gives the accelerations of all joints under motor torques, with the loop as a contact of
two points. They are affine in the torques: at each instant three calls, without torque and with each motor's
unit torque, make the 2 x 2 system for the torques. As its mass matrix has to be regular, one half of the
payload is on each tip, which is the same robot while the tips coincide, and the rotors are armatures.
"""

import numpy as np
import pinocchio as pin

from framework import ParallelRobot
from framework.numerics import Array
from tests.benchmarks.chart.bare import solve_each
from tests.benchmarks.chart.peers.five_bar import GEAR_RATIO, PAYLOAD, ROTOR_INERTIA

# absolute and relative accuracy, regularisation and iterations: the loop of a planar robot in space has a
# redundant row, without regularisation the result is not a number
PROXIMAL = (1e-12, 1e-12, 1e-8, 20)


class ConstraintDynamics:
    """The 5R with its loop as one of Pinocchio's constraints."""

    def __init__(self, robot: ParallelRobot) -> None:
        (closure,) = robot.description.closures
        self.model, self.motors = robot.model.copy(), np.array(robot.actuated)
        frames = [self.model.frames[self.model.getFrameId(name)] for name in closure.frames]
        for frame in frames:
            half = pin.Inertia(PAYLOAD / 2, np.zeros(3), np.zeros((3, 3)))
            self.model.inertias[frame.parentJoint] = frame.placement.act(half)
        armature = self.model.armature.copy()
        armature[self.motors] = ROTOR_INERTIA
        self.model.armature = armature
        self.data = self.model.createData()
        one, other = ((frame.parentJoint, frame.placement) for frame in frames)
        contact = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self.model, *one, *other, pin.LOCAL)
        self.contacts = pin.StdVec_RigidConstraintModel()
        self.contacts.append(contact)
        self.contact_data = pin.StdVec_RigidConstraintData()
        self.contact_data.append(contact.createData())
        pin.initConstraintDynamics(self.model, self.data, self.contacts, self.contact_data)

    def torques(self, q: Array, v: Array, a: Array) -> Array:
        """Motor torques (T, 2) [N m], motor side, along a motion q, v, a (T, nv)."""
        units = np.zeros((3, self.model.nv))
        units[[1, 2], self.motors] = GEAR_RATIO
        found = np.array([[self._motors(*state, unit) for unit in units] for state in zip(q, v, strict=True)])
        gains = found[:, 1:] - found[:, :1]  # (T, 2, 2): a row of accelerations for each motor's unit torque
        return solve_each(gains.swapaxes(1, 2), a[:, self.motors] - found[:, 0])

    def _motors(self, q: Array, v: Array, torque: Array) -> Array:
        """Accelerations (2,) of the motors' joints under generalised forces (nv,)."""
        settings = pin.ProximalSettings(*PROXIMAL)
        a = pin.constraintDynamics(
            self.model, self.data, q, v, torque, self.contacts, self.contact_data, settings
        )
        return np.asarray(a[self.motors])
