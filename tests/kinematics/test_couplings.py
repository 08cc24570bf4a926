"""Couplings of joints, linear ones and polynomials, against closed forms."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

import robots
from framework import (
    ControlCycle,
    InvalidInput,
    Line,
    OutOfReach,
    ParallelRobot,
    RobotFileError,
    assemble,
    dynamics_at,
    dynamics_derivatives,
    locate_singularities,
    plan_crossing,
    simulate,
)
from framework.files.mjcf import mjcf_text
from framework.kinematics.couplings import coupling_derivatives, coupling_jacobian
from framework.kinematics.linearised_loops import linearised_at
from framework.model import read_robot_file
from framework.model.description import Coupling, lock_couplings
from framework.model.robot_file_writer import write_robot_file
from framework.proofs.derivative_bounds import DerivativeBounds
from tests.robots.transformed import in_other_units

LENGTH, ARM, ROD = 0.2, (1.0, 0.1, 0.01), (2.0, 0.15, 0.02)  # [m]; mass [kg], lever [m], inertia [kg m^2]
GEAR, ROTOR, WEIGHT, DAMPING, ARMATURE = 3.0, 1e-3, 9.81, 0.3, 0.5

_BODY = (
    '<inertial><origin xyz="{1} 0 0"/><mass value="{0}"/>'
    '<inertia ixx="{2}" iyy="{2}" izz="{2}" ixy="0" ixz="0" iyz="0"/></inertial>'
)
URDF = f"""<robot name="cardan"><link name="base"/><link name="arm">{_BODY.format(*ARM)}</link>
<link name="rod">{_BODY.format(*ROD)}</link><link name="tip"/>
<joint name="a" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
<joint name="b" type="continuous"><parent link="arm"/><child link="rod"/><origin xyz="{LENGTH} 0 0"/>
<axis xyz="0 0 1"/></joint>
<joint name="end" type="fixed"><parent link="rod"/><child link="tip"/><origin xyz="{LENGTH} 0 0"/></joint>
</robot>"""
YAML = f"""version: 1
urdf: cardan.urdf
gravity: [0, -{WEIGHT}, 0]
platform: {{frame: tip, axes: [x]}}
actuators: [{{joint: a, gear_ratio: {GEAR}, rotor_inertia: {ROTOR}}}]
couplings: [{{joint: b, of: a, ratio: -2, offset: 0.0}}]
joints: {{b: {{damping: {DAMPING}, armature: {ARMATURE}}}}}
reference: {{a: 0.7}}
"""


def cardan_in(folder: Path) -> ParallelRobot:
    """Two equal links with a gear b = -2 a: the tip moves along x, x = 2 LENGTH cos(a)."""
    (folder / "cardan.urdf").write_text(URDF, encoding="utf-8")
    (folder / "cardan.yaml").write_text(YAML, encoding="utf-8")
    return ParallelRobot.from_file(folder / "cardan.yaml")


@pytest.fixture
def cardan(tmp_path) -> ParallelRobot:
    return cardan_in(tmp_path)


def torque(a: float, da: float, dda: float) -> float:
    """Motor torque [N m] by Lagrange: the arm turns by a, the rod by a + b = -a about its own centre."""
    (m1, l1, i1), (m2, l2, i2) = ARM, ROD
    # centre of the rod: LENGTH (cos a, sin a) + l2 (cos a, -sin a)
    along, across = LENGTH + l2, LENGTH - l2  # x = along cos a, y = across sin a
    inertia = m1 * l1**2 + i1 + i2 + m2 * (along**2 * np.sin(a) ** 2 + across**2 * np.cos(a) ** 2)
    inertia += 4.0 * ARMATURE + GEAR**2 * ROTOR
    slope = m2 * (along**2 - across**2) * np.sin(2 * a)  # of the inertia
    weight = WEIGHT * (m1 * l1 + m2 * across) * np.cos(a)
    return float((inertia * dda + 0.5 * slope * da**2 + weight + 4.0 * DAMPING * da) / GEAR)


@pytest.mark.slow
def test_torques_are_those_of_lagrange_and_the_robot_follows(cardan):
    plan = plan_crossing(cardan, Line([0.3], [0.2]), duration=1.0)
    times = np.linspace(0.1, 0.9, 5)
    for t in times:
        a, da, dda = (float(plan.motor_angle(t, order)[0]) / GEAR for order in range(3))
        assert 2 * LENGTH * np.cos(a) == pytest.approx(float(plan.platform(t)[0]), rel=1e-12)
        assert float(plan.torque(t)[0]) == pytest.approx(torque(a, da, dda), rel=1e-9)
    assert simulate(cardan, plan).tracking_error < 1e-10
    np.testing.assert_allclose(
        simulate(cardan, plan, method="fast", step=1e-3).q[:, 1],
        -2.0 * simulate(cardan, plan, method="fast", step=1e-3).q[:, 0],
        atol=1e-9,
    )


def test_the_coupling_gives_what_the_second_joint_needs(cardan):
    """About joint b alone: the rod's own equation, with the torque of the coupling ON b."""
    q = assemble(cardan, [0.3]).q
    instant = dynamics_at(cardan, q, dx=[0.1], ddx=[1.0])
    (m2, l2, i2), (a, b) = ROD, q
    (da, db), (dda, ddb) = instant.v, instant.a
    # the rod's centre accelerates with its hinge and about it; moments about the hinge
    hinge = LENGTH * np.array([-np.sin(a) * dda - np.cos(a) * da**2, np.cos(a) * dda - np.sin(a) * da**2]) + [
        0.0,
        WEIGHT,
    ]
    across = np.array([-np.sin(a + b), np.cos(a + b)])
    moment = (i2 + m2 * l2**2) * (dda + ddb) + m2 * l2 * (across @ hinge)
    assert instant.coupling_torques["b_of_a"] == pytest.approx(
        moment + ARMATURE * ddb + DAMPING * db, rel=1e-9
    )


