"""What is decided at the reference once for all holds elsewhere, or the reference is refused.

A parallelogram that lies flat has lost one of its two loop equations, and one of its joints moves nothing.
What would be left out for good, if that were decided there, is needed elsewhere: the loop tears by 140 mm.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import robots
from framework import (
    InvalidInput,
    Law,
    Line,
    Mechanism,
    NoAnswer,
    NotAssembled,
    ParallelRobot,
    SingularReference,
    check_robot,
    inverse_dynamics,
    plan_crossing,
    simulate,
)
from framework.cli import main
from framework.kinematics import parallel_robot
from framework.kinematics.assembly import nearby_configurations
from framework.kinematics.diagnostics.mobility import BESIDE_SINGULARITY, motions_near_reference
from framework.kinematics.loop_structure import jacobians_apart
from framework.model.readers import read_any
from framework.model.robot_file_writer import write_robot_file
from tests.oracles.closure_rows import closure_errors, closure_rows, independent
from tests.oracles.forward_simulation import kinematics

FILE = Path(__file__).parents[1] / "data" / "flat_four_bar" / "flat_four_bar.urdf"
FLAT = read_any(FILE, platform="link2", axes=["y"], motors=["joint1"])
UP = Line([0.2], [0.3])
PARALLELOGRAM, CROSSED, BETWEEN = (1.0, -1.0, 1.0), (1.0, -3.0, -3.0), (1.0, -2.0, -1.0)  # near flat
CRANK = 0.5  # [m]
INERTIA = 2 * (0.031 + 1.5 * 0.25**2) + 3.0 * CRANK**2  # [kg m^2] of a parallelogram about its crank's axis


def mechanism(*angles: float) -> Mechanism:
    """The parallelogram with this reference, which nobody looks at."""
    reference = dict(zip(("joint1", "joint2", "joint3"), angles, strict=True))
    return Mechanism.from_description(replace(FLAT, reference=reference))


def four_bar(*angles: float) -> ParallelRobot:
    """The same, proved."""
    return ParallelRobot.of(mechanism(*angles))


def openings(robot: ParallelRobot, q: np.ndarray) -> np.ndarray:
    """How far all closures are open (T, rows), by the tests' own rows."""
    data, found = robot.model.createData(), []
    for row in q:
        kinematics(robot.model, data, row, np.zeros(robot.model.nv))
        found.append(closure_errors(robot.model, data, robot.description.closures))
    return np.array(found)


@pytest.mark.parametrize("way", [PARALLELOGRAM, CROSSED, BETWEEN], ids=["one", "other", "between"])
@pytest.mark.parametrize(
    "beside", [0.0, *(10.0**p for p in range(-16, -1, 3)), 1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-2]
)
def test_near_a_flat_pose_a_reference_is_refused_or_all_loops_stay_closed(way, beside):
    reference = beside * np.array(way)
    if beside <= 1e-6:
        with pytest.raises(SingularReference, match=r"loop\.x holds nothing"):
            four_bar(*reference)
        return
    try:
        robot = four_bar(*reference)
    except SingularReference:
        assert beside < 1e-5
        return
    plan = plan_crossing(robot, UP, duration=1.0)
    t = np.linspace(0.0, 1.0, 501)
    assert np.abs(openings(robot, plan.dynamics.configuration(t))).max() < 1e-14
    if way == PARALLELOGRAM:
        y, dy, ddy = (plan.platform(t, k)[:, 0] for k in range(3))  # y = CRANK sin(angle)
        cosine = np.sqrt(CRANK**2 - y**2)
        turned = ddy / cosine + y * dy**2 / cosine**3
        np.testing.assert_allclose(plan.torque(t)[:, 0], INERTIA * turned, rtol=0, atol=1e-12)


def test_the_refusal_names_rows_joints_and_poses_that_will_do():
    with pytest.raises(SingularReference) as caught:
        four_bar(0, 0, 0)
    error = caught.value
    assert (error.rows, error.joints) == (("loop.x",), ("joint3",))
    assert "joint3 moves nothing" in str(error)
    ways = set()
    for pose in error.poses:
        plan = plan_crossing(four_bar(*pose.values()), UP, duration=1.0)
        ways.add(bool(np.isclose(plan.dynamics.configuration(0.5)[0] @ [0, 1, 1], 0, atol=1e-12)))
        assert f"joint1: {pose['joint1']:.6g}" in str(error)
    assert ways == {True, False}  # one on either branch


def test_where_no_pose_nearby_will_do_one_apart_is_sought(monkeypatch):
    """As of a walking robot with four flat legs, of which steps at random free some only."""
    serves = ParallelRobot._serves
    far = staticmethod(lambda mechanism, pose: abs(pose["joint2"]) > 0.2 and serves(mechanism, pose))
    monkeypatch.setattr(ParallelRobot, "_serves", far)
    with pytest.raises(SingularReference, match="give a reference beside it") as caught:
        four_bar(0, 0, 0)
    (pose,) = caught.value.poses
    assert abs(pose["joint2"]) > 0.2
    robot = four_bar(*pose.values())
    assert np.abs(openings(robot, robot.reference.q[None])).max() < 1e-14


