"""Changes of assembly mode around the cusps of a published 3-RPR."""

import mpmath as mp
import numpy as np
import pytest

import robots
from framework import InvalidInput, trace_locus
from framework.atlas.nonsingular_mode_change import find_mode_change
from framework.proofs.assembly_modes import assembly_modes
from framework.show.map import plot_motor_locus
from tests.proofs.test_assembly_modes import SIX
from tests.robots.test_three_rpr import CORNERS, PIVOTS, line_matrix


def open_by(lengths, turn):
    """What the platform's turn leaves open of the 3-RPR with its legs locked."""
    c, s = mp.cos(turn), mp.sin(turn)
    off = [(c * u - s * v - ax, s * u + c * v - ay) for (u, v), (ax, ay) in zip(CORNERS, PIVOTS, strict=True)]
    rows = mp.matrix([[2 * (off[i][k] - off[0][k]) for k in range(2)] for i in (1, 2)])
    square = [length**2 - a**2 - b**2 for length, (a, b) in zip(lengths, off, strict=True)]
    p = mp.lu_solve(rows, mp.matrix([square[i] - square[0] for i in (1, 2)]))
    return (p[0] + off[0][0]) ** 2 + (p[1] + off[0][1]) ** 2 - lengths[0] ** 2


@pytest.fixture(scope="module")
def locus():
    """The section of the joint space at the first leg's published length."""
    robot = robots.load("three_rpr")
    return trace_locus(robot, assembly_modes(robot, SIX).modes[0].q, free=("motor_2", "motor_3"), reach=2.5)


def cusps(locus):
    """The cusps with legs of positive length, each once: turned legs and negative lengths repeat them."""
    found = []
    for cusp in locus.cusps:
        if cusp.motors.min() > 0 and all(np.abs(cusp.motors - other.motors).max() > 1e-6 for other in found):
            found.append(cusp)
    return found


@pytest.mark.slow
def test_the_section_has_six_cusps_and_each_is_a_triple_root(locus):
    found = cusps(locus)
    assert len(found) == 6
    with mp.workdps(40):
        for cusp in found:
            lengths = [mp.mpf(float(length)) for length in cusp.motors]
            values = [abs(mp.diff(lambda t, m=lengths: open_by(m, t), float(cusp.x[2]), k)) for k in range(4)]
            assert max(values[:2]) < 1e-9
            assert values[2] < 1e-5 * values[3]  # the cusp is placed by a difference of g


@pytest.mark.slow
def test_around_each_cusp_the_assembly_mode_changes_without_a_singularity(locus):
    for cusp in cusps(locus):
        change = find_mode_change(locus, cusp)
        assert change is not None
        np.testing.assert_array_equal(change.motors[-1], change.motors[0])
        assert np.abs(change.x[-1] - change.x[0]).max() > 1e-2
        # by the lines of the three legs alone: their determinant keeps its sign, and is no smaller between
        signs = {np.sign(np.linalg.det(line_matrix(x))) for x in change.x}
        assert len(signs) == 1
        assert change.clearance > 1e-4
        # both ends are assembly modes of the same motors
        modes = assembly_modes(locus.robot, change.motors[0]).modes
        for x in (change.x[0], change.x[-1]):
            assert min(np.abs(np.exp(1j * mode.x) - np.exp(1j * x)).max() for mode in modes) < 1e-8


@pytest.mark.slow
def test_a_change_of_assembly_mode_is_drawn_around_its_cusp(locus):
    change = next(filter(None, (find_mode_change(locus, cusp) for cusp in cusps(locus))))
    ax = plot_motor_locus(locus, change)
    drawn = [line.get_xydata() for line in ax.lines]
    assert any(len(line) == len(change.motors) and np.allclose(line, change.motors[:, 1:]) for line in drawn)
    (low, high), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    assert low < change.cusp.motors[1] < high
    assert bottom < change.cusp.motors[2] < top
    assert ax.get_xlabel() == "motor_2  [m]"


def test_a_locus_over_the_workspace_has_no_motors_to_lead():
    robot = robots.load("five_bar")
    locus = trace_locus(robot, robot.reference.q, starts=4)
    with pytest.raises(InvalidInput, match="two motors"):
        find_mode_change(locus, None)
    with pytest.raises(InvalidInput, match="two motors"):
        plot_motor_locus(locus)
