"""Where a matrix loses rank along a path, against matrices Q(s) D(s) R(s)' with D known."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

import robots
from framework import Line, SingularPath
from framework.singularity.bordered_system import Border, solve_bordered
from framework.singularity.piecewise_measure import MeasuredMatrix, resolve_panels
from framework.singularity.points_on_path import search_path
from framework.singularity.rank_deficiency import find_contacts, find_near_misses

SIZE = 6


def rotation(rng, turning):
    """Of SIZE dimensions, turning with s: (T,) -> (T, SIZE, SIZE)."""
    skew = rng.normal(size=(SIZE, SIZE))
    return lambda s: np.array([expm(turning * value * (skew - skew.T)) for value in s])


def measured(*entries, power=1, turning=0.4):
    """The matrix with these functions of s, and ones, as singular values with a sign."""
    rng = np.random.default_rng(5)
    left, right = rotation(rng, turning), rotation(rng, turning)

    def matrix(s):
        values = np.ones((len(s), SIZE))
        for k, entry in enumerate(entries):
            values[:, k] = entry(s)
        product = (left(s) * values[:, None, :]) @ right(s).transpose(0, 2, 1)
        return product.transpose(0, 2, 1) @ product if power == 2 else product

    branch = SimpleNamespace(
        robot=SimpleNamespace(name="matrix"),
        path=SimpleNamespace(knots=np.empty(0)),
        panels=(),
        close=lambda s: s,
    )
    return MeasuredMatrix(branch, matrix, power)


def found(*entries, power=1):
    matrix = measured(*entries, power=power)
    return find_contacts(matrix, resolve_panels(matrix))


def root(at, slope=1.0):
    return lambda s: slope * (s - at)


def touch(at, bend=2.0):
    return lambda s: bend * (s - at) ** 2


def slow(value):
    """A case of the second stage."""
    return pytest.param(value, marks=pytest.mark.slow)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_det_G_has_the_roots_and_the_sign_of_the_determinant(count):
    matrix = measured(*[root(0.3 + 0.2 * k) for k in range(count)])
    s = np.linspace(0.0, 1.0, 41) + 1e-3
    matrices = matrix.evaluate(s)
    solution = solve_bordered(matrices, Border.of(matrices[20], count))
    np.testing.assert_array_equal(np.sign(solution.g), np.linalg.slogdet(matrices)[0])
    at = matrix.evaluate(np.array([0.3]))
    assert solve_bordered(at, Border.of(at[0], count)).g[0] == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("others", [(), (0.4,), (0.4, 0.4), (0.4, 0.4, 0.4)])
def test_values_that_vanish_together_are_one_contact(others):
    (only,) = found(root(0.4), *[root(at, -0.6) for at in others])
    assert only.s == pytest.approx(0.4, abs=1e-12)
    assert only.kind == "transversal"


TANGENTIAL = {
    "both touch": ((touch(0.37), touch(0.37, 0.7)), 1),
    "one crosses, one touches": ((root(0.37), touch(0.37, 0.7)), 1),
    "what crosses in P touches in P'P, as with redundant motors": ((root(0.37), root(0.37, -0.6)), 2),
}


@pytest.mark.parametrize(("entries", "power"), TANGENTIAL.values(), ids=TANGENTIAL)
def test_values_that_vanish_together_and_touch_are_tangential(entries, power):
    (only,) = found(*entries, power=power)
    assert only.s == pytest.approx(0.37, abs=1e-9)
    assert only.kind == "tangential"


@pytest.mark.parametrize("gap", [slow(0.1), 1e-2, slow(1e-3), slow(4e-4)])
def test_values_that_vanish_near_one_another_are_told_apart(gap):
    places = found(root(0.4), root(0.4 + gap, -0.8))
    assert [place.kind for place in places] == ["transversal"] * 2
    np.testing.assert_allclose([place.s for place in places], [0.4, 0.4 + gap], rtol=0, atol=1e-12)


@pytest.mark.parametrize("second", [0.4, 0.43, 0.7, 0.9])
def test_blocks_lose_rank_each_by_itself(second):
    """A border of one column sees the block of its singular vectors only, which do not turn."""
    matrix = measured(root(0.3), root(second, -0.8), turning=0.0)
    places = find_contacts(matrix, resolve_panels(matrix))
    assert [place.kind for place in places] == ["transversal"] * 2
    np.testing.assert_allclose([place.s for place in places], [0.3, second], rtol=0, atol=1e-12)


def bowl(depth, at=0.4137):
    """A parabola, not quite symmetric, whose lowest value is a depth: two roots where that is negative."""
    return lambda s: ((s - at) ** 2 + depth) * (1.0 + 0.3 * (s - at))


@pytest.mark.parametrize("gap", [1e-2, slow(1e-4), slow(1e-5), slow(1.8e-6), slow(1e-6), 5e-7])
def test_two_roots_are_two_however_near_to_each_other(gap):
    before, behind = found(bowl(-(gap**2) / 4))
    assert (before.kind, behind.kind) == ("transversal", "transversal")
    # g is known to a few 1e-16, and its slope at the roots is their distance
    np.testing.assert_allclose(
        [before.s, behind.s], 0.4137 + np.array([-gap, gap]) / 2, rtol=0, atol=2e-15 / gap
    )


@pytest.mark.parametrize("gap", [0.0, 1e-9, 1e-8])
def test_two_roots_that_rounding_cannot_part_are_a_touch_that_says_so(gap):
    (only,) = found(bowl(-(gap**2) / 4))
    assert only.kind == "tangential"
    assert only.s == pytest.approx(0.4137, abs=1e-9)
    assert gap < only.resolution < 5e-7


@pytest.mark.parametrize("gap", [1e-3, 1.8e-6])
def test_a_third_root_beside_two_is_found_as_well(gap):
    def three(s):
        return (s - 0.4) * (s - 0.4 - gap) * (s - 0.41)

    # what rounding leaves of g over its slope there
    slope = 0.01 * gap
    places = [place.s for place in found(three)]
    np.testing.assert_allclose(places, [0.4, 0.4 + gap, 0.41], rtol=0, atol=4e-15 / slope)


@pytest.mark.parametrize("beside", [1e-3, slow(1e-5), slow(1e-6)])
def test_a_near_miss_is_told_with_its_place_its_depth_and_its_width(beside):
    matrix = measured(bowl(beside**2))
    resolved = resolve_panels(matrix)
    assert find_contacts(matrix, resolved) == []
    (miss,) = find_near_misses(matrix, resolved, [])
    assert miss.s == pytest.approx(0.4137, abs=max(1e-9, beside**2))
    assert abs(miss.g) == pytest.approx(beside**2, rel=5e-3)
    # to where it has doubled; the walk there goes in steps of two
    assert 0.9 * beside < miss.width < 2.1 * beside


@pytest.mark.parametrize("distance", [slow(1e-2), 1e-3, slow(1e-4), slow(1e-5), slow(1e-6)])
def test_near_misses_of_two_values_are_no_contact(distance):
    """As beside an axis on which two vanish: the block [[s, d], [-d, s]] never does."""
    matrix = measured()

    def pair(s):
        matrices = matrix.evaluate(s)
        block = np.array([[[v - 0.4, distance], [-distance, v - 0.4]] for v in s])
        left, right = matrices[:, :, :2], np.eye(SIZE)[:, :2]
        return matrices - left @ right.T[None] + left @ block @ right.T[None]

    beside = MeasuredMatrix(matrix.branch, pair)
    assert find_contacts(beside, resolve_panels(beside)) == []


def test_a_contact_on_the_edge_of_panels_or_of_the_path_is_found_once():
    for at in (0.0, 0.5, 1.0):
        (only,) = found(root(at), root(at, -0.7))
        assert only.s == pytest.approx(at, abs=1e-12)


def test_a_path_along_the_locus_is_refused():
    with pytest.raises(SingularPath, match="runs along a singularity"):
        found(root(0.4), lambda s: 0.0 * s)


@pytest.mark.parametrize("gap", [1e-3, 1e-6])
def test_an_end_of_the_path_beside_a_root_is_a_near_miss(gap):
    """Where g is nearly linear it doubles over as much as the root is beyond the end."""
    robot = robots.load("five_bar")
    path = Line([0.1, 0.345], [-0.05, 0.195])
    (point,) = search_path(robot, path).points
    for start, end in ((0.0, point.s - gap), (point.s + gap, 1.0)):
        searched = search_path(robot, Line(path(start), path(end)))
        (miss,) = searched.near_misses
        assert not searched.points
        assert miss.s == (1.0 if start == 0.0 else 0.0)
        assert miss.width * (end - start) == pytest.approx(gap, rel=0.02)
        assert abs(miss.g) == pytest.approx(abs(point.slope) * gap, rel=0.02)
    for start, end in ((0.0, point.s - 0.2), (0.0, point.s + gap)):
        assert not search_path(robot, Line(path(start), path(end))).near_misses


def test_no_root_is_taken_for_one_of_those_about_a_distant_extremum():
    """Two roots about an extremum that is refined, and another that is fourteen times as far from it."""
    d = 1.3e-3
    offsets = np.array([one.s for one in found(lambda s: (s - 0.4 + d) * (s - 0.4 - d) * (s - 0.4 - 14 * d))])
    np.testing.assert_allclose(offsets - 0.4, [-d, d, 14 * d], atol=1e-9)
