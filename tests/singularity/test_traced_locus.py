"""Traced loci against the geometry of each mechanism: conics, coupler curves, rods that meet in a point."""

from types import SimpleNamespace

import mpmath as mp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import robots
from framework import InvalidInput, locate_singularities, trace_locus
from framework.kinematics.assembly import MAX_NEWTON_STEP
from framework.kinematics.linearised_loops import linearised_at_reference, type1_matrix
from framework.kinematics.modes import leg_signs, legs
from framework.planning.scenes import scene_path
from framework.singularity.curve_tracing import (
    MAX_STEP,
    LocusEquations,
    curve_points,
    find_solutions,
    trace_curves,
)
from framework.singularity.drawn_locus import locus_curves
from framework.singularity.traced_locus import REGION_REACH
from tests.robots.test_gough_stewart import plucker
from tests.singularity.test_points_on_path import LEFT, LENGTH, RIGHT

ROBOT = "three_rrr"


with mp.workdps(40):
    MOTORS_3RRR = [(0, 0), (mp.mpf("1.2"), 0), (mp.mpf("0.6"), mp.mpf("1.0392304845413265"))]
    CORNERS_3RRR = [
        tuple(map(mp.mpf, at)) for at in (("-0.0928", "-0.0535"), ("0.0928", "-0.0535"), ("0", "0.107"))
    ]
    L = mp.mpf("0.6")  # [m] of cranks and rods

UNIT = 0.05  # [m] of Innocenti and Parenti-Castelli's 3-RPR
PIVOTS = UNIT * np.array([[0.0, 0.0], [15.91, 0.0], [0.0, 10.0]])
D12, D23, D31 = UNIT * np.array([17.04, 16.54, 20.84])
X3 = (D12**2 + D31**2 - D23**2) / (2 * D12)
CORNERS = np.array([[0.0, 0.0], [D12, 0.0], [X3, np.sqrt(D31**2 - X3**2)]])


def conic(points, turn):
    """det of the leg lines of the 3-RPR at an orientation: a quadratic in the platform's place (m, 2)."""
    c, s = np.cos(turn), np.sin(turn)
    arms = CORNERS @ np.array([[c, s], [-s, c]])
    leg = points[:, None] + arms - PIVOTS  # (m, 3, 2)
    moment = arms[:, 0] * leg[..., 1] - arms[:, 1] * leg[..., 0]
    return np.linalg.det(np.concatenate([leg, moment[..., None]], axis=2))


def gap(polylines, points):
    """Distances (m,) of points from the nearest of the polylines."""
    nearest = np.full(len(points), np.inf)
    for line in polylines:
        start, way = line[:-1], np.diff(line, axis=0)
        off = points[:, None] - start
        share = np.clip(np.sum(off * way, axis=2) / np.maximum(np.sum(way**2, axis=1), 1e-30), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(off - share[..., None] * way, axis=2).min(axis=1))
    return nearest


def test_the_locus_of_the_3_rpr_at_one_orientation_is_a_whole_hyperbola():
    robot = robots.load("three_rpr")
    q, x = robot.reference.q, robot.reference.x
    drawn = locus_curves(robot, q, x)
    points = np.concatenate(drawn.curves)
    np.testing.assert_allclose(conic(points, x[2]), 0, atol=1e-12)
    # the quadratic form of its second derivatives is indefinite: a hyperbola
    at = conic(np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1.0]]), x[2])
    xx, yy = at[1] + at[2] - 2 * at[0], at[3] + at[4] - 2 * at[0]
    xy = at[5] - at[1] - at[3] + at[0]
    assert xx * yy - xy**2 < 0
    # without holes, where a leg has no length too: every point of it within the region is on what is drawn
    exact = []
    for across in np.linspace(-1, 1, 401) * drawn.reach * 0.98:
        for axis in (0, 1):
            line = np.array([-1.0, 0.0, 1.0])
            place = np.zeros((3, 2))
            place[:, axis], place[:, 1 - axis] = x[axis] + across, line
            low, middle, high = conic(place, x[2])
            for root in np.roots([(low + high) / 2 - middle, (high - low) / 2, middle]):
                found = np.zeros(2)
                found[axis], found[1 - axis] = x[axis] + across, np.real(root)
                if np.isreal(root) and abs(found[1 - axis] - x[1 - axis]) < 0.98 * drawn.reach:
                    exact.append(found)
    assert len(exact) > 400
    assert gap(drawn.curves, np.array(exact)).max() < 2e-3 * robot.length
    turned = CORNERS @ Rotation.from_rotvec([0, 0, -x[2]]).as_matrix()[:2, :2]
    assert gap(drawn.curves, PIVOTS - turned).max() < 1e-3  # the three places where a leg has no length


