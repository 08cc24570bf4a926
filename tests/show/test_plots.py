"""Figures hold the plan's numbers, say their units, and show where the crossings are."""

import re
from dataclasses import replace
from io import BytesIO
from types import SimpleNamespace
from xml.etree import ElementTree

import matplotlib
import matplotlib.image
import numpy as np
import pytest

import robots
from framework import InvalidInput, Line, ParallelRobot, fidelity_study, plan_crossing, plan_scene
from framework.dynamics.finite_differences import finite_difference_torques
from framework.planning.optimal.limit_curves import limit_curves
from framework.show import plots
from framework.show.film import film_plan
from framework.show.map import plot_locus
from framework.show.plots import plot_eyes, plot_phase_plane
from framework.show.study_figures import plot_fidelity, plot_robustness
from framework.show.style import LOCUS, figure_file, new_figure, page_figure, use_style

CASES = [("C", "flexible_links"), ("A", "rigid")]


@pytest.fixture(params=CASES, ids="-".join, scope="module")
def plan(request):
    scene, flexibility = request.param
    return plan_scene(robots.load("five_bar", flexibility=flexibility), scene)


@pytest.fixture(scope="module")
def crossing_plan():
    return plan_scene(robots.load("five_bar", flexibility="flexible_links"), "C")


def curves(ax) -> list:
    """The curves, without marks, verticals and the zero line."""
    return [line for line in ax.lines if len(line.get_xdata()) > 2]


def verticals(ax) -> list[float]:
    """Abscissae of the vertical lines."""
    pairs = [line.get_xdata() for line in ax.lines if len(line.get_xdata()) == 2]
    return [float(x[0]) for x in pairs if x[0] == x[1]]


def marks(ax) -> list[tuple[float, float]]:
    """Places of single points."""
    return [(line.get_xdata()[0], line.get_ydata()[0]) for line in ax.lines if len(line.get_xdata()) == 1]


def test_the_law_is_drawn_with_its_derivatives(plan):
    axes = plots.plot_law(plan)
    for order, (ax, unit) in enumerate(zip(axes, ("$s$", "[1/s]", "[1/s$^2$]"), strict=True)):
        (curve,) = curves(ax)
        t, value = curve.get_data()
        assert (t[0], t[-1]) == (0.0, plan.duration)
        np.testing.assert_array_equal(value, plan.law(t, order))
        assert unit in ax.get_ylabel()
        assert verticals(ax) == [crossing.time for crossing in plan.crossings]
        for t, value in marks(ax):  # on the curve
            assert value == pytest.approx(plan.law(t, order), abs=1e-12)
        assert len(marks(ax)) == len(plan.crossings)
    assert "[s]" in axes[-1].get_xlabel()
    assert str(plan.law.degree) in axes[0].get_title(loc="left")
    with use_style():  # a browser has no font of TeX, in which a prime is the digit 0
        assert "font-family: 'cm" not in figure_file(axes[0].figure, "svg").decode()
        on_page = page_figure(axes[0].figure).decode()
    ElementTree.fromstring(on_page)
    drawn = on_page.split("</style>", 1)[1]  # every colour is one that dark pages change
    assert not re.findall(r": #[0-9a-f]{6}", drawn)
    assert {"ink", "paper", "series-0"} <= set(re.findall(r"var\(--([a-z0-9-]+)\)", drawn))


def test_the_torques_are_drawn_motor_by_motor(plan):
    ax = plots.plot_torques(plan)
    drawn = curves(ax)
    assert len(drawn) == plan.robot.n_a
    for k, curve in enumerate(drawn):
        t, torque = curve.get_data()
        assert (t[0], t[-1]) == (0.0, plan.duration)
        np.testing.assert_array_equal(torque, plan.torque(t)[:, k])
    named = [text.get_text() for text in ax.get_legend().get_texts()]
    assert named == [joint.replace("_", " ") for joint in plan.robot.actuator_names]
    assert len({(curve.get_color(), curve.get_linestyle()) for curve in drawn}) == len(drawn)
    assert ("[s]" in ax.get_xlabel(), "[N m]" in ax.get_ylabel()) == (True, True)
    assert verticals(ax) == [crossing.time for crossing in plan.crossings]