def test_check_says_so_and_describes_a_pose_beside():
    found = check_robot(mechanism(0, 0, 0))
    assert (found.mobility, found.rank, found.idle_joints) == (1, 2, ())
    assert "the reference is on a singularity of the loops" in found.advice[0]
    again = check_robot(mechanism(*found.reference.values()))  # what is printed may be pasted
    assert again.advice == found.advice[1:]
    assert again.mobility == 1


@pytest.mark.parametrize(("lower", "upper"), [(-0.2, 13.0), (-13.0, 0.05), (-0.2, 0.05)])
def test_the_pose_beside_is_within_the_ranges_of_the_joints(lower, upper):
    """The flat pose can be left upwards and downwards, on either branch."""
    first, rest = FLAT.urdf_text.split('lower="-13" upper="13"', 1)
    ranged = replace(FLAT, urdf_text=f'{first}lower="{lower}" upper="{upper}"{rest}')
    found = motions_near_reference(replace(ranged, reference=dict.fromkeys(FLAT.reference, 0.0)))
    assert lower < found.q[0] < upper
    assert BESIDE_SINGULARITY in found.remarks
    assert not any("ranges" in remark for remark in found.remarks)


def test_the_command_line_refuses_in_one_line(tmp_path, capsys):
    file = str(write_robot_file(FLAT, tmp_path / "robot"))
    path = ["--from", "0.2", "--to", "0.3", "--duration", "1"]
    assert main(["plan", file, *path]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "give a reference beside it, such as {joint1: " in err
    assert main(["check", file]) == 0
    assert "singularity of the loops" in capsys.readouterr().out


def test_a_path_through_the_flat_pose_is_refused():
    with pytest.raises(NoAnswer):
        plan_crossing(four_bar(0.3, -0.3, 0.3), Line([0.2], [-0.2]), duration=1.0)


@pytest.mark.parametrize("name", robots.CATALOGUE)
def test_the_rank_at_the_reference_is_that_nearby(name):
    """By the tests' own rows, at poses that the tests find closed."""
    robot = robots.load(name)
    model, closures = robot.model, robot.description.closures
    poses = (robot.reference.q, *nearby_configurations(robot, robot.reference.q))
    assert len(poses) > 1
    data = model.createData()
    for q in poses:
        kinematics(model, data, q, np.zeros(model.nv))
        assert np.abs(closure_errors(model, data, closures)).max() < 1e-11 * max(robot.length, 1.0)
        assert len(independent(closure_rows(model, data, closures).jacobian)) == len(
            robot.structure.independent
        )


@pytest.fixture
def unguarded(monkeypatch):
    """A parallelogram whose reference, 3e-9 rad from flat or less, nobody compares with other poses."""
    monkeypatch.setattr(parallel_robot, "refuse_singular_reference", lambda *_: None)
    monkeypatch.setattr(parallel_robot, "jacobians_apart", lambda *poses: jacobians_apart(*poses)[:1])
    return lambda beside: four_bar(*(beside * np.array(PARALLELOGRAM)))


@pytest.mark.parametrize("beside", [0.0, 1e-16, 1e-12, 3e-10])
def test_the_certificate_finds_the_equation_that_was_dropped(unguarded, beside):
    with pytest.raises(NotAssembled, match=r"loop\.x, .*, is open by 0\.1.* m at t = .* tears the loop"):
        inverse_dynamics(unguarded(beside), UP, Law.rest_to_rest(1.0, 2))


def test_the_simulator_watches_the_equation_that_was_dropped(unguarded):
    with pytest.raises(NotAssembled, match=r"tears a loop: loop\.x, .* open by .* at t = "):
        simulate(unguarded(0.0), lambda t: [1.0], duration=1.0)


def test_an_equation_that_springs_move_nearby_but_not_at_the_reference_is_found():
    """A crank that twists lifts the rod's end, unless the rod lies along it, as here at the reference."""
    five_bar = robots.load("five_bar").description
    twist = replace(
        next(spring for spring in five_bar.springs if spring.name == "left_rod"),
        name="twist",
        after="left_motor",
        motion=("rx",),
        stiffness=(1e4,),
    )
    stretched = {"left_motor": 0.0, "left_elbow": 0.0}  # both in one line, the tip at (0.3, 0)
    right = float(np.arccos((0.1**2) / (2 * 0.25 * 0.1)))
    stretched |= {"right_motor": right, "right_elbow": -(np.pi - 2 * np.arcsin(0.1 / 0.5))}
    robot = ParallelRobot.from_description(
        replace(five_bar, springs=(twist,), reference=stretched), flexibility="flexible_links"
    )
    assert robot.structure.spring_only_rows == ("tip.z",)
    with pytest.raises(InvalidInput, match=r"tip\.z can only be closed by springs"):
        simulate(robot, lambda t: [0.0, 0.0], duration=0.1)