def rods(robot, curve):
    """Lines (m, 3, 3) of the rods of the 3-RRR along a curve, by platform and cranks: direction, moment."""
    motors, corners = np.array(MOTORS_3RRR, dtype=float), np.array(CORNERS_3RRR, dtype=float)
    c, s = np.cos(curve.x[:, 2]), np.sin(curve.x[:, 2])
    turn = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    ends = curve.x[:, None, :2] + corners @ turn.swapaxes(1, 2)
    elbows = motors + 0.6 * np.stack([np.cos(curve.motors), np.sin(curve.motors)], axis=2)
    rod = (ends - elbows) / 0.6
    np.testing.assert_allclose(np.linalg.norm(rod, axis=2), 1, atol=1e-9)
    moment = elbows[..., 0] * rod[..., 1] - elbows[..., 1] * rod[..., 0]
    return np.concatenate([rod, moment[..., None]], axis=2)


@pytest.mark.slow
def test_the_3_rrr_has_its_locus_in_other_working_modes_where_its_own_has_next_to_none(robot):
    traced = trace_locus(robot, robot.reference.q, starts=16)
    assert sum(np.ptp(curve.x[:, 0]) > 0.5 for curve in traced.curves) >= 4
    for curve in traced.curves:
        assert curve.closed
        np.testing.assert_allclose(np.linalg.det(rods(robot, curve)), 0, atol=1e-9)
        np.testing.assert_allclose(curve.x[:, 2], robot.reference.x[2], atol=1e-12)


def test_the_3_rrr_draws_its_locus_about_its_crossing(robot):
    (point,) = locate_singularities(robot, scene_path(robot.description.scenes["crossing"]))
    drawn = locus_curves(robot, point.q, point.platform)
    assert gap(drawn.curves, point.platform[None, :2]).max() < 1e-3
    assert sum(np.ptp(curve, axis=0).max() > 0.3 for curve in drawn.curves) >= 3


@pytest.fixture(scope="module")
def five_bar():
    robot = robots.load("five_bar")
    return trace_locus(robot, robot.reference.q)


def test_the_traced_locus_of_the_5r_is_its_closed_form(five_bar):
    """Rods stretched in line: the middle of a bar of twice their length between both elbows."""
    (curve,) = [curve for curve in five_bar.curves if curve.kind == "type_2"]
    assert curve.closed
    left, right = (
        motor + LENGTH * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        for motor, angle in zip((LEFT, RIGHT), curve.motors.T, strict=True)
    )
    np.testing.assert_allclose(np.linalg.norm(right - left, axis=1), 2 * LENGTH, atol=1e-10)
    np.testing.assert_allclose(curve.x, 0.5 * (left + right), atol=1e-10)
    # all of it: for every crank angle that allows it both closed forms are on the curve
    for crank in np.linspace(-np.pi, np.pi, 73):
        elbow = LEFT + LENGTH * np.array([np.cos(crank), np.sin(crank)])
        way = RIGHT - elbow
        distance = np.linalg.norm(way)
        along = (distance**2 + (2 * LENGTH) ** 2 - LENGTH**2) / (2 * distance)
        if along < 2 * LENGTH:
            across = np.sqrt((2 * LENGTH) ** 2 - along**2) * np.array([-way[1], way[0]]) / distance
            both = elbow + 0.5 * (along * way / distance + np.stack([across, -across]))
            assert gap([curve.x], both).max() < 1e-3


def test_the_self_motion_circles_of_the_5r_are_found(five_bar):
    circles = [curve for curve in five_bar.curves if curve.kind == "self_motion"]
    heights = []
    for circle in circles:
        centre = [0.0, np.sign(circle.x[:, 1].mean()) * np.sqrt(LENGTH**2 - RIGHT[0] ** 2)]
        np.testing.assert_allclose(np.linalg.norm(circle.x - centre, axis=1), LENGTH, atol=1e-10)
        np.testing.assert_allclose(circle.motors - circle.motors[0], 0, atol=1e-9)
        heights.append(centre[1])
    assert min(heights) < 0 < max(heights)
    above = circles[int(np.argmax(heights))]
    assert above.closed
    assert len(five_bar.curves) == 3