def test_the_speeds_are_drawn_beside_their_limits(plan):
    ax = plots.plot_speeds(plan)
    times = np.linspace(0.0, plan.duration, 4001)
    for k, curve in enumerate(curves(ax)):
        t, speed = curve.get_data()
        angle = np.interp(t, times, plan.motor_angle(times)[:, k])
        lines = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))  # the speed is the angle's rate
        np.testing.assert_allclose(lines, angle[1:] - angle[0], atol=1e-3 * np.ptp(angle))
    assert "[rad/s]" in ax.get_ylabel()
    assert verticals(ax) == [crossing.time for crossing in plan.crossings]


@pytest.mark.parametrize(("name", "draw"), [("torque", plots.plot_torques), ("speed", plots.plot_speeds)])
def test_limits_of_the_request_and_of_the_file_are_drawn(write_robot, name, draw):
    robot = ParallelRobot.from_file(write_robot((f"actuators.0.{name}_limit", 300.0)))
    plan = plan_scene(robot, "C", law="polynomial")
    for options, limits in (({}, {300.0}), ({f"{name}_limit": [400.0, 500.0]}, {400.0, 500.0})):
        planned = plan_scene(robot, "C", **options) if options else plan
        ax = draw(planned)
        levels = {line.get_ydata()[0] for line in ax.lines if len(set(line.get_ydata())) == 1}
        assert levels == limits | {-limit for limit in limits}
        assert "dotted: limits" in ax.get_xlabel()


def test_no_label_is_cut_off_where_a_figure_is_saved_as_the_readme_says(write_robot):
    robot = ParallelRobot.from_file(write_robot(("actuators.0.torque_limit", 300.0)))
    ax = plots.plot_torques(plan_scene(robot, "C", law="polynomial"))
    assert "dotted: limits" in ax.get_xlabel()
    ax.figure.draw_without_rendering()
    page = ax.figure.bbox
    for label in (ax.xaxis.label, ax.yaxis.label):
        extent = label.get_window_extent()
        assert page.x0 <= extent.x0 < extent.x1 <= page.x1
        assert page.y0 <= extent.y0 < extent.y1 <= page.y1


def test_no_label_is_cut_off_where_its_place_changes_the_ticks(crossing_plan):
    with use_style():
        picture = figure_file(plots.plot_singularity(crossing_plan).figure, "png")
    shades = matplotlib.image.imread(BytesIO(picture))[:, :, :3]
    assert shades[:, :4].min() == 1.0  # white at the left edge


def test_g_is_drawn_along_the_path_and_vanishes_at_the_marks(plan):
    ax = plots.plot_singularity(plan)
    assert marks(ax) == [(crossing.s, 0.0) for crossing in plan.crossings]
    at_rest, *deflected = curves(ax)
    assert len(deflected) == (plan.geometry == "deformed")
    s, g = at_rest.get_data()
    assert (s[0], s[-1]) == (0.0, 1.0)
    assert np.sum(np.diff(np.sign(g)) != 0) == len(plan.crossings)
    for crossing in plan.crossings:
        s, g = (deflected or [at_rest])[0].get_data()
        # between samples g is straight to their spacing squared; its slope is of order one
        assert np.interp(crossing.s, s, g) == pytest.approx(0.0, abs=1e-4 * np.abs(g).max())
        assert f"{crossing.s:.6f}" in ax.texts[0].get_text()
    assert "$s$" in ax.get_xlabel()
    assert "$g$" in ax.get_ylabel()


def test_both_robots_are_shown_magnified_where_deflections_move_the_crossing(crossing_plan):
    (inset,) = plots.plot_singularity(crossing_plan).child_axes
    # in millionths of s; at rest the robot is singular at s = 0.667006874764298 (issue: what it must show)
    shift = 1e6 * (crossing_plan.crossings[0].s - 0.667006874764298)
    zeros = [np.interp(0.0, *_rising(curve.get_ydata(), curve.get_xdata())) for curve in curves(inset)]
    # the curves are chords between samples 1/600 apart: good to some parts in a hundred
    np.testing.assert_allclose(zeros, [0.0, shift], atol=0.05 * shift)


def _rising(over, values):
    order = np.argsort(over)
    return over[order], values[order]


def test_the_wrench_is_drawn_over_time_and_vanishes_at_the_crossings(plan):
    ax = plots.plot_wrench(plan)
    (curve,) = curves(ax)
    t, wrench = curve.get_data()
    assert (t[0], t[-1]) == (0.0, plan.duration)
    assert ("[s]" in ax.get_xlabel(), "[N]" in ax.get_ylabel()) == (True, True)
    assert verticals(ax) == [crossing.time for crossing in plan.crossings]
    assert marks(ax) == [(crossing.time, 0.0) for crossing in plan.crossings]
    for crossing in plan.crossings:
        assert np.interp(crossing.time, t, wrench) == pytest.approx(0.0, abs=1e-4 * np.abs(wrench).max())


