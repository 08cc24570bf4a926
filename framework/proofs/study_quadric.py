"""Rigid displacements as points of projective space, in which leg conditions are quadrics.

A displacement q -> R q + p is a dual quaternion x + eps y up to a common factor, with R the rotation of x,
p = 2 y x* and x . y = 0 (Study 1903). Let z = (x, y). The 17 functions 1, |p|^2, p, R'p and R of a
displacement, times |x|^2, are quadratic forms of z. The condition of a leg of constant length is linear in
them (Husty 1996; Gallet, Nawratil and Schicho 2015, who so embed the displacements in P^16 as a variety of
degree 40):

    |R b + p - a|^2 = l^2:    |p|^2 + 2 b . R'p - 2 a . p - 2 a . R b + |a|^2 + |b|^2 - l^2 = 0

Such conditions make a system of a linear family (`Displacements`): K equations z' (sum_j c_ij G_j) z = 0 with
coefficients c (K, M), and F fixed equations z' S z = 0, for a point z of projective space P^(N-1), N = K + F
+ 1. For almost all coefficients a system has the same number of isolated solutions, and no system of the
family has more (Morgan and Sommese 1989). Base points, where all members vanish, do not count. `homotopy`
finds the solutions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from framework.numerics.arrays import LEAST_DIVISOR, Array, BoolArray, IntArray
from framework.numerics.ordered_sums import singular_values
from framework.tolerances import DISTINCT_SOLUTIONS, RANK_ROUNDING

ComplexArray = NDArray[np.complex128]

# indices among the 17 functions of 1, |p|^2, p (3,), R'p (3,) and R (3, 3)
_ONE, _SQUARE = np.arange(2)
_POSITION, _ORIGIN, _ROTATION = np.arange(2, 5), np.arange(5, 8), np.arange(8, 17).reshape(3, 3)
# indices in z of the real part of x and of the vectors (3,) of x and y
_X_0, _X, _Y = 0, np.arange(1, 4), np.arange(5, 8)


def complex_normal(rng: np.random.Generator, shape: int | tuple[int, ...]) -> ComplexArray:
    """Draw complex numbers with standard normal real and imaginary parts."""
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def matrix_products(matrices: Any, z: Any) -> Any:
    """Compute the products (S, K, N) of K matrices (K, N, N) and S vectors (S, N)."""
    S, N = z.shape
    return (matrices.reshape(-1, N) @ z.T).T.reshape(S, -1, N)


def append_row(matrices: Any, row: Any) -> Any:
    """Append one row (N,) to each of the matrices (S, N - 1, N)."""
    return np.hstack([matrices, np.broadcast_to(row, (len(matrices), 1, len(row)))])


def first_occurrences(z: ComplexArray) -> BoolArray:
    """Return whether each unit point z (S, N) differs from all earlier points, (S,).

    Points that differ by a complex factor are one point of the projective space.
    """
    # (S, S) cosines of the angles between points; rounding must not make them larger than 1
    cosine = np.minimum(np.abs(z.conj() @ z.T), 1.0)
    coincide = np.sqrt(1.0 - cosine**2) < DISTINCT_SOLUTIONS
    return np.asarray(~np.tril(coincide, -1).any(axis=1))


@cache
def _function_forms() -> Array:
    """Return the 17 functions, times |x|^2, as quadratic forms (17, 8, 8) of z = (x, y).

    By polarisation a quadratic form f has the symmetric matrix (f(e_i + e_j) - f(e_i) - f(e_j)) / 2, with
    unit vectors e.
    """
    units = np.eye(8)
    sums = np.array([[_scaled_functions(a + b) for b in units] for a in units])  # (8, 8, 17)
    squares = np.array([_scaled_functions(a) for a in units])  # (8, 17)
    products = sums - squares[:, None] - squares  # (8, 8, 17) f(e_i + e_j) - f(e_i) - f(e_j)
    return np.moveaxis(products, 2, 0) / 2


def _scaled_functions(z: Array) -> Array:
    """Compute |x|^2 times the functions 1, |p|^2, p, R'p, R (17,) of a dual quaternion z = (x, y).

    These are |x|^2, 4 |y|^2, 2 y x*, 2 x* y and, for the unit quaternions e = i, j, k, the columns x e x*.
    """
    x = pin.Quaternion(*z[:4])
    y = pin.Quaternion(*z[4:])
    conjugate = x.conjugate()
    columns = [(x * pin.Quaternion(0.0, *e) * conjugate).vec() for e in np.eye(3)]
    norms = [x.squaredNorm(), 4 * y.squaredNorm()]
    vectors = [2 * (y * conjugate).vec(), 2 * (conjugate * y).vec()]
    return np.concatenate([norms, *vectors, np.transpose(columns).ravel()])


def displacement_functions(R: Array, p: Array) -> Array:
    """Compute the functions 1, |p|^2, p, R'p, R (T, 17) of displacements R (T, 3, 3), p (T, 3)."""
    R_transposed_p = np.einsum("tij,ti->tj", R, p)
    square = np.sum(p * p, axis=1, keepdims=True)
    return np.hstack([np.ones_like(square), square, p, R_transposed_p, R.reshape(-1, 9)])


