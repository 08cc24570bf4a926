"""The paper's planar 5R robot, solved to fifty digits: what the five-bar tests compare with.

S. Briot and V. Arakelian, "On the dynamic properties of flexible parallel manipulators in the
presence of payload and Type 2 singularities", ASME IDETC/CIE 2010, section 3. Equation numbers
below are theirs. The oracle shares no code and no method with the framework: it knows this one
robot, and every function of time in it is a truncated power series in multiprecision arithmetic.
Derivatives are therefore coefficients, and the 0/0 of A^-T W_p at the crossing is an ordinary
quotient of two series that both start at their linear term.

Geometry, in vectors. Leg i is a crank b_i (base motor to elbow) followed by a rod p_i (elbow to
payload, length L + eps_i), and the closure (12) reads |p_i|^2 = (L + eps_i)^2. Hence

    A = 2 [p_1'; p_2']        B = 2 diag(b_i x p_i)        C = 2 diag(L + eps_i)      (13)-(15)

and det A = 4 p_1 x p_2: Type 2 singular where the rods are parallel.

Conventions. Leg 0 is the left one (motor A), leg 1 the right one (motor E); both elbows point
outward; gravity is perpendicular to the plane. Motor angles, velocities and torques are on the
motor side of the gear; link angles on the joint side. SI units throughout. eps > 0: longer rod.

Slips of the paper, corrected here: (9) lacks the gear ratio that (11b) has, (10) a bracket; the
path of scene C meets the locus at s = 0.667006..., not at 2/3 (21).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from operator import add, mul, neg
from typing import Any, NamedTuple

import mpmath
import numpy as np
from mpmath.libmp import to_fixed

mp = mpmath.mp.clone()  # a context of our own: the precision of other users is left alone
mp.dps = 60  # fifty are claimed, thirty-five where a fixed point is involved (deformed geometry)
Number = Any  # mp.mpf, which has no static type

BASES = (mp.mpf("-0.2"), mp.mpf("0.2"))  # abscissae of the motors A and E [m]
ELBOWS = (1, -1)  # the crank lies left (1) or right (-1) of the line from its motor to the payload
LENGTH = mp.mpf("0.25")  # of every link [m]
PAYLOAD = mp.mpf(10)  # [kg]
DRIVE_STIFFNESS = mp.mpf(25000)  # k1 [N m/rad]
ROD_STIFFNESS = mp.mpf(350000)  # k2 [N/m]
ROTOR_INERTIA = mp.mpf("0.064e-4")  # I_a [kg m^2], motor side
GEAR_RATIO = mp.mpf(50)  # n


class Scene(NamedTuple):
    """A straight path, its duration and what is asked where it meets the singular locus."""

    start: tuple[Number, Number]  # [m]
    end: tuple[Number, Number]  # [m]
    duration: Number  # [s]
    crossing: tuple[Number, Number] | None  # (t_c [s], s'(t_c) [1/s])


def _scene(end: tuple[str, str], crossing: tuple[str, str] | None) -> Scene:
    start = mp.mpf("0.1"), mp.mpf("0.345")
    pair = None if crossing is None else (mp.mpf(crossing[0]), mp.mpf(crossing[1]))
    return Scene(start, (mp.mpf(end[0]), mp.mpf(end[1])), mp.mpf("1.5"), pair)


SCENES = {
    "A": _scene(("-0.05", "0.295"), None),  # meets no singularity
    "B": _scene(("-0.05", "0.195"), None),  # meets one unprepared: the torque has a pole
    "C": _scene(("-0.05", "0.195"), ("1", "1.5")),  # crosses it
}


# --- Truncated power series ------------------------------------------------------------------


BITS = 224  # 67 decimals


class Series:
    """c[0] + c[1] h + c[2] h^2 + ..., known up to its length; the shorter operand decides.

    The coefficients are integers, in units of 2^-BITS: dot products are exact up to one rounding,
    and twice as fast as with floating multiprecision, with or without gmpy2.
    """

    __slots__ = ("c",)

    def __init__(self, coefficients: Iterable[int]) -> None:
        self.c = list(coefficients)

    @classmethod
    def of(cls, *coefficients: Number, length: int = 0) -> Series:
        """From numbers, padded with zeros to the length."""
        return cls(list(map(_fixed, coefficients)) + [0] * (length - len(coefficients)))

    def __getitem__(self, power: int) -> Number:
        return mp.ldexp(mp.mpf(self.c[power]), -BITS)

    def __len__(self) -> int:
        return len(self.c)

    def __add__(self, other: Series | Number) -> Series:
        if isinstance(other, Series):
            return Series(map(add, self.c, other.c))
        return Series([self.c[0] + _fixed(other), *self.c[1:]])

    def __mul__(self, other: Series | Number) -> Series:
        if not isinstance(other, Series):
            factor = _fixed(other)
            return Series([a * factor >> BITS for a in self.c])
        a, b = self.c, other.c
        return Series([_dot(a[: k + 1], b[k::-1]) >> BITS for k in range(min(len(a), len(b)))])

    def __truediv__(self, other: Series | Number) -> Series:
        if not isinstance(other, Series):
            return self * (mp.one / other)
        a, b, q = self.c, other.c, []
        for k in range(min(len(a), len(b))):
            q.append(((a[k] << BITS) - _dot(q, b[k:0:-1])) // b[0])
        return Series(q)

    def __neg__(self) -> Series:
        return Series(map(neg, self.c))

    def __sub__(self, other: Series | Number) -> Series:
        return self + -other

    def __rsub__(self, other: Number) -> Series:
        return -self + other

    def __rtruediv__(self, other: Number) -> Series:
        return Series.of(other, length=len(self)) / self

    __radd__, __rmul__ = __add__, __mul__

    def sqrt(self) -> Series:
        """The positive root."""
        root = [math.isqrt(self.c[0] << BITS)]
        for a in self.c[1:]:
            root.append(((a << BITS) - _dot(root[1:], root[:0:-1])) // (2 * root[0]))
        return Series(root)

    def derivative(self) -> Series:
        """One term shorter."""
        return Series(k * a for k, a in enumerate(self.c[1:], 1))

    def integral(self, constant: Number) -> Series:
        """One term longer."""
        return Series(Series.of(constant).c + [a // k for k, a in enumerate(self.c, 1)])

    def without_root(self) -> Series:
        """The series divided by h, its constant term being known to vanish; one term shorter."""
        return Series(self.c[1:])

    def at(self, h: Number) -> Number:
        """Value at a distance h from the centre."""
        return sum(self[k] * h**k for k in range(len(self)))


def _fixed(a: Number) -> int:
    return a << BITS if isinstance(a, int) else to_fixed(a._mpf_, BITS)


def _dot(a: Iterable[int], b: Iterable[int]) -> int:
    return sum(map(mul, a, b))


Vector = tuple[Series, Series]


def _cross(a: Vector, b: Vector) -> Series:
    return a[0] * b[1] - a[1] * b[0]


# --- Geometry, Eqs. (12)-(16) ----------------------------------------------------------------


class Leg(NamedTuple):
    """One leg, assembled in the working mode of the paper."""

    crank: Vector  # motor to elbow [m]
    rod: Vector  # elbow to payload [m]
    rod_length: Series  # L + eps [m]

    def angle(self) -> Series:
        """Crank angle [rad], from atan2 and the exact rate b x b' / L^2."""
        x, y = self.crank
        start = mp.atan2(y[0], x[0])
        return (_cross(self.crank, (x.derivative(), y.derivative())) / LENGTH**2).integral(start)


