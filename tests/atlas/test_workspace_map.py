"""Maps: held pose by pose against the geometry of the 5R, and the same whatever computes them."""

import csv
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import robots
from framework import InvalidInput, OutOfReach, ParallelRobot, assemble
from framework.atlas.map_files import map_document, setup_document, write_map
from framework.atlas.quantities import choose_quantities
from framework.atlas.survey import (
    MAX_NEIGHBOUR_DISTANCE,
    Window,
    _assemble_seeds,
    map_axes,
    map_point,
    survey_window,
)
from framework.atlas.sweep import STEP_PARTS, PoseReason, fill_grid, step_poses
from framework.atlas.workspace_map import MAX_COARSE_STRIDE, _coarse_stride, workspace_map
from framework.dynamics.loading import LOAD_WORDS, LoadReason
from framework.kinematics import inverse_kinematics
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import linearised_at
from framework.model.description import JointDynamics
from framework.numerics.kept import KeptChunks
from framework.show.map import NOT_TRACED, map_page, plot_map
from framework.singularity.traced_locus import TracedLocus
from tests.oracles import five_bar_pose
from tests.urdf_edits import parametric_five_bar

ROBOT = "five_bar"
KEYS = ("g", "conditioning", "torque", "stiffness", "frequency")


def window(robot, size, lower=(-0.32, -0.5), upper=(0.33, 0.5)):
    return Window(map_axes(robot), np.array(lower), np.array(upper), (size, size), robot.reference.x)


@cache
def five_bar_map(flexibility="flexible_links", size=41):
    robot = robots.load("five_bar", flexibility=flexibility)
    return workspace_map(robot, window(robot, size))


def test_every_pose_of_the_5r_has_the_values_of_its_geometry():
    found = five_bar_map()
    assert set(found.values) == set(KEYS)
    at = five_bar_pose.pose(found.window.points()[found.reached])
    values = {key: found.values[key][found.reached] for key in KEYS}
    signs = np.sign(at.sine)
    same = np.sign(values["g"]) == signs * np.sign(values["g"][0]) * signs[0]
    assert same[np.abs(at.sine) > 1e-9].all()
    np.testing.assert_allclose(values["torque"], five_bar_pose.worst_torque(at), rtol=1e-7)
    K = np.linalg.eigvalsh(five_bar_pose.stiffness(at, rods=True))
    np.testing.assert_allclose(values["stiffness"], K[:, 0], rtol=1e-7, atol=1e-9 * K.max())
    squares = (2 * np.pi * values["frequency"]) ** 2
    np.testing.assert_allclose(squares, K[:, 0] / five_bar_pose.PAYLOAD, rtol=1e-7, atol=1e-10 * K.max())


