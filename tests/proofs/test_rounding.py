"""Proofs where rounding decides: laws in rational arithmetic, which fail without any term of a bound.

A law takes inputs as exact numbers, and compares the bound with what is true of them. `MUTATIONS` change one
function each: the rounding is left out, a term is dropped, a radius grows by a tenth. Its law must then fail.
"""

from __future__ import annotations

import sys
from fractions import Fraction
from itertools import pairwise, permutations, product
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest

import robots
from framework import assemble
from framework.kinematics.frames import frames_at, integrate_columns
from framework.proofs import (
    homotopy,
    interval_newton,
    krawczyk,
    leg_paving,
    regular_ball,
    rounding,
    singular_paving,
)
from framework.proofs.branch_and_bound import Boxes
from framework.proofs.derivative_bounds import DerivativeBounds, Derivatives
from framework.proofs.interval_newton import LinearEnclosure, contract
from framework.proofs.krawczyk import NewtonMap
from framework.proofs.singular_paving import SingularBoxTest
from tests.mutated_code import mutated_code


def exact(values) -> np.ndarray:
    """Return the numbers as fractions."""
    return np.vectorize(Fraction, otypes=[object])(values)


def solve_exactly(M, right) -> np.ndarray:
    """Solve M z = right for fractions M (k, k) by elimination."""
    rows = np.column_stack([M, right])
    k = len(rows)
    for step in range(k):
        pivot = step + int(np.argmax(np.abs(rows[step:, step])))
        rows[[step, pivot]] = rows[[pivot, step]]
        rows[step] = rows[step] / rows[step, step]
        for row in set(range(k)) - {step}:
            rows[row] = rows[row] - rows[row, step] * rows[step]
    return rows[:, -1]


def signs(rng, like) -> np.ndarray:
    return rng.choice([-1.0, 1.0], np.shape(like))


# ------------------------------------------------------------------ laws


def defects_hold():
    """|1 - X M|, of good and bad matrices, and where the product vanishes beside the identity."""
    rng = np.random.default_rng(1)
    for k in (1, 2, 5):
        M = rng.standard_normal((30, k, k)) * 10.0 ** rng.uniform(-3, 3, (30, k, 1))
        X = np.linalg.inv(M)
        defect = np.abs(np.eye(k, dtype=int) - exact(X) @ exact(M))
        assert (defect <= rounding.identity_defect(X, M)).all()
    tiny = np.array([[[-1e-20]]])
    assert rounding.identity_defect(1.0 + 0.0 * tiny, tiny)[0, 0, 0] >= 1 + Fraction(1e-20)


def combinations_are_enclosed():
    """A mixed equation at a corner of the box, its errors at their worst."""
    rng = np.random.default_rng(2)
    for case in range(120):
        values, slopes = rng.standard_normal((1, 4)), rng.standard_normal((1, 4, 3))
        errors, radii = rng.uniform(0, 1, (1, 4)), rng.uniform(0, 1, (1, 3))
        if case % 3 == 0:
            errors = 0.0 * errors  # only rounding is left
        elif case % 3 == 1:
            values, slopes = 0.0 * values, 0.0 * slopes  # only the sum of the errors is left
        mixer = rng.standard_normal((1, 1, 4))
        mixed = LinearEnclosure(values, slopes, errors).combine(mixer, radii)
        d = exact(radii * signs(rng, radii))[0]
        at_worst = exact(errors * np.sign(mixer[:, 0]))[0]
        for side in (1, -1):
            true = exact(mixer)[0] @ (exact(values)[0] + exact(slopes)[0] @ d + side * at_worst)
            off = true - exact(mixed.values)[0] - exact(mixed.slopes)[0] @ d
            assert abs(off[0]) <= mixed.errors[0, 0]


