"""Paths: where they go, their derivatives, and x(s(t)) differentiated in time."""

from itertools import pairwise

import mpmath as mp
import numpy as np
import pytest

from framework import Arc, Condition, InvalidInput, Law, Line, Polyline, Spline
from framework.laws.path import check_path, time_derivatives

X = [0.1, 0.05, 0.0, -0.02, -0.05, -0.1, -0.1, 0.0]
Y = [0.345, 0.3, 0.26, 0.2, 0.22, 0.3, 0.2, 0.1]
POINTS = np.column_stack([X, Y])
PATHS = {
    "line": Line([0.1, 0.345], [-0.05, 0.195]),
    "arc": Arc([0.1, 0.345], [0.0, 0.26], [-0.1, 0.2]),
    "arc the long way": Arc([1.0, 0.0], [-1.0, 0.1], [0.9, -0.2]),
    "arc in space": Arc([1.0, 0.0, 0.2], [0.0, 1.0, 0.5], [-1.0, 0.3, -0.4]),
    "spline": Spline(POINTS),
    "short spline": Spline(POINTS[:3]),
    "spline of two": Spline(POINTS[:2]),
    "polyline": Polyline(POINTS[:4], blend=0.02),
    "polyline in space": Polyline([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0.5, 0]], blend=0.5),
}
every_path = pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)


@every_path
def test_shapes_follow_s(path):
    for order in range(6):
        assert path(0.3, order).shape == (path.n,)
        assert path(np.array([0.3]), order).shape == (1, path.n)
        assert path(np.linspace(0, 1, 5), order).shape == (5, path.n)


@every_path
@pytest.mark.parametrize("order", range(1, 5))
def test_each_derivative_is_that_of_the_one_before(path, order):
    h = 1e-5
    s = np.linspace(0.01, 0.99, 23)  # no spline knot within h of these
    differences = (path(s + h, order - 1) - path(s - h, order - 1)) / (2 * h)
    scale = max(np.abs(path(s, order + k)).max() for k in (-1, 0, 2))
    np.testing.assert_allclose(path(s, order), differences, atol=1e-9 * scale)  # eps / h, and h^2


def test_a_line_is_straight_and_even():
    path = Line([0.1, 0.345], [-0.05, 0.195])
    s = np.linspace(-0.1, 1.1, 7)  # it goes on beyond its ends
    np.testing.assert_allclose(path(s), [0.1, 0.345] + s[:, None] * [-0.15, -0.15], atol=1e-16)
    np.testing.assert_allclose(path(1.0), [-0.05, 0.195], atol=1e-16)
    assert np.all(path(s, 2) == 0.0)


@pytest.mark.parametrize("name", [name for name in PATHS if name.startswith("arc")])
def test_an_arc_runs_through_its_points_on_a_circle_at_constant_speed(name):
    path = PATHS[name]
    s = np.linspace(0, 1, 2001)
    x = path(s)
    np.testing.assert_allclose(x[[0, -1]], [path.start, path.end], atol=4e-16)
    spokes = x - path.center
    radius = np.linalg.norm(path.start - path.center)
    np.testing.assert_allclose(np.linalg.norm(spokes, axis=1), radius, rtol=1e-14)
    speed = np.linalg.norm(path(s, 1), axis=1)
    np.testing.assert_allclose(speed, speed[0], rtol=1e-14)
    # through `via`, in between: no sample is farther from it than half a step
    distance = np.linalg.norm(x - path.via, axis=1)
    assert distance.min() <= 0.5 * speed[0] / 2000 * 1.001
    assert 0 < np.argmin(distance) < 2000
    assert np.linalg.matrix_rank(spokes, tol=1e-12) == 2  # in one plane


@pytest.mark.parametrize(("degrees", "angle"), [((0, 45, 90), 90), ((0, -45, -90), 90), ((0, 200, 300), 300)])
def test_an_arc_has_the_length_of_its_angle(degrees, angle):
    points = [0.3 * np.array([np.cos(a), np.sin(a)]) + 0.1 for a in np.deg2rad(degrees)]
    path = Arc(*points)
    assert np.linalg.norm(path(0.5, 1)) == pytest.approx(0.3 * np.deg2rad(angle), rel=1e-14)


