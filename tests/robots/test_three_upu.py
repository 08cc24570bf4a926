"""The 3-UPU against closed forms.

Legs d_i = p + (r - R) e_i, rates of length u_i . v, constraint couples n_i.
"""

import numpy as np
import pytest

import robots
from framework import (
    Arc,
    Line,
    Spline,
    UncontrolledMotions,
    assemble,
    check_robot,
    locate_singularities,
    plan_crossing,
    track_path,
    velocity_matrices,
)
from framework.kinematics.frames import frames_at
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    linearised_at,
    passive_matrix,
)
from framework.model.description import FLEXIBILITIES
from framework.singularity.type2 import uncontrolled_motion, uncontrolled_space
from robots.generators import three_upu as generator

ROBOT = "three_upu"
SHIFT = 0.12 - 0.30  # [m] platform less base radius
ANGLES = 2 * np.pi / 3 * np.arange(3)
RADIAL = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(3)])
TANGENT = np.column_stack([-np.sin(ANGLES), np.cos(ANGLES), np.zeros(3)])
UP = np.array([0.0, 0.0, 1.0])
GRAVITY = 9.81
SCREW, ROTOR = 2 * np.pi / 0.005, 1e-5


def leg(p, i):
    """Vector from the base to the platform joint, its length, and the two angles at the base."""
    d = p + SHIFT * RADIAL[i]
    length = np.sqrt(d @ d)
    return d, length, np.arctan(-(d @ TANGENT[i]) / (d @ UP)), np.arcsin(d @ RADIAL[i] / length)


def joints(p):
    angles = {}
    for i in range(3):
        _, length, a, b = leg(p, i)
        angles |= {f"slide_{i + 1}": length, f"hip_{i + 1}a": a, f"hip_{i + 1}b": b}
    angles |= {f"wrist_{i}a": -angles[f"hip_{i}b"] for i in (1, 2, 3)}
    return angles | {"wrist_1b": -angles["hip_1a"]}


def mass_matrix(p):
    """M(p) of T = v' M v / 2; analytic in p, so that complex steps differentiate it to rounding."""
    M = 5.0 * np.eye(3) + 0j
    for i in range(3):
        d, length, _, b = leg(p, i)
        u = d / length
        turning = (np.eye(3) - np.outer(u, u)) / length  # du/dp
        y, z = d @ TANGENT[i], d @ UP
        da = (y * UP - z * TANGENT[i]) / (y**2 + z**2)
        spin = np.sin(b) * da  # about the leg itself: the first axis is not normal to it
        slide = (length - generator.ROD_CENTRE) * turning + np.outer(u, u)
        across = generator.TUBE * generator.TUBE_CENTRE**2
        across += float(generator.TUBE_INERTIA[0]) + float(generator.ROD_INERTIA[0])
        along = float(generator.TUBE_INERTIA[1]) + float(generator.ROD_INERTIA[1])
        M = M + across * turning.T @ turning + generator.ROD * slide.T @ slide + along * np.outer(spin, spin)
        M = M + ROTOR * SCREW**2 * np.outer(u, u)
    return M


def potential(p):
    V = 5.0 * p @ UP
    for i in range(3):
        d, length, _, _ = leg(p, i)
        height = d @ UP / length
        V = (
            V
            + (generator.TUBE * generator.TUBE_CENTRE + generator.ROD * (length - generator.ROD_CENTRE))
            * height
        )
    return GRAVITY * V


def motor_torques(p, v, a):
    """Lagrange for the platform's position, then virtual work on the screws."""
    steps = 1e-30j * np.eye(3)
    dM = np.array([mass_matrix(p + step).imag for step in steps]) / 1e-30  # (k, i, j)
    dV = np.array([potential(p + step).imag for step in steps]) / 1e-30
    force = mass_matrix(p).real @ a + np.einsum("kij,k,j->i", dM, v, v)
    force += dV - 0.5 * np.einsum("kij,i,j->k", dM, v, v)
    rates = np.array([leg(p, i)[0] / leg(p, i)[1] for i in range(3)])
    return np.linalg.solve(rates.T, force) / SCREW


def random_positions(count):
    rng = np.random.default_rng(1)
    return np.column_stack([rng.uniform(0.04, 0.14, (count, 2)), rng.uniform(0.5, 0.65, count)])


def linearised_of(robot, p) -> LinearisedLoops:
    """The robot where the closed form puts it, springs at rest."""
    q = np.zeros(robot.model.nq)
    for name, value in joints(p).items():
        q[robot.model.joints[robot.model.getJointId(name)].idx_q] = value
    return linearised_at(robot, q[None], np.array([p]))


def test_three_freedoms_and_no_redundant_row():
    found = check_robot(robots.load("three_upu"))
    assert (found.mobility, found.loop_equations, found.rank) == (3, 10, 10)


