"""The optimal law: what it is best at, its limits, and the motions that only it makes possible."""

import clarabel
import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebval, poly2cheb
from scipy.integrate import quad

import robots
from framework import InvalidInput, Line, locate_singularities, plan_crossing, plan_scene, simulate
from framework.laws.law import least_value
from framework.laws.squared_speed import SpeedSpace
from framework.planning.optimal.elastic_balance import _fit_series
from framework.planning.optimal.law_problem import condition_rows
from framework.planning.optimal.least_cost import find_least_cost
from framework.planning.optimal.peak_bound import bound_plan
from framework.planning.optimal.speed_program import Units
from framework.planning.optimal.undeformed_law import problem_of, solve_problem
from framework.planning.saved import plan_document
from framework.planning.scenes import scene_path
from framework.tolerances import SQUARED_SPEED_FLOORS
from tests.oracles.equations_of_motion import defects_of
from tests.planning.optimal.least_energy import least_energy
from tests.planning.optimal.tasks import series_program, task_of

LINE = Line([0.1, 0.345], [-0.05, 0.195])
PAPERS = 0.164918  # [N m] peak torque of the paper's law in scene C, rigid robot


@pytest.fixture(scope="module")
def robot():
    return robots.load("five_bar")


@pytest.fixture(scope="module")
def quickest(robot):
    return plan_crossing(robot, LINE, optimize="time", torque_limit=PAPERS)


def peak(plan) -> float:
    """Largest torque [N m], between the nodes too."""
    t = np.linspace(0.0, plan.duration, 20011)
    return float(np.abs(plan.torque(t)).max())


def test_joints_rest_at_both_ends_though_panels_there_are_short(quickest):
    """Derivatives of a series on such a panel are off by 1e-11 rad/s, which simulations then start with."""
    t = np.linspace(0.0, quickest.duration, 101)
    v = quickest.velocity(t)
    assert np.abs(v[[0, -1]]).max() < 1e-15 * np.abs(v).max()
    assert defects_of(quickest).speed < 1e-14


def test_the_quickest_law_takes_half_of_the_papers_time_at_its_torque(quickest):
    assert 0.7340 <= quickest.duration <= 0.7380  # the paper takes 1.5 s
    assert 0.995 * PAPERS < peak(quickest) <= PAPERS
    assert quickest.law.kind == "optimal"
    assert quickest.certificate.tail < 1e-10
    assert quickest.certificate.monotone


def test_the_crossing_is_certified_and_brings_the_robot_along_the_path(robot, quickest):
    (crossing,) = quickest.crossings
    assert crossing.residual < 1e-11
    assert simulate(robot, quickest).tracking_error < 1e-8


def test_the_quickest_law_is_within_a_percent_of_the_bound_of_all(quickest):
    bound = bound_plan(quickest).value
    assert 0.998 * LEAST_TIME < bound < LEAST_TIME
    assert 1.0 < quickest.duration / bound < 1.01


# Without smoothness at the ends, by the phase plane (Verscheure et al. 2009) on ever finer cells.
LEAST_TIME, LEAST_PEAK = 0.73395, 0.039482  # [s] at PAPERS N m, [N m] in 1.5 s


def test_smoothness_at_the_ends_costs_almost_nothing(robot):
    """6 derivatives that vanish; with 2: the tests above and below."""
    quick = plan_crossing(robot, LINE, optimize="time", torque_limit=PAPERS, smoothness=6)
    assert LEAST_TIME < quick.duration < 1.015 * LEAST_TIME


@pytest.mark.slow
def test_smoothness_at_the_ends_costs_almost_no_torque(robot):
    gentle = plan_crossing(robot, LINE, duration=1.5, optimize="peak_torque", law="optimal", smoothness=6)
    assert LEAST_PEAK < peak(gentle) < 1.015 * LEAST_PEAK


def test_there_is_no_bound_for_a_polynomial(robot):
    assert bound_plan(plan_crossing(robot, LINE, duration=1.5)) is None


def test_the_least_peak_at_the_papers_duration_is_a_quarter_of_its_own(robot):
    plan = plan_crossing(robot, LINE, duration=1.5, law="optimal")
    assert plan.duration == 1.5 == plan.law.duration
    assert LEAST_PEAK < peak(plan) < 1.015 * LEAST_PEAK