def solutions_stay_in_contracted_boxes():
    """Solutions at an error far below rounding, at the corner of a box, and of a matrix of condition 4e10."""

    def keeps(values, slopes, errors, radii, d, mixers=None):
        enclosure = LinearEnclosure(values, slopes, errors)
        mixers = np.zeros((1, 0, values.shape[1])) if mixers is None else mixers
        lower, upper = contract(enclosure, radii, mixers)
        return bool(((exact(lower)[0] <= d) & (d <= exact(upper)[0])).all())

    one = np.ones((1, 1))
    assert keeps(0 * one, one[:, None], 1e-20 * one, one, exact([1e-20]))
    assert keeps(0 * one, one[:, None], 0.5 * one, one, exact([0.5]))

    rng = np.random.default_rng(3)
    for _ in range(60):
        slopes, radii = rng.uniform(0.5, 1, (1, 1, 6)), rng.uniform(0.5, 1, (1, 6))
        total = (exact(slopes)[0, 0] * exact(radii)[0]).sum()
        value = np.nextafter(float(total), 0.0)
        d = -exact(radii)[0]
        d[0] += (total - Fraction(value)) / Fraction(slopes[0, 0, 0])  # in the box, and value + slopes d = 0
        assert keeps(np.array([[value]]), slopes, 0 * one, radii, d)

    J = np.array([[121393.0, 75025.0], [75025.0, 46368.0]])  # numbers of Fibonacci: the determinant is -1
    for _ in range(60):
        d = rng.integers(-(2**26), 2**26, 2) / 2.0**26
        values = -J @ d  # without rounding
        radii = 1.01 * np.abs(d)
        assert keeps(values[None], J[None], np.zeros((1, 2)), radii[None], exact(d), np.linalg.inv(J)[None])


def last_columns_are_enclosed():
    """The last column of the inverse for all matrices within the errors; none where one is singular."""
    enclose = interval_newton._enclose_last_column
    one = np.ones((1, 1, 1))
    for error in (0.5, 0.1, 0.9):  # the exact column of 1 - error, which the bound just reaches
        column = enclose(one, one, error * one, error)
        far = 1 / (1 - Fraction(error)) - 1
        assert column.valid[0]
        assert far <= column.error[0, 0]
        assert far <= column.last_error[0]
    assert not enclose(one, one, one, 0.0).valid[0]
    assert enclose(one, 0.5 * one, 0.0 * one, 0.0).error[0, 0] >= 0.5  # X is half of the inverse
    rng = np.random.default_rng(4)
    for error in (0.0, 1e-12, 1e-3):
        M = rng.standard_normal((40, 3, 3))
        column = enclose(M, np.linalg.inv(M), np.full(M.shape, error), error)
        for k in np.flatnonzero(column.valid):
            changed = exact(M[k]) + exact(error * signs(rng, M[k]))
            off = np.abs(solve_exactly(changed, exact([0, 0, 1])) - exact(column.z[k]))
            assert (off <= column.error[k]).all()
            assert off[-1] <= column.last_error[k]


def bordered_solutions_are_enclosed():
    """(eta, g) and (psi, g) of every P within the change in the box and the error at the middle.

    The singular vectors of the least singular value of a diagonal P are the last unit vector, or minus that.
    """
    rng = np.random.default_rng(14)
    P = np.array([np.diag([3.0, 2.0, least]) for least in rng.uniform(0.01, 0.5, 3)])
    for change, error in ((0.0, 1e-3), (1e-3, 0.0), (1e-3, 1e-3)):
        enclosed = interval_newton.enclose_bordered_solutions(P, np.full(P.shape, change), error)
        for right, turn in zip(enclosed, (lambda M: M, np.transpose), strict=True):
            assert right.valid.all()
            for k, middle in enumerate(P):
                b = np.sign(right.z[k, 2]) * np.eye(3)[2:]  # c as well
                sides = exact(signs(rng, middle))
                for half_width in (Fraction(change) + Fraction(error), Fraction(error)):
                    M = np.block([[exact(middle) + half_width * sides, b.T], [b, 0]])
                    off = np.abs(solve_exactly(turn(exact(M)), exact([0, 0, 0, 1])) - exact(right.z[k]))
                    assert (off <= right.error[k]).all()
                assert off[-1] <= right.last_error[k]  # for the middle alone


def newton_maps_are_enclosed():
    """z - Y F(z) at the corner of a box, for F at the edge of what is known of it."""
    rng = np.random.default_rng(5)
    for case in range(160):
        J, values = rng.standard_normal((1, 4, 4)), rng.standard_normal((1, 4))
        value_errors, radii = rng.uniform(0, 1, (1, 4)), rng.uniform(0, 1, (1, 4))
        if case % 4 == 0:
            value_errors, radii = 0 * values, 0 * values  # the rounding of the root is left
        elif case % 4 == 1:
            values, radii = 0 * values, 0 * values
        elif case % 4 == 2:
            values, value_errors = 0 * values, 0 * values
        newton = NewtonMap.of(J, values)
        bound = newton.errors(value_errors, radii)
        Y = exact(newton.Y)[0]
        defect = np.eye(4, dtype=int) - Y @ exact(J)[0]
        root = -Y @ exact(values)[0] - exact(newton.root)[0]
        for row in range(4):  # all parts of this row at their worst
            worst = abs(root[row]) + np.abs(Y[row]) @ exact(value_errors)[0]
            assert worst + np.abs(defect[row]) @ exact(radii)[0] <= bound[0, row]