def test_a_curve_that_leaves_the_workspace_is_followed_to_its_edge():
    robot = robots.load("biglide")
    for curve in trace_locus(robot, robot.reference.q).curves:
        assert curve.ends == ("left", "left")
        np.testing.assert_allclose(curve.x[:, 0], 0, atol=1e-12)
        off = np.abs(curve.x - robot.reference.x).max(axis=1)
        assert (off[1:-1] < 1.2 * robot.length).all()
        assert off[[0, -1]].min() > 1.2 * robot.length


@pytest.mark.slow  # the hyperbola would have holes without it
def test_branches_are_switched_where_a_leg_has_no_length():
    robot = robots.load("three_rpr")
    traced = trace_locus(robot, robot.reference.q, one_mode=True)
    turned = CORNERS @ Rotation.from_rotvec([0, 0, -robot.reference.x[2]]).as_matrix()[:2, :2]
    places = np.array([point.x[:2] for curve in traced.curves for point in curve.branch_points])
    for corner, pivot in zip(turned, PIVOTS, strict=True):
        assert np.linalg.norm(places - (pivot - corner), axis=1).min() < 1e-4
    pivots = [curve for curve in traced.curves if curve.kind == "joints_only"]
    assert len(pivots) == 3  # each pivot turns with its leg of no length


def open_by(cranks, turn):
    """What the platform's turn leaves open of the 3-RRR with its cranks locked, in mpmath's digits.

    The rods are circles about the elbows. Their differences are two linear equations of the platform's place;
    what is left over is the first circle.
    """
    elbows = [
        (ax + L * mp.cos(a), ay + L * mp.sin(a)) for (ax, ay), a in zip(MOTORS_3RRR, cranks, strict=True)
    ]
    c, s = mp.cos(turn), mp.sin(turn)
    arms = [(c * u - s * v, s * u + c * v) for u, v in CORNERS_3RRR]
    # |p + arm_i - elbow_i|^2 = L^2
    off = [(arm[0] - elbow[0], arm[1] - elbow[1]) for arm, elbow in zip(arms, elbows, strict=True)]
    rows = mp.matrix([[2 * (off[i][k] - off[0][k]) for k in range(2)] for i in (1, 2)])
    right = mp.matrix([off[0][0] ** 2 + off[0][1] ** 2 - off[i][0] ** 2 - off[i][1] ** 2 for i in (1, 2)])
    p = mp.lu_solve(rows, right)
    return (p[0] + off[0][0]) ** 2 + (p[1] + off[0][1]) ** 2 - L**2


