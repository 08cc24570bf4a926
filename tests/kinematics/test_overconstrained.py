"""Overconstrained loops of which no fixed equations imply the others: parallelograms, Bennett, spare cranks.

Witnesses: the angle between the rods of two arms with parallelograms, mirror symmetry, the geometry of
cranks, and a Bennett linkage, which has no singular pose at all.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from framework import Line, ParallelRobot, locate_singularities, plan_crossing, track_path
from framework.atlas.survey import survey_window
from framework.atlas.workspace_map import workspace_map
from framework.kinematics.linearised_loops import linearised_at
from framework.proofs.singular_paving import pave_singularities
from framework.singularity.type2 import singularity_measure
from tests.kinematics.linkages import frame, joint, linkage

T = np.linspace(0.0, 1.0, 11)


@dataclass(frozen=True)
class TwoArms:
    """A plate kept level by two arms of two parallelograms each, in the plane xz; hinges about y."""

    half_base: float = 0.3
    arm: float = 0.35
    rod: float = 0.55
    width: float = 0.08  # of the parallelograms
    rod_error: float = 0.0  # of one rod

    def angles(self, p):
        """Angles of arms and of rods (2, ...) for the platform's points (..., 2), elbows outward."""
        found = []
        for side in (-1.0, 1.0):
            dx, dz = p[..., 0] - side * self.half_base, p[..., 1]
            reach = np.hypot(dx, dz)
            with np.errstate(invalid="ignore"):  # out of reach: NaN
                corner = np.arccos((self.arm**2 + reach**2 - self.rod**2) / (2 * self.arm * reach))
            arm = np.arctan2(-dz, dx) - side * corner
            rod = np.arctan2(-dz + -self.arm * np.sin(arm), dx - self.arm * np.cos(arm))
            found.append((arm, rod))
        return np.moveaxis(np.array(found), 1, 0)

    def robot(self, folder, at=(0.02, -0.6)):
        arms, rods = self.angles(np.array(at))
        elements, reference, closures = "", {}, ""
        for name, side, arm, rod in zip("lr", (-1.0, 1.0), arms, rods, strict=True):
            pivot, w = side * self.half_base, self.width
            elements += joint(
                f"motor_{name}", "base", (pivot, 0, 0), "y", mass=1.0, centre=(0.5 * self.arm, 0, 0)
            )
            elements += joint(
                f"idler_{name}", "base", (pivot, 0, w), "y", mass=0.3, centre=(0.5 * self.arm, 0, 0)
            )
            elements += joint(f"knee_{name}", f"motor_{name}_link", (self.arm, 0, 0), "y", mass=0.2)
            elements += frame(f"pin_{name}", f"knee_{name}_link", (0, 0, w))
            elements += frame(f"idler_tip_{name}", f"idler_{name}_link", (self.arm, 0, 0))
            closures += hinge(f"prox_{name}", f"idler_tip_{name}", f"pin_{name}")
            reference |= {f"motor_{name}": arm, f"idler_{name}": arm, f"knee_{name}": -arm}
            for which, offset in (("a", 0.5 * w), ("b", -0.5 * w)):
                length = self.rod + (self.rod_error if name + which == "rb" else 0.0)
                elements += joint(
                    f"rod_{name}{which}",
                    f"knee_{name}_link",
                    (offset, 0, 0),
                    "y",
                    mass=0.2,
                    centre=(0.5 * self.rod, 0, 0),
                )
                elements += frame(f"tip_{name}{which}", f"rod_{name}{which}_link", (length, 0, 0))
                reference[f"rod_{name}{which}"] = rod
        elements += joint("plate", "tip_la", axis="y", mass=1.0)
        elements += frame("tool", "plate_link", (-0.5 * self.width, 0, 0))
        reference["plate"] = -reference["rod_la"]
        for which, offset in (("lb", -0.5), ("ra", 0.5), ("rb", -0.5)):
            elements += frame(f"seat_{which}", "tool", (offset * self.width, 0, 0))
            closures += (
                f"  - {{name: {which}, frames: [tip_{which}, seat_{which}], kind: revolute, axis: y}}\n"
            )
        return assembled(
            folder, elements, closures, reference, "{frame: tool, axes: [x, z]}", ("motor_l", "motor_r")
        )


def hinge(name, first, second):
    """The line of a closure by a hinge about y."""
    return f"  - {{name: {name}, frames: [{first}, {second}], kind: revolute, axis: y}}\n"


def assembled(folder, elements, closures, reference, platform, motors):
    actuators = "".join(f"  - {{joint: {name}}}\n" for name in motors)
    values = ", ".join(f"{name}: {float(value)!r}" for name, value in reference.items())
    return ParallelRobot.of(
        linkage(
            folder,
            elements,
            f"platform: {platform}\nactuators:\n{actuators}closures:\n{closures}reference: {{{values}}}\n",
        )
    )