def existence_is_proved_where_the_root_is_in_the_box():
    """F with the slope 1 at the middle and 1 - change elsewhere has its root at 1: a box must reach it.

    With a change of 1 the slope may vanish, and with it the root.
    """

    def prove(value, change, radius):
        equations = LinearEnclosure(np.array([[-value]]), np.ones((1, 1, 1)), np.zeros((1, 1)))
        return krawczyk.prove_existence(equations, np.full((1, 1, 1), change), np.array([[radius]]), None)

    for change in (0.0, 0.3, 0.9):
        value = 1.0 - change
        assert prove(value, change, 1.0 + 1e-6).proved[0]
        assert prove(value, change, 1.0 + 1e-6).upper[0, 0] >= 1.0
        for radius in (0.95, 1.0 - 1e-6, 1.0):
            assert not prove(value, change, radius).proved[0]
    for slope in (1.0, 3.0, 49.0, 0.1):
        equations = LinearEnclosure(np.zeros((1, 1)), np.full((1, 1, 1), slope), np.zeros((1, 1)))
        singular = krawczyk.prove_existence(equations, np.full((1, 1, 1), slope), np.ones((1, 1)), None)
        assert not singular.proved[0]


def arcs_are_enclosed():
    """Solutions d of value + (s + change) d + (t + change) p = error over all p, at both of its ends."""
    rng = np.random.default_rng(6)
    for case in range(80):
        values, slopes = 0.1 * rng.standard_normal((1, 1)), np.array([[[1.0, rng.uniform(-0.5, 0.5)]]])
        changes = rng.uniform(0, 0.2, (1, 1, 2)) * (case % 2)
        errors = rng.uniform(0, 0.1, (1, 1)) * (case % 4 < 2)
        radii = np.array([[2.0, rng.uniform(0.1, 1.0)]])
        proof = krawczyk.prove_existence(
            LinearEnclosure(values, slopes, errors), changes, radii, np.array([1])
        )
        assert proof.proved[0]
        p = Fraction(radii[0, 1]) * int(rng.choice([-1, 1]))
        changed = exact(slopes[0, 0]) + exact(changes[0, 0] * signs(rng, changes[0, 0]))
        error = Fraction(errors[0, 0]) * int(rng.choice([-1, 1]))
        d = (error - Fraction(values[0, 0]) - changed[1] * p) / changed[0]
        assert proof.lower[0, 0] <= d <= proof.upper[0, 0]
        assert abs(d - Fraction(proof.along[0, 0]) * p) <= proof.spread[0, 0]


def quadrics_are_solved_in_their_enclosures():
    """y^2 + 2 b y = c with c near 1e6, solved up to rounding; also for every c within a radius."""
    rng = np.random.default_rng(7)
    for case in range(200):
        b, c = rng.uniform(300, 600), rng.uniform(1e5, 1e6)
        radii = np.diag([1e-3 * (case % 2), 0.0])[None]
        near = (np.sqrt(b * b + c) - b) * (1.0 + 1e-6 * (case % 3 == 2))
        quadric = np.array([[[-c, b], [b, 1.0]]]).astype(complex)
        point = np.array([[1.0, near]]).astype(complex)
        proof = krawczyk.enclose_solutions(quadric, radii, np.array([1.0, 0.0]), point)
        assert proof.proved[0]
        with mpmath.workdps(60):
            for side in (-1, 0, 1):
                c_exact = mpmath.mpf(c) + side * mpmath.mpf(radii[0, 0, 0])
                y = mpmath.sqrt(mpmath.mpf(b) ** 2 + c_exact) - mpmath.mpf(b)
                assert abs(y - mpmath.mpf(near)) <= proof.radii[0, 1]


def infinite_points_are_not_denied():
    """z' A z that vanishes, but for rounding; and at the edge of the polydisc, where the bound is met."""
    rng = np.random.default_rng(7)
    for _ in range(40):
        w, scale = np.float64(np.float32(rng.uniform(0.5, 1))), rng.uniform(0.5, 1)
        z = np.array([[3 * w, 4 * w, 5 * w]]).astype(complex)
        cone = scale * np.diag([1.0, 1.0, -1.0])
        assert not homotopy._have_no_infinite_point(cone, z, np.zeros((1, 3)))[0]
    for r in (0.25, 0.01):
        edge = np.array([[1 - r, 1.0]]).astype(complex)
        assert not homotopy._have_no_infinite_point(np.diag([1.0, -1.0]), edge, np.array([[r, 0.0]]))[0]
        inside = homotopy._have_no_infinite_point(np.diag([1.0, -1.0]), edge, np.array([[0.99 * r, 0.0]]))
        assert inside[0]


