"""Real displacements of rods against published numbers and closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from framework.proofs.homotopy import find_real_solutions
from framework.proofs.study_quadric import (
    planar_displacements,
    spatial_displacements,
    translation_displacements,
)
from tests.proofs.rods import rod

# P. Dietmaier, "The Stewart-Gough platform of general geometry can have 40 real postures", ARK 1998, table 1
BASE = np.array(
    [
        [0, 0, 0],
        [1.107915, 0, 0],
        [0.549094, 0.756063, 0],
        [0.735077, -0.223935, 0.525991],
        [0.514188, -0.526063, -0.368418],
        [0.590473, 0.094733, -0.205018],
    ]
)
PLATFORM = np.array(
    [
        [0, 0, 0],
        [0.542805, 0, 0],
        [0.956919, -0.528915, 0],
        [0.665885, -0.353482, 1.402538],
        [0.478359, 1.158742, 0.107672],
        [-0.137087, -0.235121, 0.353913],
    ]
)
LENGTHS = np.array([1, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071])


def conditions(base, platform, lengths):
    return np.array([rod(a, b, length) for a, b, length in zip(base, platform, lengths, strict=True)])


def lengths_at(R, p, base, platform):
    return np.linalg.norm(platform @ R.swapaxes(-1, -2) + p[..., None, :] - base, axis=-1)


def test_the_forty_real_poses_of_dietmaiers_platform_are_found_and_proved_complete():
    found = find_real_solutions(spatial_displacements(), conditions(BASE, PLATFORM, LENGTHS))
    assert (len(found.R), found.status) == (40, "proved")
    assert found.proved.all()
    np.testing.assert_allclose(
        lengths_at(found.R, found.p, BASE, PLATFORM), np.tile(LENGTHS, (40, 1)), atol=1e-12
    )
    apart = np.linalg.norm(found.p[:, None] - found.p, axis=2) + np.linalg.norm(
        found.R[:, None] - found.R, axis=(2, 3)
    )
    assert apart[~np.eye(40, dtype=bool)].min() > 1e-4


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 10))])
def test_a_random_platform_has_the_pose_that_it_was_built_in_among_its_forty(seed):
    rng = np.random.default_rng(seed)
    base, platform = rng.standard_normal((2, 6, 3))
    R, p = Rotation.random(random_state=seed).as_matrix(), rng.standard_normal(3)
    found = find_real_solutions(
        spatial_displacements(), conditions(base, platform, lengths_at(R, p, base, platform))
    )
    assert found.status == "proved"
    assert (found.count.finite, found.count.lost) == (40, 0)
    assert len(found.R) % 2 == 0  # the others are pairs
    assert (np.abs(found.R - R).max(axis=(1, 2)) + np.abs(found.p - p).max(axis=1)).min() < 1e-9


def on_circle(radius, *degrees):
    return radius * np.array([[np.cos(a), np.sin(a), 0.0] for a in np.radians(degrees)])


TRIANGLE = on_circle(1.0, 90, 210, 330)
MIDDLES = 0.5 * (TRIANGLE + np.roll(TRIANGLE, -1, axis=0))
# base, platform, and how many poses their complex solutions are, whatever the legs
COUNTS = {
    # six legs between two triangles: eight pairs, mirrored at the base (Nanua, Waldron and Murthy, IEEE
    # Trans. Robotics and Automation 6, 1990; Griffis and Duffy, J. Robotic Systems 6, 1989)
    "octahedron": (on_circle(1, 0, 0, 120, 120, 240, 240), on_circle(0.6, -60, 60, 60, 180, 180, 300), 16),
    # the same on six points of the base (Innocenti and Parenti-Castelli, Mechanism and Machine Theory 25,
    # 1990)
    "6-3": (on_circle(1, -17, 17, 103, 137, 223, 257), on_circle(0.6, -60, 60, 60, 180, 180, 300), 16),
}


@pytest.mark.parametrize("name", COUNTS)
def test_platforms_on_triangles_have_the_published_number_of_poses(name):
    base, platform, number = COUNTS[name]
    R, p = Rotation.random(random_state=0).as_matrix(), np.array([0.3, -0.4, 0.8])
    found = find_real_solutions(
        spatial_displacements(), conditions(base, platform, lengths_at(R, p, base, platform))
    )
    assert (found.count.finite, found.count.infinite, found.count.lost) == (number, 40 - number, 0)
    assert found.status == "numerically complete"
    assert (np.abs(found.R - R).max(axis=(1, 2)) + np.abs(found.p - p).max(axis=1)).min() < 1e-8
    mirror = np.diag([1.0, 1.0, -1.0])  # base and platform are plane: a pose and its image at the base
    for turn, place in zip(found.R, found.p, strict=True):
        off = np.abs(found.R - mirror @ turn @ mirror).max(axis=(1, 2)) + np.abs(
            found.p - mirror @ place
        ).max(axis=1)
        assert off.min() < 1e-8


@pytest.mark.parametrize(
    ("base", "platform"),
    [
        # vertices to middles of sides: M. Griffis and J. Duffy, US patent 5 179 525, 1993; its self-motions:
        # Husty and Karger, ICRA 2000
        (
            np.stack([TRIANGLE, MIDDLES], axis=1).reshape(6, 3),
            0.5 * np.stack([np.roll(MIDDLES, 1, axis=0), TRIANGLE], axis=1).reshape(6, 3),
        ),
        (on_circle(1.0, 0, 60, 120, 180, 240, 300), on_circle(0.6, 0, 60, 120, 180, 240, 300)),
    ],
    ids=["Griffis-Duffy", "similar hexagons"],
)
def test_architecturally_singular_platforms_are_named_so_and_nothing_is_counted(base, platform):
    R, p = Rotation.from_rotvec([0.2, -0.1, 0.4]).as_matrix(), np.array([0.1, -0.2, 1.0])
    legs = p + platform @ R.T - base
    lines = np.concatenate([legs, np.cross(base, legs)], axis=1)
    assert np.linalg.matrix_rank(lines, tol=1e-12) == 5  # the lines of the legs depend on one another
    found = find_real_solutions(
        spatial_displacements(), conditions(base, platform, np.linalg.norm(legs, axis=1))
    )
    assert (found.status, len(found.R)) == ("architecturally singular", 0)


def similar(ratio):
    """A base and a platform, three points each in the plane as complex numbers, of one shape."""
    base = np.array([0.0, 1.0, 0.3 + 1.1j])
    return base, ratio * base


def planar_rods(base, platform, lengths):
    """Conditions of rods in the plane z = 0, whose points are complex numbers: R_22 = R_11, R_12 = -R_21."""
    flat = [np.stack([points.real, points.imag, 0 * points.real], axis=1) for points in (base, platform)]
    rows = conditions(*flat, lengths)
    rows[:, 8] += rows[:, 12]
    rows[:, 11] -= rows[:, 9]
    return rows[:, planar_displacements(2).chosen]


def test_a_similar_3_rpr_has_the_four_poses_of_its_closed_form():
    """p + (k e^ia - 1) a_i = p + w a_i has length l_i: with a_1 = 0, two conditions linear in w conj(p) and
    |w|^2, and |w conj(p)|^2 = l_1^2 |w|^2: a quadratic in |w|^2 = 1 + k^2 - 2 k cos a. Special architectures:
    Gosselin and Merlet, Mechanism and Machine Theory 29(8), 1994.
    """
    ratio, turn, p = 0.5, np.exp(0.7j), 0.2 + 0.3j
    base, platform = similar(ratio)
    lengths = np.abs(p + turn * platform - base)
    found = find_real_solutions(planar_displacements(2), planar_rods(base, platform, lengths))
    assert (found.count.finite, found.count.infinite, found.status) == (4, 2, "numerically complete")
    # u = u0 + u1 |w|^2 of |p|^2 + |w|^2 |a|^2 + 2 Re(u a) = l^2
    of_u = 2 * np.stack([base[1:].real, -base[1:].imag], axis=1)
    u0 = np.linalg.solve(of_u, lengths[1:] ** 2 - lengths[0] ** 2)
    u1 = np.linalg.solve(of_u, -(np.abs(base[1:]) ** 2))
    squares = np.roots([u1 @ u1, 2 * u0 @ u1 - lengths[0] ** 2, u0 @ u0])
    cosines = (1 + ratio**2 - squares.real) / (2 * ratio)
    angles = [sign * np.arccos(c) for c in cosines[np.abs(cosines) < 1] for sign in (1, -1)]
    exact = sorted(complex(np.exp(1j * angle)).imag for angle in angles)
    np.testing.assert_allclose(sorted(found.R[:, 1, 0]), exact, atol=1e-12)


def test_conditions_have_the_same_poses_whatever_they_are_multiplied_by():
    base, platform = np.array([0.0, 1.0, 0.3 + 1.1j]), np.array([0.0, 0.6, 0.4 + 0.3j])
    p, turn = 0.3 + 0.4j, np.exp(0.5j)
    rows = planar_rods(base, platform, np.abs(p + turn * platform - base))
    for factors in ([1.0, 1.0, 1.0], [1e7, 1.0, 1e-7]):
        found = find_real_solutions(planar_displacements(2), rows * np.reshape(factors, (3, 1)))
        assert found.status == "proved"
        there = found.p[:, 0] + 1j * found.p[:, 1]
        assert np.abs(there - p).min() < 1e-9


def test_a_pose_in_which_two_meet_is_not_counted_as_single():
    base = np.array([0.0, 1.0, 0.3 + 1.1j])
    through = 0.4 + 0.3j  # the lines of all legs pass it: Type 2
    platform = through + (base - through) * np.array([0.5, 0.3, 0.6])
    found = find_real_solutions(planar_displacements(2), planar_rods(base, platform, np.abs(base - platform)))
    assert found.status == "at least"
    assert found.count.multiple > 0
    assert (found.count.infinite, found.count.lost) == (0, 6 - found.count.finite - found.count.multiple)


def test_circles_about_one_point_have_no_single_pose():
    rows = np.array([rod(np.zeros(3), np.zeros(3), length) for length in (1.0, 0.5)])
    found = find_real_solutions(
        translation_displacements((0, 1)), rows[:, translation_displacements((0, 1)).chosen]
    )
    assert found.status == "architecturally singular"
