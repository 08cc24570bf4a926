"""Arclength on curves known in closed form: corrections, steps, folds, and the ends of branches."""

from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

import robots
from framework.kinematics.continuation.arclength import (
    MAX_ARC_LENGTH,
    UNCHECKED_MOTION,
    CurveEquations,
    CurveReason,
    Curves,
    correct_points,
    solve_step_and_tangent,
)
from framework.tolerances import NEWTON_STEP

ROBOT = robots.load("slider_crank")  # the joints move freely here: only their units count
SLIDE = int(np.argmax(ROBOT.column_scale != 1.0))
TURNING = [column for column in range(ROBOT.nv) if column != SLIDE]
UNIT = ROBOT.column_scale[SLIDE]  # [m] for 1 of y


def graphs(g, slope, turns=0.0, count=1, lean=0.0, power=2, error=0.0):
    """Curves s = g(y, k) of the slide, numbered k, while another joint turns by `turns` in all.

    A third joint is at lean y^power. The slopes are computed with a relative error.
    """
    turn = np.zeros((count, ROBOT.nv))
    turn[:, TURNING[0]] = turns
    lean = np.broadcast_to(lean, count)

    def evaluate(q, share, rows):
        y, z, w = q[:, SLIDE] / UNIT, q[:, TURNING[1]], lean[rows]
        slopes = np.zeros((len(y), 2, 3))
        slopes[:, 0, 0], slopes[:, 0, 2] = slope(y, rows), -1.0
        slopes[:, 1, 0], slopes[:, 1, 1] = -power * w * y ** (power - 1), 1.0
        values = np.stack([g(y, rows) - share, z - w * y**power], axis=1)
        return CurveEquations(values, (1.0 - error) * slopes)

    return Curves(ROBOT, np.array([SLIDE, TURNING[1]]), turn, evaluate)


class Way(NamedTuple):
    """The end of curves from y = s = 0, and the steps on the way."""

    y: np.ndarray
    share: np.ndarray
    reason: np.ndarray
    steps: list


def all_go_on(ends):
    return np.ones(len(ends.rows), dtype=bool), np.ones(len(ends.rows), dtype=bool)


def follow(curves, longest=0.3, accept=all_go_on, **options):
    count = len(curves.turn)
    q, share = np.zeros((count, ROBOT.model.nq)), np.zeros(count)
    steps = []

    def note(ends):
        steps.append(ends)
        return accept(ends)

    first = curves.evaluate(q, share, np.arange(count))
    ends, reason = curves.follow(q, share, first, longest=np.full(count, longest), accept=note, **options)
    return Way(ends.q[:, SLIDE] / UNIT, ends.share, reason, steps)


def test_steps_are_across_the_border_and_tangents_along_the_curve():
    rng = np.random.default_rng(1)
    F, c = CurveEquations(rng.normal(size=(5, 3)), rng.normal(size=(5, 3, 4))), rng.normal(size=(5, 4))
    step, tangent = solve_step_and_tangent(F, c)
    np.testing.assert_allclose(np.einsum("tij,tj->ti", F.slopes, step), -F.values, atol=1e-12)
    np.testing.assert_allclose(np.einsum("tij,tj->ti", F.slopes, tangent), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("tj,tj->t", c, step), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("tj,tj->t", c, tangent), 1.0, atol=1e-12)


class Place(NamedTuple):
    u: np.ndarray  # (T, 2)


def shift(places, steps, _):
    return Place(places.u + steps)


def on_circle(places, _):
    return CurveEquations((places.u**2).sum(axis=1, keepdims=True) - 1.0, 2.0 * places.u[:, None])


def corrected(u, border, longest, equations=on_circle, repeats=False, **options):
    return correct_points(
        equations,
        shift,
        Place(np.array(u)),
        np.array(border),
        longest=np.array(longest),
        repeats=np.full(len(u), repeats),
        **options,
    )


