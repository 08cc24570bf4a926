"""A closed pose is found where Newton's method from the reference finds none, within the joints' limits.

Closed is judged by pinocchio's frame placements alone.
"""

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import Mechanism, NotAssembled, ParallelRobot, check_robot, load_robot
from framework.cli import main
from framework.kinematics.assembly_search import find_closed_pose
from tests.kinematics.linkages import ball, frame, joint, linkage
from tests.oracles.placements import placements

# arms, half rods and the second pivot [m]: a spatial four-bar whose rod is cut in its middle, both halves on
# balls and welded to each other. At zero the halves stand anywhere, and have to turn to fit each other
HALVES = {
    "skew": ((-0.1, 0, 0), (0, 0.1, 0), (0, 0.15, 0), (0, 0.15, 0), (0.3, 0.05, 0.02)),
    "raised": ((0, 0, -0.1), (-0.1, 0, 0), (0, 0.15, 0), (0, 0.15, 0), (0.3, 0, 0)),
    "upright": ((0, -0.1, 0), (0, 0.1, 0), (0, 0, 0.15), (0, 0, 0.15), (0.3, 0.05, 0.02)),
}
TURNED_OVER = ((0.1, 0, 0), (0, 0.1, 0), (0, -0.15, 0), (0, 0, 0.15), (0.3, 0, 0))


def halves(shape, side="", limit=""):
    arm_1, arm_2, half_1, half_2, pivot = shape
    kind = "revolute" if limit else "continuous"
    return (
        joint(f"{side}crank", "base", (0, 0, 0), kind=kind, limit=limit)
        + ball(f"{side}one", f"{side}crank_link", arm_1)
        + frame(f"{side}end_1", f"{side}one_z_link", half_1)
        + joint(f"{side}rocker", "base", pivot)
        + ball(f"{side}two", f"{side}rocker_link", arm_2)
        + frame(f"{side}end_2", f"{side}two_z_link", half_2, (np.pi, 0, 0))
    )


def can_close(shape):
    """Whether the rod's length, from ball to ball, lies between the least and the most that arms allow."""
    arm_1, arm_2, half_1, half_2, pivot = np.array(shape, dtype=float)
    rod = np.linalg.norm(half_1 - half_2 * [1, -1, -1])  # the second half is welded on turned about x
    angles = np.linspace(0.0, 2 * np.pi, 181)
    tips = [arm[:1] * np.cos(angles) - arm[1:2] * np.sin(angles) for arm in (arm_1, arm_2)]
    across = [arm[:1] * np.sin(angles) + arm[1:2] * np.cos(angles) for arm in (arm_1, arm_2)]
    x = pivot[0] + tips[1][None] - tips[0][:, None]
    y = pivot[1] + across[1][None] - across[0][:, None]
    reach = np.sqrt(x**2 + y**2 + (pivot[2] + arm_2[2] - arm_1[2]) ** 2)
    return reach.min() <= rod <= reach.max()


def robot_file(*sides):
    closures = ", ".join(
        f"{{name: {side}rod, frames: [{side}end_1, {side}end_2], kind: fixed}}" for side in sides
    )
    motors = ", ".join(f"{{joint: {side}crank}}" for side in sides)
    return (
        f"platform: {{frame: {sides[0]}rocker_link, axes: [rz]}}\n"
        f"actuators: [{motors}]\nclosures: [{closures}]\n"
    )


def apart(robot, q, first, second):
    """Distance [m] and angle [rad] between two frames."""
    one, two = placements(robot.model, (first, second), q)
    between = one.actInv(two)
    return np.linalg.norm(between.translation), np.linalg.norm(pin.log3(between.rotation))


@pytest.mark.parametrize("shape", HALVES.values(), ids=HALVES)
def test_loops_that_newton_leaves_open_are_closed(tmp_path, shape):
    robot = linkage(tmp_path, halves(shape), robot_file(""))
    with pytest.raises(NotAssembled, match="do not close near the reference"):
        ParallelRobot.of(robot)
    pose = find_closed_pose(robot)
    assert max(apart(robot, pose.q, "end_1", "end_2")) < 1e-9
    offset = np.abs(pose.q - robot.q_near)
    joint = robot.coordinates.name_of(int(np.argmax(offset)))
    assert pose.farthest == f"{joint} {offset.max():.3g} rad"