@pytest.mark.parametrize("count", range(2, len(POINTS) + 1))
def test_a_spline_runs_through_its_points_in_turn(count):
    points = POINTS[:count]
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(chords) / chords.sum()])
    np.testing.assert_allclose(Spline(points)(at), points, atol=1e-14)  # a linear system of eight


def test_a_spline_has_four_continuous_derivatives_and_tells_where_the_fifth_jumps():
    path = Spline(POINTS)
    assert len(path.knots) > 0
    assert np.all((path.knots > 0) & (path.knots < 1))
    h = 1e-9
    for order in range(6):
        scale = np.abs(path(np.linspace(0, 1, 101), order)).max()
        jump = np.abs(path(path.knots + h, order) - path(path.knots - h, order)).max() / scale
        if order <= 4:
            assert jump < 1e-7  # h times the next derivative, some 30 times larger
        else:
            assert jump > 1e-2
    inside = [np.linspace(a, b, 9)[1:-1] for a, b in pairwise([0.0, *path.knots, 1.0])]
    for s in inside:  # between knots a polynomial of degree 5
        np.testing.assert_allclose(path(s, 5), np.broadcast_to(path(s[0], 5), (7, 2)), rtol=1e-9)


@pytest.mark.parametrize("blend", [0.0005, 0.02, 0.05])
def test_a_polyline_is_straight_but_for_blends_that_keep_to_the_inside_of_their_corners(blend):
    points = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.2, 0.2]])
    path, lengths = Polyline(points, blend=blend), np.linalg.norm(np.diff(points, axis=0), axis=1)
    corners = np.cumsum(lengths) / lengths.sum()
    s = np.linspace(0, 1, 4001)
    along = np.interp(s, [0.0, *corners], [0.0, *np.cumsum(lengths)])
    sharp = np.column_stack([np.interp(s, [0.0, *corners], column) for column in points.T])
    away = np.abs(along[:, None] - np.cumsum(lengths)[:-1]).min(axis=1) >= blend
    np.testing.assert_allclose(path(s)[away], sharp[away], rtol=0, atol=1e-15)
    # the speed turns from one segment's direction to the other's, along the chord between them
    turn, shares = path(s, 1) / lengths.sum(), []
    for k, corner in enumerate(corners[:-1]):
        first, second = (np.diff(points, axis=0) / lengths[:, None])[k : k + 2]
        inside = np.abs(s - corner) * lengths.sum() < blend
        share = (turn[inside] - first) @ (second - first) / ((second - first) @ (second - first))
        np.testing.assert_allclose(turn[inside], first + share[:, None] * (second - first), atol=1e-12)
        shares.append(share)
        # half of the turning at the corner; x there by integrating the speed from the blend's begin
        passed = np.linalg.norm(path(corner) - points[k + 1])
        assert passed == pytest.approx(blend * 35 / 256 * np.linalg.norm(second - first), rel=1e-12)
    assert all((np.diff(share) > -1e-12).all() for share in shares)


def test_a_polyline_has_four_continuous_derivatives_where_its_blends_begin_and_end():
    points = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.2, 0.2]])
    path, h = Polyline(points, blend=0.05), 1e-9  # two blends meet on the second segment
    assert len(path.knots) == 3
    for order in range(6):
        scale = np.abs(path(np.linspace(0, 1, 1001), order)).max()
        jump = np.abs(path(path.knots + h, order) - path(path.knots - h, order)).max() / scale
        assert jump < 1e-6 if order <= 4 else jump > 0.1


def test_a_polyline_is_equal_to_itself_alone():
    one, same, other = (Polyline(POINTS[:4], blend=blend) for blend in (0.02, 0.02, 0.01))
    assert one == same != other
    assert hash(one) == hash(same)
    assert one != Spline(POINTS[:4])
    assert eval(repr(one)) == one