def test_a_corrected_point_is_where_the_normal_meets_the_circle():
    rng = np.random.default_rng(2)
    u = np.array([1.3, 0.8, 1.1])[:, None] * np.array([[0.6, 0.8], [-0.8, 0.6], [1.0, 0.0]])
    border = np.stack([-u[:, 1], u[:, 0]], axis=1) + 0.2 * rng.normal(size=(3, 2))
    normal = np.stack([border[:, 1], -border[:, 0]], axis=1)
    normal *= np.sign((normal * u).sum(axis=1))[:, None] / np.linalg.norm(normal, axis=1)[:, None]
    along = (normal * u).sum(axis=1)  # u + a normal has length 1
    a = -along + np.sqrt(along**2 - (u**2).sum(axis=1) + 1.0)
    found = corrected(u, border, np.full(3, 1.0))
    assert found.converged.all()
    np.testing.assert_allclose(found.points.u, u + a[:, None] * normal, atol=1e-12)
    np.testing.assert_allclose(found.step, a[:, None] * normal, atol=1e-12)
    # none is believed whose corrections are longer than they may be: they add up to this way at least
    far = np.abs(found.step).max(axis=1)
    assert corrected(u, border, far * [0.99, 3.0, 0.99]).converged.tolist() == [False, True, False]


def test_only_the_unknowns_that_are_measured_limit_a_correction():
    up = [[0.1, 1.5]], [[1.0, 0.0]], [0.0]  # at constant y the share alone is corrected
    assert not corrected(*up).converged[0]
    assert corrected(*up, measured=slice(-1)).converged[0]
    assert not corrected([[1.5, 0.1]], [[0.0, 1.0]], [0.0], measured=slice(-1)).converged[0]


@pytest.mark.parametrize(("repeats", "left"), [(False, 0.5e-10), (True, 0.5e-12)])
def test_the_last_step_is_below_the_tolerance_and_one_more_follows_where_asked(repeats, left):
    # slopes that are too small by 1 %: each step leaves a hundredth of the error, with the sign turned
    def line(places, _):
        return CurveEquations(places.u[:, :1].copy(), np.tile([[[1.0 / 1.01, 0.0]]], (len(places.u), 1, 1)))

    found = corrected([[0.5, 0.0], [0.0, 0.3]], [[0.0, 1.0]] * 2, [1.0, 1.0], line, repeats)
    assert found.converged.all()
    assert abs(found.points.u[0, 0]) == pytest.approx(left, rel=1e-3)
    assert found.points.u[1].tolist() == [0.0, 0.3]
    last = 100.0 * left  # the step before was needed: equations are of before the last step
    assert abs(found.equations.values[0, 0]) == pytest.approx(last, rel=1e-3)
    assert last < NEWTON_STEP
    assert repeats == (100.0 * last < NEWTON_STEP)


def bent(y, k):
    """Curves that begin flat, or steep, or straight, and reach s = 1 at y = 1."""
    return np.choose(k, [0.02 * y + 0.98 * y**3, 1.0 - 0.02 * (1.0 - y) - 0.98 * (1.0 - y) ** 3, y])


def bent_slope(y, k):
    return np.choose(k, [0.02 + 2.94 * y**2, 0.02 + 2.94 * (1.0 - y) ** 2, 1.0])


LEANS = np.array([0.4, 0.4, 0.0])


@pytest.mark.parametrize("turns", [0.0, 0.7, 2.5])
def test_curves_arrive_by_steps_of_the_allowed_length_along_unit_tangents(turns):
    way = follow(graphs(bent, bent_slope, turns, 3, LEANS))
    np.testing.assert_allclose(way.y, 1.0, atol=1e-9)
    assert (way.reason == CurveReason.ARRIVED).all()
    assert (way.share == 1.0).all()
    last = {}
    for ends in way.steps:
        y, rows = ends.points.q[:, SLIDE] / UNIT, ends.rows
        slope, lean = bent_slope(y, rows), 2.0 * LEANS[rows] * y
        np.testing.assert_allclose(ends.points.share, bent(y, rows), atol=1e-9)
        np.testing.assert_allclose(ends.points.q[:, TURNING[0]], turns * ends.points.share, atol=1e-9)
        # of unit length in all joints, and along (1, 2 lean y, g')
        along = np.stack([np.ones(len(y)), lean, slope], axis=1)
        unit = along / np.linalg.norm([np.ones(len(y)), lean, turns * slope], axis=0)[:, None]
        np.testing.assert_allclose(ends.tangent, unit, atol=1e-6)
        assert (ends.size <= 0.3 + 1e-12).all()
        for row, size, point in zip(rows.tolist(), ends.size, ends.points.share, strict=True):
            before, start = last.get(row, (0.3, 0.0))
            assert size <= 2.0 * before + 1e-12
            assert point > start if start < 1.0 else point < start  # back where it has passed the end
            last[row] = size, point
    # a straight line is one step after the other, none halved: of the joint that moves farthest
    straight = [ends.size[ends.rows == 2] for ends in way.steps]
    assert sum(map(len, straight)) == int(np.ceil(max(1.0, turns) / 0.3))