@pytest.mark.parametrize("enough", [1, 2, 9])
def test_as_many_seeds_are_assembled_as_are_enough_and_can_be(robot, enough):
    x = robot.reference.x + 0.01 * np.array([[[0.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [100.0, 0.0]]])
    q, reason = np.zeros((2, 2, len(robot.reference.q))), np.full((2, 2), PoseReason.NO_NEIGHBOUR)
    count = _assemble_seeds(robot, x, q, reason, np.argwhere(np.ones((2, 2))), enough=enough)
    assert count == np.sum(reason == PoseReason.REACHED) == min(enough, 3)  # one is out of reach


@pytest.mark.parametrize("size", [5, 9, 30, 70, 300])
def test_coarse_poses_are_as_far_apart_as_neighbours_may_be_and_no_farther(size):
    robot = robots.load("five_bar")
    seen = window(robot, size)
    stride, edge = _coarse_stride(robot, seen), seen.cell.max() / robot.length
    assert stride == 1 or stride * edge <= MAX_NEIGHBOUR_DISTANCE
    assert stride == MAX_COARSE_STRIDE or 2 * stride * edge > MAX_NEIGHBOUR_DISTANCE


def test_one_motor_with_a_torque_limit_is_enough_to_ask_what_the_motors_hold():
    description = robots.load("five_bar").description
    first, second = description.actuators
    limited = replace(description, actuators=(first, replace(second, torque_limit=2.0)))
    g, holding = choose_quantities(ParallelRobot.from_description(limited), ["holding"])
    assert (g.key, holding.key) == ("g", "holding")
    with pytest.raises(InvalidInput, match="holding"):
        choose_quantities(robots.load("five_bar"), ["holding"])


def test_what_is_reached_is_the_workspace_and_no_elbow_has_turned_over():
    found = five_bar_map()
    x = found.window.points().reshape(-1, 2)
    inside = five_bar_pose.reachable(x)
    cell = found.window.cell.max()
    folded = np.linalg.norm(x[:, None] - five_bar_pose.BASES, axis=2).min(axis=1) < cell
    reached = found.reached.ravel()
    assert not reached[inside < 0].any()
    assert reached[(inside > cell) & ~folded].all()
    q = found.q.reshape(-1, found.q.shape[-1])[reached]
    at = five_bar_pose.pose(x[reached])
    for leg, name in enumerate(("left_motor", "right_motor")):
        column = found.robot.actuator_names.index(name)
        angle = q[:, found.robot.actuated[column]]
        crank = five_bar_pose.LENGTH * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        np.testing.assert_allclose(crank, at.crank[:, leg], rtol=0, atol=1e-7)


def test_a_pose_beyond_the_legs_is_out_of_reach_and_one_on_another_island_is_not_joined(tmp_path):
    """With cranks of 0.6 and rods of 0.25 m the rings that the legs reach meet above and below the motors."""
    robot = ParallelRobot.from_file(parametric_five_bar(tmp_path), parameters={"l1": 0.6, "l2": 0.25})
    done = [0]
    at = window(robot, 61, (-0.4, -0.95), (0.4, 0.95))
    found = workspace_map(robot, at, ["g"], progress=done.append)
    assert len(done) > 2  # bands
    assert sorted(done) == done
    assert done[-1] == 61**2  # poses
    x = found.window.points()
    far = np.linalg.norm(x[:, :, None] - five_bar_pose.BASES, axis=3)
    inside = np.minimum(0.85 - far.max(axis=2), far.min(axis=2) - 0.35)
    cell = found.window.cell.max()
    above = x[..., 1] > 0.0
    assert (found.reason[inside < 0] == PoseReason.OPEN).all()
    assert (found.reason[(inside > cell) & above] == PoseReason.REACHED).all()
    assert (found.reason[(inside > cell) & ~above] == PoseReason.NO_NEIGHBOUR).all()
    assert ((inside > cell) & ~above).sum() > 100


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["biglide", "delta", "five_bar", "humanoid_ankle", "orthoglide", "three_rrr"]
)
def test_no_random_start_closes_the_loops_at_a_pose_out_of_reach(name):
    """10^4 poses: in other working modes the loops close from some start, out of reach from none."""
    robot, random = robots.load(name), np.random.default_rng(0)
    found = workspace_map(robot, survey_window(robot, size=100), ["g"])
    x, reached = found.window.points(), found.q[found.reached]
    for reason, closable in ((PoseReason.OPEN, False), (PoseReason.OTHER_MODE, True)):
        at = np.argwhere(found.reason == reason)
        at = at[random.permutation(len(at))[:300]]
        closed = np.zeros(len(at), dtype=bool)
        for _ in range(12):
            start = reached[random.integers(len(reached), size=len(at))]
            aside = random.standard_normal((len(at), robot.model.nv)) * robot.column_scale
            aside *= random.integers(0, 2, (len(at), 1))
            closed |= close_each(robot, x[at[:, 0], at[:, 1]], integrate(robot, start, aside)).closed
        assert (closed == closable).all(), reason.name


@pytest.mark.slow
def test_other_working_modes_are_searched_from_random_starts_too():
    """From the nearest reached configuration alone the two arms reach two poses in another mode."""
    robot = robots.load("two_arms")
    found = workspace_map(robot, survey_window(robot, size=21), ["g"])
    closable = (found.reason == PoseReason.OTHER_MODE) | (found.reason == PoseReason.NO_NEIGHBOUR)
    assert closable.sum() >= 8


def test_the_window_of_a_map_is_about_all_that_the_5r_reaches(robot):
    found = survey_window(robot)
    x = replace(found, lower=np.array([-0.5, -0.5]), upper=np.array([0.5, 0.5])).points().reshape(-1, 2)
    reached = x[five_bar_pose.reachable(x) > 0]
    assert (found.lower < reached.min(axis=0)).all()
    assert (found.upper > reached.max(axis=0)).all()
    assert ((found.upper - found.lower) < 1.2 * np.ptp(reached, axis=0)).all()


