"""The delta, the Gough-Stewart platform and the 3-RPR without mass in their legs, by virtual work in mpmath.

Nothing of the framework. A row of P is what the platform's twist does to the length of a leg, P x' = D q', so
that the motors' forces are g = D y with P' y = W, and W the force (and moment) that the platform's motion
asks: singular where P is. Accelerations of motors and the change of angular momentum are mpmath's own
derivatives. Dimensions: Williams 2015, The MathWorks 1998-2003, and Innocenti and Parenti-Castelli 1998, as
robots/generators quotes them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import mpmath
import numpy as np
from mpmath import mp, mpf

DIGITS = 40
REST = 2  # derivatives of the law that vanish at both ends
Number = Any  # mpmath's
Place = Sequence[Number]  # coordinates of the platform
Motion = Callable[[Number], Place]  # of time


@dataclass(frozen=True)
class Machine:
    """A robot: P (n, n), D (n,) and the motors' coordinates at x; what a motion asks of the platform at t."""

    geometry: Callable[[Place], tuple[Any, list[Number], list[Number]]]
    wrench: Callable[[Motion, Number], Any]
    gear: str
    rotor: str

    def torque(self, motion: Motion, t: Number) -> list[Number]:
        """Motor torques (n,) [N m] of a motion at t."""
        slope, levers, motors = self.geometry(motion(t))
        forces = mpmath.lu_solve(slope.T, self.wrench(motion, t))
        gear, rotor = mpf(self.gear), mpf(self.rotor)
        accelerations = [
            mpmath.diff(lambda at, k=k: self.geometry(motion(at))[2][k], t, 2) for k in range(len(motors))
        ]
        return [
            rotor * gear * a + lever * y / gear
            for a, lever, y in zip(accelerations, levers, forces, strict=True)
        ]

    def slopes(self, x: np.ndarray, dx: np.ndarray, ddx: np.ndarray) -> np.ndarray:
        """Derivatives (n, 3 n) of the torques along x, x' and x", each (n,)."""
        with mp.workdps(DIGITS):
            state = [mpf(float(value)) for part in (x, dx, ddx) for value in part]
            n = len(x)

            def torque(state: Sequence[Number]) -> list[Number]:
                return self.torque(
                    lambda t: [state[k] + t * state[n + k] + t**2 / 2 * state[2 * n + k] for k in range(n)],
                    mpf(0),
                )

            def moved(column: int, by: Number) -> list[Number]:
                return torque([value + (by if k == column else 0) for k, value in enumerate(state)])

            h = mpf(10) ** -13  # its square is rounding to floats, and twice its inverse leaves 27 digits
            slopes = [
                [(a - b) / (2 * h) for a, b in zip(moved(k, h), moved(k, -h), strict=True)]
                for k in range(3 * n)
            ]
            return np.array(slopes, dtype=float).T


@dataclass(frozen=True)
class Crossings:
    """A motion along a line from rest to rest, through singular points at chosen instants and speeds.

    ends: of the platform. near: two places about each singular point. timing: [s], [1/s] at each.
    """

    machine: Machine
    ends: tuple[tuple[str, ...], tuple[str, ...]]
    duration: str
    near: tuple[tuple[str, str], ...]
    timing: tuple[tuple[str, str], ...]

    def on_line(self, s: Number) -> list[Number]:
        return [mpf(a) + s * (mpf(b) - mpf(a)) for a, b in zip(*self.ends, strict=True)]

    @cached_property
    def singular(self) -> list[Number]:
        """s of the singular points."""
        with mp.workdps(DIGITS):

            def determinant(s: Number) -> Number:
                return mpmath.det(self.machine.geometry(self.on_line(s))[0])

            return [
                mpmath.findroot(determinant, tuple(map(mpf, between)), solver="secant")
                for between in self.near
            ]

    @cached_property
    def conditions(self) -> list[tuple[Number, tuple[Number, Number, Number]]]:
        """Each instant with s, s' and s": condition (8), t_s' W = 0 with P t_s = 0, is linear in s"."""
        with mp.workdps(DIGITS):
            return [
                (mpf(time), self._condition(s_c, mpf(speed)))
                for s_c, (time, speed) in zip(self.singular, self.timing, strict=True)
            ]

    def _condition(self, s_c: Number, speed: Number) -> tuple[Number, Number, Number]:
        twist = _null(self.machine.geometry(self.on_line(s_c))[0])

        def left(dds: int) -> Number:
            motion = lambda t: self.on_line(s_c + speed * t + dds * t**2 / 2)  # noqa: E731
            return mpmath.fdot(twist, self.machine.wrench(motion, mpf(0)))

        return s_c, speed, -left(0) / (left(1) - left(0))

    @cached_property
    def powers(self) -> list[Number]:
        """Of the law of least degree (ascending)."""
        rest = [mpf(0)] * REST
        with mp.workdps(DIGITS):
            conditions = [(mpf(0), (mpf(0), *rest)), *self.conditions, (mpf(self.duration), (mpf(1), *rest))]
            asked = [(t, order, value) for t, values in conditions for order, value in enumerate(values)]
            rows = [[mpmath.ff(k, n) * t ** max(k - n, 0) for k in range(len(asked))] for t, n, _ in asked]
            return list(mpmath.lu_solve(mpmath.matrix(rows), [value for *_, value in asked]))

    def law(self, t: Number) -> Number:
        return mpmath.fsum(c * t**k for k, c in enumerate(self.powers))

    def torque(self, times: Sequence[float] | np.ndarray) -> np.ndarray:
        """Motor torques (T, n) [N m]."""
        with mp.workdps(DIGITS):
            found = [self.machine.torque(lambda t: self.on_line(self.law(t)), mpf(float(t))) for t in times]
            return np.array(found, dtype=float)


