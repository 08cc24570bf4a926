"""Six rows of the chart again, without the framework.

The reference is mpmath's: the 5R by virtual work, g = D P^-T m a with P the rods and D = p . (crank turned by
a right angle), the cranks' accelerations by mpmath's own differentiation in fifty digits. The methods are
written anew with numpy, scipy and pinocchio on the URDF alone.
"""

from collections.abc import Callable
from pathlib import Path

import mpmath
import numpy as np
import pinocchio as pin
from mpmath import mp, mpc, mpf
from scipy.interpolate import make_interp_spline
from scipy.optimize import brentq

URDF = Path(__file__).resolve().parents[2] / "urdf" / "five_bar" / "five_bar.urdf"
FREE = ("left_motor", "left_elbow", "right_motor", "right_elbow")
T, L, M, GEAR, ROTOR = 1.5, 0.25, 10.0, 50.0, 6.4e-6
START, WAY = complex(0.1, 0.345), complex(-0.15, -0.15)
BASES, ELBOWS = (-0.2, 0.2), (1, -1)
in_fifty_digits = mp.workdps(50)


def legs(x, number=mpf, root=mpmath.sqrt):
    """Return crank and rod of both legs as complex numbers."""
    pairs = []
    for base, elbow in zip(("-0.2", "0.2"), ELBOWS, strict=True):
        reach = x - number(base)
        square = reach.real**2 + reach.imag**2
        crank = (number("0.5") + 1j * elbow * root(number("0.0625") / square - number("0.25"))) * reach
        pairs.append((crank, reach - crank))
    return pairs


def cross(a, b):
    return a.real * b.imag - a.imag * b.real


def point_on_path(s):
    return mpc("0.1", "0.345") + s * mpc("-0.15", "-0.15")


def area(s):
    (_, one), (_, two) = legs(point_on_path(s))
    return cross(one, two)


def power(t, k, order):
    factor = mpmath.ff(k, order)
    return factor * mpf(t) ** (k - order) if factor else mpf(0)


with in_fifty_digits:
    S_C = mpmath.findroot(area, (mpf("0.66"), mpf("0.67")))
    ROWS = [(t, k) for t in (mpf(0), mpf("1.5"), mpf(1)) for k in range(3)]
    RIGHT = [0, 0, 0, 1, 0, 0, S_C, mpf("1.5"), 0]
    MATRIX = mpmath.matrix([[power(t, k, order) for k in range(9)] for t, order in ROWS])
    POWERS = list(mpmath.lu_solve(MATRIX, RIGHT))
    LAW = np.polynomial.Chebyshev.interpolate(  # powers of t would lose two digits
        np.vectorize(lambda t: float(sum(c * mpf(t) ** k for k, c in enumerate(POWERS)))), 8, domain=[0.0, T]
    )


@in_fifty_digits
def exact_torques(t: float) -> list[float]:
    """Return motor torques (2,) [N m] at t [s]."""
    t = mpf(t)

    def s(time, order=0):
        return sum(c * power(time, k, order) for k, c in enumerate(POWERS))

    a = s(t, 2) * mpc("-0.15", "-0.15") * 10
    (b_1, p_1), (b_2, p_2) = legs(point_on_path(s(t)))
    below = cross(p_1, p_2)  # P' y = m a, so that g_i = D_i y_i
    y = cross(a, p_2) / below, cross(p_1, a) / below
    torques = []
    for leg, (b, p, y_i) in enumerate(((b_1, p_1, y[0]), (b_2, p_2, y[1]))):
        alpha = mpmath.diff(
            lambda time, leg=leg: mpmath.arg(legs(point_on_path(s(time)))[leg][0]), t, 2, h=mpf(10) ** -16
        )
        torques.append(float(mpf("6.4e-6") * 50 * alpha + y_i * cross(b, p) / 50))
    return torques


def torque_error(table: Callable[[np.ndarray], np.ndarray]) -> float:
    near = [1.0 + side * 10.0**-k for k in range(1, 10) for side in (-1, 1)]
    times = np.sort(np.concatenate([np.delete(np.linspace(0.0, T, 151), 100), near]))
    return float(np.abs(table(times) - np.array([exact_torques(t) for t in times])).max())


def formula(t: np.ndarray) -> np.ndarray:
    """Return motor torques (T, 2) [N m] in floats, with alpha by the chain rule."""
    s, ds, dds = (LAW.deriv(k)(t) if k else LAW(t) for k in range(3))
    v, a = ds * WAY, dds * WAY
    both = legs(START + s * WAY, float, np.sqrt)
    torques = []
    below = cross(both[0][1], both[1][1])
    y = M * cross(a, both[1][1]) / below, M * cross(both[0][1], a) / below
    for (b, p), y_i in zip(both, y, strict=True):
        d = cross(b, p)  # p . (i b)
        rate = (p.real * v.real + p.imag * v.imag) / d
        dp = v - 1j * b * rate
        w = a + rate**2 * b
        alpha = (p.real * w.real + p.imag * w.imag + dp.real**2 + dp.imag**2) / d
        torques.append(ROTOR * GEAR * alpha + y_i * d / GEAR)
    return np.array(torques).T