def test_the_eye_closes_to_a_point_that_the_motion_passes(crossing_plan):
    """At any torque limit: the band has no width at the singular instant, and the curve goes through it."""
    description = crossing_plan.robot.description
    for limit in (0.2, 20.0):
        motors = tuple(replace(motor, torque_limit=limit) for motor in description.actuators)
        robot = ParallelRobot.from_description(replace(description, actuators=motors))
        plan = plan_scene(robot, "C")
        ax = plot_eyes([film_plan(plan)], np.full(2, limit))
        (curve,) = curves(ax)
        (band,) = (part.get_paths()[0].vertices for part in ax.collections)
        width = np.abs(band[:, 1])
        singular = plan.crossings[0].s
        inside = np.abs(band[:, 0] - singular) < 1e-9
        assert width[inside].max() < 1e-6 * width.max()
        assert np.interp(singular, *curve.get_data()) == pytest.approx(0.0, abs=1e-6 * width.max())
        assert f"{limit:.3g} N m" in ax.get_legend().get_texts()[0].get_text()


def test_a_plan_without_a_crossing_has_no_eye(crossing_plan):
    clear = plan_crossing(crossing_plan.robot, Line([0.1, 0.345], [0.08, 0.335]), duration=1.0)
    with pytest.raises(InvalidInput, match="through a singularity"):
        plot_eyes([film_plan(clear)], np.ones(2))


def test_raw_torques_are_drawn_sample_by_sample_with_their_poles(crossing_plan):
    robot, plan = crossing_plan.robot, crossing_plan
    raw = finite_difference_torques(robot, plan.path, plan.law, samples=101)
    ax = plots.plot_raw_torques(raw, robot, [0.7, 1.0])
    for curve, torque in zip(curves(ax), raw.torque.T, strict=True):
        np.testing.assert_array_equal(curve.get_data(), [raw.time, torque])
    assert verticals(ax) == [0.7, 1.0]
    assert "[N m]" in ax.get_ylabel()
    assert "proves nothing" in ax.get_xlabel()


@pytest.mark.parametrize("draw", [plots.plot_torques, plots.plot_singularity, plots.plot_wrench])
def test_figures_are_drawn_on_the_axes_that_one_gives(crossing_plan, draw):
    (ax,) = new_figure()
    assert draw(crossing_plan, ax) is ax
    assert curves(ax)


@pytest.mark.slow
def test_all_figures_are_saved_as_pages_of_a_pdf_and_as_png(crossing_plan, tmp_path):
    settings = dict(matplotlib.rcParams)
    document, *pictures = plots.save_figures(crossing_plan, tmp_path)
    assert dict(matplotlib.rcParams) == settings
    names = ("robot", "law", "torques", "singularity", "wrench", "eye", "vibrations")
    assert [path.name for path in pictures] == [f"{name}.png" for name in names]
    assert {document, *pictures} == set(tmp_path.iterdir())
    assert document.name == "figures.pdf"
    content = document.read_bytes()
    assert content.startswith(b"%PDF-")
    assert content.rstrip().endswith(b"%%EOF")
    assert len(re.findall(rb"/Type /Page\b", content)) == len(names)
    assert b"/Type3" not in content  # fonts that publishers refuse
    assert 0 < len(re.findall(rb"/FontFile2\b", content)) < len(names)  # they are shared by the pages
    for picture in pictures:
        image = matplotlib.image.imread(picture)
        assert image.shape[1] == 700  # [px], a column of 3.5 inches
        assert image[..., :3].std() > 0.05  # there is something on it
    twice = [
        [
            path.read_bytes()
            for path in plots.save_figure(lambda: plots.plot_torques(crossing_plan), tmp_path / stem)
        ]
        for stem in ("again", "and_again")
    ]
    assert twice[0] == twice[1]
    assert twice[0][1] == pictures[2].read_bytes()