def pieces_cover_boxes():
    """Narrowed and halved boxes, wide and narrow ones, have every point of what they come from."""
    rng = np.random.default_rng(8)
    for _ in range(200):
        middle = rng.standard_normal((1, 1)) * 10.0 ** rng.uniform(-3, 1)
        radii = np.abs(middle) * 10.0 ** rng.uniform(-12, 9, (1, 1))
        lower, upper = np.sort(rng.uniform(-1, 1, (2, 1, 1)) * radii, axis=0)
        part = Boxes(middle, radii).sub_boxes(lower, upper)
        m = Fraction(middle[0, 0])
        covers(part, [(m + Fraction(lower[0, 0]), m + Fraction(upper[0, 0]))])
        halves = Boxes(middle, radii).halve(np.array([0]))
        r = Fraction(radii[0, 0])
        covers(halves, [(m - r, m + r)])


def covers(boxes, intervals):
    """Assert that intervals of one coordinate are in the union of boxes, which overlap in their order."""
    ends = [(Fraction(m) - Fraction(r), Fraction(m) + Fraction(r)) for (m,), (r,) in zip(*boxes, strict=True)]
    for (_, high), (low, _) in pairwise(ends):
        assert low <= high
    for low, high in intervals:
        assert ends[0][0] <= low
        assert high <= ends[-1][1]


def spectral_radii_are_not_rounded_below_one():
    """Matrices with equal rows: the spectral radius is the exact sum of a row, 1 or little more."""
    rng = np.random.default_rng(9)
    for _ in range(1000):
        row = rng.uniform(0, 1, 9)
        row /= row.sum()
        if exact(row).sum() >= 1:
            assert not regular_ball._spectral_radius_below_one(np.tile(row, (1, 9, 1)))[0]
        else:
            assert regular_ball._spectral_radius_below_one(0.999 * np.tile(row, (1, 9, 1)))[0]


def solutions_are_alone_in_their_radii():
    """Of F(d) = slope d - d^2 the other root is at `slope`, and dF/dd vanishes at half of it."""
    for slope in (1.0, 0.3, 1e-3):
        derivatives = SimpleNamespace(
            slopes=np.array([[[slope]]]),
            remainders=lambda radii: SimpleNamespace(slopes=2.0 * radii[:, None]),
        )
        equations = SimpleNamespace(configurations=lambda u: u, evaluate=lambda q, d=derivatives: d)
        radius = leg_paving.unique_radii(equations, np.zeros((1, 1)))[0]
        assert 0.49 * slope < radius < 0.5 * slope
    known = leg_paving.KnownSolutions(np.array([[3.0, 1.0]]), np.array([0.5]), np.array([2 * np.pi, np.inf]))
    for turns in (-2, 0, 1):
        middle = np.tile([3.3 + 2 * np.pi * turns, 1.0], (2, 1))
        assert known.contains(Boxes(middle, np.array([[0.199, 0.4], [0.201, 0.4]]))).tolist() == [True, False]


def frames_are_bounded_at_a_point():
    """Loop residuals and slopes of the 5R in fifty digits: boxes of no size still have errors."""
    robot = robots.load("five_bar")
    bounds = DerivativeBounds.of(robot)
    rng = np.random.default_rng(10)
    u = rng.uniform(-1, 1, (20, 4))
    q = bounds.configurations(u)
    at = bounds.evaluate(q)
    zero = at.remainders(np.zeros_like(u))
    names = list(robot.model.names)[1:]
    with mpmath.workdps(50):
        for k, joints in enumerate(q):
            angle = dict(zip(names, map(mpmath.mpf, joints.tolist()), strict=True))
            length, half = mpmath.mpf(0.25), mpmath.mpf(0.2)
            legs = []
            for side, sign in (("left", -1), ("right", 1)):
                motor, elbow = angle[f"{side}_motor"], angle[f"{side}_motor"] + angle[f"{side}_elbow"]
                x = sign * half + length * (mpmath.cos(motor) + mpmath.cos(elbow))
                y = length * (mpmath.sin(motor) + mpmath.sin(elbow))
                legs.append(([x, y], [-length * mpmath.sin(elbow), length * mpmath.cos(elbow)]))
            size = mpmath.mpf(robot.length)
            for row in range(2):
                gap = (legs[1][0][row] - legs[0][0][row]) / size
                assert abs(at.values[k, 2 + row] - gap) <= zero.values[k, 2 + row]
                right_elbow = robot.moving.tolist().index(
                    robot.model.joints[names.index("right_elbow") + 1].idx_v
                )
                slope = legs[1][1][row] / size
                assert abs(at.slopes[k, 2 + row, right_elbow] - slope) <= zero.slopes[k, 2 + row, right_elbow]