def test_derivatives_of_coupled_loops_are_those_of_differences():
    description = replace(
        robots.load("five_bar").description, couplings=(Coupling("right_motor", "left_elbow", 0.7, 1.2),)
    )
    robot = robots.load("five_bar")
    rows = type(robot).__mro__[1].from_description(description).rows
    assert rows.names[-1] == "right_motor_of_left_elbow.q"
    q = robot.reference.q[None]
    columns = [robot.coordinates.names.index(name) for name in ("right_motor", "left_elbow")]
    residual = q[0, columns[0]] - 0.7 * q[0, columns[1]] - 1.2
    assert coupling_derivatives(rows, q, 0)[0, 0] == pytest.approx(residual)
    np.testing.assert_allclose(coupling_jacobian(rows, q, 4)[0, -1, columns], [1.0, -0.7])


def test_a_table_of_rows_is_the_parts_in_which_it_was_taken():
    rows = robots.load("delta").rows
    count = len(rows.names)
    for first in (0, 2, count):
        joined = rows.take(np.arange(first)).append(rows.take(np.arange(first, count)))
        for field in fields(rows):
            np.testing.assert_array_equal(getattr(joined, field.name), getattr(rows, field.name))


@pytest.mark.parametrize("size", [1.0, 1e-9])
def test_a_redundant_coupling_is_named_and_has_no_torque_at_any_size(cardan, size):
    same = Coupling("a", "b", -0.5)
    twice = replace(cardan.description, couplings=(*cardan.description.couplings, same))
    robot = ParallelRobot.from_description(in_other_units(twice, length=size))
    assert len(robot.rows.names) == 2
    assert len(robot.structure.independent) == 1
    assert np.isnan(dynamics_at(robot, robot.reference.q).coupling_torques["a_of_b"])
    assert linearised_at(robot, robot.reference.q[None], None).gap[0] < 1e-12


def test_a_path_ends_where_the_gear_turns_the_tip_back(cardan):
    """x = 2 LENGTH cos(a) is at most 2 LENGTH."""
    with pytest.raises(OutOfReach, match="leaves the workspace"):
        locate_singularities(cardan, Line([0.3], [0.41]))