@dataclass(frozen=True, eq=False)
class Displacements:
    """A group of displacements, and the systems of quadrics that are linear conditions on the group.

    A system has K equations, each a combination of the M members, and F fixed equations. They are quadrics in
    N homogeneous coordinates z, which are some of those of a dual quaternion.
    """

    name: str  # in words
    members: Array  # (M, N, N) functions of the displacement as quadratic forms of z; the first one is 1
    fixed: Array  # (F, N, N) the Study quadric x . y = 0, or F = 0 where all z satisfy it
    bound: int  # on the number of isolated solutions of any system
    chosen: IntArray  # (M,) indices of the members among the 17 functions
    coordinates: IntArray  # (N,) indices of z among the 8 coordinates of a dual quaternion

    @property
    def size(self) -> int:
        """Number N of homogeneous coordinates of z."""
        return int(self.members.shape[1])

    @property
    def equations(self) -> int:
        """Number K of combinations of members in a system."""
        return self.size - 1 - len(self.fixed)

    def quadrics(self, coefficients: ComplexArray | Array) -> ComplexArray:
        """Return the matrices (K + F, N, N) of the system with coefficients (K, M)."""
        matrices = np.tensordot(coefficients, self.members, axes=1)
        return np.concatenate([matrices, self.fixed]).astype(complex)

    def quadrics_slack(self, slack: Array) -> Array:
        """Bound the change (K + F, N, N) of `quadrics` where coefficients change by up to `slack` (K, M)."""
        changes = np.tensordot(slack, np.abs(self.members), axes=1)
        return np.concatenate([changes, np.zeros_like(self.fixed)])

    def values(self, z: ComplexArray) -> ComplexArray:
        """Evaluate the members (S, M) at points z (S, N)."""
        return np.einsum("mij,ti,tj->tm", self.members, z, z)

    def random_point(self, rng: np.random.Generator) -> ComplexArray:
        """Find a random unit point (N,) on the fixed quadric z' S z = 0, or anywhere without one.

        The quadric has z and all multiples of z.
        """
        z, direction = complex_normal(rng, (2, self.size))  # (N,) each
        if len(self.fixed):
            (S,) = self.fixed
            # z + t direction is on the quadric at the roots t; either will do
            t = np.roots([direction @ S @ direction, 2 * z @ S @ direction, z @ S @ z])
            z = z + t[0] * direction
        return z / np.linalg.norm(z)

    def random_coefficients(self, rng: np.random.Generator) -> ComplexArray:
        """Draw complex coefficients (K, M), each row of unit size."""
        rows = complex_normal(rng, (self.equations, len(self.members)))
        return rows / np.linalg.norm(rows, axis=1, keepdims=True)

    def is_dependent(self, coefficients: Array) -> bool:
        """Return whether the equations depend on one another, so that no solution is isolated.

        Let f_1 be the first member, which is zero only at infinity, and f_k the combinations of members with
        coefficients (K, M). The equations are f_k / f_1 and the fixed quadric. If their gradients have full
        rank anywhere, they have full rank with probability one at a random point z of the fixed quadric. Two
        points are tried.
        """
        rng = np.random.default_rng(0)
        quadrics = self.quadrics(coefficients)
        first = self.members[0]  # matrix (N, N) of f_1
        for _ in range(2):
            z = self.random_point(rng)
            gradients = quadrics @ z  # (K + F, N) half the gradients of f_k and of the fixed quadric
            quotients = (gradients @ z)[: self.equations] / (z @ first @ z)  # (K,) f_k / f_1
            # the quotient rule gives f_1 / 2 times the gradients of f_k / f_1
            gradients[: self.equations] -= np.outer(quotients, first @ z)
            sigma = singular_values(gradients)  # descending
            if sigma[-1] > RANK_ROUNDING * sigma[0]:
                return False
        return True

    @property
    def only_translates(self) -> bool:
        """Whether all displacements are translations."""
        return not np.isin(_X, self.coordinates).any()

    def eliminate_square(self, coefficients: Array, rounding: float) -> tuple[Array, Array]:
        """Eliminate |p|^2 from all conditions (K, M) but one.

        Towards infinity |p|^2 outgrows all other functions, so conditions that contain |p|^2 become nearly
        parallel. The condition with the largest share of |p|^2 is the pivot. It is divided by its coefficient
        of |p|^2, and multiples of it are subtracted from the others.

        Args:
            rounding: error of the coefficients, relative to the largest coefficient of each condition.

        Returns:
            Equivalent conditions (K, M), and bounds (K, M) on the errors of their coefficients. The
            coefficients of |p|^2 become exactly 1 for the pivot and 0 for the others.
        """
        largest = np.abs(coefficients).max(axis=1, keepdims=True)  # (K, 1)
        errors = np.repeat(rounding * largest, len(self.chosen), axis=1)
        square = np.flatnonzero(self.chosen == _SQUARE)  # the column of |p|^2, if any
        multiples = coefficients[:, square]  # (K, 1) of the pivot in each condition
        shares = np.abs(multiples / largest)
        if not shares.any():
            return coefficients, errors
        k = np.argmax(shares)  # the pivot's row
        pivot = coefficients[k] / multiples[k]

        rows = coefficients - multiples * pivot
        rows[:, square] = 0.0
        rows[k] = pivot

        # the error of a quotient c / m is at most (error of c + error of m * |c / m|) / (|m| - error of m)
        divisor = np.maximum(np.abs(multiples[k]) - errors[k], LEAST_DIVISOR)
        pivot_errors = errors[k] * (1.0 + np.abs(pivot)) / divisor
        # the errors of a condition, of its multiple, and of the pivot that is subtracted
        errors += errors * np.abs(pivot) + (np.abs(multiples) + errors) * pivot_errors
        errors[k] = pivot_errors
        errors[:, square] = 0.0  # |p|^2 has exact coefficients
        return rows, errors

    def to_displacements(self, z: Array) -> tuple[Array, Array]:
        """Compute rotations R (T, 3, 3), translations p (T, 3) of real z (T, N).

        The coordinates of the dual quaternions that z lacks are 0.
        """
        quaternions = np.zeros((len(z), 8))
        quaternions[:, self.coordinates] = z
        # (T, 17) functions times |x|^2
        scaled = np.einsum("mij,ti,tj->tm", _function_forms(), quaternions, quaternions)
        values = scaled / scaled[:, :1]  # the first function is 1
        return np.take(values, _ROTATION, axis=1), np.take(values, _POSITION, axis=1)


