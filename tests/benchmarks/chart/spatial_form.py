"""The delta and the Gough-Stewart platform without mass in their legs, by virtual work in mpmath.

Nothing of the framework. A row of P is what the platform's twist does to the length of a leg, P x' = D q', so
that the motors' forces are g = D y with P' y = W, and W the force (and moment) that the platform's motion
asks: singular where P is. Accelerations of motors and the change of angular momentum are mpmath's own
derivatives. Dimensions: Williams 2015 and The MathWorks 1998-2003, as robots/generators quotes them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from typing import Any

import mpmath
import numpy as np
from mpmath import mp, mpf

from framework.arrays import Array
from tests.benchmarks.chart import closed_form

DIGITS = 40
Number = Any  # mpmath's

Geometry = Callable[[Number], tuple[Any, list[Number], list[Number]]]  # s -> P, D, motor coordinates


@dataclass(frozen=True)
class SpatialCrossing:
    """A motion along a line from rest to rest through one singular point, at a chosen instant and speed.

    geometry: P (n, n), D (n,) and the motors' coordinates at s.
    wrench: what the platform's motion asks (n,), of a function of time s(t), at t.
    near: two places about the singular point.
    """

    geometry: Geometry
    wrench: Callable[[Callable[[Number], Number], Number], Any]
    gear: str
    rotor: str
    duration: str
    time: str
    speed: str
    near: tuple[str, str]

    @cached_property
    def s_c(self) -> Number:
        with mp.workdps(DIGITS):
            return mpmath.findroot(
                lambda s: mpmath.det(self.geometry(s)[0]), tuple(mpf(s) for s in self.near), solver="secant"
            )

    @cached_property
    def at_crossing(self) -> tuple[Number, Number, Number]:
        """s, s' and s" there: condition (8), t_s' W = 0 with P t_s = 0, is linear in s"."""
        with mp.workdps(DIGITS):
            speed, twist = mpf(self.speed), _null(self.geometry(self.s_c)[0])

            def left(dds: int) -> Number:
                asked = self.wrench(lambda t: self.s_c + speed * t + dds * t**2 / 2, mpf(0))
                return mpmath.fdot(twist, asked)

            return self.s_c, speed, -left(0) / (left(1) - left(0))

    @cached_property
    def powers(self) -> list[Number]:
        """Of the law of degree 8 (ascending)."""
        inner = [Decimal(mpmath.nstr(value, DIGITS)) for value in self.at_crossing]
        rest = [Decimal(0)] * 2
        series = closed_form.polynomial(
            [
                (Decimal(0), [Decimal(0), *rest]),
                (Decimal(self.duration), [Decimal(1), *rest]),
                (Decimal(self.time), inner),
            ]
        )
        return [mpf(str(value)) for value in series]

    def law(self, t: Number) -> Number:
        return mpmath.fsum(c * t**k for k, c in enumerate(self.powers))

    def torque(self, times: Sequence[float] | Array) -> Array:
        """Motor torques (T, n) [N m]."""
        with mp.workdps(DIGITS):
            return np.array([self._torque(mpf(float(t))) for t in times])

    def _torque(self, t: Number) -> list[float]:
        slope, levers, motors = self.geometry(self.law(t))
        forces = mpmath.lu_solve(slope.T, self.wrench(self.law, t))
        gear, rotor = mpf(self.gear), mpf(self.rotor)
        accelerations = [
            mpmath.diff(lambda at, k=k: self.geometry(self.law(at))[2][k], t, 2) for k in range(len(motors))
        ]
        return [
            float(rotor * gear * a + lever * y / gear)
            for a, lever, y in zip(accelerations, levers, forces, strict=True)
        ]


def _null(matrix: Any) -> list[Number]:
    """The null vector of a matrix of rank one less than its size."""
    size = matrix.rows
    part = mpmath.lu_solve(matrix[: size - 1, : size - 1], -matrix[: size - 1, size - 1])
    return [*part, mpf(1)]


def _line(start: Sequence[str], end: Sequence[str]) -> Callable[[Number], list[Number]]:
    pairs = [(mpf(a), mpf(b)) for a, b in zip(start, end, strict=True)]
    return lambda s: [a + s * (b - a) for a, b in pairs]