def measures_are_enclosed():
    """The slope of g at all corners of a box, of P linear in two joints but for the change of dP."""
    rng = np.random.default_rng(11)
    r = np.array([0.05, 0.05])
    block = SimpleNamespace(rows=np.arange(2), columns=np.arange(2))
    for case in range(300):
        P = np.diag([1.0, rng.uniform(-0.2, 0.2)])
        dP, change = np.zeros((2, 2, 2)), np.zeros((2, 2, 2))
        if case % 3 == 0:
            dP[1, 1, 0] = rng.uniform(0.5, 1)
            change[1, 1] = rng.uniform(0, 0.1, 2)
        elif case % 3 == 1:  # the left or the right singular vector turns
            dP[1, 0, 1] = 1.0
            dP[0, 1, 0] = rng.uniform(0.5, 1)
            change[0, 1] = rng.uniform(0, 0.3)
        else:
            dP = rng.standard_normal((2, 2, 2))
        derivatives = SimpleNamespace(bounds=SimpleNamespace(rounding=0.0), slopes=P[None], hessians=dP[None])
        errors = SimpleNamespace(slopes=(np.abs(dP) @ r + change @ r)[None], hessians=change[None])
        valid, g, slope_changes = singular_paving.enclose_measure(block, derivatives, errors)
        if not valid[0]:
            continue
        U, _, V_rows = np.linalg.svd(P)
        for corner in product((-1, 1), repeat=2):
            for side in (-1, 1):
                there = P + dP @ (r * corner)
                inverse = np.linalg.inv(np.block([[there, U[:, -1:]], [V_rows[-1:], np.zeros((1, 1))]]))
                slope = -np.einsum("i,ijl,j->l", inverse[-1, :-1], dP + side * change, inverse[:-1, -1])
                off = np.abs(slope - g.slopes[0, 0])
                assert (off <= slope_changes[0, 0] + 1e-12).all()


def cells_hold_their_joints():
    """q - c q^2 / 2 = x has the root (1 - sqrt(1 - 2 c x)) / c, up to x = 1 / (2 c)."""
    c = 0.8
    derivatives = SimpleNamespace(
        remainders=lambda r: SimpleNamespace(values=0.5 * c * r**2, slopes=c * r[:, :, None])
    )
    for offset, share in product((0.0, 0.3), (0.5, 0.95, 1.001, 1.05)):
        x = share / (2 * c)
        newton = NewtonMap.of(np.ones((1, 1, 1)), np.array([[-offset * x]]))
        boxes = regular_ball._prove_joint_boxes(derivatives, newton, np.array([[(1 - offset) * x]]))
        assert not (boxes.proved[0] and share > 1)
        if share == 0.5:
            root = (1 - np.sqrt(1 - share)) / c
            assert boxes.proved[0]
            assert root <= min(boxes.radii[0, 0], boxes.image[0, 0])
            assert root - (1 - offset) * x <= boxes.error[0, 0]
    robot = robots.load("biglide")
    test = SimpleNamespace(bounds=DerivativeBounds.of(robot))
    q, moved = robot.reference.q, robot.reference.q.copy()
    moved[robot.moving[-1]] += 0.05  # a hinge
    cells = SimpleNamespace(q=q[None], radii=np.full((1, len(robot.moving)), 0.1))
    assert regular_ball._contain_joint_boxes(test, cells, moved, 0.0499)[0]
    assert not regular_ball._contain_joint_boxes(test, cells, moved, 0.0501)[0]
    assert not regular_ball._contain_joint_boxes(test, cells, q, 0.1001)[0]


