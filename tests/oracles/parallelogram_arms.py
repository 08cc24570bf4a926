"""Arms on motors with parallelograms for forearms (delta, Par4): closed forms, analytic in the wrists."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

UP = np.array([0.0, 0.0, 1.0])


def arccos(c):
    """Also of a complex number near the real axis."""
    return np.arccos(c.real) - 1j * c.imag / np.sqrt(1 - c.real**2)


@dataclass(frozen=True)
class ParallelogramArms:
    """Legs that know neither rods nor hinges: the wrist p of each is on a sphere about its knee."""

    yaw: np.ndarray  # of the legs [rad]
    arm: float  # [m]
    rod: float  # [m]
    reach: float  # motor axes, as seen from a wrist at the origin [m]
    arm_mass: float  # [kg]
    arm_inertia: float  # about the motor, that of the rotor included [kg m^2]
    rod_mass: float  # of all rods of a leg [kg]
    rod_radius: float  # [m]
    elbow: np.ndarray | float = 1.0  # -1 where it is inward
    swung_inertia: float = 0.0  # about `side`, of what swings with the rods of a leg [kg m^2]

    @cached_property
    def out(self):
        return np.column_stack([np.cos(self.yaw), np.sin(self.yaw), 0 * self.yaw])

    @cached_property
    def side(self):
        return np.column_stack([-np.sin(self.yaw), np.cos(self.yaw), 0 * self.yaw])

    def motor_angles(self, p):
        """Inverse kinematics: |p - knee(q)| = rod for each leg, the elbow chosen."""
        out, side = np.sum(self.out * p, axis=1) - self.reach + 0j, np.sum(self.side * p, axis=1)
        z = p[..., 2] + 0j
        c = (out**2 + side**2 + z**2 + self.arm**2 - self.rod**2) / (2 * self.arm * np.sqrt(out**2 + z**2))
        square = out.real**2 + z.real**2
        lowered = np.arctan2(-z.real, out.real) + 1j * (z.real * out.imag - out.real * z.imag) / square
        return lowered - self.elbow * arccos(c)

    def knees(self, q):
        """Centres of the spheres on which the wrists lie (legs, 3)."""
        return (self.reach + self.arm * np.cos(q))[:, None] * self.out - (self.arm * np.sin(q))[:, None] * UP

    def knee_rates(self, q):
        return -self.arm * (np.sin(q)[:, None] * self.out + np.cos(q)[:, None] * UP)

    def forearms(self, p, q):
        """Unit vectors from knee to wrist (legs, 3)."""
        return (p - self.knees(q)) / self.rod

    def kinetic_energy(self, p, dp):
        """Of the arms, the rods and the rotors [J]."""
        q = self.motor_angles(p)
        n, slope = self.forearms(p, q), self.knee_rates(q)
        dq = np.sum(n * dp, axis=1) / np.sum(n * slope, axis=1)
        knee = dq[:, None] * slope
        dn = (dp - knee) / self.rod
        # a rod hangs in a universal joint: about `side`, then sideways
        lateral = np.sum(self.side * n, axis=1)
        flat, dflat = (np.column_stack([np.sum(self.out * u, axis=1), u[:, 2]]) for u in (n, dn))
        swing = (flat[:, 1] * dflat[:, 0] - flat[:, 0] * dflat[:, 1]) / (1 - lateral**2)
        spin = swing * lateral  # the part of the swing that is along the rod
        across = (3 * self.rod_radius**2 + self.rod**2) / 12 * np.sum(dn**2)
        along = self.rod_radius**2 / 2 * np.sum(spin**2)
        middle = np.sum((knee + 0.5 * self.rod * dn) ** 2)
        rods = 0.5 * self.rod_mass * (middle + across + along) + 0.5 * self.swung_inertia * np.sum(swing**2)
        return rods + 0.5 * self.arm_inertia * np.sum(dq**2)

    def potential_energy(self, p):
        knee = self.knees(self.motor_angles(p))[:, 2]
        return 9.81 * np.sum(0.5 * self.arm_mass * knee + 0.5 * self.rod_mass * (knee + p[..., 2]))


@dataclass(frozen=True)
class LevelPlatform:
    """A platform of three such legs, on which all wrists are one point x: the delta."""

    arms: ParallelogramArms
    mass: float  # [kg] of what moves with the platform

    def motor_angles(self, x):
        return self.arms.motor_angles(x).real

    def forearms(self, x):
        """Unit vectors from knee to platform (3, 3)."""
        return self.arms.forearms(x, self.motor_angles(x))

    def velocity_ratio(self, x):
        """dq/dx (3, 3): n . (v - knee rate) = 0 in each leg."""
        n = self.forearms(x)
        return n / np.sum(n * self.arms.knee_rates(self.motor_angles(x)), axis=1)[:, None]

    def kinetic_energy(self, x, dx):
        return 0.5 * self.mass * dx @ dx + self.arms.kinetic_energy(x, dx)

    def potential_energy(self, x):
        return 9.81 * self.mass * x[2] + self.arms.potential_energy(x)