def test_a_reference_that_newton_closes_turned_over_is_none(tmp_path):
    robot = linkage(tmp_path, halves(TURNED_OVER), robot_file(""))
    with pytest.raises(NotAssembled, match="only with rod turned over"):
        ParallelRobot.of(robot)
    assert max(apart(robot, find_closed_pose(robot).q, "end_1", "end_2")) < 1e-9


# the first four can be closed; that others cannot is said after all starts
@pytest.mark.parametrize("seed", [2, 3, 6, 11, *(pytest.param(k, marks=pytest.mark.slow) for k in (0, 1, 4))])
def test_a_pose_is_found_where_there_is_one(tmp_path, seed):
    rng = np.random.default_rng(seed)

    def along_an_axis(length):
        return tuple(length * rng.choice([-1, 1]) * np.eye(3)[rng.integers(3)])

    shape = (*(along_an_axis(length) for length in (0.1, 0.1, 0.15, 0.15)), (0.3, 0.05, 0.02))
    robot = linkage(tmp_path, halves(shape), robot_file(""))
    if can_close(shape):
        assert max(apart(robot, find_closed_pose(robot).q, "end_1", "end_2")) < 1e-9
    else:
        with pytest.raises(NotAssembled, match=r"rod\.r?[xyz] stays"):
            find_closed_pose(robot)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("low", "high", "closes"), [(0.9, 1.1, True), (-1.1, -0.9, True), (-0.1, 0.4, False)]
)
def test_a_limit_decides_which_pose_is_found(tmp_path, low, high, closes):
    """The skew four-bar has poses with its crank anywhere but from -0.2 to 0.5 rad."""
    limit = f'lower="{low}" upper="{high}"'
    robot = linkage(tmp_path, halves(HALVES["skew"], limit=limit), robot_file(""))
    if not closes:
        contradiction = r"only beyond the joints' limits, with crank position 0\.[5-9]\d* rad of 0\.4:"
        with pytest.raises(NotAssembled, match=contradiction):
            find_closed_pose(robot)
        return
    pose = find_closed_pose(robot)
    assert max(apart(robot, pose.q, "end_1", "end_2")) < 1e-9
    crank = pose.q[robot.model.joints[robot.model.getJointId("crank")].idx_q]
    assert low - 1e-12 <= crank <= high + 1e-12


@pytest.mark.slow
def test_limits_of_two_loops_are_blamed_loop_by_loop(tmp_path):
    """Both skew four-bars have cranks that must be beyond 0.4 rad; each is enough for its own loop."""
    limit = 'lower="-0.1" upper="0.4"'
    elements = halves(HALVES["skew"], "left_", limit) + halves(HALVES["skew"], "right_", limit)
    robot = linkage(tmp_path, elements, robot_file("left_", "right_"))
    with pytest.raises(NotAssembled, match=r"limits, with \w+_crank position 0\.[5-9]\d* rad of 0\.4:"):
        find_closed_pose(robot)


@pytest.mark.parametrize(
    "far", [{}, {"motor_2": 1e5}, pytest.param({"motor_3": 1e6}, marks=pytest.mark.slow)]
)
def test_slides_keep_their_limits_too(far):
    """The 3-RPR from a reference far outside of them; from there it still closes to rounding."""
    given = robots.load("three_rpr")
    lost = {limit.joint: 0.0 if limit.unit == "rad" else 2.4 for limit in given.limits}
    if far:
        lost = {**given.description.reference, **far}
    robot = Mechanism.from_description(replace(given.description, reference=lost))
    pose = find_closed_pose(robot)
    for corner, tip in (("corner_2", "tip_2"), ("corner_3", "tip_3")):
        assert apart(robot, pose.q, corner, tip)[0] < 1e-12
    for limit in robot.limits:
        assert limit.lower - 1e-12 <= pose.q[limit.coordinate] <= limit.upper + 1e-12