def bennett(folder, side, twist, other_twist, start):
    """Four hinges; opposite links are equal and side / sin(twist) is the same for all."""
    other = side * np.sin(other_twist) / np.sin(twist)
    ratio = np.sin((other_twist + twist) / 2) / np.sin((other_twist - twist) / 2)
    second = 2 * np.arctan2(ratio, np.tan(start / 2))
    elements = joint("h1", "base", mass=1.0, centre=(0.5 * side, 0, 0))
    elements += frame("e1", "h1_link", (side, 0, 0), (twist, 0, 0))
    elements += joint("h2", "e1", mass=1.0, centre=(0.5 * other, 0, 0))
    elements += frame("e2", "h2_link", (other, 0, 0), (other_twist, 0, 0))
    elements += joint("h3", "e2", mass=1.0, centre=(0.5 * side, 0, 0))
    elements += frame("end", "h3_link", (side, 0, 0), (twist, 0, 0))
    # the fourth link leads from the fourth hinge back to the first
    elements += frame("last", "base", (0, 0, 0), (0, 0, 0))
    elements += frame("seat", "last", tuple(-other * np.array([1.0, 0.0, 0.0])), (-other_twist, 0, 0))
    closures = "  - {name: h4, frames: [end, seat], kind: revolute, axis: z}\n"
    reference = {"h1": start, "h2": second, "h3": -start}
    return assembled(folder, elements, closures, reference, "{joints: [h2]}", ("h1",))


def cranks(folder, pivots, radius, start):
    """Equal cranks that carry one coupler."""
    elements, closures, reference = "", "", {}
    for k, (x, z) in enumerate(pivots):
        elements += joint(f"crank_{k}", "base", (x, 0, z), "y", mass=1.0, centre=(0.5 * radius, 0, 0))
        reference[f"crank_{k}"] = start
    elements += joint("coupler", "crank_0_link", (radius, 0, 0), "y", mass=2.0)
    reference["coupler"] = -start
    for k, (x, z) in enumerate(pivots[1:], start=1):
        elements += frame(f"tip_{k}", f"crank_{k}_link", (radius, 0, 0))
        elements += frame(f"seat_{k}", "coupler_link", (x - pivots[0][0], 0, z - pivots[0][1]))
        closures += hinge(f"pin_{k}", f"tip_{k}", f"seat_{k}")
    last = len(pivots) - 1
    return assembled(folder, elements, closures, reference, f"{{joints: [crank_{last}]}}", ("crank_0",))


def hexagon(folder, angles=(-0.3, -1.2, -2.3), side=0.3):
    """Twelve bars in three directions, the edges of a flat cube: ten equations of rank 9.

    Bar a is fixed. The first bar that arrives at a corner carries the next ones; the others close on it.
    """
    directions = dict(zip("abc", np.eye(3, dtype=int), strict=True))
    angle = dict(zip("abc", angles, strict=True))
    start = (side * np.cos(angle["a"]), 0, -side * np.sin(angle["a"]))
    elements, closures, reference = frame("corner_100", "base", start), "", {}
    carriers = {(0, 0, 0): ("base", 0.0), (1, 0, 0): ("corner_100", 0.0)}
    corners = sorted(np.ndindex(2, 2, 2), key=sum)
    for corner in corners:
        for name, direction in directions.items():
            end = tuple(int(k) for k in np.add(corner, direction))
            if max(end) > 1 or (corner, name) == ((0, 0, 0), "a"):
                continue
            bar, tip = (f"{word}_{name}{''.join(map(str, corner))}" for word in ("bar", "tip"))
            parent, turned = carriers[corner]
            elements += joint(bar, parent, (0, 0, 0), "y", mass=0.5, centre=(0.5 * side, 0, 0))
            elements += frame(tip, f"{bar}_link", (side, 0, 0))
            reference[bar] = angle[name] - turned
            if end in carriers:
                closures += hinge(f"pin_{bar}", tip, carriers[end][0])
            else:
                carriers[end] = (tip, angle[name])
    elements += frame("tool", carriers[1, 1, 1][0], (0, 0, 0))
    platform = "{frame: tool, axes: [x, z]}"
    return assembled(folder, elements, closures, reference, platform, ("bar_b000", "bar_c000"))


def expect_signs(arms: TwoArms, robot: ParallelRobot, path: Line) -> None:
    """g has the sign of the sine of the angle between the rods, up to one sign of the robot."""
    s = np.linspace(0.0, 1.0, 41)
    closed = track_path(robot, path).close(s)
    assert np.abs(closed.loops.residual).max() < 1e-12
    motors, rods = arms.angles(closed.x)
    turns = robot.actuated_coordinates(closed.q) - motors.T
    assert np.abs(np.sin(0.5 * turns)).max() < 1e-12
    sines = np.sin(rods[1] - rods[0])
    g = singularity_measure(robot, linearised_at(robot, closed.q)).g
    assert (np.abs(g) > 1e-6).all()
    assert len(set(np.sign(g * sines))) == 1