def passive_blocks_are_regular():
    """P = 1 less one part of its change at a time: 1, where P vanishes, or 0.99, where it does not."""

    def regular(P=1.0, dP=0.0, slope=0.0, error=0.0, change=0.0, rounding=0.0):
        shape = (1, 2, 2, 2)
        P_matrix, dP_matrix = np.eye(2)[None] * [[[1.0], [P]]], np.zeros(shape)
        dP_matrix[0, 1, 1, 1] = dP
        robot = SimpleNamespace(n=0, n_a=0)
        derivatives = SimpleNamespace(
            bounds=SimpleNamespace(robot=robot, rounding=rounding), slopes=P_matrix, hessians=dP_matrix
        )
        boxes = SimpleNamespace(
            error=np.array([[0.0, error]]),
            radii=np.array([[0.0, 1.0]]),
            remainders=SimpleNamespace(hessians=np.full(shape, change) * (dP_matrix == dP)),
        )
        slopes = np.array([[[0.0], [slope]]])
        return regular_ball._passive_block_is_regular(derivatives, slopes, np.ones(1), boxes, 1)[0]

    for size in (0.99, 1.0):
        assert regular(dP=1.0, slope=size) == (size < 1)
        assert regular(dP=1.0, error=size) == (size < 1)
        assert regular(dP=1.0, slope=0.5, error=size - 0.5) == (size < 1)
        assert regular(rounding=size / 2) == (size < 1)  # of both entries in the row
    assert not regular(change=1.0)  # changes of all entries by half
    assert not regular(P=0.0)

    def regular_along(P, dP):
        """Return whether P (s, s) is proved regular along a coordinate that moves all k joints alike."""
        k = dP.shape[-1]
        bounds = SimpleNamespace(robot=SimpleNamespace(n=0, n_a=0), rounding=0.0)
        derivatives = SimpleNamespace(bounds=bounds, slopes=P[None], hessians=dP[None])
        boxes = SimpleNamespace(
            error=np.zeros((1, k)), radii=np.zeros((1, k)), remainders=SimpleNamespace(hessians=0 * dP[None])
        )
        return regular_ball._passive_block_is_regular(derivatives, np.ones((1, k, 1)), np.ones(1), boxes, 1)[
            0
        ]

    for summands in permutations((2.0**54, 1.0, -(2.0**54))):  # they change P by 1, but for rounding
        assert not regular_along(np.eye(1), np.reshape(summands, (1, 1, 3)))
    rng = np.random.default_rng(13)
    for _ in range(30):
        P = rng.integers(-9, 9, (3, 3)).astype(float)
        P[2] = 2 * P[1] - 3 * P[0]  # singular, but for the rounding of its inverse
        assert not regular_along(P, np.full((3, 3, 1), 1e-30))


def platforms_stay_in_their_boxes():
    """Ends of arcs; and corners of boxes about the 5R stretched along x, whose x has no slope there."""
    rng = np.random.default_rng(12)
    robot = SimpleNamespace(n=2, length=1.0, platform_scale=np.ones(2))
    test = SimpleNamespace(bounds=SimpleNamespace(robot=robot), resolution=1e9)
    for case in range(40):
        slopes, x_slopes = rng.standard_normal((1, 2, 3)), rng.standard_normal((1, 2, 3))
        boxes, errors = Boxes(np.zeros((1, 3)), np.full((1, 3), 0.5)), rng.uniform(0, 0.1, (1, 2))
        change = np.full((1, 2, 3), 10.0 * (case % 2))  # with it no arc can be proved
        at_middle = LinearEnclosure(np.zeros((1, 2)), slopes, np.zeros((1, 2)))
        equations = singular_paving._SingularEquations(
            np.ones(1, dtype=bool), at_middle, np.zeros((1, 2)), change, np.zeros((1, 2)), x_slopes, errors
        )
        *_, arcs = SingularBoxTest._decide_arcs(test, boxes, np.full((1, 3), 9.0), equations)
        assert len(arcs.x) == (not case % 2)
        if len(arcs.x):
            parameter = arcs.along[0]
            others = np.delete(np.arange(3), parameter)
            d = np.zeros(3)
            d[parameter] = 0.5
            d[others] = -np.linalg.solve(slopes[0][:, others], slopes[0][:, parameter] * 0.5)
            assert (np.abs(x_slopes[0] @ d) + errors[0] <= arcs.x_radii[0] + 1e-12).all()

    robot = robots.load("five_bar")
    bounds = DerivativeBounds.of(robot)
    radii = np.full((1, 4), 0.3)
    at = bounds.evaluate(robot.neutral[None])
    bound = singular_paving._platform_radii(at, radii, at.remainders(radii).values)
    for corner in product((-1, 1), repeat=4):
        q = integrate_columns(robot, robot.neutral[None], bounds.unknowns, radii * corner)
        change = robot.platform.coordinates(frames_at(robot, q)) - robot.platform.coordinates(at.frames)
        assert (np.abs(change) <= bound).all()
    test = SingularBoxTest(bounds, None, singular_paving.singular_sets(robot)[0], None, 1e-3)
    at = bounds.evaluate(robot.reference.q[None])
    loops = LinearEnclosure(at.values[:, 2:], at.slopes[:, 2:], np.full((1, 2), bounds.rounding))
    point = test._singular_equations(at, loops, 0 * radii, 1e-3 * radii)  # a box of no size
    assert (point.errors >= point.at_middle.errors).all()
    assert (point.at_middle.errors > 0).all()