def test_legs_are_closed_one_by_one(tmp_path):
    """Five loops, each of which few starts close, do not have to be closed by the same start."""
    shape = HALVES["skew"]
    sides = ("a_", "b_", "c_", "d_", "e_")
    robot = linkage(tmp_path, "".join(halves(shape, side) for side in sides), robot_file(*sides))
    pose = find_closed_pose(robot)
    for side in sides:
        assert max(apart(robot, pose.q, f"{side}end_1", f"{side}end_2")) < 1e-9


@pytest.mark.slow
def test_what_cannot_close_is_told_with_the_least_gap(write_robot):
    """Motors 1.6 m apart and 1 m of links: the tips stay 0.6 m apart at least."""
    robot = Mechanism.from_file(write_robot(urdf=(('xyz="0.2 0 0"', 'xyz="1.4 0 0"'),)))
    with pytest.raises(NotAssembled) as first:
        find_closed_pose(robot)
    with pytest.raises(NotAssembled, match=r"do not close: of \d+ starts .* tip\.[xyz] stays") as failure:
        find_closed_pose(robot)
    assert str(first.value) == str(failure.value)
    assert first.value is not failure.value
    assert 0.6 < apart(robot, failure.value.q, "left_tip", "right_tip")[0] < 0.7


@pytest.mark.parametrize("words", [[], ["--json"]])
def test_check_answers_no_where_the_reference_is_not_assembled_and_prints_the_pose(tmp_path, capsys, words):
    linkage(tmp_path, halves(HALVES["skew"]), robot_file(""))
    (file,) = tmp_path.glob("*.yaml")
    assert main(["check", str(file), *words]) == 1
    out, err = capsys.readouterr()
    assert err.count("\n") == 1
    assert "the loops do not close near the default reference (all zero)" in err
    if not words:
        assert "  reference         {crank: " in out
        return
    found = json.loads(out)
    assert not found["assembled"]
    assert found["error"]["kind"] == "NotAssembled"
    assert found["error"]["residual"] == found["gap_at_reference"] > 1e-3
    pasted = [f"{joint}={value!r}" for joint, value in found["reference"].items()]
    assert main(["check", str(file), "--reference", *pasted]) == 0


def test_a_robot_without_reference_is_refused_with_one_that_serves_in_python_and_in_words(tmp_path, capsys):
    """The remedy of the error makes the same call succeed; the command that is printed ends with 0."""
    linkage(tmp_path, halves(HALVES["skew"]), robot_file(""))
    (file,) = tmp_path.glob("*.yaml")
    with pytest.raises(NotAssembled) as refusal:
        load_robot(file)
    robot = load_robot(file, **refusal.value.remedy)
    assert max(apart(robot, robot.reference.q, "end_1", "end_2")) < 1e-9
    assert refusal.value.__notes__ == [f"try: reference={refusal.value.remedy['reference']}"]
    for command in ["locate"], ["pose", "--motors", "0.3"], ["show"]:
        assert main([command[0], str(file), *command[1:]]) == 1
        *_, tried = capsys.readouterr().err.partition("try: crossing ")
        # the pose of these motors and the nearest singular pose have answers of their own
        assert command == ["show"] or tried.startswith(command[0])
        assert main(["check", str(file), *tried[tried.index("--reference") :].split()]) == 0
        capsys.readouterr()


@pytest.mark.parametrize("kind", ["spherical", "fixed", "revolute"])
def test_one_joint_that_cannot_close_its_loop_is_refused(tmp_path, kind):
    """An arm of 1 m ends 2 m from a point at 3 m, wherever it turns within its range."""
    limit = 'lower="-1" upper="1"'
    arm = joint("arm", "base", kind="revolute", limit=limit, mass=1) + frame("tip", "arm_link", (1, 0, 0))
    content = (
        "platform: {joints: [arm]}\nactuators: [{joint: arm}]\n"
        f"closures: [{{name: pin, frames: [post, tip], kind: {kind}}}]\n"
    )
    robot = linkage(tmp_path, arm + frame("post", "base", (3, 0, 0)), content)
    with pytest.raises(NotAssembled, match="do not close"):
        find_closed_pose(robot)