@pytest.mark.parametrize(
    "name",
    [
        "delta",
        "three_rrr",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("orthoglide", "par4", "two_arms")),
    ],
)
def test_a_pose_that_is_followed_from_the_reference_is_in_the_window_of_a_map(name):
    """Straight lines from the reference, followed as plans follow them until they end."""
    robot = robots.load(name)
    found = survey_window(robot)
    axes, random = list(found.axes), np.random.default_rng(1)
    for _ in range(5):
        direction = np.zeros(robot.n)
        direction[axes] = random.standard_normal(2)
        direction /= np.linalg.norm(direction)
        with pytest.raises(OutOfReach) as caught:
            assemble(robot, robot.reference.x + 2.0 * robot.length * direction)
        last = caught.value.platform[axes]
        assert ((found.lower < last) & (last < found.upper)).all()
        nearly = robot.reference.x + 0.99 * (caught.value.platform - robot.reference.x)
        np.testing.assert_allclose(assemble(robot, nearly).x, nearly, atol=1e-9)  # so far it is reached


@pytest.mark.slow
def test_a_map_says_at_which_edges_of_its_window_more_may_be_reached():
    robot = robots.load("biglide")  # its slides have no end
    assert workspace_map(robot, survey_window(robot, size=9), ["g"]).open_edges == ("least y", "largest y")
    assert five_bar_map("rigid").open_edges == ()


@pytest.mark.parametrize("size", [9, 61])
def test_the_locus_on_a_map_is_where_the_rods_are_in_line_however_coarse_the_map(size):
    found = five_bar_map("rigid", size)
    assert len(found.locus.curves) == 3
    for curve in found.locus.curves:
        inside = five_bar_pose.reachable(curve.x) > 1e-6  # beyond: the elbows' own end, to rounding
        at = five_bar_pose.pose(curve.x[inside])  # of the map's working mode
        assert inside.sum() > 20
        assert np.abs(at.sine).max() < 1e-9
    assert not len(found.locus.unexplained)
    assert found.locus.sign_changes > size


@pytest.mark.parametrize(("centre", "half"), [((0.1746, -0.0263), 0.0557), ((-0.0628, -0.0978), 0.1957)])
def test_a_curve_that_passes_one_cell_beside_another_one_is_drawn(robot, centre, half):
    """Wherever rods become aligned within the window, on a grid a hundred times as fine as the map."""
    centre = np.array(centre)
    found = workspace_map(robot, window(robot, 4, centre - half, centre + half), ["g"])
    fine = window(robot, 301, centre - half, centre + half).points()
    with np.errstate(invalid="ignore"):  # some lie beyond the reach
        sine = five_bar_pose.pose(fine.reshape(-1, 2)).sine.reshape(301, 301)
    changes = np.argwhere(sine[1:] * sine[:-1] < 0)
    aligned = fine[tuple(changes.T)]  # (k, 2), each within a fine cell of the locus
    points = [np.linspace(curve.x[:-1], curve.x[1:], 30).reshape(-1, 2) for curve in found.locus.curves]
    offsets = (aligned[:, None] - np.concatenate(points)) / found.window.cell
    assert len(aligned) > 100
    assert np.abs(offsets).max(axis=2).min(axis=1).max() < 0.05


def test_the_self_motions_of_the_orthoglide_are_one_curve():
    """Where all legs coincide they turn about one point, a quarter of a circle: two motions are uncontrolled.

    g vanishes there with its slope, and the third leg is at Type 1 all along.
    """
    robot = robots.load("orthoglide")
    at = Window((0, 1), np.array([-0.33, -0.33]), np.array([0.04, 0.04]), (8, 8), robot.reference.x)
    found = workspace_map(robot, at, ["g"])
    (curve,) = [curve for curve in found.locus.curves if curve.kind == "self_motion"]
    leg = robot.reference.q[robot.actuated[0]]  # at the reference each leg is along its own axis
    np.testing.assert_allclose(np.linalg.norm(curve.x, axis=1), leg, rtol=1e-9)
    np.testing.assert_allclose(robot.actuated_coordinates(curve.q), 0.0, atol=1e-7)
    ends = np.sort(np.degrees(np.arctan2(*curve.x[[0, -1]].T[::-1])))
    np.testing.assert_allclose(ends, [-180.0, -90.0], atol=2.0)  # the last step may be missing