CRANK, ROD, OFFSET = 0.04, 0.12, -0.02  # of the slider-crank, see its robot file


def balls_end_before_dead_centres():
    """The ball of a slider-crank ends where crank and rod are in line; one cell proves its own ball."""
    robot = robots.load("slider_crank")
    test = regular_ball.CellTest(DerivativeBounds.of(robot), np.zeros(1))
    dead = np.array([np.arcsin(OFFSET / (CRANK + ROD)), np.pi - np.arcsin(OFFSET / (CRANK - ROD))])
    for angle in (-0.2, 0.7, 2.2):
        pose = assemble(robot, [angle])
        distance = np.abs(angle - dead).min()
        radius = regular_ball.prove_regular_ball(robot, pose.q, pose.x, 1.5 * distance, max_cells=200)
        assert 0.98 * distance < radius <= distance
        one = regular_ball._prove_one_cell(test._replace(x=pose.x), pose.q, distance)
        cell = test._replace(x=pose.x)(np.zeros((1, 1)), pose.q[None], np.array([one]), dual_norm=2)
        assert cell.proved[0]
        assert one <= 1.5 * cell.radii.max()


# ------------------------------------------------------------------ no term is idle

NO_ROUNDING = (rounding.gamma, "8 * (terms + 4) * UNIT_ROUNDOFF", "0.0")
combine, map_errors = LinearEnclosure.combine, NewtonMap.errors
bordered = interval_newton.enclose_bordered_solutions
last_column, prove = interval_newton._enclose_last_column, krawczyk.prove_existence
enclose, infinite = krawczyk.enclose_solutions, homotopy._have_no_infinite_point
remainders, measure = Derivatives.remainders, singular_paving.enclose_measure
decide_arcs = SingularBoxTest._decide_arcs
passive, joints = regular_ball._passive_block_is_regular, regular_ball._prove_joint_boxes
# laws, and what must not be left out of a function: (function, source, instead of it)
MUTATIONS = {
    defects_hold: [NO_ROUNDING, (rounding.identity_defect, " + identity)", ")")],
    combinations_are_enclosed: [
        NO_ROUNDING,
        (combine, "self.errors + rounding", "self.errors"),
        (combine, "self.errors + rounding", "rounding"),
    ],
    solutions_stay_in_contracted_boxes: [NO_ROUNDING, (contract, "axis=2) + errors", "axis=2)")],
    last_columns_are_enclosed: [
        NO_ROUNDING,
        (last_column, "residual + product_error", "residual"),
        (last_column, "residual + product_error", "product_error"),
        (last_column, " + X_size @ M_errors", ""),
        (last_column, "identity_defect(X, M) + ", ""),
        (last_column, " + row_sums * largest[:, None]", ""),
        (last_column, "np.matvec(M, z)) + residual_rounding", "np.matvec(M, z))"),
        (last_column, "norm < 1.0", "norm < 1.1"),
    ],
    bordered_solutions_are_enclosed: [
        (bordered, "errors + rounding", "errors"),
        (bordered, "errors + rounding", "0 * errors + rounding"),
        (last_column, "solution_error(rounding *", "solution_error(0 * rounding *"),
    ],
    newton_maps_are_enclosed: [
        NO_ROUNDING,
        (map_errors, "self.rounding + ", ""),
        (map_errors, " + np.matvec(np.abs(self.Y), value_errors)", ""),
        (map_errors, " + np.matvec(self.defect, radii)", ""),
    ],
    existence_is_proved_where_the_root_is_in_the_box: [
        (prove, "reach) < radii", "reach) < 1.1 * radii"),
        (prove, "np.abs(newton.root) + reach", "reach"),
        (prove, " + ROUND_UP * np.matvec(slope_changes, radii)", ""),
    ],
    arcs_are_enclosed: [
        (prove, "equations.errors + ", ""),
        (prove, " + np.abs(along) * p_radius", ""),
        (prove, "errors + np.abs(newton.root)", "errors"),
        (prove, "lower=newton.root - reach", "lower=newton.root - reach / 1.1"),
    ],
    quadrics_are_solved_in_their_enclosures: [
        NO_ROUNDING,
        (enclose, "rounding * Q_size + radii", "rounding * Q_size"),
        (enclose, "F_errors + np.matvec(J_errors, r)", "np.matvec(J_errors, r)"),
        (enclose, "np.abs(newton.root) + ", ""),
    ],
    infinite_points_are_not_denied: [
        NO_ROUNDING,
        (infinite, " + 2 * rounding", ""),
        (infinite, " + radii @ A_size", ""),
        (infinite, "2 * np.abs(slopes) + ", ""),
    ],
    pieces_cover_boxes: [
        NO_ROUNDING,
        (Boxes.halve, " + gamma(2) * np.abs(self.middle)", ""),
        (Boxes.sub_boxes, "(upper - lower) + rounding", "(upper - lower)"),
    ],
    spectral_radii_are_not_rounded_below_one: [
        (regular_ball._spectral_radius_below_one, "< w)", "< 1.1 * w)")
    ],
    solutions_are_alone_in_their_radii: [
        (leg_paving.unique_radii, "np.minimum(", "1.1 * np.minimum("),
        (leg_paving.KnownSolutions.contains, "farthest < self.radii", "farthest < 1.1 * self.radii"),
        (leg_paving.KnownSolutions.contains, " + boxes.radii[:, None]", ""),
    ],
    platforms_stay_in_their_boxes: [
        (singular_paving._platform_radii, " + remainders[:, : robot.n]", ""),
        (decide_arcs, "half_length + equations.x_errors", "half_length"),
        (decide_arcs, "half_length + equations.x_errors", "equations.x_errors"),
        (decide_arcs, "is_arc = proof.proved & ~remaining", "is_arc = ~remaining"),
        (SingularBoxTest._singular_equations, "g.errors + np.matvec", "np.matvec"),
    ],
    frames_are_bounded_at_a_point: [
        (remainders, "value_errors += rounding * (1 + radii", "value_errors += rounding * (radii"),
        (remainders, " + rounding,", ","),
    ],
    measures_are_enclosed: [
        (measure, "slope_changes += _bilinear_form(psi_size, dP_size, eta_error)", "pass"),
        (measure, "slope_changes += _bilinear_form(psi_error, dP_size + dP_change, eta_size)", "pass"),
        (measure, "slope_changes = _b", "slope_changes = 0 * _b"),
        (measure, "np.abs(eta) + eta_error", "np.abs(eta)"),
        (measure, "dP_size + dP_change, eta", "dP_size, eta"),
    ],
    cells_hold_their_joints: [
        (joints, "(reach + error)", "(error)"),
        (joints, "(reach + error)", "(reach)"),
        (joints, "(offset + newton", "(newton"),
        (joints, "image < radii", "image < 1.1 * radii"),
        (regular_ball._contain_joint_boxes, "np.abs(offset) + radii", "np.abs(offset)"),
        (regular_ball._contain_joint_boxes, "np.abs(offset) + radii", "radii"),
        (regular_ball._contain_joint_boxes, "<= cells.radii", "<= 1.1 * cells.radii"),
    ],
    passive_blocks_are_regular: [
        (passive, " + _bound_over_cell(changes, half, dual_norm)", ""),
        (passive, "identity_defect(Y, P) + ", ""),
        (passive, " + gamma(s * k) * rounded", ""),
        (passive, "dP_size + rounding, boxes.error", "0 * dP_size, boxes.error"),
        (passive, "P_errors += 0.5 *", "P_errors += 0.4 *"),
        (passive, "P_errors += rounding", "P_errors += 0 * rounding"),
    ],
    balls_end_before_dead_centres: [
        (regular_ball._largest_proved, "float(radii", "1.1 * float(radii"),
        (regular_ball._prove_cubes, "return float(distances(dis", "return 1.1 * float(distances(dis"),
    ],
}
# laws whose bounds have no other margin than the rounding of sums upwards
WITHOUT_ROUND_UP = [
    combinations_are_enclosed,
    solutions_stay_in_contracted_boxes,
    newton_maps_are_enclosed,
    pieces_cover_boxes,
    spectral_radii_are_not_rounded_below_one,
]


def name(value):
    return getattr(value, "__name__", value)


@pytest.mark.parametrize("law", MUTATIONS, ids=name)
def test_law(law):
    law()


@pytest.mark.parametrize(
    ("law", "function", "old", "new"),
    [(law, *change) for law, changes in MUTATIONS.items() for change in changes],
    ids=name,
)
def test_no_term_is_idle(law, function, old, new, monkeypatch):
    monkeypatch.setattr(function, "__code__", mutated_code(function, old, new))
    with pytest.raises(AssertionError):
        law()


@pytest.mark.parametrize("law", WITHOUT_ROUND_UP, ids=name)
def test_rounding_up_is_not_idle(law, monkeypatch):
    for module_name, module in list(sys.modules.items()):
        if module_name.startswith("framework.proofs") and hasattr(module, "ROUND_UP"):
            monkeypatch.setattr(module, "ROUND_UP", 1.0)
    with pytest.raises(AssertionError):
        law()