def _displacement_group(name: str, bound: int, chosen: IntArray, coordinates: IntArray) -> Displacements:
    """Return the displacements whose dual quaternions have only the given coordinates (N,).

    Args:
        name: of the group, in words.
        bound: number of isolated solutions that a system of conditions has at most.
        chosen: (M,) indices of functions that are independent on the group.
    """
    study = np.zeros((1, 8, 8))
    study[0, :4, 4:] = study[0, 4:, :4] = 0.5 * np.eye(4)  # x . y = 0
    fixed = study[:, coordinates[:, None], coordinates]  # (1, N, N)
    fixed = fixed[fixed.any(axis=(1, 2))]  # none where all points of the group satisfy it
    members = _function_forms()[np.ix_(chosen, coordinates, coordinates)]
    return Displacements(name, members, fixed, bound, chosen, coordinates)


@cache
def spatial_displacements() -> Displacements:
    """Return all displacements: six conditions, at most 40 solutions (Ronga and Vust 1992; Mourrain 1993)."""
    return _displacement_group(
        "displacements in space", bound=40, chosen=np.arange(17), coordinates=np.arange(8)
    )


@cache
def spherical_displacements() -> Displacements:
    """Return the rotations about a point: three conditions (quadrics in P^3), at most 8 solutions."""
    chosen = np.array([_ONE, *_ROTATION.ravel()])
    return _displacement_group("turns about a point", bound=8, chosen=chosen, coordinates=np.arange(4))


@cache
def planar_displacements(axis: int) -> Displacements:
    """Return the displacements normal to a base axis: three conditions, at most 6 solutions.

    The conditions are three quadrics in P^3 that share a pair of points on the line x = 0, |y|^2 = 0 (Hunt
    1983; Gosselin, Sefrioui and Richard 1992).
    """
    in_plane = [(axis + 1) % 3, (axis + 2) % 3]
    cosine_and_sine = _ROTATION[in_plane, in_plane[0]]  # the other entries of R follow from these two
    chosen = np.array([_ONE, _SQUARE, *_POSITION[in_plane], *_ORIGIN[in_plane], *cosine_and_sine])
    coordinates = np.array([_X_0, _X[axis], *_Y[in_plane]])
    return _displacement_group("displacements in a plane", bound=6, chosen=chosen, coordinates=coordinates)


@cache
def translation_displacements(axes: tuple[int, ...]) -> Displacements:
    """Return the translations along two or three base axes: at most 2 solutions.

    The conditions are circles or spheres.
    """
    chosen = np.array([_ONE, _SQUARE, *_POSITION[list(axes)]])
    return _displacement_group(
        "translations", bound=2, chosen=chosen, coordinates=np.array([_X_0, *_Y[list(axes)]])
    )