def test_a_window_much_smaller_than_the_robot_has_a_smooth_locus(robot):
    centre = np.array([0.0, np.sqrt(0.06)])  # on the locus
    found = workspace_map(robot, window(robot, 9, centre - 2e-3, centre + 2e-3), ["g"])
    (curve,) = found.locus.curves
    middle = 0.5 * (curve.x[1:] + curve.x[:-1])  # a chord leaves the curve by less than is seen
    assert np.abs(five_bar_pose.pose(middle).sine).max() < 1e-4


def test_a_sign_of_g_that_no_curve_explains_is_told(robot, monkeypatch):
    module = "framework.singularity.locus_on_map"
    monkeypatch.setattr(f"{module}.trace_locus", lambda *given, **more: TracedLocus(robot, ("x", "y"), (), 0))
    found = workspace_map(robot, window(robot, 13), ["g"])
    assert len(found.locus.unexplained) == found.locus.sign_changes > 0
    assert f"at {found.locus.sign_changes} no curve passes" in map_document(found)["locus"]["status"]


def test_where_no_locus_can_be_traced_a_map_says_why(tmp_path):
    robot = robots.load("two_arms")
    axes = list(map_axes(robot))
    at = Window(
        map_axes(robot),
        *(robot.reference.x[axes] + side * 0.02 for side in (-1, 1)),
        (3, 3),
        robot.reference.x,
    )
    found = workspace_map(robot, at, ["g"])
    locus = map_document(found)["locus"]
    assert (locus["traced"], locus["curves"]) == (False, 0)
    assert "one motor for each freedom" in locus["status"]
    assert NOT_TRACED in [text.get_text() for text in plot_map(found).figure.legends[0].get_texts()]
    assert "one motor for each freedom" in map_page(found)


def test_no_step_goes_through_a_folded_leg(robot):
    """Straight across the motor's place, where the leg has no length and may come out on either side."""
    start, end = np.array([[-0.2, 0.03]]), np.array([[-0.2, -0.03]])
    step = step_poses(robot, assemble(robot, start[0]).q[None], start, end)
    assert step.reason[0] in (PoseReason.OPEN, PoseReason.OTHER_MODE)


def test_a_kept_band_of_another_map_is_not_taken(robot, tmp_path):
    at = window(robot, 20)
    small, large = (choose_quantities(robot, keys) for keys in (["g"], None))
    places = {
        KeptChunks.of(tmp_path, setup_document(robot, one, keys)).folder
        for one in (at, window(robot, 21))
        for keys in (small, large)
    }
    assert len(places) == 4


@pytest.mark.parametrize(
    ("name", "keys", "told"),
    [
        ("five_bar", ["g", "stiffness"], "no springs"),
        ("five_bar", ["gravity"], "unknown quantity"),
        ("agile_eye", ["torque"], "only turns"),
    ],
)
def test_a_quantity_that_a_robot_has_not_is_refused(name, keys, told):
    with pytest.raises(InvalidInput, match=told):
        choose_quantities(robots.load(name), keys)


def test_where_a_load_is_not_carried_a_map_says_so_everywhere(tmp_path):
    robot = robots.load("five_bar", flexibility="flexible_links")
    at = window(robot, 5, (-0.02, 0.2), (0.02, 0.36))
    found = workspace_map(robot, at, ["loaded_stiffness"], wrench=[0.0, -300.0])
    lost = found.load != LoadReason.CARRIED
    assert 0 < lost.sum() < lost.size == found.reached.sum()
    np.testing.assert_array_equal(np.isnan(found.values["loaded_stiffness"]), lost)
    document = map_document(found)
    assert document["wrench"] == (0.0, -300.0)
    assert document["load"][LOAD_WORDS[LoadReason.GIVES_WAY]] == (found.load == LoadReason.GIVES_WAY).sum()
    write_map(found, tmp_path)
    words = [row["load"] for row in csv.DictReader((tmp_path / "map.csv").read_text().splitlines())]
    assert words == [LOAD_WORDS[LoadReason(int(kind))] for kind in found.load.flat]
    legend = [text.get_text() for text in plot_map(found, "loaded_stiffness").figure.legends[0].get_texts()]
    assert f"load not carried: {lost.sum()} poses" in legend
    assert f"load not carried: {lost.sum()} poses" in map_page(found)
    no_load = workspace_map(robot, at, ["stiffness"])
    assert no_load.load is None
    with pytest.raises(InvalidInput, match="wrench: affects only holding, loaded_stiffness"):
        workspace_map(robot, at, ["stiffness"], wrench=[0.0, 1.0])


