"""All singular poses in boxes: for the 5R and the biglide against the closed forms of their curves."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import robots
from framework import InvalidInput, ParallelRobot, pave_singularities
from framework.proofs.regular_ball import prove_regular_ball

MILLIMETRE = 1e-3
LEFT, RIGHT, LENGTH = np.array([-0.2, 0.0]), np.array([0.2, 0.0]), 0.25  # motors and links of the 5R
TURN = np.linspace(0.0, 2 * np.pi, 20001)
CIRCLE = np.stack([np.cos(TURN), np.sin(TURN)], axis=1)


def rods_in_line():
    """Middles of a bar of two rods between both elbows, for all angles of the left crank."""
    elbow = LEFT + LENGTH * CIRCLE
    way = RIGHT - elbow
    distance = np.linalg.norm(way, axis=1)
    along = (distance**2 + 3 * LENGTH**2) / (2 * distance)  # to the foot of the right elbow
    elbow, way, distance, along = (part[along < 2 * LENGTH] for part in (elbow, way, distance, along))
    across = np.sqrt(4 * LENGTH**2 - along**2)
    unit = way / distance[:, None]
    normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    return np.concatenate(
        [elbow + 0.5 * (along[:, None] * unit + side * across[:, None] * normal) for side in (1, -1)]
    )


def elbows_together():
    """The circles on which the tip goes round while both elbows are in one place."""
    height = np.sqrt(LENGTH**2 - RIGHT[0] ** 2)
    return np.concatenate([np.array([0.0, side * height]) + LENGTH * CIRCLE for side in (1, -1)])


def leg_stretched_or_folded(motor, other):
    """Twice a link from one motor, within reach of the other; and the motor itself."""
    circle = motor + 2 * LENGTH * CIRCLE
    return np.concatenate([circle[np.linalg.norm(circle - other, axis=1) <= 2 * LENGTH], motor[None]])


def check_against(closed_form, found):
    """Every point of the closed form lies in a box, and every box within a millimetre of such a point."""
    assert found.complete
    assert (2 * found.x_radii <= MILLIMETRE).all()
    assert cKDTree(closed_form).query(found.x)[0].max() <= MILLIMETRE
    near = cKDTree(found.x).query(closed_form, k=min(64, len(found.x)))[1]
    inside = (np.abs(found.x[near] - closed_form[:, None]) <= found.x_radii[near]).all(axis=2)
    assert inside.any(axis=1).all()


@pytest.mark.slow
def test_the_singular_poses_of_the_5r_are_its_curves_and_no_others():
    paved = pave_singularities(robots.load("five_bar"))
    type_2, *type_1 = paved.sets
    check_against(np.concatenate([rods_in_line(), elbows_together()]), type_2)
    for found, motor, other in zip(type_1, (LEFT, RIGHT), (RIGHT, LEFT), strict=True):
        check_against(leg_stretched_or_folded(motor, other), found)
    assert paved.complete
    assert "no box undecided" in paved.sentence


HALF, ROD = 0.2, 0.2 * np.sqrt(2)  # of the biglide: rails at x = -0.2 and 0.2, rods


def test_the_singular_poses_of_the_biglide_are_three_lines():
    """Rods in line: the tip half-way between the rails. A rod square to its rail: a rod's length from it."""
    window = np.array([[-0.2, -0.05], [0.2, 0.05]])
    paved = pave_singularities(robots.load("biglide"), window=window)
    assert paved.complete
    y = np.linspace(-0.05, 0.05, 401)
    for found, x in zip(paved.sets, (0.0, ROD - HALF, HALF - ROD), strict=True):
        inside = (np.abs(found.x[:, 0] - x) <= found.x_radii[:, 0]).all()
        covered = (np.abs(found.x[:, 1] - y[:, None]) <= found.x_radii[:, 1]).any(axis=1)
        assert inside
        assert covered.all()
        assert (2 * found.x_radii <= MILLIMETRE).all()


CRANK, CONNECTING_ROD, OFFSET = 0.04, 0.12, -0.02  # of the slider-crank, see its robot file