def _legs(position: Vector, eps: Sequence[Series | Number] = (mp.zero, mp.zero)) -> tuple[Leg, Leg]:
    """Inverse kinematics: solve the closures (12) for the cranks, given payload and deflections."""
    legs = []
    for base, elbow, stretch in zip(BASES, ELBOWS, eps, strict=True):
        reach = position[0] - base, position[1]  # motor to payload
        rod_length = Series.of(LENGTH, length=len(reach[0])) + stretch
        inverse = 1 / (reach[0] * reach[0] + reach[1] * reach[1])
        along = ((LENGTH**2 - rod_length * rod_length) * inverse + 1) / 2
        across = (LENGTH**2 * inverse - along * along).sqrt() * elbow
        crank = (along * reach[0] - across * reach[1], along * reach[1] + across * reach[0])
        legs.append(Leg(crank, (reach[0] - crank[0], reach[1] - crank[1]), rod_length))
    return legs[0], legs[1]


def _multipliers(legs: tuple[Leg, Leg], wrench: Vector, singular: bool) -> Vector:
    """lambda = A^-T W_p (4), by Cramer; at a crossing both sides of the quotient lose a root."""
    left, right = legs
    above = _cross(wrench, right.rod), _cross(left.rod, wrench)
    below = _cross(left.rod, right.rod) * 2
    if singular:
        above = above[0].without_root(), above[1].without_root()
        below = below.without_root()
    return above[0] / below, above[1] / below


def _drive_torques(legs: tuple[Leg, Leg], multipliers: Vector) -> Vector:
    """B^T lambda [N m], joint side: what the drives hand to the cranks, B from (14)."""
    (left, right), (m, n) = legs, multipliers
    return _cross(left.crank, left.rod) * 2 * m, _cross(right.crank, right.rod) * 2 * n