@pytest.mark.slow
def test_energy_is_least_where_it_is_asked_for(robot):
    def energy(plan) -> float:
        t, weights = np.polynomial.legendre.leggauss(400)
        at = 0.5 * plan.duration * (t + 1)
        return float(0.5 * plan.duration * weights @ (plan.torque(at) ** 2).sum(axis=1))

    frugal = plan_crossing(robot, LINE, duration=1.5, optimize="energy")
    least = least_energy(robot, LINE, 1.5)  # by another discretisation, on torques of its own
    assert 0.999 * least < energy(frugal) < 1.01 * least
    for other in (
        plan_crossing(robot, LINE, duration=1.5, law="optimal"),
        plan_crossing(robot, LINE, duration=1.5),
    ):
        assert energy(frugal) < 0.99 * energy(other)


def test_a_margin_is_left_of_every_limit_and_costs_time(robot, quickest):
    careful = plan_crossing(robot, LINE, optimize="time", torque_limit=PAPERS, margin=0.1)
    assert peak(careful) <= 0.9 * PAPERS
    assert careful.duration > quickest.duration


def test_a_speed_limit_is_kept(robot, quickest):
    t = np.linspace(0.0, quickest.duration, 4001)
    free = np.abs(quickest.motor_angle(t, 1)).max()
    slower = plan_crossing(
        robot, LINE, optimize="time", torque_limit=PAPERS, speed_limit=[0.7 * free, 0.8 * free]
    )
    t = np.linspace(0.0, slower.duration, 4001)
    speeds = np.abs(slower.motor_angle(t, 1)).max(axis=0)
    assert np.all(speeds <= np.array([0.7, 0.8]) * free)
    assert slower.duration > quickest.duration


def test_a_bounded_duration_is_kept(robot):
    plan = plan_crossing(robot, LINE, optimize="energy", longest=1.2)
    assert plan.duration <= 1.2 * (1 + 1e-6)


def test_a_speed_at_the_crossing_is_met(robot):
    plan = plan_crossing(robot, LINE, duration=1.5, law="optimal", speeds=[1.5])
    (crossing,) = plan.crossings
    assert crossing.speed == pytest.approx(1.5, rel=1e-9)


@pytest.mark.slow
def test_a_speed_at_the_crossing_of_the_deflected_robot_is_met():
    elastic = robots.load("five_bar", flexibility="flexible_joints")
    plan, rigid = (
        plan_crossing(one, LINE, optimize="time", torque_limit=2.0, speeds=[3.0])
        for one in (elastic, robots.load("five_bar"))
    )
    (crossing,) = plan.crossings
    assert crossing.speed == pytest.approx(3.0, rel=1e-6)
    assert max(plan.peak_torque.values()) <= 2.0
    assert rigid.duration < plan.duration < 1.02 * rigid.duration  # deflections of a milliradian


@pytest.mark.slow
def test_an_elastic_robot_with_rigid_geometry_keeps_its_limits_between_points():
    elastic = robots.load("five_bar", flexibility="flexible_joints")
    limits = dict(duration=1.0, optimize="energy", geometry="rigid")
    energy = []
    for torque_limit in (0.10, 0.13):
        plan = plan_crossing(elastic, LINE, torque_limit=torque_limit, **limits)
        t = np.linspace(0.0, 1.0, 4001)
        torque = plan.torque(t)
        assert np.abs(torque).max() <= torque_limit
        energy.append(np.trapezoid((torque**2).sum(axis=1), t))
    assert energy[1] < energy[0]  # the wider limit allows less


def test_the_plan_says_which_law_it_took_and_why(robot, quickest):
    plain = plan_crossing(robot, LINE, duration=1.5)
    assert (plain.law.kind, plain.reason) == ("polynomial", "the polynomial advances")
    assert quickest.reason == "optimize time asks for it"
    assert plan_document(quickest)["law"]["kind"] == "optimal"