def test_joints_have_their_closed_forms_and_the_platform_stays_level(robot):
    for p in random_positions(6):
        q = assemble(robot, p).q
        found = {robot.coordinates.name_of(k): q[k] for k in range(robot.model.nv)}
        assert found == pytest.approx(joints(p), abs=1e-12)
        np.testing.assert_allclose(frames_at(robot, q[None]).rotation[0, 0], np.eye(3), atol=1e-12)
        A, B, _ = velocity_matrices(robot, q)
        rates = np.array([leg(p, i)[0] / leg(p, i)[1] for i in range(3)])
        np.testing.assert_allclose(np.linalg.solve(B, A), rates, atol=1e-11)


@pytest.mark.parametrize("flexibility", FLEXIBILITIES)
@pytest.mark.parametrize("height", [0.45, 0.6])
def test_the_symmetric_pose_is_a_constraint_singularity(height, flexibility):
    """Each leg resists a couple along n_i, normal to both axes of its universal joint: all vertical there."""
    p = np.array([0.0, 0.0, height])
    couples = np.array([leg(p, i)[0] - (leg(p, i)[0] @ RADIAL[i]) * RADIAL[i] for i in range(3)])
    assert np.linalg.matrix_rank(couples) == 1
    robot = robots.load("three_upu", flexibility=flexibility)
    linearised = linearised_of(robot, p)
    np.testing.assert_allclose(linearised.residual, 0, atol=1e-15)
    found = uncontrolled_motion(robot, linearised)
    assert (found.kind, found.corank) == ("constraint", 2)
    np.testing.assert_array_equal(found.twist, np.zeros(3))
    assert uncontrolled_space(robot, linearised).freedoms == 5
    # with the motors locked the platform turns about level axes only
    twist = linearised.frames.frame_jacobian(0)[0] @ found.motion
    assert np.linalg.norm(twist[3:5]) > 0.1
    assert twist[5] == pytest.approx(0.0, abs=1e-12)


def test_elsewhere_det_P_is_that_of_the_couples(robot):
    """det [n_1 n_2 n_3] = -(3 sqrt(3) / 8) z (x^2 + y^2): nothing but the axis of symmetry, no Type 2."""
    for p in random_positions(6):
        couples = np.array([leg(p, i)[0] - (leg(p, i)[0] @ RADIAL[i]) * RADIAL[i] for i in range(3)])
        expected = -3 * np.sqrt(3) / 8 * p[2] * (p[0] ** 2 + p[1] ** 2)
        assert np.linalg.det(couples) == pytest.approx(expected, rel=1e-12)
        legs = np.array([leg(p, i)[0] for i in range(3)])
        assert np.linalg.det(legs) == pytest.approx(3 * np.sqrt(3) / 2 * SHIFT**2 * p[2], rel=1e-12)
        assert np.linalg.svd(passive_matrix(robot, linearised_of(robot, p))[0], compute_uv=False)[-1] > 1e-3


START, END = np.array([0.12, 0.06, 0.55]), np.array([-0.08, -0.04, 0.62])  # through the axis at s = 0.6
SIDEWAYS = np.array([1.0, -2.0, 0.0]) / np.sqrt(5.0)  # normal to it


def around_the_axis(centre, radius, first, last):
    """An arc in the plane y = 0 about (centre, 0, 0.57), from angle to angle; s goes with the angle."""
    return Arc(
        *[
            [centre - radius * np.cos(turn), 0.0, 0.57 + radius * np.sin(turn)]
            for turn in (first, 0.5 * (first + last), last)
        ]
    )


@pytest.mark.parametrize("flexibility", FLEXIBILITIES)
def test_a_line_through_the_axis_meets_it_where_its_plan_view_does(flexibility):
    robot = robots.load("three_upu", flexibility=flexibility)
    (point,) = locate_singularities(robot, Line(START, END))
    assert point.s == pytest.approx(0.6, abs=1e-11)
    assert (point.kind, point.corank, point.contact) == ("constraint", 2, "transversal")
    np.testing.assert_array_equal(point.twist, np.zeros(3))
    q = {robot.coordinates.name_of(k): point.q[k] for k in range(robot.model.nv)}
    springs = {robot.coordinates.name_of(k): 0.0 for k in robot.elastic}
    assert q == pytest.approx(joints(np.array([0, 0, 0.592])) | springs, abs=1e-10)


@pytest.mark.parametrize("angle", [0.0, 0.5, 2.0, np.pi])
def test_lines_through_the_axis_in_any_direction_and_both_ways(robot, angle):
    way = np.array([np.cos(angle), np.sin(angle), 0.0])
    start, end = 0.1 * way + 0.55 * UP, -0.06 * way + 0.6 * UP
    (there,) = locate_singularities(robot, Line(start, end))
    (back,) = locate_singularities(robot, Line(end, start))
    assert there.s == pytest.approx(0.625, abs=1e-11)
    assert back.s == pytest.approx(0.375, abs=1e-11)
    for point in (there, back):
        assert (point.kind, point.corank, point.contact) == ("constraint", 2, "transversal")
    assert there.slope == pytest.approx(back.slope, rel=1e-6)