def test_the_phase_plane_holds_both_laws_between_what_the_motors_allow(crossing_plan):
    robot = robots.load("five_bar")
    quickest = plan_crossing(robot, crossing_plan.path, optimize="time", torque_limit=0.165)
    axes = plot_phase_plane(quickest, beside=crossing_plan)
    (crossing,) = quickest.crossings
    for order, (ax, unit) in enumerate(zip(axes, ("[1/s]", "[1/s$^2$]"), strict=True), start=1):
        assert [line.get_label() for line in curves(ax)] == [
            f"optimal, {quickest.duration:.3g} s",
            "polynomial, 1.5 s",
        ]
        s, value = curves(ax)[0].get_data()
        times = np.linspace(0.0, quickest.duration, len(s))
        np.testing.assert_array_equal(value, quickest.law(times, order))
        assert marks(ax) == [(crossing.s, (crossing.speed, crossing.acceleration)[order - 1])]
        assert unit in ax.get_ylabel()
    legend = [text.get_text() for text in axes[0].get_legend().get_texts()]
    assert "within 0.165 N m" in legend


@pytest.mark.slow
def test_an_optimal_law_is_saved_with_its_phase_plane(tmp_path, crossing_plan):
    plan = plan_crossing(robots.load("five_bar"), crossing_plan.path, duration=1.5, law="optimal")
    assert "phase_plane.png" in {path.name for path in plots.save_figures(plan, tmp_path)}
    assert not [path for path in tmp_path.glob("*") if path.stat().st_size == 0]


# the figure of a fidelity study draws the errors that were measured, and the crossing


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
        assert tolerance.get_label() == f"tolerance {study.tolerance:g}"
        assert set(crossing.get_xdata()) == {study.highest.crossings[0].s}


@pytest.mark.parametrize(
    ("limit", "drawn", "words"),
    [
        (None, [], ""),
        ((0.25, 0.3), [0.25, 0.3], "(dashed: limits)"),
        ((0.25, 5.0), [0.25], "(dashed: limits; limits beyond: 5)"),
        ((5.0, np.inf), [], "(limits beyond: 5)"),
    ],
)
def test_limits_of_a_robustness_figure_are_drawn_or_told(limit, drawn, words):
    study = SimpleNamespace(
        controller="lqr",
        passed=np.array([True, True]),
        probability=1.0,
        tracking_error=np.array([1e-3, 2e-3]),
        peak_torque=np.array([[0.1, 0.2], [0.3, 0.1]]),
    )
    loop = SimpleNamespace(tolerance=1e-2, limit=limit)
    errors, torques = plot_robustness([study], loop=loop, length=0.5).figure.axes
    assert errors.get_legend_handles_labels()[1][-1] == "tolerance 0.01 (5 mm)"
    assert [line.get_xdata()[0] for line in torques.lines[1:]] == drawn
    assert torques.get_xlabel() == f"peak motor torque  [N m]\n{words}".rstrip()


def test_a_phase_plane_where_the_motors_cannot_even_hold_the_robot_gives_no_warning(
    crossing_plan, monkeypatch
):
    curves = limit_curves(crossing_plan)
    nowhere = curves._replace(highest_speed=np.full_like(curves.highest_speed, np.nan))
    monkeypatch.setattr(plots, "limit_curves", lambda _: nowhere)
    plot_phase_plane(crossing_plan)  # warnings are errors here


# maps: the locus of the 5R is where its rods are in line, by the geometry of the robot alone


def rods_in_line(x, y):
    """Sine of the angle between the rods of the 5R, elbows outward."""
    ends = []
    for motor, side in ((np.array([-0.2, 0.0]), 1.0), (np.array([0.2, 0.0]), -1.0)):
        way = np.array([x, y]) - motor
        half = np.linalg.norm(way) / 2
        across = side * np.sqrt(max(0.25**2 - half**2, 0.0)) * np.array([-way[1], way[0]]) / (2 * half)
        rod = np.array([x, y]) - (motor + way / 2 + across)
        ends.append(rod / np.linalg.norm(rod))
    return ends[0][0] * ends[1][1] - ends[0][1] * ends[1][0]


def test_the_locus_on_the_map_is_where_the_rods_are_in_line():
    robot = robots.load("five_bar")
    ax = plot_locus(robot, plan_scene(robot, "C"))
    drawn = [line.get_xydata() for line in ax.lines if line.get_color() == LOCUS]
    points = np.concatenate(drawn)
    points = points[np.isfinite(points).all(axis=1)]
    assert len(points) > 50
    assert max(abs(rods_in_line(*point)) for point in points) < 1e-6
    assert ax.get_xlabel() == "x  [m]"


def test_a_robot_without_a_plane_has_no_map():
    with pytest.raises(InvalidInput, match="two translations"):
        plot_locus(robots.load("gough_stewart"))