def _rod_deflections(legs: tuple[Leg, Leg], multipliers: Vector) -> Vector:
    """eps = -C^T lambda / k2 [m], Eq. (11a), C from (15)."""
    (left, right), (m, n), compliance = legs, multipliers, -2 / ROD_STIFFNESS
    return left.rod_length * m * compliance, right.rod_length * n * compliance


def _point(x: Sequence[float]) -> Vector:
    return Series.of(mp.mpf(x[0])), Series.of(mp.mpf(x[1]))


def inverse_kinematics(x: Sequence[float], eps: Sequence[float] = (0, 0)) -> np.ndarray:
    """Link angles (2,) [rad] of the payload position x (2,) [m] and deflections eps (2,) [m]."""
    legs = _legs(_point(x), [mp.mpf(e) for e in eps])
    return np.array([leg.angle()[0] for leg in legs], dtype=float)


def velocity_matrices(
    x: Sequence[float], eps: Sequence[float] = (0, 0)
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C (2, 2) each, Eqs. (13)-(15): A v = B dq + C deps, with dq on the joint side."""
    legs = _legs(_point(x), [mp.mpf(e) for e in eps])
    a = [[2 * leg.rod[0][0], 2 * leg.rod[1][0]] for leg in legs]
    b = [2 * _cross(leg.crank, leg.rod)[0] for leg in legs]
    c = [2 * leg.rod_length[0] for leg in legs]
    return np.array(a, dtype=float), np.diag(np.array(b, float)), np.diag(np.array(c, float))


def singular_twist(x: Sequence[float], eps: Sequence[float] = (0, 0)) -> np.ndarray:
    """t_s (2,), Eq. (16): the unit normal of the left rod, the free motion where A is singular."""
    rod = _legs(_point(x), [mp.mpf(e) for e in eps])[0].rod
    x, y = (component[0] for component in rod)
    return np.array([-y, x], dtype=float) / float(mp.hypot(x, y))


def _along(scene: Scene, s: Series) -> Vector:
    """Payload position (17)."""
    (x0, y0), (x1, y1) = scene.start, scene.end
    return s * (x1 - x0) + x0, s * (y1 - y0) + y0


def locus_position(scene: str = "C", eps: Sequence[Number] = (mp.zero, mp.zero)) -> Number:
    """s where the rods are parallel, the deflections eps (2,) [m] held; from the paper's 2/3 (21).

    Newton's method; the slope is the second coefficient of the expansion in s.
    """
    s = mp.mpf(2) / 3
    for _ in range(20):
        left, right = _legs(_along(SCENES[scene], Series.of(s, mp.one)), eps)
        area = _cross(left.rod, right.rod)
        step = area[0] / area[1]
        s -= step
        if abs(step) < mp.mpf(10) ** -35:  # the next step would be its square
            return s
    raise ArithmeticError(f"scene {scene}: no point of the locus near s = 2/3")


# --- Law of motion, Eqs. (19)-(31) -----------------------------------------------------------


def polynomial_law(
    duration: Number, smoothness: int, crossing: tuple[Number, Sequence[Number]] | None = None
) -> tuple[Number, ...]:
    """Coefficients of s(t), ascending powers of t, by the linear system of all its conditions.

    s = 0 and 1 at the ends, with `smoothness` vanishing derivatives there; `crossing` is
    (t_c, [s, s', s'']) or None. Degree 2 R + 1, or 2 R + 4 with a crossing: 9 and 12 for R = 4.
    """
    still = [mp.zero] * smoothness
    conditions = [(mp.zero, [mp.zero, *still]), (mp.mpf(duration), [mp.one, *still])]
    if crossing is not None:
        conditions.append((crossing[0], list(crossing[1])))
    values = [value for _, given in conditions for value in given]
    rows = [
        [math.perm(power, order) * t ** max(power - order, 0) for power in range(len(values))]
        for t, given in conditions
        for order in range(len(given))
    ]
    return tuple(mp.lu_solve(mp.matrix(rows), mp.matrix(values)))


def law_series(coefficients: Sequence[Number], centre: Number, length: int) -> Series:
    """Expansion of the law about `centre`, by repeated synthetic division."""
    work, expansion = list(coefficients[::-1]), []
    while work and len(expansion) < length:
        for k in range(1, len(work)):
            work[k] += centre * work[k - 1]
        expansion.append(work.pop())
    return Series.of(*expansion, length=length)


# --- Dynamics, Eq. (11) ----------------------------------------------------------------------

NEAR = mp.mpf("0.002")  # [s]: closer than this to t_c, the expansion about t_c itself is used
NEAR_TERMS = 36  # its terms before the fixed point, which costs one a pass
PASSES = 80  # of the fixed point at most; a pass divides the error by about |t - t_c| / 1e-4 s
SETTLED = mp.mpf(10) ** -33  # change of the coefficients of eps [m/s^k] that ends the fixed point
FLEXIBILITIES = ("rigid", "flexible_joints", "flexible_links")
GEOMETRIES = ("rigid", "deformed")


class Motion(NamedTuple):
    """Everything asked of the robot, as series in t - centre, left before right."""

    motor_angle: Sequence[Series]  # [rad]
    torque: Sequence[Series]  # [N m]
    deflection: Sequence[Series]  # drives [rad], then rods [m]


@dataclass(frozen=True, eq=False)
class Oracle:
    """The exact motion of the 5R along a scene. Every method takes one instant t [s]."""

    scene: str
    flexibility: str
    geometry: str
    smoothness: int
    coefficients: tuple[Number, ...]  # of the law, ascending powers of t
    s_c: Number | None = None  # where the path crosses the locus
    _crossing: Motion | None = field(default=None, repr=False)  # expansion about t_c

    @property
    def t_c(self) -> Number | None:
        """Instant of the crossing [s]."""
        crossing = SCENES[self.scene].crossing
        return None if crossing is None else crossing[0]

    def law(self, t: float, order: int = 0) -> Number:
        """s or its derivative of the given order [1/s^order]."""
        series = law_series(self.coefficients, mp.convert(t), order + 1)
        return series[order] * math.factorial(order)

    def motor_angle(self, t: float) -> tuple[Number, ...]:
        """(2,) left and right [rad], motor side."""
        return self._values("motor_angle", t)

    def torque(self, t: float) -> tuple[Number, ...]:
        """(2,) left and right [N m], motor side."""
        return self._values("torque", t)

    def deflection(self, t: float) -> tuple[Number, ...]:
        """(n_e,) of the springs present: drives q_link - q_motor / n [rad], then rods eps [m].

        n_e is 0, 2 or 4: rigid robot, flexible joints, flexible links (and joints).
        """
        return self._values("deflection", t)

    def _values(self, quantity: str, t: float) -> tuple[Number, ...]:
        centre, h, motion = mp.convert(t), mp.zero, self._crossing
        if motion is not None and abs(centre - self.t_c) < NEAR:
            h = centre - self.t_c
        else:
            motion = _motion(self, centre)
        return tuple(series.at(h) for series in getattr(motion, quantity))


def _demand(oracle: Oracle, centre: Number, length: int) -> tuple[Vector, Vector]:
    """Payload position [m] and wrench W_p = m x'' [N] about `centre`.

    The torque needs two derivatives of the angles, and of the spring torques where there are
    springs: `length` terms of x, with one of x'' in three or with as many (jerk and beyond).
    """
    scene = SCENES[oracle.scene]
    s = law_series(oracle.coefficients, centre, length + 2)
    thrust = s.derivative().derivative() * PAYLOAD
    if oracle.flexibility == "rigid":
        thrust = Series(thrust.c[: length - 2])
    (x0, y0), (x1, y1) = scene.start, scene.end
    return _along(scene, Series(s.c[:length])), (thrust * (x1 - x0), thrust * (y1 - y0))


def _rods(position: Vector, wrench: Vector, eps: Vector, singular: bool = False) -> Vector:
    """One pass of the fixed point: the deflections under the rod forces of the geometry eps."""
    legs = _legs(position, eps)
    return _rod_deflections(legs, _multipliers(legs, wrench, singular))


def _change(before: Vector, after: Vector) -> Number:
    """Largest change of a coefficient."""
    moves = (new - old for old, new in zip(before, after, strict=True))
    return max(abs(move[k]) for move in moves for k in range(len(move)))


def _unstretched(length: int) -> Vector:
    return Series.of(length=length), Series.of(length=length)


def _deflected(oracle: Oracle, position: Vector, wrench: Vector) -> Vector:
    """eps [m] at a regular instant: Eq. (11a) at the rigid geometry, or at its own."""
    eps = _unstretched(len(position[0]))
    for _ in range(PASSES):
        before, eps = eps, _rods(position, wrench, eps)
        if oracle.geometry == "rigid" or _change(before, eps) < SETTLED:
            return eps
    raise ArithmeticError("the deformed robot has no equilibrium that a fixed point can reach")


@cache
def _motion(oracle: Oracle, centre: Number, length: int = 3, eps: Vector | None = None) -> Motion:
    """Expand the inverse dynamics about `centre`; `eps` is given at the crossing and only there."""
    position, wrench = _demand(oracle, centre, length)
    singular = eps is not None
    unloaded = loaded = _legs(position)
    if oracle.flexibility == "flexible_links":
        eps = eps or _deflected(oracle, position, wrench)
        loaded = _legs(position, eps)  # link angles from (12), the deflections introduced
    bearing = loaded if oracle.geometry == "deformed" else unloaded
    spring_torques = _drive_torques(bearing, _multipliers(bearing, wrench, singular))

    joints = [leg.angle() for leg in loaded]
    twists: list[Series] = []
    if oracle.flexibility != "rigid":
        twists = [g / -DRIVE_STIFFNESS for g in spring_torques]
        joints = [q - twist for q, twist in zip(joints, twists, strict=True)]  # (11b)
    motors = [q * GEAR_RATIO for q in joints]
    torques = [
        motor.derivative().derivative() * ROTOR_INERTIA + g / GEAR_RATIO  # (11c)
        for motor, g in zip(motors, spring_torques, strict=True)
    ]
    rods = [] if oracle.flexibility != "flexible_links" else list(eps)
    return Motion(motors, torques, twists + rods)


def _cross_locus(oracle: Oracle) -> Oracle:
    """Place the crossing, give the law its three conditions, expand the motion about t_c.

    On a straight path t_s . W_p = 0 (8) is s''(t_c) = 0 (27). With deformed geometry the locus
    itself moves with eps(t_c): the fixed point relocates it in every pass. A pass divides by a
    series whose constant term vanishes, hence costs the last term of eps; it brings the others
    about three digits. The limit is the only s_c for which a smooth eps(t) exists. (At t_c the
    equations also have the root eps = 0, since W_p(t_c) = 0: no smooth eps(t) passes there.)
    """
    t_c, speed = SCENES[oracle.scene].crossing
    eps = _unstretched(NEAR_TERMS)
    for _ in range(NEAR_TERMS // 2):
        s_c = locus_position(oracle.scene, [e[0] for e in eps])
        conditions = t_c, (s_c, speed, mp.zero)
        law = polynomial_law(SCENES[oracle.scene].duration, oracle.smoothness, conditions)
        oracle = replace(oracle, s_c=s_c, coefficients=law)
        if oracle.flexibility != "flexible_links":
            break
        before, eps = eps, _rods(*_demand(oracle, t_c, NEAR_TERMS), eps, singular=True)
        if oracle.geometry == "rigid" or _change(before, eps) < SETTLED:
            break
    else:
        raise ArithmeticError("the relocated crossing does not settle")
    return replace(oracle, _crossing=_motion(oracle, t_c, NEAR_TERMS, eps))


@cache
def solve(
    scene: str = "C",
    flexibility: str = "flexible_links",
    geometry: str = "deformed",
    smoothness: int | None = None,
) -> Oracle:
    """The motion of a scene: "A" (no singularity), "B" (unprepared) or "C" (crossing).

    flexibility: "rigid", "flexible_joints" or "flexible_links" (links and joints). geometry:
    "rigid" evaluates A, B, C at eps = 0 (the paper's small displacements), "deformed" at eps;
    they differ for flexible links only, the drives' springs being outside the loop. smoothness:
    vanishing derivatives of s at both ends, 2 for a rigid robot and 4 for an elastic one.
    """
    if flexibility not in FLEXIBILITIES or geometry not in GEOMETRIES:
        raise ValueError(f"unknown variant {flexibility!r}, {geometry!r}")
    if smoothness is None:
        smoothness = 2 if flexibility == "rigid" else 4
    law = polynomial_law(SCENES[scene].duration, smoothness)
    oracle = Oracle(scene, flexibility, geometry, smoothness, law)
    return oracle if oracle.t_c is None else _cross_locus(oracle)


def torques(oracle: Oracle, times: Iterable[float]) -> np.ndarray:
    """Motor torques (T, 2) [N m] at times (T,) [s]."""
    return np.array([oracle.torque(t) for t in times], dtype=float)


def motor_angles(oracle: Oracle, times: Iterable[float]) -> np.ndarray:
    """Motor angles (T, 2) [rad] at times (T,) [s]."""
    return np.array([oracle.motor_angle(t) for t in times], dtype=float)


def deflections(oracle: Oracle, times: Iterable[float]) -> np.ndarray:
    """Deflections of the springs (T, n_e) [rad, m] at times (T,) [s], drives before rods."""
    return np.array([oracle.deflection(t) for t in times], dtype=float)