@pytest.mark.parametrize(("to_rounding", "most"), [(False, 1e-9), (True, 1e-11)])
def test_points_on_the_way_are_corrected_once_more_where_asked(to_rounding, most):
    # slopes that are too small by 1 %: each correction leaves a hundredth of the error
    curves = graphs(lambda y, _: 0.7 * y + 0.3 * y**2, lambda y, _: 0.7 + 0.6 * y, 0.7, error=0.01)
    way = follow(curves, to_rounding=to_rounding)
    y = np.concatenate([ends.points.q[:, SLIDE] for ends in way.steps]) / UNIT
    share = np.concatenate([ends.points.share for ends in way.steps])
    left = np.abs(0.7 * y + 0.3 * y**2 - share)[share < 1.0]
    assert len(left) > 2
    assert (left.max() > 1e-11) != to_rounding
    assert left.max() < most


def test_a_parabola_that_does_not_turn_takes_one_step():
    """The gain in s is the mean slope times the length, that of the correction to the end included."""
    way = follow(graphs(lambda y, _: 0.8 * y + 0.2 * y**2, lambda y, _: 0.8 + 0.4 * y), longest=2.0)
    assert way.reason.tolist() == [CurveReason.ARRIVED]
    np.testing.assert_allclose([ends.size[0] for ends in way.steps], [1.0 / 0.8])
    assert way.y[0] == pytest.approx(1.0)


def test_a_step_is_as_short_as_a_quarter_of_it_corrects():
    """Of any joint: the third one is 2 y^2 off the tangent, and 2 h^2 is a quarter of a step h at 1 / 8."""
    way = follow(graphs(lambda y, _: y, lambda y, _: 1.0 + 0.0 * y, lean=2.0))
    first = next(ends.size[0] for ends in way.steps if len(ends.rows))
    assert first == pytest.approx(0.3 / 4)
    assert way.y[0] == pytest.approx(1.0)


@pytest.mark.parametrize(("off", "is_straight"), [(0.0, True), (0.05, True), (0.15, False)])
def test_a_step_is_straight_where_its_tangent_turns_little(off, is_straight):
    """By y^8 the tangent turns eight times the correction; five times and a quarter of the step may be."""
    h = 0.2
    curve = graphs(lambda y, _: y, lambda y, _: 1 + 0 * y, lean=off * h / h**8, power=8)
    way = follow(curve, longest=h, accept=partial(ends_at, 0.1, region=True))  # one step
    assert way.steps[0].size == pytest.approx([h])
    assert way.steps[0].is_straight.tolist() == [is_straight]


def test_the_length_is_that_of_all_joints_in_their_units():
    """Of tangents (y, s) whose s moves a slide in metres, over the length of the robot."""
    rng = np.random.default_rng(6)
    turn, tangent = np.zeros((4, ROBOT.nv)), rng.normal(size=(4, 3))
    turn[:, SLIDE] = UNIT * rng.normal(size=4)
    turn[3], tangent[3] = 0.0, [0.0, 0.0, 1.0]  # without any motion the length is that in s
    unit = Curves(ROBOT, np.array(TURNING), turn, None)._scale_tangents(tangent, np.arange(4))
    by_slide = turn[:, SLIDE] / UNIT + np.array([0.0, 0.0, 0.0, 1.0])
    lengths = np.linalg.norm([tangent[:, 0], tangent[:, 1], by_slide * tangent[:, 2]], axis=0)
    np.testing.assert_allclose(unit, tangent / lengths[:, None], rtol=1e-12)