def test_a_short_spline_is_one_polynomial():
    for count in range(2, 7):
        assert len(Spline(POINTS[:count]).knots) == 0
    straight = Spline(POINTS[:2])
    np.testing.assert_allclose(straight(0.25), 0.75 * POINTS[0] + 0.25 * POINTS[1], atol=1e-16)


@pytest.mark.parametrize(
    ("kind", "points", "words"),
    [
        (Line, ([0, 0], [0, 0]), "line: two points in a row are the same"),
        (Line, ([0, 0], [1, 1, 1]), "line: points must be lists of numbers of one length"),
        (Line, ([0, 0], ["a", "b"]), "line: points must be lists of numbers"),
        (Line, ([0, 0], [np.nan, 0]), "line: points must be finite"),
        (Line, ([0, 0], [0, np.inf]), "line: points must be finite"),
        (Line, (0.0, 1.0), r"line: needs at least 2 points \(m, n\)"),
        (Line, ([], []), "line: needs"),
        (Arc, ([0, 0], [1, 1], [2, 2]), "arc: its three points lie on a line"),
        (Arc, ([0, 0], [1, 0], [0, 0]), "arc: its three points lie on a line"),
        (Arc, ([0, 0], [0, 0], [1, 0]), "arc: two points in a row are the same"),
        (Arc, ([0], [1], [2]), "arc"),
        (Spline, ([[0, 0]],), "spline: needs at least 2 points"),
        (Spline, ([[0, 0], [1, 0], [1, 0], [2, 0]],), "spline: two points in a row are the same"),
        (Spline, ([[0, 0], [1]],), "spline: points must be lists of numbers of one length"),
        (Spline, ([],), "spline: needs at least 2 points"),
        (Spline, (None,), "spline"),
        (Polyline, ([[0, 0], [1, 0]], 0.1), "polyline: needs at least 3 points"),
        (Polyline, ([[0, 0], [1, 0], [1, 1]], 0.0), "blend must be from 5e-05 to 0.5"),
        (Polyline, ([[0, 0], [1, 0], [1, 1]], 1e-300), "blend must be from 5e-05 to 0.5"),
        (Polyline, ([[0, 0], [1, 0], [1, 1], [3, 1]], 0.6), "to 0.5, half of the shortest segment"),
        (Polyline, ([[0, 0], [1, 0], [1, 1]], None), "blend"),
        (Polyline, ([[0, 0], [1, 0], [0, 0]], 0.1), "at point 1, .*, it turns straight back"),
    ],
)
def test_points_that_make_no_path_raise(kind, points, words):
    with pytest.raises(InvalidInput, match=words):
        kind(*points)


class Joined:
    """x = (s, c (s - 0.4)^degree beyond s = 0.4): all derivatives below `degree` are continuous."""

    n = 2

    def __init__(self, degree, knots=()):
        self.degree, self.knots = degree, np.array(knots)

    def __call__(self, s, order=0):
        s = np.asarray(s, dtype=float)
        further, power = np.maximum(s - 0.4, 0.0), self.degree - order
        falling = np.prod(np.arange(self.degree, power, -1.0))
        y = falling * further ** max(power, 0) * (s > 0.4) if power >= 0 else 0.0 * s
        return np.stack([(s, np.ones_like(s), 0.0 * s)[min(order, 2)], 0.3 * y], axis=-1)


@pytest.mark.parametrize("knots", [(), (0.4,)])
@pytest.mark.parametrize(("degree", "size"), [(1, 0.3), (2, 0.6)])
def test_a_path_with_a_corner_is_refused_where_it_is_at_a_knot_or_not(degree, size, knots):
    words = rf"path\(s, {degree}\) jumps at s = 0.4 by {size:g}, .* round it"
    with pytest.raises(InvalidInput, match=words):
        check_path(Joined(degree, knots))