def _null(matrix: Any) -> list[Number]:
    """The null vector of a matrix of rank one less than its size."""
    size = matrix.rows
    part = mpmath.lu_solve(matrix[: size - 1, : size - 1], -matrix[: size - 1, size - 1])
    return [*part, mpf(1)]


def _accelerations(motion: Motion, t: Number, count: int) -> list[Number]:
    return [mpmath.diff(lambda at, k=k: motion(at)[k], t, 2) for k in range(count)]


def delta() -> Machine:
    """Arms 2 and 3 outward, arm 1 folded inward."""
    base, platform, arm, rod = (mpf(size) for size in ("0.164", "0.044", "0.524", "1.244"))
    gravity, mass = mpf("9.81"), mpf("1.5")

    def geometry(place: Place) -> tuple[Any, list[Number], list[Number]]:
        x, y, z = place
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

    def wrench(motion: Motion, t: Number) -> Any:
        x, y, z = _accelerations(motion, t, 3)
        return mpmath.matrix([mass * x, mass * y, mass * (z + gravity)])

    return Machine(geometry, wrench, "30", "1e-4")


def three_rpr() -> Machine:
    """The corner B_1 of the platform and its angle; flat, and gravity across."""
    mass, moment = mpf(5), mpf("0.3466106944444445")
    pivots = [mpmath.mpc(x, y) for x, y in (("0", "0"), ("0.7955", "0"), ("0", "0.5"))]
    corners = [
        mpmath.mpc(x, y) for x, y in (("0", "0"), ("0.852", "0"), ("0.661818661971831", "0.8048354233418255"))
    ]
    centre = mpmath.mpc("0.504606220657277", "0.2682784744472752")

    def geometry(place: Place) -> tuple[Any, list[Number], list[Number]]:
        x, y, angle = place
        rows, lengths = [], []
        for pivot, corner in zip(pivots, corners, strict=True):
            arm = mpmath.expj(angle) * corner
            leg = mpmath.mpc(x, y) + arm - pivot
            length = abs(leg)
            u = leg / length
            rows.append([u.real, u.imag, (mpmath.conj(arm) * u).imag])
            lengths.append(length)
        return mpmath.matrix(rows), [mpf(1)] * 3, lengths

    def wrench(motion: Motion, t: Number) -> Any:
        def middle(at: Number) -> list[Number]:
            x, y, angle = motion(at)
            place = mpmath.mpc(x, y) + mpmath.expj(angle) * centre
            return [place.real, place.imag, angle]

        x, y, spun = _accelerations(middle, t, 3)
        arm = mpmath.expj(motion(t)[2]) * centre
        return mpmath.matrix([mass * x, mass * y, moment * spun + mass * (arm.real * y - arm.imag * x)])

    return Machine(geometry, wrench, "314.1592653589793", "2e-5")