@pytest.mark.slow
@pytest.mark.parametrize("flexibility", ["flexible_joints", "flexible_links"])
def test_deformed_robots_cross_by_their_own_best_law(flexibility):
    robot = robots.load("five_bar", flexibility=flexibility)
    plan = plan_crossing(robot, LINE, duration=1.5, law="optimal")
    assert plan.duration == 1.5
    assert peak(plan) <= 0.046
    assert simulate(robot, plan).tracking_error < 1e-8


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"law": "best", "duration": 1.5}, "unknown law 'best'"),
        ({"optimize": "speed", "duration": 1.5}, "unknown optimize 'speed'"),
        ({"law": "polynomial", "duration": 1.5, "margin": 0.1}, "for the optimal law"),
        ({"law": "optimal", "duration": 1.5, "times": []}, "times: none, .* belong to the polynomial"),
        ({"law": "optimal", "duration": 1.5, "times": [1.5]}, "times: a crossing must lie inside the motion"),
        ({"optimize": "time", "duration": 1.5, "torque_limit": 1.0}, "duration: with optimize time"),
        ({"optimize": "time"}, "torque_limit or speed_limit is needed"),
        ({"optimize": "energy"}, "duration: optimize energy needs one"),
        ({}, "duration: needed"),
        ({"duration": 1.5, "torque_limit": -1.0}, "torque_limit: needs one positive number"),
        ({"duration": 1.5, "torque_limit": [1.0, 1.0, 1.0]}, "torque_limit: needs one positive number"),
        ({"duration": 1.5, "margin": 1.0}, r"margin: must lie in \[0, 1\)"),
        ({"duration": 1.5, "longest": 2.0}, "longest: bounds a duration that is open"),
    ],
)
def test_what_cannot_be_asked_is_told(robot, options, words):
    with pytest.raises(InvalidInput, match=words):
        plan_crossing(robot, LINE, **options)


def beside_the_locus(robot, distance: float) -> Line:
    """LINE up to this distance [m] beyond its singular point."""
    along = LINE.end - LINE.start
    (singular,) = locate_singularities(robot, LINE)
    return Line(LINE.start, singular.platform + distance * along / np.linalg.norm(along))