def test_a_path_without_a_corner_is_none_however_sharp_its_bends():
    check_path(Joined(3))

    class Own(Joined):
        bends = Polyline([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0]], blend=0.001)
        knots = bends.knots

        def __call__(self, s, order=0):
            return self.bends(s, order)

    check_path(Own(1, Own.knots))


def test_the_points_of_a_path_are_its_own():
    given = POINTS[:2].copy()
    path = Line(*given)
    given[:] = 0.0
    np.testing.assert_array_equal(path(0.0), POINTS[0])


LAW = Law.rest_to_rest(1.5, 4, [Condition(1.0, 0, 0.667), Condition(1.0, 1, 1.5), Condition(1.0, 2, -0.3)])


def exactly(path, t: float) -> list[list[float]]:
    """x(s(t)) and four time derivatives at one instant: Taylor series of a closed form, 40 digits."""
    series = [mp.mpf(float(c)) for c in LAW.coefficients]

    def s(time):
        return mp.fsum(c * mp.chebyt(k, 2 * time / 1.5 - 1) for k, c in enumerate(series))

    def coordinate(k):
        if isinstance(path, Line):
            return lambda time: path.start[k] + s(time) * (mp.mpf(path.end[k]) - mp.mpf(path.start[k]))
        spoke = path.start - path.center
        quarter = path(0.0, 1) / path.angle  # the other radius, along the motion

        def on_circle(time):
            turn = path.angle * s(time)
            return path.center[k] + spoke[k] * mp.cos(turn) + quarter[k] * mp.sin(turn)

        return on_circle

    with mp.workdps(40):
        columns = [mp.taylor(coordinate(k), mp.mpf(t), 4) for k in range(path.n)]
        return [[float(column[m] * mp.factorial(m)) for column in columns] for m in range(5)]


@pytest.mark.parametrize("name", ["line", "arc", "arc in space"])
def test_time_derivatives_along_a_path_agree_with_forty_digits(name):
    times = np.array([0.0, 0.4, 1.0, 1.3])
    found = np.array(time_derivatives(PATHS[name], [LAW(times, k) for k in range(5)]))  # (5, T, n)
    exact = np.array([exactly(PATHS[name], t) for t in times]).transpose(1, 0, 2)
    for order in range(5):
        # a sum of at most five products, each good to some eps of the largest values
        np.testing.assert_allclose(found[order], exact[order], atol=2e-14 * np.abs(exact[order]).max())


def test_as_many_orders_come_out_as_go_in():
    for orders in range(1, 6):
        assert (
            len(time_derivatives(PATHS["line"], [LAW(np.array([0.1]), k) for k in range(orders)])) == orders
        )
    with pytest.raises(InvalidInput, match=r"order.*from 0 to 4, got 5"):
        time_derivatives(PATHS["line"], [LAW(np.array([0.1]), k) for k in range(6)])


def test_three_points_on_a_line_are_never_an_arc_whatever_rounding_makes_of_them():
    rng = np.random.default_rng(7)
    for _ in range(200):
        start, span = rng.normal(size=(2, 3))
        with pytest.raises(InvalidInput, match="lie on a line"):
            Arc(start, start + rng.uniform(0.05, 0.95) * span, start + span)


@pytest.mark.parametrize("bow", [1e-1, 1e-3, 1e-6])
def test_a_flat_arc_runs_through_its_points_as_well_as_its_far_centre_lets_it(bow):
    points = np.array([[0.3, -0.2, 1.0], [0.8, -0.2, 1.0 + bow], [1.3, -0.2, 1.0]])
    arc = Arc(*points)
    ends = arc(np.array([0.0, 1.0]))
    assert arc.radius == pytest.approx((0.25 + bow**2) / (2 * bow), rel=1e-9)
    np.testing.assert_allclose(ends, points[[0, 2]], rtol=0, atol=1e-14 * arc.radius)
    np.testing.assert_allclose(arc(0.5), points[1], rtol=0, atol=1e-14 * arc.radius)