def nodes(size: int):
    """Interpolate torques at Chebyshev nodes by the barycentric formula."""
    k = np.arange(size) + 0.5
    x = np.cos(np.pi * k / size)
    values, weights = formula(0.5 * T * (x + 1)), (-1.0) ** np.arange(size) * np.sin(np.pi * k / size)

    def interpolate(t):
        c = weights / ((2 * t / T - 1)[:, None] - x)
        return (c @ values) / c.sum(axis=1)[:, None]

    return interpolate


class Tree:
    """The URDF in pinocchio, joints as in FREE."""

    def __init__(self):
        self.model = pin.buildModelFromUrdf(str(URDF))
        self.data = self.model.createData()
        self.order = [self.model.joints[self.model.getJointId(name)].idx_v for name in FREE]
        self.tips = [self.model.getFrameId(f"{side}_tip") for side in ("left", "right")]

    def tip(self, q):
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        places = np.concatenate([self.data.oMf[tip].translation[:2] for tip in self.tips])
        axes = pin.LOCAL_WORLD_ALIGNED
        return places, np.vstack(
            [pin.getFrameJacobian(self.model, self.data, t, axes)[:2] for t in self.tips]
        )

    def newton(self, x, q, steps):
        target = np.tile([x.real, x.imag], 2)
        for _ in range(steps):
            places, slope = self.tip(q)
            q = q + np.linalg.solve(slope, target - places)
        return q

    def pose(self, x):
        q = np.zeros(self.model.nv)
        for (crank, rod), columns in zip(legs(complex(x), float, np.sqrt), ((0, 1), (2, 3)), strict=True):
            q[self.order[columns[0]]] = np.angle(crank)
            q[self.order[columns[1]]] = np.angle(rod / crank)
        return q

    def torques(self, t, damping=0.0):
        s, ds, dds = (LAW.deriv(k)(t) if k else LAW(t) for k in range(3))
        motors, others = self.order[::2], self.order[1::2]
        torques = []
        for k in range(len(t)):
            q = self.pose(START + s[k] * WAY)
            slope = self.tip(q)[1]
            v = np.linalg.solve(slope, np.tile([ds[k] * WAY.real, ds[k] * WAY.imag], 2))
            pin.forwardKinematics(self.model, self.data, q, v, np.zeros_like(v))
            drift = np.concatenate(
                [
                    pin.getFrameClassicalAcceleration(
                        self.model, self.data, tip, pin.LOCAL_WORLD_ALIGNED
                    ).linear[:2]
                    for tip in self.tips
                ]
            )
            a = np.linalg.solve(slope, np.tile([dds[k] * WAY.real, dds[k] * WAY.imag], 2) - drift)
            r, loop = pin.rnea(self.model, self.data, q, v, a), slope[:2] - slope[2:]
            P, right = loop[:, others].T, r[others]
            mu = damping * np.linalg.norm(P)
            force = (
                np.linalg.solve(P.T @ P + mu**2 * np.eye(2), P.T @ right) if mu else np.linalg.solve(P, right)
            )
            torques.append(ROTOR * GEAR * a[motors] + (r[motors] - loop[:, motors].T @ force) / GEAR)
        return np.array(torques)


def table(torque, samples, degree):
    times = np.linspace(0.0, T, samples)
    return make_interp_spline(times, torque(times), k=degree)


@in_fifty_digits
def newton_error(tree, steps):
    places = np.linspace(0.05, 1.0, 96)
    errors = []
    for s in places:
        q = tree.newton(START + s * WAY, tree.pose(START + (s - 0.05) * WAY), steps)
        cranks = [float(mpmath.arg(crank)) for crank, _ in legs(point_on_path(mpf(float(s))))]
        errors.append(np.abs(q[tree.order[::2]] - cranks).max())
    return max(errors)


@in_fifty_digits
def determinant_error(tree, tolerance):
    def measure(s):
        slope = tree.tip(tree.pose(START + s * WAY))[1]
        return np.linalg.det((slope[:2] - slope[2:])[:, tree.order[1::2]])

    return float(abs(mpf(brentq(measure, 0.6, 0.75, xtol=tolerance, rtol=4 * np.finfo(float).eps)) - S_C))


def rows() -> dict[str, Callable[[], float]]:
    """Return the error of each row by its key."""
    tree = Tree()
    return {
        "torque:formula:64": lambda: torque_error(nodes(64)),
        "torque:pinocchio:65,9": lambda: torque_error(table(tree.torques, 65, 9)),
        "torque:pinocchio:129,5": lambda: torque_error(table(tree.torques, 129, 5)),
        "torque:damped:1e-05": lambda: torque_error(table(lambda t: tree.torques(t, 1e-5), 257, 9)),
        "closing:newton:3": lambda: newton_error(tree, 3),
        "singular:determinant:1e-08": lambda: determinant_error(tree, 1e-8),
    }
