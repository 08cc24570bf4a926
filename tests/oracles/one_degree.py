"""Closed form of any linkage with one degree of freedom, in mpmath: Lagrange's equation in one coordinate.

x is the platform's coordinate, q(x) the motor's joint, J(x) the inertia of all bodies but the rotor and V(x)
their potential energy. Then

    F = J x" + J'/2 x'^2 + V'        joint force = F / q'        motor torque = I n q" + (joint force) / n

Where q' = 0 (Type 2) the motor has no hold and F must vanish; the quotient there is taken as a limit.
"""

from collections.abc import Callable
from dataclasses import dataclass

import mpmath as mp
import numpy as np

DIGITS = 60
ASIDE = mp.mpf(10) ** -12  # [s] from the crossing, where the limit is taken; its mistake is as small
Function = Callable[[mp.mpf], mp.mpf]


@dataclass(frozen=True)
class OneDegree:
    """A linkage: functions of x, gear ratio n [1, or rad/m] and rotor inertia I [kg m^2]."""

    joint: Function  # q(x) [rad, m]
    inertia: Function  # J(x) [kg m^2]
    potential: Function  # V(x) [J]
    gear_ratio: mp.mpf
    rotor_inertia: mp.mpf

    def singular_point(self, near: float) -> mp.mpf:
        """Root of q'(x)."""
        return mp.findroot(lambda x: mp.diff(self.joint, x), mp.mpf(near))

    def acceleration(self, x: mp.mpf, rate: mp.mpf) -> mp.mpf:
        """The x" that needs no motor at x."""
        return -(mp.diff(self.inertia, x) / 2 * rate**2 + mp.diff(self.potential, x)) / self.inertia(x)


@dataclass(frozen=True)
class Crossing:
    """A straight path x = start + s (end - start) crossed at `time` with s' = `speed`, from rest to rest."""

    linkage: OneDegree
    start: mp.mpf
    end: mp.mpf
    s: mp.mpf  # of the singular point
    time: mp.mpf
    coefficients: list[mp.mpf]  # of s(t), powers of t

    def x(self, t: mp.mpf, order: int = 0) -> mp.mpf:
        """x or its derivatives at t."""
        s = law_value(self.coefficients, t, order)
        return s * (self.end - self.start) + (self.start if order == 0 else 0)

    def joint_force(self, t: mp.mpf) -> mp.mpf:
        """Force of the motor on its joint, rotor excluded [N m, N]."""
        x, dx, ddx = (self.x(t, order) for order in range(3))
        there = self.linkage
        force = there.inertia(x) * ddx + mp.diff(there.inertia, x) / 2 * dx**2 + mp.diff(there.potential, x)
        return force / mp.diff(there.joint, x)

    def _beside(self, t: float) -> mp.mpf:
        return mp.mpf(t) + (ASIDE if mp.mpf(t) == self.time else 0)

    def torque(self, t: float) -> float:
        """Motor torque of the rigid linkage [N m]."""
        with mp.workdps(DIGITS):
            at, there = self._beside(t), self.linkage
            x, dx, ddx = (self.x(at, order) for order in range(3))
            ddq = mp.diff(there.joint, x) * ddx + mp.diff(there.joint, x, 2) * dx**2
            rotor = there.rotor_inertia * there.gear_ratio * ddq
            return float(rotor + self.joint_force(at) / there.gear_ratio)

    def torque_behind_spring(self, t: float, stiffness: float) -> tuple[float, float]:
        """Motor torque [N m] and deflection [rad, m] with a spring between the motor and its joint."""
        with mp.workdps(DIGITS):
            at, there = self._beside(t), self.linkage

            def motor(u: mp.mpf) -> mp.mpf:
                return there.joint(self.x(u)) + self.joint_force(u) / mp.mpf(stiffness)

            force = self.joint_force(at)
            rotor = there.rotor_inertia * there.gear_ratio * mp.diff(motor, at, 2)
            return float(rotor + force / there.gear_ratio), float(-force / mp.mpf(stiffness))


def crossing(
    linkage: OneDegree, *, ends: tuple[float, float], near: float, duration: float, time: float, speed: float,
    smoothness: int,
) -> Crossing:  # fmt: skip
    """The law of least degree with `smoothness` zero derivatives at both ends that crosses with no motor."""
    with mp.workdps(DIGITS):
        start, end = map(mp.mpf, ends)
        x = linkage.singular_point(near)
        s, rate = (x - start) / (end - start), mp.mpf(speed) * (end - start)
        curve = linkage.acceleration(x, rate) / (end - start)
        coefficients = law_powers(duration, smoothness, [(time, 0, s), (time, 1, speed), (time, 2, curve)])
        return Crossing(linkage, start, end, s, mp.mpf(time), coefficients)


def law_powers(duration: float, smoothness: int, inner: list[tuple]) -> list[mp.mpf]:
    """Powers of t of the law s(t) of least degree from 0 to 1, from rest to rest, under inner conditions.

    A condition is (t, order, value); `smoothness` derivatives vanish at both ends.
    """
    ends = [(t, k, t > 0 and k == 0) for t in (0, duration) for k in range(smoothness + 1)]
    asked = [(mp.mpf(t), k, mp.mpf(value)) for t, k, value in [*ends, *inner]]
    rows = mp.matrix(len(asked), len(asked))
    for i, (t, k, _) in enumerate(asked):
        for p in range(k, len(asked)):
            rows[i, p] = mp.ff(p, k) * t ** (p - k)
    return list(mp.lu_solve(rows, mp.matrix([value for *_, value in asked])))


def law_value(powers: list[mp.mpf], t: mp.mpf, order: int = 0) -> mp.mpf:
    """s(t) or one of its derivatives."""
    return mp.fsum(c * mp.ff(p, order) * t ** (p - order) for p, c in enumerate(powers) if p >= order)


def instants(duration: float, time: float, count: int = 12) -> np.ndarray:
    """Some instants of the motion [s], the crossing among them and close to it."""
    return np.sort(np.append(np.linspace(0.02, 0.98, count) * duration, [time - 1e-3, time, time + 1e-6]))
