"""Bounds of all laws: closed forms, integrals with many digits, and laws that must not be below them."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise, product
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

import robots
from framework import Line, ParallelRobot, plan_crossing
from framework.model.description import JointDynamics
from framework.numerics.bernstein import DEGREE, Bernstein
from framework.planning.optimal import path_series, peak_bound
from framework.planning.optimal.dual_program import DualProgram, Evidence, Multipliers
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.path_series import PathSeries
from framework.planning.optimal.peak_bound import bound_duration, bound_peak, find_refuting_bound
from framework.planning.optimal.phase_plane import AffineInSpeed, Demand
from framework.planning.request import Specification
from framework.planning.scenes import scene_path
from tests.mutated_code import mutated_code
from tests.planning.optimal.tasks import task_of

LINE = Line([0.1, 0.345], [-0.05, 0.195])
MASS, LIMIT = 3.0, 2.0


def motion(
    monkeypatch,
    *,
    torque=lambda s: (0.0 * s, 0.0 * s, MASS + 0.0 * s),
    damping=lambda s: 0.0 * s,
    direction=lambda s: 1.0 + 0.0 * s,
    friction=0.0,
    limit=LIMIT,
    speed_limit=np.inf,
    duration=None,
    crossings=(),
):
    """The task of motors whose torques c, cz, cu over s are given: (M,) of one motor, (M, m) of m of them."""
    columns = lambda values: np.reshape(values, (len(values), -1))  # noqa: E731

    def demand(branch, phi, sigma):
        constant, per_z, per_u = (columns(part) for part in torque(sigma))
        speed = np.broadcast_to(np.abs(columns(direction(sigma))), constant.shape)
        turning = np.broadcast_to(columns(direction(sigma)), constant.shape)
        per_speed = np.broadcast_to(columns(damping(sigma)), constant.shape)
        return Demand(AffineInSpeed(constant, per_z, per_u), per_speed, speed, turning if friction else None)

    monkeypatch.setattr(path_series, "demand", demand)
    monkeypatch.setattr(peak_bound, "demand", demand)
    m = columns(torque(np.zeros(1))[2]).shape[1]
    robot = SimpleNamespace(n_e=0, n_a=m, n=m, is_damped=bool(np.any(damping(np.ones(1)))))
    smooth = SimpleNamespace(knots=np.empty(0))
    branch = SimpleNamespace(robot=robot, path=smooth, wrenches=smooth)
    points = tuple(SimpleNamespace(s=s, corank=1, contact="transversal") for s in crossings)
    specification = Specification(
        "time", duration, None, np.full(m, limit), np.full(m, speed_limit), 1, np.full(m, friction)
    )
    to_cross = SimpleNamespace(branch=branch, points=points)
    return Task(to_cross, SimpleNamespace(geometry="rigid"), specification)


def close_below(value, best, share=3e-3):
    assert (1.0 - share) * best < value < (1.0 + 1e-9) * best


def test_margins_grow_until_the_factor_is_proved():
    """Of a solver whose factor stays below the margin that it is asked for, on each of two cells."""
    lacking = np.array([0.3, 0.02])
    program = SimpleNamespace(
        series=None,
        factor_error=np.full(2, 1e-3),
        solve=lambda margin: margin - lacking,
        evaluate_bound=lambda factor: Evidence(1.0, np.maximum(-factor, 0.0), np.full(2, 0.5)),
    )
    assert peak_bound._solve_program(program, None).complete


def test_a_mass_is_moved_by_full_force_forth_and_back(monkeypatch):
    close_below(bound_duration(motion(monkeypatch)).value, 2.0 * np.sqrt(MASS / LIMIT))
    task = motion(monkeypatch, duration=1.7)
    close_below(bound_peak(task, np.ones(1)).value, 4.0 * MASS / 1.7**2)


def test_a_mass_that_grows_on_a_short_stretch_is_resolved_there(monkeypatch):
    """Of m(s) z'/2 = +-L the integral z = 2 L I(s), I = integral of 1/m, is the largest up to I's middle."""
    mass = lambda s: MASS * (1.0 + np.exp(-(((s - 0.3) / 0.003) ** 2)))  # noqa: E731
    task = motion(monkeypatch, torque=lambda s: (0.0 * s, 0.0 * s, mass(s)))
    s = np.linspace(0.0, 1.0, 20001)
    times = []
    for places in (s, s[::-1]):  # from either end: dt = ds / sqrt(z) = 2 m d(sqrt(I)) / sqrt(2 L)
        integral = np.abs(cumulative_trapezoid(1.0 / mass(places), places, initial=0.0))
        half = integral <= 0.5 * integral[-1]
        slowness = 2.0 * mass(places[half]) / np.sqrt(2.0 * LIMIT)
        times.append(np.trapezoid(slowness, np.sqrt(integral[half])))
    close_below(bound_duration(task).value, sum(times))


def test_a_weight_is_lifted_with_what_it_leaves_of_the_limit(monkeypatch):
    weight = 0.8
    task = motion(monkeypatch, torque=lambda s: (weight + 0.0 * s, 0.0 * s, MASS + 0.0 * s))
    up, down = LIMIT - weight, LIMIT + weight
    close_below(bound_duration(task).value, np.sqrt(2.0 * MASS * (1.0 / up + 1.0 / down)))
    close_below(bound_peak(task, np.ones(1)).value, weight)  # slowly


def test_a_speed_limit_is_counted(monkeypatch):
    fastest = 0.4
    task = motion(monkeypatch, speed_limit=fastest)
    close_below(bound_duration(task).value, 1.0 / fastest + fastest * MASS / LIMIT)


def test_dry_friction_is_a_weight_that_turns_with_the_motor(monkeypatch):
    rub, turn = 0.5, 0.6137
    task = motion(
        monkeypatch, friction=rub, direction=lambda s: turn - s, torque=lambda s: (0 * s, 0 * s, MASS + 0 * s)
    )
    # z with full force up to a place s, from there with full braking: friction helps to brake up to the turn
    speeds = np.linspace(0.0, 1.0, 200001)
    first = 2.0 / MASS * np.where(speeds < turn, LIMIT - rub, LIMIT + rub)
    last = 2.0 / MASS * np.where(speeds < turn, LIMIT + rub, LIMIT - rub)
    forth = np.concatenate([[0.0], np.cumsum(first[:-1])]) * speeds[1]
    back = np.concatenate([np.cumsum(last[::-1][:-1])[::-1], [0.0]]) * speeds[1]
    z = np.minimum(forth, back)
    middle = 0.5 * (z[1:] + z[:-1])
    duration = np.sum(2.0 * np.diff(speeds) / (np.sqrt(z[1:]) + np.sqrt(z[:-1])))
    assert middle.min() > 0.0
    close_below(bound_duration(task).value, duration)


def test_viscous_damping_slows(monkeypatch):
    damp = 1.1
    task = motion(monkeypatch, damping=lambda s: damp + 0.0 * s)

    def travelled(split):  # forth by full force for `split` seconds, then back until at rest
        rate = damp / MASS
        speed = LIMIT / damp * (1.0 - np.exp(-rate * split))
        stop = np.log(1.0 + speed * damp / LIMIT) / rate
        forth = LIMIT / damp * (split - (1.0 - np.exp(-rate * split)) / rate)
        back = (speed + LIMIT / damp) * (1.0 - np.exp(-rate * stop)) / rate - LIMIT / damp * stop
        return forth + back, split + stop

    low, high = 0.0, 10.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if travelled(middle)[0] < 1.0 else (low, middle)
    duration = travelled(low)[1]
    value = bound_duration(task).value
    assert 2.0 * np.sqrt(MASS / LIMIT) < value  # more than without
    close_below(value, duration, 8e-3)


CROSSING = 0.4
ALONG = np.array([0.6, -0.8])


def singular_torques(s, root=np.sin, wave=np.cos):
    """c, cz, cu (2,) each, with a pole along ALONG at the crossing, of numpy or mpmath."""
    pole = 1 / (s - CROSSING)
    constant = [pole * a * (1 - 3 * s) + b for a, b in zip(ALONG, (wave(2 * s), root(s) - 0.4), strict=True)]
    per_z = [pole * a * (0.3 + s) + b for a, b in zip(ALONG, (0.2 * s, wave(s)), strict=True)]
    per_u = [pole * a * (1 + 0.2 * s) + b for a, b in zip(ALONG, (1.0 + s, 0.7 - root(s)), strict=True)]
    return constant, per_z, per_u


def singular_motion(monkeypatch, **options):
    stacked = lambda s: tuple(np.stack(np.broadcast_arrays(*part), axis=1) for part in singular_torques(s))  # noqa: E731
    return motion(monkeypatch, torque=stacked, crossings=(CROSSING,), **options)


def test_the_value_is_what_its_multipliers_give_with_many_digits(monkeypatch):
    """By Gauss quadrature with 30 digits, between signs of nu; the factor on points between the nodes too."""
    monkeypatch.setattr(peak_bound, "MAX_CELLS", 0)  # no refinement
    monkeypatch.setattr(peak_bound, "FIRST_CELLS", 24)
    bound = bound_peak(singular_motion(monkeypatch), np.ones(2))
    gained, length, least = mpmath.mpf(0), mpmath.mpf(0), mpmath.inf
    with mpmath.workdps(30):
        for k, (low, high) in enumerate(zip(bound.edges[:-1], bound.edges[1:], strict=True)):
            low, high = mpmath.mpf(float(low)), mpmath.mpf(float(high))
            p, across = bound.p[k], bound.across[k]

            def nu(s, *, low=low, high=high, p=p, across=across):
                x = (s - low) / (high - low)
                share = [(1 - x) ** 2, 2 * x * (1 - x), x**2]
                constant, per_z, per_u = singular_torques(s, mpmath.sin, mpmath.cos)
                square = sum(value**2 for value in per_u)
                at = sum(float(value) * weight for value, weight in zip(p, share, strict=True))
                free = [sum(float(across[i, j]) * share[i] for i in range(3)) for j in range(2)]
                along = (2 * at - sum(f * c for f, c in zip(free, per_u, strict=True))) / square
                found = [f + along * c for f, c in zip(free, per_u, strict=True)]
                slope = (
                    2
                    * ((float(p[1]) - float(p[0])) * (1 - x) + (float(p[2]) - float(p[1])) * x)
                    / (high - low)
                )
                factor = sum(a * b for a, b in zip(found, per_z, strict=True)) - slope
                return found, sum(a * b for a, b in zip(found, constant, strict=True)), factor

            points = [low + (high - low) * (mpmath.mpf(i) - 0.3) / 7 for i in range(1, 8)]
            least = min(least, *(nu(s)[2] for s in points))
            gained += mpmath.quad(
                lambda s, nu=nu: nu(s)[1], [low, *points, high], method="gauss-legendre", maxdegree=2
            )
            for j in range(2):
                cuts = [low, *_sign_changes(lambda s, nu=nu, j=j: nu(s)[0][j], [low, *points, high]), high]
                length += mpmath.quad(
                    lambda s, nu=nu, j=j: abs(nu(s)[0][j]), cuts, method="gauss-legendre", maxdegree=3
                )
    assert least >= 0
    true = float(gained / length)
    assert bound.by_duality <= true
    assert bound.by_duality == pytest.approx(true, rel=2e-3)


def _sign_changes(function, points):
    """Return zeros of a function between neighbours of points where its sign differs, by bisection."""
    found = []
    for low, high in pairwise(points):
        if function(low + (high - low) / 1000) * function(high - (high - low) / 1000) < 0:
            for _ in range(60):
                middle = (low + high) / 2
                low, high = (
                    (middle, high)
                    if function(low + (high - low) / 1000) * function(middle) > 0
                    else (low, middle)
                )
            found.append(low)
    return found


def least_cost(factor, damping, lam):
    """The least of F y^2 + w y + lambda / y over y > 0, with thirty digits."""
    with mpmath.workdps(30):
        y = mpmath.findroot(lambda y: 2 * factor * y**3 + damping * y**2 - lam, 0.6)
        return factor * y**2 + damping * y + lam / y


def test_a_bound_counts_the_errors_of_its_series():
    """Constant functions, each anywhere within its error: no law of any of them is below the bound.

    One motor and one cell, with nu = x v, c, cz, cu, d, k constant: the least of F z + w sqrt(z) + lambda
    / sqrt(z) is found with thirty digits, for the worst of all signs. A sum of many cells without errors is
    rounded down.
    """
    errors = {"v": 0.03, "constant": 0.05, "per_z": 0.04, "damping": 0.02, "squared_speed": 0.06}
    values = {"v": 1.0, "constant": 0.9, "per_z": 0.8, "damping": 0.3, "squared_speed": 0.5}
    mu, lam = 0.1, 0.7

    def series_of(widths, shapes):
        """Constant functions on cells, with their errors."""
        k = len(widths)
        bernstein = {
            name: Bernstein(np.full((k, DEGREE + 1, *shape), values[name]), np.full((k, *shape), error))
            for (name, error), shape in zip(shapes.items(), [(1, 1), (1,), (1,), (1,), (1,)], strict=True)
        }
        return PathSeries(np.append(0.0, np.cumsum(widths)), np.zeros((k, 0, 1)), **bernstein)

    for damped in (-1.0, 0.0, 1.0):
        values["damping"] = 0.3 * damped
        x = np.ones((1, 3, 1))
        multipliers = Multipliers(x, np.array([[mu]]), np.full((1, 2), 0.84), lam)
        series = series_of([1.0], errors)
        for longest, timed in ((1.3, False), (None, True)):
            bound = DualProgram(series, longest, timed).evaluate_bound(multipliers)
            least = mpmath.inf
            for sides in product((-1, 1), repeat=5):
                v, c, cz, d, k = (
                    values[name] + side * errors[name] for name, side in zip(errors, sides, strict=True)
                )
                total = c - mu + least_cost(cz + mu * k, d, lam)
                true = (total - abs(v)) / lam if timed else (total - lam * longest) / abs(v)
                least = min(least, true)
            assert not bound.shortfall.any()
            assert bound.value <= least
            assert bound.value > 0.9 * least

    values |= {"constant": 1 / 3, "damping": 0.0}
    no_errors = dict.fromkeys(errors, 0.0)
    for seed in range(20):
        widths = np.random.default_rng(seed).uniform(0.5, 1.0, 99)
        k = len(widths)
        multipliers = Multipliers(np.ones((k, 3, 1)), np.zeros((k, 1)), np.full((k, 2), 0.8), 0.0)
        series = series_of(widths, no_errors)
        exact = Fraction(1 / 3)  # nu is 1: the ratio of both integrals
        assert DualProgram(series, None, False).evaluate_bound(multipliers).value <= exact


@pytest.mark.parametrize(
    ("function", "old", "new"),
    [
        (DualProgram._bound_terms, "damping.min(axis=1) - damping_error", "damping.min(axis=1)"),
        (DualProgram._bound_terms, "constant.mean(axis=1) - constant_error", "constant.mean(axis=1)"),
        (DualProgram._bound_norm, ".sum(axis=1) + error", ".sum(axis=1)"),
        (DualProgram._bound_distance, " - error - (mu", " - (mu"),
        (DualProgram._bound_distance, " - (mu * series.squared_speed.error).sum(axis=1)", ""),
        (DualProgram.evaluate_bound, " - rounding", ""),
        (DualProgram.evaluate_bound, "float(value)", "1.1 * float(value)"),
    ],
)
def test_no_error_of_a_bound_is_idle(function, old, new, monkeypatch):
    monkeypatch.setattr(function, "__code__", mutated_code(function, old, new))
    with pytest.raises(AssertionError):
        test_a_bound_counts_the_errors_of_its_series()


def test_units_change_a_bound_as_they_change_what_is_bounded(monkeypatch):
    plain = bound_peak(singular_motion(monkeypatch, duration=1.3), np.ones(2)).value
    scaled = bound_peak(singular_motion(monkeypatch, duration=1.3), np.full(2, 1e3)).value
    assert scaled == pytest.approx(1e-3 * plain, rel=1e-3)
    duration = bound_duration(singular_motion(monkeypatch, limit=4.0)).value
    slow = lambda s: tuple(  # noqa: E731  # seconds become milliseconds
        np.stack(np.broadcast_arrays(*part), axis=1) * unit
        for part, unit in zip(singular_torques(s), (1.0, 1e6, 1e6), strict=True)
    )
    in_milliseconds = bound_duration(motion(monkeypatch, torque=slow, crossings=(CROSSING,), limit=4.0)).value
    assert in_milliseconds == pytest.approx(1e3 * duration, rel=1e-3)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_at_the_ends_motors_overcome_friction_the_way_they_turn(monkeypatch, side):
    weight = lambda s: (1.0 + s, 0.0 * s, 2.0 + 0.0 * s)  # noqa: E731
    task = motion(monkeypatch, torque=weight, direction=lambda s: side + 0.0 * s, friction=0.3)
    np.testing.assert_allclose(peak_bound.torques_at_ends(task)[:, 0], [1.0 + 0.3 * side, 2.0 + 0.3 * side])


def peak_of(plan, reference):
    """The largest torque over a reference (n_a,)."""
    return float((np.abs(plan.torque(np.linspace(0.0, plan.duration, 6001))) / reference).max())


def upright():
    description = robots.load("five_bar_heavy").description
    return ParallelRobot.from_description(replace(description, gravity=(0.0, -9.81, 0.0)))


def rubbing():
    description = robots.load("five_bar").description
    joints = {
        "left_motor": JointDynamics(friction=1.5, damping=0.4),
        "right_motor": JointDynamics(friction=0.8),
    }
    return ParallelRobot.from_description(replace(description, joints=joints))


CASES = {
    "flat": (lambda: robots.load("five_bar"), lambda robot: LINE, {}),
    "upright": (upright, lambda robot: LINE, {}),
    "friction and damping": (rubbing, lambda robot: LINE, {}),
    "pushed": (
        lambda: robots.load("five_bar"),
        lambda robot: LINE,
        {"wrenches": {"left_tip": [0, -20, 0, 0, 0, 0]}},
    ),
    "delta": (lambda: robots.load("delta"), lambda robot: scene_path(robot.description.scenes["cross"]), {}),
    "par4": (lambda: robots.load("par4"), lambda robot: scene_path(robot.description.scenes["cross"]), {}),
    "six legs": (
        lambda: robots.load("gough_stewart"),
        lambda robot: scene_path(robot.description.scenes["turn"]),
        {},
    ),
}


@pytest.mark.slow  # of the flat five-bar at once: test_best_law.py
@pytest.mark.parametrize("name", CASES)
def test_no_law_is_below_and_the_best_is_close(name):
    make, path_of, options = CASES[name]
    robot = make()
    path, reference = path_of(robot), np.ones(robot.n_a)
    bound = bound_peak(task_of(robot, path, duration=1.5, **options), reference)
    plan = plan_crossing(robot, path, duration=1.5, law="optimal", **options)
    assert 1.0 < peak_of(plan, reference) / bound.value < 1.02
    for other in ({"optimize": "energy"}, {"smoothness": 4}):
        law = plan_crossing(robot, path, duration=1.5, law="optimal", **options, **other)
        assert peak_of(law, reference) > bound.value
    limit = 1.2 * peak_of(plan, reference)
    quickest = plan_crossing(robot, path, optimize="time", torque_limit=limit, **options)
    least = bound_duration(task_of(robot, path, optimize="time", torque_limit=limit, **options))
    assert 1.0 < quickest.duration / least.value < 1.03


def test_a_polynomial_of_the_paper_is_above():
    robot = robots.load("five_bar")
    plan = plan_crossing(robot, LINE, duration=1.5, law="polynomial")
    assert bound_peak(task_of(robot, LINE, duration=1.5), np.ones(2)).value < 0.6 * peak_of(plan, np.ones(2))


def problem_of(robot, **options):
    return LawProblem(task_of(robot, LINE, **options), np.empty(0), np.empty((0, 4)))


def test_there_is_a_proof_just_below_the_least_peak_and_none_above():
    robot = upright()
    least = peak_of(plan_crossing(robot, LINE, duration=1.5, law="optimal"), np.ones(2))
    assert find_refuting_bound(problem_of(robot, duration=1.5, torque_limit=1.001 * least).task) is None
    proof = find_refuting_bound(problem_of(robot, duration=1.5, torque_limit=0.98 * least).task)
    assert 1.0 < proof.value < 1.03
    assert proof.edges[0] == 0.0
    assert proof.edges[-1] == 1.0
    assert len(proof.p) == len(proof.edges) - 1


def test_where_the_bound_does_not_hold_there_is_none():
    elastic = robots.load("five_bar", flexibility="flexible_joints")
    assert bound_peak(task_of(elastic, LINE, duration=1.5), np.ones(2)) is None
    robot = robots.load("five_bar")
    assert find_refuting_bound(problem_of(robot, duration=1.5).task) is None  # no limit