@pytest.mark.parametrize("quantity", ["stiffness", "loaded_stiffness", "loaded_frequency"])
def test_a_platform_that_springs_leave_rigid_has_no_stiffness_anywhere(quantity):
    """The motors of the 5R hold all joints, so its elbow's spring gives way to nothing."""
    joints = {"left_elbow": JointDynamics(stiffness=2.0)}
    robot = ParallelRobot.from_description(replace(robots.load("five_bar").description, joints=joints))
    found = workspace_map(robot, window(robot, 3, (-0.02, 0.3), (0.02, 0.36)), [quantity])
    assert found.reached.all()
    assert np.isnan(found.values[quantity]).all()


@pytest.mark.parametrize("turned", [0.0, 2.0])
def test_the_stroke_of_a_slider_crank_ends_its_hold_at_the_dead_centres(turned):
    """Crank and rod are on one line at both, wherever the reference lies on the turn."""
    robot = robots.load("slider_crank")
    reference = assemble(robot, robot.reference.x + turned)
    moved = replace(robot.description, reference=robot.reference_values(reference.q))
    found = workspace_map(ParallelRobot.from_description(moved))
    assert found.values["g"].shape == (200, 1)
    assert found.reached.all()  # the crank turns fully
    assert found.open_edges == ()
    outer, inner = (
        np.arcsin(-0.02 / 0.16),
        -np.pi - np.arcsin(0.02 / 0.08),
    )  # of crank 40, rod 120, offset -20 mm
    located = np.array([curve.x[0, 0] for curve in found.locus.curves])
    for angle in (outer, inner):
        gap = (located - angle + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(gap).min() < 1e-10
    assert [curve.kind for curve in found.locus.curves] == ["type_2", "type_2"]
    assert "2 points located" in found.locus.sentence


def test_the_stroke_of_the_knee_ends_where_crank_and_rod_no_longer_reach():
    """The default window holds all that is reached, though it is more than half a turn to one side."""
    found = workspace_map(robots.load("humanoid_knee"))
    assert found.open_edges == ()
    angles = found.window.spans[0][found.reached[:, 0]]
    below, above = (assemble(found.robot, [angle]) for angle in (angles[0], angles[-1]))
    for end, step in ((below, -0.1), (above, 0.1)):  # beyond both ends no step leads on
        q = step_poses(found.robot, end.q[None], end.x[None], end.x[None] + step).reason
        assert q[0] != PoseReason.REACHED
    assert np.isfinite(found.values["conditioning"][found.reached]).all()


def test_the_axes_of_a_map_are_two_or_the_only_one():
    assert map_axes(robots.load("four_bar")) == (0,)
    with pytest.raises(InvalidInput, match="rz alone"):
        map_axes(robots.load("four_bar"), ("x", "y"))
    with pytest.raises(InvalidInput, match="two of x, y"):
        map_axes(robots.load("five_bar"), ("x", "x"))
    with pytest.raises(InvalidInput, match="at"):
        map_point(robots.load("five_bar"), [1.0])


# poses that are neighbours on a map are neighbours of one branch, whichever way each was reached


CATALOGUE = (
    *("delta", "gough_stewart", "three_rrr", "three_rpr", "agile_eye", "par4", "orthoglide", "three_upu"),
    *("biglide", "spherical_rrr", "five_bar_heavy", "two_arms", "standing_quadruped"),
)


def pairs(found):
    """Steps between all neighbours that are both reached: where they should lead, and where they do."""
    robot, x, q, reached = found.robot, found.window.points(), found.q, found.reached
    for one, other in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        both = reached[one] & reached[other]
        yield q[other][both], step_poses(robot, q[one][both], x[one][both], x[other][both], STEP_PARTS)


def turns_apart(robot, one, two):
    """Largest difference (T,) of joints, whole turns of hinges left out."""
    apart = one - two
    apart = np.where(robot.sliding, apart / robot.length, np.mod(apart + np.pi, 2 * np.pi) - np.pi)
    return np.abs(apart).max(axis=1)


@pytest.mark.parametrize(
    ("name", "size"),
    [("five_bar", 21), *(pytest.param(name, 32, marks=pytest.mark.slow) for name in CATALOGUE)],
)
def test_a_step_between_neighbours_leads_from_the_one_to_the_other(name, size):
    robot = robots.load(name)
    window = survey_window(robot, size=size)
    found = workspace_map(robot, window, ["g"])
    asked = refused = 0
    for expected, step in pairs(found):
        told = step.reason == PoseReason.REACHED
        asked, refused = asked + len(told), refused + int(np.sum(~told))
        assert turns_apart(robot, expected[told], step.q[told]).max() < 1e-5
    assert asked > size**2 / 2
    assert refused < 1.5 * size  # beside a stretched leg, on the rim, no single step is trusted


@pytest.mark.parametrize(
    "point",
    [
        (0.292, 0.03),
        *(pytest.param(x, marks=pytest.mark.slow) for x in ((0.1, 0.345), (0.15, -0.34), (0, 0.457))),
    ],
)
def test_the_default_window_holds_all_of_the_workspace_wherever_the_reference_is(point):
    """The tip of the 5R is at most two links, 0.5 m, from both motors, at (-0.2, 0) and (0.2, 0)."""
    reference = {}
    for name, motor, side in (("left", -0.2, 1), ("right", 0.2, -1)):  # elbows outward
        way = np.array(point) - (motor, 0.0)
        bend = np.arccos(np.linalg.norm(way) / 0.5)
        reference[f"{name}_motor"] = np.arctan2(way[1], way[0]) + side * bend
        reference[f"{name}_elbow"] = -2 * side * bend
    robot, centre = (
        ParallelRobot.from_file(robots.CATALOGUE["five_bar"].file, reference=reference),
        np.array(point),
    )
    found, sought = survey_window(robot), 1.6 * robot.length
    corner = np.array([0.3, np.sqrt(0.5**2 - 0.2**2)])
    assert (found.lower <= np.maximum(-corner, centre - sought) + 1e-9).all()
    assert (found.upper >= np.minimum(corner, centre + sought) - 1e-9).all()
    assert (found.upper - found.lower < 2 * corner + 0.1).all()


def test_a_pose_between_two_closes_by_one_newton_step(monkeypatch):
    """Cubic guesses leave 1e-6 at cells of 0.016 robot lengths: most poses are linearised twice."""
    robot = robots.load("gough_stewart")
    reach = 0.3 * robot.length
    x = robot.reference.x
    window = Window((0, 1), x[:2] - reach, x[:2] + reach, (41, 41), x)
    counted, whole = [], inverse_kinematics.linearised_at

    def counting(robot, q, *rest):
        counted.append(len(q))
        return whole(robot, q, *rest)

    monkeypatch.setattr(inverse_kinematics, "linearised_at", counting)
    found = workspace_map(robot, window, ["g"])
    assert found.reached.all()
    assert sum(counted) < 2.5 * found.reached.size
    monkeypatch.undo()
    gaps = linearised_at(robot, found.q.reshape(-1, robot.model.nq), window.points().reshape(-1, robot.n))
    assert np.abs(gaps.residual).max() < 1e-12 * robot.length


def test_part_of_a_turn_may_go_on_at_both_ends_and_poses_are_counted_once():
    robot = robots.load("slider_crank")
    middle = robot.reference.x
    found = workspace_map(robot, Window((0,), middle - 0.4, middle + 0.5, (7, 1), middle), ["g"])
    axis = robot.axis_names[0]
    assert found.open_edges == (f"least {axis}", f"largest {axis}")
    assert found.counts == dict.fromkeys(found.reason_words, 0) | {found.reason_words[0]: 7}
    locus = map_document(found)["locus"]
    assert locus["traced"] is True


def test_of_poses_that_are_not_reached_only_those_beside_reached_ones_have_been_tried(robot):
    """Up from the reference of the 5R until both legs are too short."""
    x = robot.reference.x + np.outer(0.03 * np.arange(9), [0.0, 1.0])
    q, reason = np.full((9, 1, robot.model.nq), np.nan), np.full((9, 1), PoseReason.NO_NEIGHBOUR)
    q[0, 0], reason[0, 0] = robot.reference.q, PoseReason.REACHED
    fill_grid(robot, x[:, None], q, reason, [1])
    inside = int((five_bar_pose.reachable(x) > 0.0).sum())
    assert 0 < inside < 8
    assert (reason[:inside] == PoseReason.REACHED).all()
    assert reason[inside, 0] == PoseReason.OPEN  # it has been tried, and its loops do not close
    assert (reason[inside + 1 :] == PoseReason.NO_NEIGHBOUR).all()
