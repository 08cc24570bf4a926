"""Pinocchio's own constrained dynamics: the fastest way to accelerations, for robots that it supports.

Pinocchio supports loops that are points (spherical) or welds (fixed). It factorises the mass matrix of the
tree, which must be definite: every joint has to move some mass or a rotor. Its proximal iterations handle
redundant rows. Loops are pinocchio's own constraints at the frames of the robot file. Only rotors, springs
and damping come from `equations`, so this module also checks the loop equations independently.
Source: Carpentier, Budhiraja and Mansard 2021, "Proximal and sparse resolution of constrained dynamic
equations", Robotics: Science and Systems.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput
from framework.model.description import AXES
from framework.numerics.arrays import Array
from framework.simulation.equations import EquationsOfMotion
from framework.tolerances import RANK_ROUNDING

CONTACT_TYPES = {AXES[:3]: pin.ContactType.CONTACT_3D, AXES: pin.ContactType.CONTACT_6D}


@dataclass(frozen=True, eq=False)
class ContactDynamics:
    """A robot prepared for pinocchio's contact solver; one object serves one thread at a time."""

    model: pin.Model  # with rotors as armature
    data: pin.Data
    contacts: Any  # pin.StdVec_RigidConstraintModel
    contact_data: Any  # pin.StdVec_RigidConstraintData
    settings: pin.ProximalSettings
    stiffness: Array | None  # (nv,), None without springs
    rest: Array  # (nv,)
    damping: Array | None  # (nv,), None without damping

    def acceleration(self, q: Array, v: Array, force: Array) -> Array:
        """Compute joint accelerations (nv,) under applied forces (nv,), springs and damping."""
        if self.stiffness is not None:
            force = force - self.stiffness * (q - self.rest)
        if self.damping is not None:
            force = force - self.damping * v
        return pin.constraintDynamics(
            self.model, self.data, q, v, force, self.contacts, self.contact_data, self.settings
        )

    @staticmethod
    def of(equations: EquationsOfMotion, closing: float) -> ContactDynamics:
        """Prepare a robot; gaps of loops close with the time constant `closing` [s], critically damped.

        Raises:
            InvalidInput: a loop that is neither spherical nor fixed, a joint that moves no mass, or a joint
                with several degrees of freedom.
        """
        robot, rows = equations.robot, equations.robot.rows
        _check_contact_robot(equations)
        model = robot.model.copy()
        model.armature[:] += equations.rotors
        contacts, contact_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        # all rows of a closure, named CLOSURE.AXIS, have the same two frames, so any row identifies them
        row_of = {name.rpartition(".")[0]: row for row, name in enumerate(rows.names)}
        for closure in robot.description.closures:
            row = row_of[closure.name]
            first = model.frames[robot.frames[rows.first[row]]]
            second = model.frames[robot.frames[rows.second[row]]]
            contact = pin.RigidConstraintModel(
                CONTACT_TYPES[closure.axes],
                model,
                first.parentJoint,
                first.placement,
                second.parentJoint,
                second.placement,
                pin.ReferenceFrame.LOCAL,
            )
            gains = contact.m_baumgarte_parameters
            gains.Kp = 1 / closing**2
            gains.Kd = 2 / closing
            contacts.append(contact)
            contact_data.append(contact.createData())
        data = model.createData()
        pin.initConstraintDynamics(model, data, contacts, contact_data)
        return ContactDynamics(
            model=model,
            data=data,
            contacts=contacts,
            contact_data=contact_data,
            # with the default settings redundant rows, as of a planar loop described in space, give NaN
            settings=pin.ProximalSettings(accuracy=1e-12, mu=1e-8, max_iter=20),
            stiffness=equations.stiffness if equations.stiffness.any() else None,
            rest=robot.joint_rest,
            damping=equations.damping if equations.damping.any() else None,
        )


def _check_contact_robot(equations: EquationsOfMotion) -> None:
    """Raise InvalidInput for a robot that pinocchio's contact solver cannot treat."""
    robot = equations.robot
    others = [c.name for c in robot.description.closures if c.axes not in CONTACT_TYPES]
    others += [coupling.name for coupling in robot.description.couplings]
    if others:
        raise InvalidInput(
            f"{robot.name}: pinocchio's contact dynamics knows loops of kind spherical and fixed, "
            f"not {', '.join(others)}; use another method"
        )
    if robot.has_balls:
        raise InvalidInput(
            f"{robot.name}: pinocchio's contact dynamics is for joints of one degree of freedom"
        )
    mass = equations.tangent_at_rest(robot.reference.q).mass[0]
    inertias, motions = np.linalg.eigh(mass)  # ascending
    if inertias[0] <= RANK_ROUNDING * inertias[-1]:
        joint = robot.coordinates.name_of(int(np.argmax(np.abs(motions[:, 0]))))
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: {joint} moves no mass, and pinocchio's contact dynamics "
            f"divides by the mass matrix of the tree; use another method"
        )
