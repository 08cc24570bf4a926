"""Paths that touch the locus, cross it twice in a short stretch, or just miss it.

What goes wrong: a search for sign changes on a grid does not see two crossings between two samples, nor a
touch, which changes no sign at all; on sigma_min there is never a change of sign.
Why: singularity is looked for on samples, with a measure that has no sign or loses it.
What we do: the bordered scalar g is a polynomial, up to rounding, on panels of the path. All its roots and
all its extrema are eigenvalues of a small matrix; none is stepped over. At a touch finite torques ask for
condition (8) and its derivative at once: the optimal law meets both, the polynomial is refused.
"""

import numpy as np
import pytest

from framework import (
    Line,
    NoAnswer,
    NoLaw,
    NotConverged,
    locate_singularities,
    plan_crossing,
    simulate,
    track_path,
)
from framework.singularity.points_on_path import search_path
from framework.singularity.type2 import singularity_measure
from tests.oracles.equations_of_motion import defects_at
from tests.oracles.planar import cross, exact, legs, mp, rods_cross, without_rotors
from tests.singularity.test_points_on_path import locus, locus_tangent

DEPTHS = 10.0 ** -np.arange(3, 13)  # [m] by which the path reaches over the locus


def chord(depth: float, at: float = 0.5) -> Line:
    """A straight path, 0.12 m long, that reaches over the locus by a depth [m] at s; negative: misses."""
    middle, tangent = locus(1.7), locus_tangent(1.7)
    reach = 0.06 * tangent / np.linalg.norm(tangent)
    normal = np.array([-reach[1], reach[0]]) / np.linalg.norm(reach)
    inside = np.sign(normal @ (locus(1.7 + 1e-2) + locus(1.7 - 1e-2) - 2 * middle))
    shift = depth * inside * normal
    return Line(middle - 2 * at * reach + shift, middle + 2 * (1 - at) * reach + shift)


def exact_crossings(path: Line, near: list[float]) -> list:
    """Roots of the closed form in fifty digits, from starting values."""

    def measure(s):
        ends = zip(path.start, path.end, strict=True)
        x, y = (exact(float(a)) + s * (exact(float(b)) - exact(float(a))) for a, b in ends)
        return rods_cross(x, y)

    return [mp.findroot(measure, (mp.mpf(s), mp.mpf(s) + mp.mpf("1e-9"))) for s in near]


def found(depth: float) -> tuple[int, float]:
    """Number of crossings found, and the largest error in s."""
    path = chord(depth)
    ours = [point.s for point in locate_singularities(without_rotors(), path)]
    exact_ones = exact_crossings(path, ours)
    return len(ours), max((abs(float(s - e)) for s, e in zip(ours, exact_ones, strict=True)), default=0.0)


@pytest.mark.parametrize("depth", DEPTHS)
def test_two_crossings_are_found_however_near_to_each_other(depth):
    count, error = found(depth)
    gap = 3.6 * np.sqrt(depth / 1e-1)  # of the two in s, a parabola through the first depth
    assert count == 2
    # g is known to a few 1e-16 and its slope falls with the gap
    assert error < max(1e-13, 1e-14 / gap)


def test_a_near_miss_has_no_crossing_and_a_touch_is_one_of_its_own():
    for depth in DEPTHS[::3]:
        assert found(-depth)[0] == 0
    (touch,) = locate_singularities(without_rotors(), chord(0.0))
    assert touch.contact == "tangential"
    with pytest.raises(NoLaw, match="touches the locus without crossing"):
        plan_crossing(without_rotors(), chord(0.0), duration=1.5, law="polynomial")
    with pytest.raises(
        NotConverged, match="torques are not resolved"
    ):  # nor does a law without conditions pass
        plan_crossing(without_rotors(), chord(0.0), duration=1.5, times=[])


def test_a_touch_is_crossed_by_a_law_that_meets_the_condition_and_its_derivative():
    """Not halfway, where a law that is symmetric about the touch has no acceleration."""
    plan = plan_crossing(without_rotors(), chord(0.0, 0.3), duration=3.0, optimize="energy")
    (crossing,) = plan.crossings
    assert plan.certificate.tail < 1e-10
    assert simulate(without_rotors(), plan).tracking_error < 1e-7

    def across_the_rod(t: float) -> float:  # share of the payload's acceleration that the rods cannot give
        (_, rod), _ = legs(*map(float, plan.platform(t)))
        return float(cross(rod, plan.platform(t, 2)))

    h, size = 1e-3 * plan.duration, max(abs(across_the_rod(t)) for t in np.linspace(0.1, 2.9, 57))
    before, here, after = (across_the_rod(crossing.time + k * h) for k in (-1, 0, 1))
    assert abs(here) < 1e-9 * size
    assert abs(after - before) < 1e-4 * size  # it vanishes with its derivative