@pytest.fixture
def arms():
    return TwoArms()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_two_arms_have_no_singular_point_where_the_rods_are_not_in_line(arms, tmp_path, side):
    robot = arms.robot(tmp_path)
    assert robot.structure.varies
    path = Line([0.0, -0.6], [side * 0.4, -0.55])
    assert not locate_singularities(robot, path)
    expect_signs(arms, robot, path)


@pytest.mark.parametrize("error", [0.0, 1e-8])
def test_torques_of_mirrored_paths_are_mirrored_also_with_a_rod_that_is_off(tmp_path, error):
    robot = TwoArms(rod_error=error).robot(tmp_path)
    left, right = (
        plan_crossing(robot, Line([0.0, -0.6], [side * 0.35, -0.55]), duration=1.0).torque(T)
        for side in (-1, 1)
    )
    np.testing.assert_allclose(left, -right[:, ::-1], rtol=0, atol=1e-10 + 20.0 * error)


def test_no_singular_pose_of_a_bennett_linkage_is_proved(tmp_path):
    paving = pave_singularities(bennett(tmp_path, 0.3, 0.6, 1.4, 1.0))
    assert paving.complete
    assert not any(len(paved.x) for paved in paving.sets)


def test_cranks_without_a_dead_point_turn_all_the_way_round(tmp_path):
    robot = cranks(tmp_path, [(0, 0), (1, 0), (0.4, 0.5)], 0.3, 0.5)
    closed = track_path(robot, Line([0.5], [0.5 + 2 * np.pi])).close(T)
    np.testing.assert_allclose(robot.actuated_coordinates(closed.q), closed.x, rtol=0, atol=1e-12)
    assert not locate_singularities(robot, Line([0.5], [0.5 + 2 * np.pi]))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_random_arms_have_neither_false_signs_nor_false_refusals(tmp_path, seed):
    rng = np.random.default_rng(seed)
    half_base, arm = rng.uniform(0.1, 0.4), rng.uniform(0.3, 0.5)
    arms = TwoArms(half_base, arm, arm * rng.uniform(1.3, 1.8), rng.uniform(0.04, 0.12))
    robot = arms.robot(tmp_path, at=(0.0, -1.1 * arms.rod))
    for side in (-1.0, 1.0):
        path = Line([0.0, -1.1 * arms.rod], [side * 0.6 * arm, -arms.rod])
        expect_signs(arms, robot, path)
        assert not locate_singularities(robot, path)
    for curve in workspace_map(robot, survey_window(robot, size=15), ["g"]).locus.curves:
        motors, rods = arms.angles(curve.x)
        in_mode = np.abs(np.sin(0.5 * (robot.actuated_coordinates(curve.q) - motors.T))).max(axis=1) < 1e-6
        # curves end where all parallelograms of rods are flat: the loops lose rank, the end has no digits
        judged = in_mode & (np.abs(np.sin(rods)).max(axis=0) > 1e-6)
        assert not curve.is_type2 or np.abs(np.sin(rods[1] - rods[0]))[judged].max(initial=0.0) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_random_bennett_linkages_turn_and_have_no_singular_pose(tmp_path, seed):
    rng = np.random.default_rng(seed)
    twist = rng.uniform(0.3, 0.9)
    robot = bennett(
        tmp_path, rng.uniform(0.2, 0.5), twist, twist + rng.uniform(0.4, 0.9), rng.uniform(0.5, 2.0)
    )
    assert robot.structure.varies
    x = robot.reference.x[0]
    for turn in (-2 * np.pi, 2 * np.pi):
        assert plan_crossing(robot, Line([x], [x + turn]), duration=1.0).crossings == ()
    paving = pave_singularities(robot)
    assert not any(len(paved.x) for paved in paving.sets)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_random_cranks_turn_all_the_way_round(tmp_path, seed):
    rng = np.random.default_rng(seed)
    pivots = [tuple(pivot) for pivot in rng.uniform(-0.6, 0.6, (int(rng.integers(3, 6)), 2)).tolist()]
    start = rng.uniform(0.0, 2 * np.pi)
    robot = cranks(tmp_path, pivots, rng.uniform(0.1, 0.4), start)
    x = robot.reference.x[0]
    path = Line([x], [x + 2 * np.pi])
    assert not locate_singularities(robot, path)
    closed = track_path(robot, path).close(T)
    np.testing.assert_allclose(robot.actuated_coordinates(closed.q), closed.x, rtol=0, atol=1e-10)


@pytest.mark.slow
def test_a_hexagon_of_twelve_bars_has_one_sign_and_no_type_2(tmp_path):
    """The motors turn two bars and with them all of their direction: dx/dq_a is that of a chain of two."""
    robot = hexagon(tmp_path)
    assert robot.structure.varies
    drawn = workspace_map(robot, survey_window(robot, size=11), ["g"])
    b, c = robot.actuated_coordinates(drawn.q[drawn.reached]).T
    g = drawn.values["g"][drawn.reached] * np.sign(np.sin(b - c))
    assert len(g) > 20
    assert len(set(np.sign(g))) == 1
    assert not any(curve.is_type2 for curve in drawn.locus.curves)