def slider_crank(folder, reference, crank="", block='lower="-9" upper="9"'):
    """Crank 0.1 m, rod 0.26 m, a block on the x axis: at crank angle a it is at 0.1 cos a +- sqrt(...)."""
    elements = (
        joint("crank", "base", kind="revolute" if crank else "continuous", limit=crank)
        + joint("rod", "crank_link", (0.1, 0, 0))
        + frame("pin", "rod_link", (0.26, 0, 0))
        + joint("block", "base", axis="x", kind="prismatic", limit=block)
    )
    rest = (
        "platform: {joints: [block]}\nactuators: [{joint: crank}]\n"
        f"closures: [{{name: pin, frames: [pin, block_link], axes: [x, y]}}]\nreference: {reference}\n"
    )
    return linkage(folder, elements, rest)


@pytest.mark.slow
def test_a_limit_that_contradicts_the_loop_is_blamed(tmp_path):
    """The block is never nearer than 0.16 m."""
    with pytest.raises(
        NotAssembled, match=r"only beyond the joints' limits, with block position .* m of 0\.12"
    ):
        find_closed_pose(slider_crank(tmp_path, "{crank: 0.5}", block='lower="0.05" upper="0.12"'))


def test_what_the_reference_states_stays_as_far_as_the_loops_allow(tmp_path):
    mechanism = slider_crank(tmp_path, "{crank: 2.0}")
    q = find_closed_pose(mechanism).q
    crank, rod, block = (
        float(q[mechanism.coordinates.names.index(name)]) for name in ("crank", "rod", "block")
    )
    assert crank == pytest.approx(2.0, abs=1e-2)
    tip = 0.1 * np.exp(1j * crank) + 0.26 * np.exp(1j * (crank + rod))
    assert abs(tip - block) < 1e-9


def test_without_a_reference_a_pose_within_ranges_is_proposed(tmp_path):
    mechanism = slider_crank(tmp_path, "{}", crank='lower="0.7" upper="1.2"', block='lower="0.2" upper="0.3"')
    reference = check_robot(mechanism).reference
    assert 0.7 <= reference["crank"] <= 1.2
    assert 0.2 <= reference["block"] <= 0.3


def test_a_robot_without_a_reference_is_loaded_within_ranges(tmp_path):
    mechanism = slider_crank(tmp_path, "{}", crank='lower="0.7" upper="1.2"', block='lower="0.2" upper="0.3"')
    robot = ParallelRobot.of(mechanism)
    crank, block = robot.reference_values(robot.reference.q)["crank"], float(robot.reference.x[0])
    assert 0.7 <= crank <= 1.2
    assert block == pytest.approx(0.1 * np.cos(crank) + np.sqrt(0.26**2 - (0.1 * np.sin(crank)) ** 2))


@pytest.mark.parametrize(
    ("reference", "target", "block"),
    [("{crank: 2.0, rod: 2.0, block: 5.0}", "0.3", 0.3), ("{}", "0.5", 0.36)],  # stretched out at 0.36 m
)
def test_loops_are_assembled_near_a_platform_pose_and_the_reference_can_be_pasted(
    tmp_path, capsys, reference, target, block
):
    """By the law of cosines the crank stands at +-acos((x^2 + r^2 - l^2) / 2 r x)."""
    file = slider_crank(tmp_path, reference).description.file
    assert main(["pose", str(file), "--near-platform", target]) == 0
    out = capsys.readouterr().out
    pasted = out[out.index("{") : out.index("}") + 1]
    assert ("  near  " in out) == (target == "0.5")
    file.write_text(file.read_text().replace(reference, pasted))
    robot = ParallelRobot.from_file(file)
    assert robot.reference.x == pytest.approx([block], abs=1e-4)
    cosine = (block**2 + 0.1**2 - 0.26**2) / (2 * 0.1 * block)
    crank = robot.reference_values(robot.reference.q)["crank"]
    assert np.cos(crank) == pytest.approx(cosine, abs=1e-3)