@pytest.mark.slow
def test_at_a_cusp_in_the_space_of_the_motors_three_assembly_modes_meet(robot):
    """The one equation of the forward kinematics has a triple root there, and a double one beside it."""
    traced = trace_locus(robot, robot.reference.q, free=("motor_1", "motor_2"), starts=12)
    assert len(traced.cusps) >= 4
    with mp.workdps(40):

        def derivatives(q_a, turn):
            cranks = [mp.mpf(float(a)) for a in q_a]
            return [abs(float(mp.diff(lambda t: open_by(cranks, t), float(turn), k))) for k in range(4)]

        for cusp in traced.cusps[:4]:
            value, first, second, third = derivatives(cusp.motors, cusp.x[2])
            assert max(value, first, second) < 1e-8
            assert third > 1e-2
        curve = traced.curves[0]
        middle = len(curve.x) // 2
        value, first, second, _ = derivatives(curve.motors[middle], curve.x[middle, 2])
        assert max(value, first) < 1e-8 < 1e-4 < second
    for curve in traced.curves:
        np.testing.assert_allclose(curve.motors[:, 2], robot.reference.q[robot.actuated[2]], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("free", [("rx", "ry"), ("x", "z")])
def test_slices_of_the_gough_stewart_platform_are_singular_all_along(free):
    robot = robots.load("gough_stewart")
    (point,) = locate_singularities(robot, scene_path(robot.description.scenes["turn"]))[:1]
    traced = trace_locus(robot, point.q, free=free, starts=8)
    assert traced.curves
    held = [k for k, name in enumerate(robot.axis_names) if name not in free]
    for curve in traced.curves:
        np.testing.assert_allclose(
            curve.x[:, held], np.tile(point.platform[held], (len(curve.x), 1)), atol=1e-9
        )
        if curve.kind == "type_2":
            for x in curve.x[:: max(len(curve.x) // 20, 1)]:
                assert np.linalg.svd(plucker(x), compute_uv=False)[-1] < 1e-9


@pytest.mark.parametrize(
    "name", ["five_bar", "three_rrr", "gough_stewart", "delta", "orthoglide", "four_bar"]
)
def test_the_determinants_of_the_legs_multiply_to_that_of_the_inverse_kinematics(name):
    robot = robots.load(name)
    linearised = linearised_at_reference(robot)
    whole = np.linalg.slogdet(type1_matrix(robot, linearised))
    parts = [
        np.linalg.slogdet(type1_matrix(robot, linearised)[:, leg.rows][:, :, leg.columns])[1]
        for leg in legs(robot)
    ]
    assert sum(parts)[0] == pytest.approx(whole[1][0], abs=1e-9)
    assert set(np.abs(leg_signs(robot, linearised)[0])) == {1.0}
    assert sorted(motor for leg in legs(robot) for motor in leg.motors) == sorted(robot.actuator_names)


def test_solutions_are_found_by_steps_that_are_not_too_long():
    """Of linear equations: the way is straight."""
    goal, steps = np.array([2.5, -1.0]) * MAX_NEWTON_STEP, []

    def evaluate(q, corank):
        return SimpleNamespace(values=q - goal, slopes=np.tile(np.eye(2), (len(q), 1, 1)))

    def move(q, change):
        steps.extend(change)
        return q + change

    found = find_solutions(SimpleNamespace(evaluate=evaluate, move=move), np.zeros((1, 2)))
    np.testing.assert_allclose(found, [goal], rtol=1e-14)
    assert np.abs(steps).max() == pytest.approx(MAX_NEWTON_STEP)
    assert np.linalg.matrix_rank([goal, *steps], tol=1e-12) == 1


def test_a_closed_curve_arrives_in_the_direction_in_which_it_starts(robot):
    q = robot.reference.q
    equations = LocusEquations.of(robot, q, robot.reference.x, None)
    # from this start the curve closes first against its tangent
    guess = equations.move(q, np.array([[-0.6, 0.3, -3.0, 1.6, 0.2, -1.1, 1.8]]))
    solution = find_solutions(equations, guess)
    start = curve_points(solution, equations.evaluate(solution), previous=None)
    (curve,) = trace_curves(equations, start, lambda q: np.full(len(q), True), MAX_STEP)
    assert curve.ends == ("closed", "closed")
    np.testing.assert_array_equal(curve.points.tangent[-1], curve.points.tangent[0])
    np.testing.assert_array_equal(curve.points.determinant[-1], curve.points.determinant[0])


@pytest.mark.slow
def test_curves_traced_together_are_those_that_each_start_gives_alone():
    robot = robots.load("five_bar")
    q = robot.reference.q
    together = trace_locus(robot, q, starts=12, with_cusps=False)
    rng = np.random.default_rng(0)  # the draws of `starts`
    guesses = rng.uniform(-np.pi, np.pi, (12, len(robot.moving)))  # four hinges
    alone = [trace_locus(robot, q, starts=0, near=[q + guess], with_cusps=False).curves for guess in guesses]
    for first, second in ((together.curves, sum(alone, ())), (sum(alone, ()), together.curves)):
        points = np.concatenate([curve.x for curve in first])
        offset = np.abs(points - robot.reference.x).max(axis=1)
        points = points[offset < REGION_REACH * robot.length]  # the ends lie a step outside
        # chords are off the curve by MAX_TANGENT_TURN^2 / 8 of its radius, on both sides
        assert gap([curve.x for curve in second], points).max() < 2e-3 * robot.length


def test_slices_that_cannot_be_are_refused():
    robot = robots.load("gough_stewart")
    q = robot.reference.q
    with pytest.raises(InvalidInput, match="name two axes or two motors"):
        trace_locus(robot, q)
    with pytest.raises(InvalidInput, match="two axes or two motors"):
        trace_locus(robot, q, free=("x", "leg_1_motor"))
    with pytest.raises(InvalidInput, match="freedom"):
        trace_locus(robot, q, free=("x", "elbow"))
    with pytest.raises(InvalidInput, match="one motor for each freedom"):
        trace_locus(robots.load("two_arms"), robots.load("two_arms").reference.q, free=("x", "y"))


def test_offsets_take_back_the_steps_of_hinges_and_slides():
    robot = robots.load("three_rpr")  # whose length is not one
    equations = LocusEquations.of(robot, robot.reference.q, robot.reference.x, None)
    steps = np.linspace(-0.3, 0.3, len(robot.moving))[None]
    start = robot.reference.q[None]
    np.testing.assert_allclose(equations.offsets(start, equations.move(start, steps)), steps, atol=1e-14)