@pytest.mark.parametrize("distance", [-1e-6, pytest.param(3e-6, marks=pytest.mark.slow)])
def test_paths_that_end_beside_a_singular_point_keep_the_least_speed_between_all_points(robot, distance):
    path = beside_the_locus(robot, distance)
    plan = plan_crossing(robot, path, duration=1.5)
    assert (plan.law.kind, len(plan.crossings)) == ("optimal", distance > 0)
    assert least_value(plan.law.series) * plan.duration**2 > 0.99 * SQUARED_SPEED_FLOORS[-1]
    if distance < 0:  # just short of the point, the optimal law takes a hundredth of the polynomial's torque
        assert peak(plan) < 0.01 * peak(plan_crossing(robot, path, duration=1.5, law="polynomial"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flexibility", "limit", "longest"),
    [("flexible_joints", 5.0, 0.3), ("flexible_links", 2.0, None), ("flexible_links", 2.0, 1.0)],
)
def test_the_quickest_law_of_an_elastic_robot_is_nearly_that_of_the_rigid_one_whatever_longest(
    flexibility, limit, longest
):
    path = scene_path(robots.load("five_bar").description.scenes["C"])
    rigid = plan_crossing(robots.load("five_bar"), path, optimize="time", torque_limit=limit)
    elastic = robots.load("five_bar", flexibility=flexibility)
    plan = plan_crossing(elastic, path, optimize="time", torque_limit=limit, longest=longest)
    # springs of the catalogue are stiff: their motion asks for two percent of time
    assert rigid.duration < plan.duration < 1.025 * rigid.duration
    assert 0.995 * limit < max(plan.peak_torque.values()) <= limit


# a path that meets the locus in its very middle, to the last digit


TOP = np.array([0.0, np.sqrt(0.06)])  # of the 5R's locus


@pytest.mark.parametrize("half", [(0.0, 0.1), pytest.param((0.02, 0.08), marks=pytest.mark.slow)])
def test_the_optimal_law_crosses_there_too(half):
    robot = robots.load("five_bar")
    plan = plan_crossing(robot, Line(TOP + half, TOP - half), duration=1.5, law="optimal")
    assert plan.crossings[0].s == pytest.approx(0.5, abs=1e-12)
    assert plan.certificate.tail < 1e-10
    assert simulate(robot, plan).tracking_error < 1e-9


# laws of splines that become one series, as deflections need them


@pytest.mark.parametrize("share", [0.08, 1.0])
def test_a_series_fitted_to_splines_keeps_duration_condition_and_speed(share):
    robot, path = robots.load("five_bar", flexibility="flexible_links"), Line([0.1, 0.345], [-0.05, 0.195])
    task = task_of(robot, path, duration=1.5)
    law = solve_problem(problem_of(task), share=share).law
    series = _fit_series(problem_of(task), law)
    assert not series.basis.is_spline
    duration = SpeedSpace(series.basis, series.stretch).duration(series.coefficients)
    assert duration == pytest.approx(1.5, rel=1e-11)
    rows = condition_rows(problem_of(task), series.basis)
    terms = np.abs(rows.matrix.toarray() * series.coefficients).sum(axis=1)
    assert np.all(np.abs(rows(series.coefficients)) <= 1e-11 * terms)
    sigma = np.linspace(0.0, 1.0, 301)
    np.testing.assert_allclose(series.squared_speed(sigma), law.squared_speed(sigma), rtol=0.05)


def test_the_conditions_of_an_end_in_motion_are_not_nearly_parallel():
    """The derivatives of Chebyshev polynomials are; on such rows the solver needs a multiple of its time."""
    robot = robots.load("five_bar", flexibility="flexible_joints")
    program = series_program(task_of(robot, LINE, duration=1.5, start_speed=[0.6, 0.3, -1.0, 5.0]), 40)
    _, *rows = program.solved_conditions.matrix.toarray()
    assert np.shape(rows) == (4, 41)
    assert np.linalg.cond(rows) < 1.001
    y = program.space.adjust(np.eye(41)[0], program.conditions)  # which meets the derivatives themselves
    assert np.abs(program.solved_conditions(y)).max() < 1e-11 * np.abs(y).max()


@pytest.mark.parametrize("least", [1e-2, 1e-3])
def test_the_tangent_of_the_duration_is_the_duration_at_its_law_and_below_it_elsewhere(robot, least):
    """Durations by QUADPACK, of laws that are slow in the middle of the path."""
    task = task_of(robot, LINE, duration=3.0)
    program = series_program(task, 40)

    def duration(y: np.ndarray) -> float:
        def slowness(sigma: float) -> float:
            return chebval(float(task.stretch(np.array(sigma))), y) ** -0.5

        return quad(slowness, 0.0, 1.0, points=[0.4, 0.5, 0.6], limit=500, epsabs=1e-10)[0]

    slow = np.pad(poly2cheb([least + 0.04, -0.4, 1.0]), (0, 38))  # (xi - 0.2)^2 + least
    row = program._duration_tangents(slow, np.zeros(1), Units(1.0, 1.0))

    def tangent(y: np.ndarray) -> float:
        return float((row.parts["y"] @ y + row.offset)[0])

    assert tangent(slow) == pytest.approx(duration(slow), rel=1e-5)
    for other in (2.0 * slow, np.pad([1.0], (0, 40)), np.pad(poly2cheb([least, 0.0, 0.5]), (0, 38))):
        assert tangent(other) < duration(other) * (1.0 + 1e-5)


def test_the_least_energy_of_a_series_is_that_of_splines():
    robot = robots.load("biglide", flexibility="flexible_joints")
    path = scene_path(robot.description.scenes["across"])
    problem = problem_of(task_of(robot, path, longest=1.0, optimize="energy", smoothness=6))
    series = find_least_cost(problem._replace(degree=40)).speed.energy
    assert series == pytest.approx(find_least_cost(problem).speed.energy, rel=1e-2)


@pytest.mark.slow
def test_a_limit_that_is_exceeded_between_points_still_has_a_law():
    robot = robots.load("three_rrr", flexibility="flexible_joints")
    plan = plan_scene(robot, "crossing", law="optimal", optimize="time", torque_limit=30.0, duration=None)
    assert max(plan.peak_torque.values()) <= 30.0
    rigid = plan_scene(
        robots.load("three_rrr"), "crossing", law="optimal", optimize="time", torque_limit=30.0, duration=None
    )
    assert rigid.duration < plan.duration < 1.05 * rigid.duration


@pytest.mark.slow
def test_a_smooth_law_is_found_at_once_where_limits_leave_hardly_a_choice(monkeypatch):
    """Laws here differ by 0.4 %: the solver stalls in digits of a curvature that no one needs.

    By rounding it may stall all the same: the median of three durations counts.
    """
    statuses, stalls = list[str](), list[int]()
    solver = clarabel.DefaultSolver

    class Heard:
        def __init__(self, *program):
            self.solver = solver(*program)

        def solve(self):
            solution = self.solver.solve()
            statuses.append(str(solution.status))
            return solution

    monkeypatch.setattr(clarabel, "DefaultSolver", Heard)
    path = Line([-0.13462, 0.23115, 0.39903], [0.18997, 0.32572, 0.51356])
    # the quickest law within the speed limit takes 3.212 s
    for duration in (3.213, 3.2131, 3.2132):
        statuses.clear()
        plan = plan_crossing(robots.load("three_rpr"), path, duration=duration, speed_limit=19.03)
        stalls.append(statuses.count("InsufficientProgress"))
        assert statuses
        t = np.linspace(0.0, plan.duration, 20011)
        assert np.abs(plan.motor_angle(t, 1)).max() <= 19.03
        assert max(defects_of(plan)) < 1e-9
    assert np.median(stalls) == 0