def _delta() -> SpatialCrossing:
    """Scene `cross`: arms 2 and 3 outward, arm 1 folded inward."""
    base, platform, arm, rod = (mpf(size) for size in ("0.164", "0.044", "0.524", "1.244"))
    gravity, mass = mpf("9.81"), mpf("1.5")
    place = _line(("-0.15", "-0.05", "-1.15"), ("0.1", "0.05", "-0.8"))

    def geometry(s: Number) -> tuple[Any, list[Number], list[Number]]:
        x, y, z = place(s)
        rows, levers, motors = [], [], []
        for turn, side in ((0, 1), (1, -1), (-1, -1)):
            c, n = mpmath.cos(2 * mp.pi * turn / 3), mpmath.sin(2 * mp.pi * turn / 3)
            a, w = c * x + n * y + platform - base, c * y - n * x
            reach = mpmath.hypot(a, z)
            share = (a**2 + w**2 + z**2 + arm**2 - rod**2) / (2 * arm * reach)
            angle = -mpmath.atan2(z, a) + side * mpmath.acos(share)
            p, q, r = a - arm * mpmath.cos(angle), w, z + arm * mpmath.sin(angle)
            rows.append([c * p - n * q, n * p + c * q, r])
            levers.append(-arm * (p * mpmath.sin(angle) + r * mpmath.cos(angle)))
            motors.append(angle)
        return mpmath.matrix(rows), levers, motors

    def wrench(law: Callable[[Number], Number], t: Number) -> Any:
        x = [mpmath.diff(lambda at, k=k: place(law(at))[k], t, 2) for k in range(3)]
        return mpmath.matrix([mass * x[0], mass * x[1], mass * (x[2] + gravity)])

    return SpatialCrossing(geometry, wrench, "30", "1e-4", "0.8", "0.334", "1.66", ("0.52", "0.522"))


def _gough_stewart() -> SpatialCrossing:
    """Scene `turn`: a quarter turn about the vertical while the platform comes down."""
    gravity = mpf("9.81")
    mass = mpf("76000") / gravity * mp.pi * mpf("0.05")
    moments = [mass * (3 + mpf("0.05") ** 2) / 12] * 2 + [mass / 2]
    place = _line(("0.1", "0", "2.5", "0.1", "-0.05", "1.3"), ("-0.05", "0.1", "1.3", "-0.1", "0.15", "1.9"))

    def ring(radius: int, degrees: Sequence[str]) -> list[Any]:
        angles = [mpf(value) * mp.pi / 180 for value in degrees]
        return [mpmath.matrix([radius * mpmath.cos(a), radius * mpmath.sin(a), 0]) for a in angles]

    feet = ring(3, ("-2.5", "2.5", "117.5", "122.5", "237.5", "242.5"))
    balls = ring(1, ("-50", "50", "70", "170", "190", "290"))

    def pose(s: Number) -> tuple[Any, Any]:
        x = place(s)
        a, b, c = x[3:]
        angle = mpmath.sqrt(a**2 + b**2 + c**2)
        spin = mpmath.matrix([[0, -c, b], [c, 0, -a], [-b, a, 0]]) / angle
        turn = mpmath.eye(3) + mpmath.sin(angle) * spin + (1 - mpmath.cos(angle)) * spin * spin
        return mpmath.matrix(x[:3]), turn

    def geometry(s: Number) -> tuple[Any, list[Number], list[Number]]:
        centre, turn = pose(s)
        rows, lengths = [], []
        for foot, ball in zip(feet, balls, strict=True):
            r = turn * ball
            leg = centre + r - foot
            length = mpmath.norm(leg)
            u = leg / length
            moment = [r[1] * u[2] - r[2] * u[1], r[2] * u[0] - r[0] * u[2], r[0] * u[1] - r[1] * u[0]]
            rows.append([*u, *moment])
            lengths.append(length)
        return mpmath.matrix(rows), [mpf(1)] * 6, lengths

    def momentum(law: Callable[[Number], Number], t: Number) -> list[Number]:
        turn = pose(law(t))[1]
        rate = mpmath.matrix(3, 3)
        for i in range(3):
            for j in range(3):
                rate[i, j] = mpmath.diff(lambda at, i=i, j=j: pose(law(at))[1][i, j], t)
        spin = rate * turn.T
        body = turn.T * mpmath.matrix([spin[2, 1], spin[0, 2], spin[1, 0]])
        return list(turn * mpmath.matrix([m * w for m, w in zip(moments, body, strict=True)]))

    def wrench(law: Callable[[Number], Number], t: Number) -> Any:
        a = [mpmath.diff(lambda at, k=k: place(law(at))[k], t, 2) for k in range(3)]
        moment = [mpmath.diff(lambda at, k=k: momentum(law, at)[k], t) for k in range(3)]
        return mpmath.matrix([mass * a[0], mass * a[1], mass * (a[2] + gravity), *moment])

    return SpatialCrossing(geometry, wrench, "314.159265", "2e-3", "1", "0.533", "1.45", ("0.449", "0.451"))


def spatial_crossing(name: str) -> SpatialCrossing:
    """The crossing of a robot of the catalogue: delta or gough_stewart."""
    with mp.workdps(DIGITS):
        return {"delta": _delta, "gough_stewart": _gough_stewart}[name]()