def test_the_dead_centres_of_a_slider_crank_are_all_of_its_singular_poses():
    """The slide drives the crank: it cannot where crank and rod are in line, stretched or folded."""
    type_2, *others = pave_singularities(robots.load("slider_crank"), reach=3.0).sets
    assert type_2.complete
    assert all(one.complete and not len(one.x) for one in others)
    sines = OFFSET / (CRANK + CONNECTING_ROD), OFFSET / (CRANK - CONNECTING_ROD)
    centres = np.array([angle for sine in sines for angle in (np.arcsin(sine), np.pi - np.arcsin(sine))])
    off = np.mod(type_2.x - centres + np.pi, 2 * np.pi) - np.pi  # (B, 4)
    inside = np.abs(off) <= type_2.x_radii
    assert inside.any(axis=0).all()
    assert inside.any(axis=1).all()


def test_a_near_miss_is_proved_free():
    """Ten micrometres beside the line of singular poses the robot is proved to be regular, in all modes."""
    robot = robots.load("biglide")
    beside = np.array([[1e-5, -1e-4], [2e-4, 1e-4]])
    paved = pave_singularities(robot, window=beside)
    assert paved.complete
    assert not any(len(one.x) for one in paved.sets)
    on_the_line = pave_singularities(robot, window=beside - [2e-5, 0.0])
    assert [len(one.x) > 0 for one in on_the_line.sets] == [True, False, False]


def test_where_closed_poses_bifurcate_nothing_is_called_decided():
    """Two parallelograms in a row: a flat pose goes on in several ways, on no smooth curve."""
    paved = pave_singularities(robots.load("n_four_bar"), max_boxes=500)
    assert not paved.complete
    assert "undecided" in paved.sentence


@pytest.mark.parametrize(
    ("name", "options", "told"),
    [
        ("three_rpr", {}, "one or two freedoms"),
        ("two_arms", {}, "one or two freedoms"),
        ("five_bar", {"resolution": 0.0}, "resolution"),
        ("five_bar", {"resolution": "fine"}, "resolution"),
        ("five_bar", {"max_boxes": 0.5}, "max_boxes"),
        ("five_bar", {"window": [[0.0, 0.0], [0.0, 1.0]]}, "window"),
    ],
)
def test_what_cannot_be_paved_is_refused(name, options, told):
    with pytest.raises(InvalidInput, match=told):
        pave_singularities(robots.load(name), **options)


@pytest.mark.parametrize("window", [(0.0, 6.2831), (-3.2, 0.0)])
def test_a_window_has_an_angle_on_every_turn(window):
    """The dead centres of the slider crank: rod and crank in line, slider on either side."""
    crank, rod, offset = 0.04, 0.12, -0.02
    sines = np.array([offset / (crank + rod), offset / (crank - rod)])
    angles = np.concatenate([np.arcsin(sines), np.pi - np.arcsin(sines)])
    there = (np.mod(angles - window[0], 2 * np.pi) < window[1] - window[0]).sum()
    paved = pave_singularities(robots.load("slider_crank"), reach=3.0, window=np.array(window)[:, None])
    assert paved.complete
    assert len(paved.sets[0].x) == there
    assert "in the window" in paved.sentence


def test_a_ball_that_moves_is_refused_and_no_margin_is_proved(tmp_path):
    """The 5R with a ball for an elbow, whose spin is idle: its columns do not turn one after the other."""
    entry = robots.CATALOGUE["five_bar"].file
    hinge = '<joint name="right_elbow" type="revolute">'
    tree = entry.with_suffix(".urdf").read_text()
    assert hinge in tree
    tree = tree.replace(hinge, hinge.replace("revolute", "spherical"))
    (tmp_path / "five_bar.urdf").write_text(tree)
    file = tmp_path / "five_bar.yaml"
    file.write_text(entry.read_text().replace("right_elbow: ", "right_elbow_rz: "))
    robot = ParallelRobot.from_file(file)
    with pytest.raises(InvalidInput, match="right_elbow"):
        pave_singularities(robot)
    assert prove_regular_ball(robot, robot.reference.q, robot.reference.x, 0.1) == 0.0
