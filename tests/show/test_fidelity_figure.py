"""The figure of a fidelity study draws the errors that were measured, and the crossing."""

import numpy as np

import robots
from framework import fidelity_study
from framework.show.study_figures import plot_fidelity


def test_a_curve_for_each_rung_with_torques_of_its_own():
    study = fidelity_study(robots.load("five_bar"), "C")
    drawn = plot_fidelity(study).figure
    own = [comparison for comparison in study.levels if not comparison.same_as]
    s = study.highest.law(study.times)
    for ax, errors in zip(drawn.axes, ("torque_error", "platform_error"), strict=True):
        *curves, tolerance, crossing = ax.lines
        for curve, comparison in zip(curves, own, strict=True):
            x, y = curve.get_data()
            np.testing.assert_array_equal(x, s)
            np.testing.assert_allclose(
                np.nan_to_num(y), np.nan_to_num(getattr(comparison, errors)), rtol=0, atol=1e-12
            )
        assert set(tolerance.get_ydata()) == {study.tolerance}
        assert set(crossing.get_xdata()) == {study.highest.crossings[0].s}