def test_the_slope_is_that_of_the_smallest_singular_value(robot):
    path, h = Line(START, END), 1e-5
    (point,) = locate_singularities(robot, path)
    for side in (-h, h):
        P = passive_matrix(robot, linearised_of(robot, path(point.s + side)))[0]
        assert np.linalg.svd(P, compute_uv=False)[-1] / h == pytest.approx(point.slope, rel=1e-3)


def test_an_arc_meets_the_axis_twice_or_touches_it(robot):
    meets = np.arccos(0.06 / 0.08)
    points = locate_singularities(robot, around_the_axis(0.06, 0.08, -1.2, 1.0))
    assert [point.contact for point in points] == ["transversal"] * 2
    expected = [(1.2 + turn) / 2.2 for turn in (-meets, meets)]
    np.testing.assert_allclose([point.s for point in points], expected, rtol=0, atol=1e-11)
    (point,) = locate_singularities(robot, around_the_axis(0.08, 0.08, -1.2, 1.0))
    assert point.s == pytest.approx(1.2 / 2.2, abs=1e-8)
    assert (point.kind, point.corank, point.contact) == ("constraint", 2, "tangential")


def test_a_spline_through_the_axis_meets_it_in_its_knot(robot):
    path = Spline([START, [0.05, 0.04, 0.56], [0, 0, 0.58], [-0.05, 0.01, 0.6], END])
    (point,) = locate_singularities(robot, path)
    np.testing.assert_allclose(path(point.s)[:2], 0.0, atol=1e-9)
    assert (point.kind, point.corank, point.contact) == ("constraint", 2, "transversal")


@pytest.mark.parametrize("distance", [5e-5, -5e-5, 1e-6])
def test_a_path_beside_the_axis_meets_nothing_and_has_lagrange_s_torques(robot, distance):
    path = Line(START + distance * SIDEWAYS, END + distance * SIDEWAYS)
    assert locate_singularities(robot, path) == ()
    assert locate_singularities(robot, Line(path(1.0), path(0.0))) == ()
    plan = plan_crossing(robot, path, duration=1.0)
    assert plan.crossings == ()
    for t in np.linspace(0.0, 1.0, 11):
        expected = motor_torques(plan.platform(t), plan.platform(t, 1), plan.platform(t, 2))
        np.testing.assert_allclose(plan.torque(t), expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("way", [1, -1])
def test_a_path_1e_8_m_beside_the_axis_meets_it(robot, way):
    """Nearer than what counts as moving: 1e-7 of a unit motion."""
    ends = (START + 1e-8 * SIDEWAYS, END + 1e-8 * SIDEWAYS)[::way]
    (point,) = locate_singularities(robot, Line(*ends))
    assert point.s == pytest.approx(0.6 if way > 0 else 0.4, abs=1e-7)  # the path is 0.2 m long
    assert (point.kind, point.corank) == ("constraint", 2)


def test_the_track_keeps_the_platform_level_beside_the_axis(robot):
    """Branches with the platform turned cross there; the track takes none of them."""
    s = np.linspace(0.0, 1.0, 41)
    for distance in (0.0, 1e-7, 1e-5, 1e-3):
        branch = track_path(robot, Line(START + distance * SIDEWAYS, END + distance * SIDEWAYS))
        for knot, pose in zip(branch.s, branch.guess(branch.s), strict=True):
            q = {robot.coordinates.name_of(k): pose[k] for k in range(robot.model.nv)}
            assert q == pytest.approx(joints(branch.path(knot)), abs=1e-10)
        assert np.abs(branch.guess(s)).max() < 1.0


@pytest.mark.parametrize("times", [None, [], [0.6]])
def test_no_law_leads_through_the_axis(robot, times):
    with pytest.raises(
        UncontrolledMotions, match=r"two uncontrolled motions at once at s = 0\.6, .* constraint"
    ) as e:
        plan_crossing(robot, Line(START, END), duration=1.0, times=times)
    assert (e.value.count, e.value.s) == (2, pytest.approx(0.6, abs=1e-11))


def test_a_path_that_starts_on_the_axis_is_refused_and_not_as_type_1(robot):
    with pytest.raises(UncontrolledMotions, match="two uncontrolled motions at once") as caught:
        locate_singularities(robot, Line([0, 0, 0.6], START))
    np.testing.assert_allclose(caught.value.platform, [0, 0, 0.6], atol=1e-6)
