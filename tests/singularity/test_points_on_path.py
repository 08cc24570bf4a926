"""Singular points on a path against the closed-form locus of the planar 5R."""

from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import (
    Arc,
    InvalidInput,
    Line,
    OutOfReach,
    SingularPath,
    Spline,
    assemble,
    locate_singularities,
    track_path,
)
from framework.singularity.piecewise_measure import Unresolved
from framework.singularity.points_on_path import _unresolved_error, search_path
from framework.singularity.type2 import singularity_measure
from tests.oracles import five_bar as oracle

ROBOT = "five_bar"
LEFT, RIGHT = np.array([-0.2, 0.0]), np.array([0.2, 0.0])
LENGTH = 0.25


def locus(crank: float) -> np.ndarray:
    """Payload (2,) [m] when both rods lie on one line: the middle of the bar between the elbows."""
    left = LEFT + LENGTH * np.array([np.cos(crank), np.sin(crank)])
    # right elbow: 2 LENGTH from the left one, LENGTH from its motor, on the upper side
    between = RIGHT - left
    distance = np.linalg.norm(between)
    along = (distance**2 + (2 * LENGTH) ** 2 - LENGTH**2) / (2 * distance)
    normal = np.array([-between[1], between[0]]) / distance
    right = left + along * between / distance + np.sqrt((2 * LENGTH) ** 2 - along**2) * normal
    return 0.5 * (left + right)


def locus_tangent(crank: float) -> np.ndarray:
    """Direction of the locus by a central difference, good to 1e-10."""
    h = 1e-5
    return (locus(crank + h) - locus(crank - h)) / (2 * h)


def rods_cross(x) -> float:
    """Cross product of the rods of the undeformed 5R with the payload at x: zero on the locus."""
    A = oracle.velocity_matrices(x)[0]
    return float(A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0])


PATHS = [
    Line([0.1, 0.345], [-0.05, 0.195]),
    Line([0.1, 0.345], [-0.2, -0.2]),  # crosses twice
    Arc([0.1, 0.345], [0.0, 0.26], [-0.1, 0.2]),
    Spline([[0.1, 0.345], [0.05, 0.3], [0.0, 0.26], [-0.02, 0.2], [-0.05, 0.22], [-0.1, 0.3], [-0.1, 0.2]]),
    Line([0.1, 0.345], [-0.05, 0.295]),  # stays clear
]


@pytest.mark.parametrize("path", PATHS, ids=["line", "twice", "arc", "spline", "clear"])
def test_all_crossings_are_found_to_rounding(robot, path):
    found = locate_singularities(robot, path)
    grid = np.linspace(0.0, 1.0, 401)
    values = [rods_cross(path(s)) for s in grid]
    changes = np.flatnonzero(np.diff(np.sign(values)))
    assert len(found) == len(changes)
    for point, k in zip(found, changes, strict=True):
        assert grid[k] < point.s < grid[k + 1]
        assert point.contact == "transversal"
        h = 1e-12  # the closed form changes sign within 1e-12 of the root
        assert rods_cross(path(point.s - h)) * rods_cross(path(point.s + h)) < 0


@pytest.mark.parametrize("crank", [1.5, 1.7, 1.9])
def test_a_tangential_touch_is_found_though_g_keeps_its_sign(robot, crank):
    middle, tangent = locus(crank), locus_tangent(crank)
    reach = 0.06 * tangent / np.linalg.norm(tangent)
    # an arc that is nearly the tangent line: touches at its middle, s = 1/2
    path = Line(middle - reach, middle + reach)
    (point,) = locate_singularities(robot, path)
    assert point.contact == "tangential"
    assert point.s == pytest.approx(0.5, abs=1e-9)  # what the differenced tangent allows
    g = singularity_measure(robot, track_path(robot, path).close(np.linspace(0, 1, 101))).g
    assert np.all(g[:45] * g[56:] > 0)


def test_tangential_touch_by_an_exact_arc_is_located_to_1e_12(robot):
    # by symmetry the locus is horizontal on the axis x = 0; an arc symmetric to it touches there
    top = locus(float(np.arccos(-0.2)))
    assert top[0] == pytest.approx(0.0, abs=1e-15)
    end = np.array([0.08, top[1] + 0.05])
    path = Arc(end, top, end * [-1, 1])
    (point,) = locate_singularities(robot, path)
    assert point.contact == "tangential"
    assert point.s == pytest.approx(0.5, abs=1e-12)


def test_a_start_out_of_reach_is_said_so(robot):
    with pytest.raises(OutOfReach, match="way from the reference"):
        locate_singularities(robot, Line([0.1, 0.7], [0.1, 0.345]))


@pytest.mark.parametrize("x", [[0.1], [0.1, np.nan], [0.1, 0.2, 0.3]])
def test_assemble_refuses_what_is_no_platform_point(robot, x):
    with pytest.raises(InvalidInput, match="2 finite numbers"):
        assemble(robot, x)


class AlongTheLocus:
    """The singular curve itself as a path."""

    n, knots = 2, np.empty(0)

    def __call__(self, s, order=0):
        cranks = 1.6 + 0.2 * np.atleast_1d(np.asarray(s, dtype=float))
        h = 1e-4
        derivative = [
            locus,
            lambda c: 0.2 * locus_tangent(c),
            lambda c: 0.04 * (locus_tangent(c + h) - locus_tangent(c - h)) / (2 * h),
        ][order]
        return np.array([derivative(c) for c in cranks]).reshape(*np.shape(s), 2)


def test_a_path_along_the_locus_is_told_as_such(robot):
    with pytest.raises(SingularPath, match="runs along a singularity"):
        locate_singularities(robot, AlongTheLocus())


class Shaking:
    """A platform that turns to and fro about z."""

    n, knots = 3, np.empty(0)

    def __call__(self, s: np.ndarray, order: int = 0) -> np.ndarray:
        pace = 2 * np.pi * 20.7
        turn = 1.5 * pace**order * np.sin(pace * np.asarray(s) + order * np.pi / 2)
        return np.stack([0 * turn, 0 * turn, turn], axis=-1)


@pytest.mark.slow
def test_a_searched_path_stays_on_the_branch_where_the_measure_does_not_see_the_motion():
    """The agile eye as a whole turns with its motors: no panel is halved for it, and its joints swing."""
    robot, path, s = robots.load("agile_eye"), Shaking(), np.linspace(0.0, 1.0, 400)
    tracked = track_path(robot, path).close(s).q
    searched = search_path(robot, path).branch.close(s).q
    np.testing.assert_allclose(searched, tracked, rtol=0, atol=1e-12)


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("lost", [1, 2])
def test_a_measure_that_is_not_resolved_names_as_many_motions_as_vanish_together(lost, power):
    """Of P of size five, or of P'P with its squares; one motion alone is no reason."""
    passive = SimpleNamespace(
        branch=SimpleNamespace(robot=robots.load(ROBOT), path=Line([0.1, 0.345], [-0.05, 0.195])),
        linearise_guesses=lambda s: s,
        matrix=lambda loops: np.diag(np.repeat([1.0, 3e-4], [5 - lost, lost]) ** power)[None],
        power=power,
    )
    unresolved = Unresolved(ROBOT, 0.5, 1e-9)
    error = _unresolved_error(passive, unresolved)
    assert error is unresolved if lost == 1 else error.count == lost