def level(gap: float, *, across: bool) -> tuple[Line, list]:
    """The level path, 0.12 m long, that meets the locus twice, a gap in s apart, or misses it by as little.

    The 5R and its locus are symmetric about x = 0. With it the exact roots for its y as rounded.
    """
    top = mp.sqrt(mp.mpf("0.06"))
    depth = top - mp.findroot(lambda y: rods_cross(exact(0.06) * gap, y), (top, top - mp.mpf("1e-4")))
    y = float(top - depth if across else top + depth)
    path = Line([0.06, y], [-0.06, y])
    return path, exact_crossings(path, [0.5 - gap / 2, 0.5 + gap / 2]) if across else []


@pytest.mark.parametrize("gap", [1e-3, 1e-5, 1.8e-6, 1e-6])
def test_two_crossings_a_micrometre_of_path_apart_are_told_as_two(gap):
    path, (before, behind) = level(gap, across=True)
    assert float(behind - before) == pytest.approx(gap, rel=0.02)  # but for the rounding of y
    found = locate_singularities(without_rotors(), path)
    assert [point.contact for point in found] == ["transversal"] * 2
    assert found[0].slope * found[1].slope < 0
    for point, exactly in zip(found, (before, behind), strict=True):
        # half of what rounding leaves of g over its slope there
        assert abs(float(point.s - exactly)) < 1e-15 / (0.15 * gap)


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1.8e-6])
def test_a_near_miss_is_told_with_its_place_and_how_near_it_is(gap):
    """The same depth beyond the locus as a crossing would reach over it: g has the same size there."""
    missing, _ = level(gap, across=False)
    searched = search_path(without_rotors(), missing)
    assert searched.points == ()
    (miss,) = searched.near_misses
    assert miss.s == pytest.approx(0.5, abs=1e-7)
    over, _ = level(gap, across=True)
    middle = track_path(without_rotors(), over).close(np.array([0.5]))
    g = singularity_measure(without_rotors(), middle).g[0]
    assert abs(miss.g) == pytest.approx(abs(g), rel=0.02)
    assert miss.g * g < 0
    assert 0.3 * gap < miss.width < 3 * gap


@pytest.mark.parametrize("gap", [1e-2, 1e-5, 1e-6])
def test_no_torque_is_certified_across_a_near_miss_and_the_refusal_says_where(gap):
    """A stretch of 1e-6 in s lies between two nodes: the tail alone would be 7e-12 and prove it."""
    missing, _ = level(gap, across=False)
    with pytest.raises(NotConverged, match=r"at s = 0\.5.*misses a singularity by \|g\| =") as caught:
        plan_crossing(without_rotors(), missing, duration=1.5, law="polynomial")
    assert caught.value.s == pytest.approx(0.5, abs=1e-7)
    np.testing.assert_allclose(caught.value.platform, missing(0.5), atol=1e-7)


def test_a_law_that_is_certified_across_a_near_miss_has_the_forces_of_the_motion_there():
    """By symmetry the law of least peak asks nothing along t_s where the path just misses the locus."""
    robot, (missing, _) = without_rotors(), level(0.01, across=False)
    plan = plan_crossing(robot, missing, duration=1.5, law="optimal")
    away = np.array([0.0, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
    t = 0.75 + np.concatenate([-away, away])
    assert np.abs(plan.law(t[:1]) - 0.5).max() < 1e-9
    left = defects_at(plan, t)
    assert left.force < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("depth", [*DEPTHS[:5], 1e-10, *-DEPTHS[:6], -1e-12])
def test_every_chord_is_planned_and_proved_or_refused(depth):
    try:
        plan = plan_crossing(without_rotors(), chord(depth), duration=1.5)
    except NoAnswer:
        assert abs(depth) < 1e-4  # too near for a law of low degree, or for 512 nodes
        return
    assert plan.certificate.tail < 1e-10
    assert len(plan.crossings) == (2 if depth > 0 else 0)