def gough_stewart() -> Machine:
    """Position and rotation vector of the platform."""
    gravity = mpf("9.81")
    mass = mpf("76000") / gravity * mp.pi * mpf("0.05")
    moments = [mass * (3 + mpf("0.05") ** 2) / 12] * 2 + [mass / 2]

    def ring(radius: int, degrees: Sequence[str]) -> list[Any]:
        angles = [mpf(value) * mp.pi / 180 for value in degrees]
        return [mpmath.matrix([radius * mpmath.cos(a), radius * mpmath.sin(a), 0]) for a in angles]

    feet = ring(3, ("-2.5", "2.5", "117.5", "122.5", "237.5", "242.5"))
    balls = ring(1, ("-50", "50", "70", "170", "190", "290"))

    def pose(place: Place) -> tuple[Any, Any]:
        a, b, c = place[3:]
        angle = mpmath.sqrt(a**2 + b**2 + c**2)
        spin = mpmath.matrix([[0, -c, b], [c, 0, -a], [-b, a, 0]]) / angle
        turn = mpmath.eye(3) + mpmath.sin(angle) * spin + (1 - mpmath.cos(angle)) * spin * spin
        return mpmath.matrix(place[:3]), turn

    def geometry(place: Place) -> tuple[Any, list[Number], list[Number]]:
        centre, turn = pose(place)
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

    def momentum(motion: Motion, t: Number) -> list[Number]:
        turn = pose(motion(t))[1]
        rate = mpmath.matrix(3, 3)
        for i in range(3):
            for j in range(3):
                rate[i, j] = mpmath.diff(lambda at, i=i, j=j: pose(motion(at))[1][i, j], t)
        spin = rate * turn.T
        body = turn.T * mpmath.matrix([spin[2, 1], spin[0, 2], spin[1, 0]])
        return list(turn * mpmath.matrix([m * w for m, w in zip(moments, body, strict=True)]))

    def wrench(motion: Motion, t: Number) -> Any:
        x, y, z = _accelerations(motion, t, 3)
        moment = [mpmath.diff(lambda at, k=k: momentum(motion, at)[k], t) for k in range(3)]
        return mpmath.matrix([mass * x, mass * y, mass * (z + gravity), *moment])

    return Machine(geometry, wrench, "314.159265", "2e-3")


_MACHINES = {"delta": delta, "gough_stewart": gough_stewart, "three_rpr": three_rpr}
_TURNS = (0.5946, 2.387, 3.9388, 5.6496, 6.8777, 8.6702, 10.222)  # [rad] near the 3-RPR's locus
# Of 1 to 6 crossings: instants over the duration and speeds times it, sought beforehand so that the law
# advances all the way and its s" is small.
_TIMING: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...] = (
    ((0.3933,), (1.3406,)),
    ((0.2585, 0.7157), (0.9445, 1.3877)),
    ((0.1656, 0.4381, 0.7371), (0.9832, 1.5933, 0.6542)),
    ((0.158, 0.3902, 0.6242, 0.8536), (0.8488, 1.4684, 0.7388, 1.1059)),
    ((0.1351, 0.3347, 0.5444, 0.7191, 0.8269), (0.8041, 1.3427, 0.675, 1.489, 1.1833)),
    ((0.0786, 0.2104, 0.3758, 0.5469, 0.668, 0.8715), (1.0733, 1.8963, 0.6483, 1.1653, 0.7855, 0.8212)),
)


def machine(name: str) -> Machine:
    """The robot of the catalogue of that name."""
    with mp.workdps(DIGITS):
        return _MACHINES[name]()


@cache
def crossings(name: str, count: int = 1) -> Crossings:
    """Scene `cross` of the delta, `turn` of the Gough-Stewart platform, or so many crossings of the 3-RPR."""
    if name == "delta":
        line = ("-0.15", "-0.05", "-1.15"), ("0.1", "0.05", "-0.8")
        return Crossings(machine(name), line, "0.8", (("0.52", "0.522"),), (("0.334", "1.66"),))
    if name == "gough_stewart":
        ends = ("0.1", "0", "2.5", "0.1", "-0.05", "1.3"), ("-0.05", "0.1", "1.3", "-0.1", "0.15", "1.9")
        return Crossings(machine(name), ends, "1", (("0.449", "0.451"),), (("0.533", "1.45"),))
    turns, (shares, speeds) = _TURNS[: count + 1], _TIMING[count - 1]
    way, duration = sum(turns[-2:]) / 2, 0.75 * (count + 1)
    near = tuple((str((turn - 0.002) / way), str((turn + 0.002) / way)) for turn in turns[:-1])
    timing = tuple((str(t * duration), str(v / duration)) for t, v in zip(shares, speeds, strict=True))
    turn = ("-0.2", "0.25", "0.4"), ("-0.2", "0.25", str(0.4 + way))
    return Crossings(machine(name), turn, str(duration), near, timing)