def test_without_any_motion_the_share_alone_grows():
    curves = graphs(lambda y, k: y, lambda y, k: 1.0 + 0.0 * y)

    def rest(q, share, rows):
        slopes = np.tile(np.eye(2, 3), (len(q), 1, 1))
        return CurveEquations(np.stack([q[:, SLIDE] / UNIT, q[:, TURNING[1]]], axis=1), slopes)

    way = follow(Curves(ROBOT, curves.columns, curves.turn, rest))
    assert way.reason.tolist() == [CurveReason.ARRIVED]
    assert way.share.tolist() == [1.0]
    assert way.y.tolist() == [0.0]


def folded_cubics():
    """Cubics with folds at a < b in one long step from y = 0, which reach s = 1 behind them."""
    rng = np.random.default_rng(3)
    a = rng.uniform(0.05, 0.8, 40)
    b = a + rng.uniform(0.02, 0.5, 40)
    size = 1.0 / np.abs(a**2 * (3 * b - a) / 6.0) * rng.uniform(0.1, 0.9, 40)  # s at a is below 1

    def g(y, k):
        return size[k] * (y**3 / 3 - (a + b)[k] / 2 * y**2 + (a * b)[k] * y)

    def slope(y, k):
        return size[k] * (y - a[k]) * (y - b[k])

    return a, g, slope


@pytest.mark.parametrize("turns", [0.0, 0.5])
def test_no_step_jumps_two_folds_and_the_first_is_solved_for(turns):
    a, g, slope = folded_cubics()
    way = follow(graphs(g, slope, turns, len(a)), longest=1.0)
    assert (way.reason == CurveReason.TURNED).all()
    np.testing.assert_allclose(way.y, a, atol=1e-7)
    np.testing.assert_allclose(way.share, g(a, np.arange(len(a))), rtol=1e-12)


def test_curves_in_a_stack_end_where_each_ends_alone():
    _, g, slope = folded_cubics()
    together = follow(graphs(g, slope, 0.0, 8), longest=1.0)
    for k in range(8):
        one = follow(graphs(lambda y, _, k=k: g(y, k), lambda y, _, k=k: slope(y, k)), longest=1.0)
        assert one.reason[0] == together.reason[k]
        np.testing.assert_allclose([one.y[0], one.share[0]], [together.y[k], together.share[k]], rtol=1e-9)


def ends_at(place, ends, *, region):
    below = ends.points.q[:, SLIDE] / UNIT < place
    always = np.ones(len(below), dtype=bool)
    return (always, below) if region else (below, always)


def test_the_end_of_a_branch_is_bracketed_and_a_region_is_left_at_once():
    line = partial(graphs, lambda y, k: y, lambda y, k: 1.0 + 0.0 * y)
    lost = follow(line(), accept=partial(ends_at, 0.37, region=False))
    assert lost.reason.tolist() == [CurveReason.TURNED]
    assert 0.37 - 2 * UNCHECKED_MOTION < lost.y[0] < 0.37
    left = follow(line(), accept=partial(ends_at, 0.37, region=True))
    assert left.reason.tolist() == [CurveReason.LEFT]
    assert left.y[0] == pytest.approx(0.6)
    # what is refused is halved, what is accepted doubles the next step
    step = 0.3
    for ends in lost.steps:
        assert ends.size[0] == pytest.approx(step)
        step = min(2.0 * step, 0.3) if ends.points.share[0] < 0.37 else 0.5 * step
    # a place beyond s = 1 does not count, since the curve comes back
    curve = partial(graphs, lambda y, k: 0.1 * y + 0.9 * y**5, lambda y, k: 0.1 + 4.5 * y**4)
    assert any((ends.points.share > 1.0).any() for ends in follow(curve()).steps)
    assert follow(curve(), accept=partial(ends_at, 1.0 + 1e-9, region=True)).reason.tolist() == [
        CurveReason.ARRIVED
    ]
    # no equations behind a place: not a fold
    torn = graphs(lambda y, k: np.where(y < 0.37, y, np.nan), lambda y, k: 1.0 + 0.0 * y)
    stalled = follow(torn)
    assert stalled.reason.tolist() == [CurveReason.STALLED]
    assert 0.37 - 2 * UNCHECKED_MOTION < stalled.y[0] < 0.37


