"""Spherical 3-RRR robots in closed form: unit vectors of axes, and Lagrange's equations.

Base axes x, y, z; platform axes -z, -x, -y at the reference; arcs of `proximal` and 90 degrees. All
functions are analytic, so a step of 1e-30 i gives their derivatives to rounding.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tests.oracles import lagrange

BASE = np.eye(3)  # u_i, one a row
WRISTS = -np.eye(3)[[2, 0, 1]]  # v_i in the platform's frame
GEAR, ROTOR = 30.0, 4e-6  # [kg m^2]
GRAVITY = np.array([0, 0, -9.81])


def cross(a, b):
    return np.stack([a[..., i - 2] * b[..., i - 1] - a[..., i - 1] * b[..., i - 2] for i in range(3)], -1)


def rodrigues(r):
    """Rotation matrix of a rotation vector, also a complex one."""
    t = np.sqrt(r @ r + 1e-40 + 0j)
    skew = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    return np.eye(3) + np.sin(t) / t * skew + 2 * (np.sin(t / 2) / t) ** 2 * (skew @ skew)


def spin(r, dr):
    """Angular velocity of a rotation vector and its rate."""
    t = np.sqrt(r @ r + 0j)
    if abs(t) < 1e-3:
        a, b = 0.5 - (r @ r) / 24, 1 / 6 - (r @ r) / 120  # the next terms are below 1e-14
    else:
        a, b = 2 * (np.sin(t / 2) / t) ** 2, (t - np.sin(t)) / t**3
    return dr + a * cross(r, dr) + b * cross(r, cross(r, dr))


def spin_matrix(r):
    """Angular velocity = this (3, 3) times the rate of the rotation vector."""
    return np.column_stack([spin(r, e) for e in np.eye(3)])


def second_moment(mass, centre, along, length, radius):
    """Integral of x x' dm of a cylinder (3, 3) [kg m^2]."""
    t = np.outer(along, along)
    return mass * (np.outer(centre, centre) + length**2 / 12 * t + radius**2 / 4 * (np.eye(3) - t))


def arc_body(mass, radius, angle):
    """First (3,) and second moments (3, 3) of three straight bars from z to -y, about the centre."""
    ends = radius * np.array([[0, -np.sin(a), np.cos(a)] for a in np.linspace(0, angle, 4)])
    first, second = np.zeros(3), np.zeros((3, 3))
    for a, b in pairwise(ends):
        length = np.linalg.norm(b - a)
        first += mass / 3 * (a + b) / 2
        second += second_moment(mass / 3, (a + b) / 2, (b - a) / length, length, 0.006)
    return first, second


def turning_energy(second, rotation, omega):
    """0.5 omega' I omega with I = tr(S) - S and S the second moments, turned."""
    local = rotation.T @ omega
    return 0.5 * (np.trace(second) * local @ local - local @ second @ local)


@dataclass(frozen=True)
class Spherical:
    """The robot with one length of the proximal arcs [rad] and one working mode."""

    proximal: float
    mode: tuple[int, int, int]

    def axes(self, x):
        """w_i and v_i (3, 3), one a row: w . u = cos(proximal), w . v = 0."""
        v = WRISTS @ rodrigues(x).T
        c = np.sum(BASE * v, axis=1)
        p = np.cos(self.proximal) / (1 - c**2)
        q = -c * p
        k = np.array(self.mode) * np.sqrt((1 - p * np.cos(self.proximal)) / (1 - c**2))
        return p[:, None] * BASE + q[:, None] * v + k[:, None] * cross(BASE, v), v

    def motor_angles(self, x):
        w = self.axes(x)[0].real
        return np.array([np.arctan2(w[i, i - 2], -w[i, i - 1]) for i in range(3)])

    def matrices(self, x):
        """A and B (3, 3) of A omega = B dq: rows w x v, and (w x v) . u on the diagonal."""
        w, v = self.axes(x)
        A = cross(w, v)
        return A, np.diag(np.sum(A * BASE, axis=1))

    def measure(self, x):
        """Zero at Type 2: w_i x v_i in one plane."""
        return float(np.linalg.det(self.matrices(x)[0].real))

    def ratio(self, x):
        """Rates of the motors over the angular velocity (3, 3)."""
        A, B = self.matrices(np.asarray(x, float))
        return np.linalg.solve(B, A).real

    def rates(self, x):
        """d(motor angles)/dx (3, 3)."""
        return self.ratio(x) @ spin_matrix(x).real

    def kinetic_energy(self, x, dx):
        omega = spin(x, dx)
        w, v = self.axes(x)
        A = cross(w, v)
        dq = A @ omega / np.sum(A * BASE, axis=1)
        z = np.ones(3) / np.sqrt(3)
        camera = second_moment(1.2, 0.02 * z, z, 0.08, 0.03)
        energy = turning_energy(camera, rodrigues(x), omega)
        for i in range(3):
            _, second = arc_body(0.25, 0.14, self.proximal)
            # about the motor's axis z: S_xx + S_yy
            energy += 0.5 * (second[0, 0] + second[1, 1] + GEAR**2 * ROTOR) * dq[i] ** 2
            turn = dq[i] * BASE[i]
            elbow = A[i] @ cross(omega - turn, v[i])  # its rate: w and v are orthogonal
            turn = turn + w[i] * elbow
            energy += turning_energy(arc_body(0.2, 0.12, np.pi / 2)[1], self.distal_axes(w[i], v[i]), turn)
        return energy

    @staticmethod
    def distal_axes(w, v):
        """Frame of a distal link as columns: z along w, -y along v."""
        return np.column_stack([cross(w, v), -v, w])

    def potential_energy(self, x):
        w, v = self.axes(x)
        moment = rodrigues(x) @ (1.2 * 0.02 * np.ones(3) / np.sqrt(3))
        for i in range(3):
            first, _ = arc_body(0.25, 0.14, self.proximal)
            lever = (w[i] - np.cos(self.proximal) * BASE[i]) / np.sin(self.proximal)  # unit, from u to w
            moment = moment + first[2] * BASE[i] - first[1] * lever
            moment = moment + self.distal_axes(w[i], v[i]) @ arc_body(0.2, 0.12, np.pi / 2)[0]
        return -GRAVITY @ moment

    def platform_force(self, x, dx, ddx):
        """Lagrange: what the motors must do on the rotation vector (3,) [N m]."""
        return lagrange.platform_force(self.kinetic_energy, self.potential_energy, x, dx, ddx)
