"""What the methods of the chart must do, whatever machine they run on."""

import numpy as np
import pytest

from tests.benchmarks.chart import robot, stages, torque
from tests.benchmarks.chart.measure import Row, measured
from tests.benchmarks.chart.reading import WRONG
from tests.benchmarks.chart.robot import SceneC


def cell(panel: str, method: str, *setting: float) -> Row:
    """A cell of the map of failure."""
    return row("failure", f"{panel}-{method}", *setting)


def row(stage: str, method: str, *setting: float) -> Row:
    one = stages.stage(stage)
    return measured(one, one.method(method), tuple(map(float, setting)), repeats=1)


def test_differences_fall_with_the_square_of_the_step_until_rounding():
    """At a tenth of a second from the singular instant; s" by differences loses 1e-16 / h^2 to rounding."""
    times = np.array([torque.T_C - 0.1, torque.T_C + 0.1])
    exact = torque.reference(times)

    def error(step: float) -> float:
        law = torque.DifferencedLaw(robot.law(), step)
        return float(np.abs(SceneC(law).pointwise(times) - exact).max())

    errors = np.array([error(step) for step in (1e-2, 1e-3, 1e-4)])
    np.testing.assert_allclose(errors[:-1] / errors[1:], 100.0, rtol=0.1)
    assert error(1e-6) > 10 * errors[-1]
    assert error(1e-7) > 10 * error(1e-6)


def test_differences_leave_a_pole():
    near = np.array(row("torque", "differences", 1e-3).profile[2:7])
    np.testing.assert_allclose(near[1:] / near[:-1], 10.0, rtol=0.1)  # each ten times nearer


def test_a_pointwise_solve_loses_a_digit_for_each_it_comes_nearer():
    near = np.array(row("torque", "pointwise", 17, 3).profile)
    assert near[0] < 1e-14
    assert near[-1] > 1e-9  # 1 ns: 1e-16 over the distance, on torques of 0.1 N m
    assert np.all(near[2:] < 1e-16 / np.array(stages.stage("torque").profile[2:]))


@pytest.mark.parametrize("degree", torque.DEGREES)
def test_a_table_with_a_spline_falls_with_its_order(degree):
    coarse, fine = (row("torque", "pointwise", samples, degree).error for samples in (33, 129))
    assert 4.0 ** (degree + 1) / 32 < coarse / fine < 4.0 ** (degree + 1) * 32


def test_pinocchio_alone_has_the_same_table():
    one, other = (row("torque", method, 65, 5) for method in ("pinocchio", "pointwise"))
    assert one.error == pytest.approx(other.error, rel=1e-6)


@pytest.mark.parametrize("method", ["forces", "pinocchio_forces", "constraint", "pinocchio_nodes"])
def test_all_who_solve_on_the_nodes_are_right_there(method):
    found = row("torque", method, 64)
    assert max(found.error, *found.profile) < 1e-11  # constraintDynamics loses three digits
    assert row("torque", method, 16).error > 1e6 * found.error


def test_tables_that_are_doubled_are_as_right_as_they_agree_and_know_a_pole():
    assert row("torque", "doubled", 1e-9).error < 1e-9
    assert row("torque", "certified", 1e-6).error < 1e-12


@pytest.mark.parametrize("method", ["pseudo_inverse", "damped"])
def test_what_is_cut_or_damped_is_wrong_by_the_torque_itself(method):
    """Within the band where the least singular value is below the threshold; outside it is not felt."""
    found = row("torque", method, 1e-4)
    assert min(found.profile[-4:]) > 0.05  # [N m]; the torque there is 0.1
    assert found.profile[0] < 1e-5


def test_a_series_has_the_torque_at_the_singular_instant():
    found = row("torque", "chebyshev", 64)
    assert max(found.error, *found.profile) < 1e-12
    assert row("torque", "chebyshev", 16).error > 1e6 * found.error


def test_the_robots_own_formula_is_the_closed_form():
    assert max(row("torque", "formula", 64).profile) < 1e-13


def test_no_step_mends_what_the_imposed_point_has_spoilt():
    errors = [cell("imposed", "table", 1e-4, 1.5 / 2**k).error for k in (4, 8)]
    assert min(errors) > 1.0  # more than the torque itself
    assert cell("imposed", "table", 1e-12, 1.5 / 2**8).error < 1e-5


@pytest.mark.parametrize("method", ["proved", "doubled"])
def test_what_is_imposed_beside_the_point_is_refused_by_who_checks_it(method):
    for offset in (1e-2, 1e-6):
        assert not np.isfinite(cell("imposed", method, offset, 1e-10).error)
    assert cell("imposed", method, 1e-12, 1e-10).error < 1e-5


def test_all_methods_agree_with_the_reference_on_the_loaded_condition():
    for method, allowed in (("proved", 1e-12), ("root", 1e-7), ("repeated", 1e-12), ("differences", 1e-4)):
        assert cell("misfit", method, 1.0, 0.0).error < allowed, method


def test_beside_the_loaded_condition_only_ours_says_no():
    assert not np.isfinite(cell("misfit", "proved", 1.0, 1e-4).error)
    for method in ("root", "repeated", "differences"):
        assert cell("misfit", method, 1.0, 1e-4).error >= WRONG, method


def test_variants_are_the_paper_robot_in_other_units():
    """The reference by similarity against the planner, which shares nothing with it."""
    for panel, setting in (("sizes", (1e-4, 1e2)), ("masses", (1e-3, 1e-6))):
        for method in ("planned", "pinocchio"):
            assert cell(panel, method, *setting).error < 1e-9, (panel, method)


@pytest.mark.parametrize("method", ["planned", "simulated"])
def test_ours_is_right_whatever_size_duration_and_masses(method):
    for setting in ((1e-6, 1e-4), (1e4, 1e4), (1e-6, 1e4)):
        assert cell("sizes", method, *setting).error < 1e-6, setting
    for setting in ((1e-9, 1e-12), (1e6, 1.0)):
        assert cell("masses", method, *setting).error < 1e-6, setting