def test_mjcf_has_the_coupling_and_proofs_refuse_it(cardan):
    text = mjcf_text(cardan)
    assert '<joint name="b_of_a" joint1="b" joint2="a" polycoef="0.0 -2.0 0.0 0.0 0.0"' in text
    assert 'damping="0.3"' in text
    with pytest.raises(InvalidInput, match="couplings of joints"):
        DerivativeBounds.of(cardan)


def test_couplings_are_written_and_read_again(cardan, tmp_path):
    read = read_robot_file(write_robot_file(cardan.description, tmp_path / "out"))
    assert read.couplings == cardan.description.couplings
    assert read.closures == ()


@pytest.mark.parametrize(
    ("coupling", "message"),
    [
        (
            {"joint": "left_motor", "of": "left_motor"},
            "couplings[0].of: needs another joint than 'left_motor'",
        ),
        ({"joint": "left_motor", "of": "tip"}, "couplings[0].of: unknown joint 'tip'"),
        ({"joint": "left_motor"}, "couplings[0].of: missing"),
    ],
)
def test_what_couples_nothing_is_refused(write_robot, coupling, message):
    with pytest.raises(RobotFileError) as raised:
        read_robot_file(write_robot(("couplings", [coupling])))
    assert message in str(raised.value)


BENT_URDF = f"""<robot name="bent"><link name="base"/><link name="arm">{_BODY.format(*ARM)}</link>
<link name="rod">{_BODY.format(*ROD)}</link><link name="head">{_BODY.format(0.7, 0.05, 0.004)}</link>
<joint name="a" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
<joint name="b" type="continuous"><parent link="arm"/><child link="rod"/><origin xyz="{LENGTH} 0 0"/>
<axis xyz="0 0 1"/></joint>
<joint name="c" type="prismatic"><parent link="rod"/><child link="head"/><axis xyz="1 0.5 0.2"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
BENT_YAML = f"""version: 1
urdf: bent.urdf
gravity: [0, -{WEIGHT}, 0]
platform: {{joints: [a, b]}}
actuators: [{{joint: a}}, {{joint: c}}]
couplings:
- joint: c
  of: a
  ratio: 0.3
  offset: 0.1
  terms: {{b: -0.2, a*a: 0.4, a*b: 0.25, b*b*b: -0.15}}