# ------------------------------------------------------------------ turning points


def arcs(fold, bend, radius=0.4):
    """Curves on a circle of two turning joints with s = 0.5 - bend (angle - fold)^2, from angle 0."""
    columns = np.array(TURNING[:2])

    def evaluate(q, share, rows):
        w = bend[rows]
        x, y = q[:, columns[0]] + radius, q[:, columns[1]]
        angle_left = np.arctan2(y, x) - fold[rows]
        gradient = np.stack([-y, x], axis=1) / (x * x + y * y)[:, None]  # of the angle
        values = np.stack([np.hypot(x, y) / radius - 1.0, 0.5 - w * angle_left**2 - share], axis=1)
        slopes = np.zeros((len(q), 2, 3))
        slopes[:, 0, :2] = np.stack([x, y], axis=1) / np.hypot(x, y)[:, None] / radius
        slopes[:, 1, :2] = -2.0 * (w * angle_left)[:, None] * gradient
        slopes[:, 1, 2] = -1.0
        return CurveEquations(values, slopes)

    return Curves(ROBOT, columns, np.zeros((len(fold), ROBOT.nv)), evaluate)


def test_a_fold_counts_where_the_way_to_it_bends_little():
    fold, bend = np.array([0.3, 0.9, 0.3]), np.array([0.5, 0.5, -0.5])  # ahead; round a corner; behind
    share = 0.5 - bend * fold**2
    q = np.zeros((3, ROBOT.model.nq))
    found = arcs(fold, bend).find_turning_points(q, share, np.arange(3))
    assert found.found.tolist() == [True, False, False]
    assert found.share[0] == pytest.approx(0.5, rel=1e-12)
    place = 0.4 * np.array([np.cos(0.3) - 1.0, np.sin(0.3)])
    np.testing.assert_allclose(found.q[0, TURNING[:2]], place, atol=1e-8)
    # the length is counted along the first tangent, which is across the radius
    assert found.length[0] == pytest.approx(0.4 * np.sin(0.3), abs=1e-8)


# s = top - (y - f)^2 (1 + skew (y - f) / f); the share at y = 0 is less by f^2 (1 - skew)
@pytest.mark.parametrize(
    ("f", "skew", "top", "counts"),
    [
        (0.2, 0.0, 0.8, True),
        (0.2, 0.0, 1.2, False),  # beyond the end of the motion
        (0.2, 0.2, 0.8, True),  # s gains 14 % more than on a parabola
        (0.2, 0.38, 0.8, False),  # 44 %
        (0.99 * MAX_ARC_LENGTH, 0.0, 0.8, True),
        (1.01 * MAX_ARC_LENGTH, 0.0, 0.8, False),
    ],
)
@pytest.mark.parametrize("turns", [0.0, 0.01])
def test_a_fold_counts_where_it_is_near_on_the_way_and_like_that_of_a_parabola(f, skew, top, counts, turns):
    curves = graphs(
        lambda y, _: top - (y - f) ** 2 * (1.0 + skew * (y - f) / f),
        lambda y, _: -2.0 * (y - f) - 3.0 * skew * (y - f) ** 2 / f,
        turns,
    )
    q, rows = np.zeros((1, ROBOT.model.nq)), np.arange(1)
    share = np.array([top - f**2 * (1.0 - skew)])
    found = curves.find_turning_points(q, share, rows)
    assert found.found.tolist() == [counts]
    if counts:
        assert found.share[0] == pytest.approx(top, rel=1e-12)
        assert found.length[0] == pytest.approx(f, abs=1e-7)
        assert found.q[0, SLIDE] == pytest.approx(UNIT * f, abs=1e-7)
        assert found.q[0, TURNING[0]] == pytest.approx(turns * (top - share[0]), abs=1e-9)