"""


@pytest.fixture
def bent(tmp_path) -> ParallelRobot:
    """Return a chain whose slide c follows its hinges a and b: c = f(a, b), motors on a and c."""
    (tmp_path / "bent.urdf").write_text(BENT_URDF, encoding="utf-8")
    (tmp_path / "bent.yaml").write_text(BENT_YAML, encoding="utf-8")
    return ParallelRobot.from_file(tmp_path / "bent.yaml")


def bent_motion(x, dx, ddx):
    """Joint positions, rates and accelerations (3,) each, and dq/dx (3, 2), by hand."""
    a, b = x
    c = 0.1 + 0.3 * a - 0.2 * b + 0.4 * a**2 + 0.25 * a * b - 0.15 * b**3
    slopes = np.array([0.3 + 0.8 * a + 0.25 * b, -0.2 + 0.25 * a - 0.45 * b**2])
    bends = np.array([[0.8, 0.25], [0.25, -0.9 * b]])
    G = np.vstack([np.eye(2), slopes])
    return np.append(x, c), G @ dx, np.append(ddx, slopes @ ddx + dx @ bends @ dx), G


def bent_torque(robot, x, dx, ddx):
    """Torques of the motors a and c by the principle of virtual work on the open tree."""
    q, v, a, G = bent_motion(x, dx, ddx)
    forces = pin.rnea(robot.model, robot.model.createData(), q, v, a)
    return np.linalg.solve(G[[0, 2]].T, G.T @ forces)


STATE = (np.array([0.4, -0.7]), np.array([0.9, 1.3]), np.array([-2.0, 3.0]))


def test_torques_and_their_derivatives_follow_a_polynomial_of_two_joints(bent):
    x, dx, ddx = STATE
    q = assemble(bent, x).q
    np.testing.assert_allclose(q, bent_motion(*STATE)[0], atol=1e-14)
    instant = dynamics_at(bent, q, dx=dx, ddx=ddx)
    np.testing.assert_allclose(instant.torque, bent_torque(bent, *STATE), rtol=1e-12)
    derivatives = dynamics_derivatives(bent, q, dx=dx, ddx=ddx)
    for k, slope in enumerate((derivatives.torque_x, derivatives.torque_dx, derivatives.torque_ddx)):
        for j, step in enumerate(1e-5 * np.eye(2)):
            ends = [[*STATE[:k], STATE[k] + sign * step, *STATE[k + 1 :]] for sign in (1, -1)]
            high, low = (bent_torque(bent, *end) for end in ends)
            np.testing.assert_allclose(slope[:, j], (high - low) / 2e-5, atol=1e-8)


def test_the_robot_and_its_controller_follow_a_polynomial(bent):
    plan = plan_crossing(bent, Line([0.3, 0.1], [0.5, -0.2]), duration=1.0)
    for t in (0.2, 0.7):
        expected = bent_torque(bent, *(plan.platform(t, order) for order in range(3)))
        np.testing.assert_allclose(plan.torque(t), expected, rtol=1e-9)
    assert simulate(bent, plan).tracking_error < 1e-9
    q, v, a, _ = bent_motion(*STATE)
    cycle = ControlCycle(bent, near=q)
    cycle.update(q[[0, 2]], v[[0, 2]])
    np.testing.assert_allclose(cycle.torque(a[[0, 2]]), bent_torque(bent, *STATE), rtol=1e-9)


def test_mujoco_has_no_equality_for_a_product_of_joints(bent):
    with pytest.raises(InvalidInput, match=r"no equality for coupling 'c_of_a' of c, a, b \(valid"):
        mjcf_text(bent)


def test_a_polynomial_is_written_and_read_again(bent, tmp_path):
    read = read_robot_file(write_robot_file(bent.description, tmp_path / "out"))
    assert read.couplings == bent.description.couplings


def test_locked_joints_leave_the_polynomial_of_the_others(bent):
    (coupling,) = bent.description.couplings
    # c = 0.1 + 0.3 a - 0.4 + 0.4 a^2 + 0.5 a - 1.2 at b = 2
    (left,), positions = lock_couplings([coupling], {"b": 2.0})
    assert (left.joint, left.of, left.terms, positions) == ("c", "a", ((("a", "a"), 0.4),), {})
    assert (left.ratio, left.offset) == (pytest.approx(0.8), pytest.approx(-1.5))
    assert lock_couplings([coupling], {"a": 1.0, "b": 2.0}) == ([], {"c": pytest.approx(-0.3)})
    with pytest.raises(RobotFileError, match="no unique solution where c is locked: lock a and b"):
        lock_couplings([coupling], {"c": 0.0})
    assert lock_couplings([Coupling("c", "a", 2.0, 0.5)], {"c": 1.5}) == ([], {"a": 0.5})


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        ({"b*d": 1.0}, "couplings[0].terms.b*d: unknown joint 'd'"),
        ({"a": 1.0}, "couplings[0].terms.a: the factor of 'a' alone is the key `ratio`"),
        ({"b*c": 1.0}, "couplings[0].terms.b*c: needs other joints than 'c'"),
        ({"a*b": 1.0, "b * a": 2.0}, "couplings[0].terms.b * a: stands twice"),
        ({"a*a*a*b*b": 1.0}, "couplings[0].terms.a*a*a*b*b: at most 4 joints are multiplied"),
    ],
)
def test_terms_that_mean_nothing_are_refused(bent, tmp_path, terms, message):
    content = {**yaml.safe_load(BENT_YAML), "couplings": [{"joint": "c", "of": "a", "terms": terms}]}
    (tmp_path / "bent.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(RobotFileError) as raised:
        read_robot_file(tmp_path / "bent.yaml")
    assert message in str(raised.value)


def test_coefficients_whose_powers_overflow_are_refused():
    for ratio, terms in ((1e308, ()), (2.0, ((("b", "b"), -1e308),))):
        with pytest.raises(RobotFileError, match="coupling a_of_b: coefficients must be at most"):
            Coupling("a", "b", ratio, terms=terms)
