"""A pose in which every loop equation holds, but with a joint turned over, is no assembled pose.

One body on a ball, closed on the base: the right poses are known by hand, and those that are turned over.
"""

import numpy as np
import pinocchio as pin
import pytest

from framework import NotAssembled, ParallelRobot, check_robot
from framework.kinematics.assembly import close_reference
from framework.kinematics.closures import direction_gap_derivatives, direction_gaps, loop_equations
from framework.kinematics.frames import frames_at, integrate
from tests.kinematics.linkages import ball, frame, joint, linkage
from tests.oracles.placements import placements

THIRD = 2 * np.pi / 3


def on_a_ball(folder, kind, turn):
    """A body turned by a rotation vector [rad], on a closure with a seat on the base that is not turned."""
    rotation = pin.exp3(np.array(turn, dtype=float))
    # R = Rx(a) Ry(b) Rz(c); where b is a quarter turn, a and c turn about one axis
    level = np.hypot(rotation[0, 0], rotation[0, 1])
    a = np.arctan2(-rotation[1, 2], rotation[2, 2]) if level > 1e-9 else 0.0
    rest = pin.exp3(np.array([-a, 0.0, 0.0])) @ rotation
    angles = {
        "body_x": a,
        "body_y": np.arctan2(rotation[0, 2], level),
        "body_z": np.arctan2(rest[1, 0], rest[1, 1]),
    }
    given = ", ".join(f"{name}: {float(angle)!r}" for name, angle in {"motor": 0.0, **angles}.items())
    return linkage(
        folder,
        frame("seat", "base", (0.1, 0, 0)) + joint("motor", "base", (0.1, 0, 0)) + ball("body", "motor_link"),
        f"platform: {{frame: body_z_link, axes: [rz]}}\nactuators: [{{joint: motor}}]\n"
        f"closures: [{{name: joint, frames: [seat, body_z_link], kind: {kind}}}]\nreference: {{{given}}}\n",
    )


TURNED_OVER = [
    ("fixed", (np.pi, 0, 0)),
    ("fixed", (0, 0, np.pi)),
    ("fixed", THIRD / np.sqrt(3) * np.ones(3)),
    ("revolute", (np.pi, 0, 0)),
    ("revolute", np.pi / np.sqrt(2) * np.array([1, 1, 0])),
    ("prismatic", (0, np.pi, 0)),
    ("planar", (np.pi, 0, 0)),
    ("cylindrical", (0, np.pi, 0)),
]
RIGHT = [
    ("fixed", (0, 0, 0)),
    ("revolute", (0, 0, 2.5)),
    ("cylindrical", (0, 0, -3.0)),
    ("planar", (0, 0, 2.0)),
    ("spherical", (1.0, 2.0, 1.5)),
    ("universal", (np.pi, 0, 0)),
]


@pytest.mark.parametrize(("kind", "turn"), TURNED_OVER)
def test_turned_over_is_not_assembled(tmp_path, kind, turn):
    robot = on_a_ball(tmp_path, kind, turn)
    equations = loop_equations(robot.rows, frames_at(robot, robot.q_near[None])).residual
    assert np.abs(equations).max() < 1e-14  # which is why they alone do not tell
    with pytest.raises(NotAssembled, match="the loops close only with joint turned over"):
        ParallelRobot.of(robot)
    found = check_robot(robot)  # looks for another pose
    assert not found.assembled
    values = np.array([found.reference[name] for name in ("motor", "body_x", "body_y", "body_z")])
    (body,) = placements(robot.model, ("body_z_link",), values)
    np.testing.assert_allclose(body.rotation[:, 2], [0, 0, 1], atol=1e-9)


@pytest.mark.parametrize(("kind", "turn"), RIGHT)
def test_a_right_pose_is_assembled(tmp_path, kind, turn):
    robot = on_a_ball(tmp_path, kind, turn)
    np.testing.assert_allclose(close_reference(robot).q, robot.q_near, atol=1e-12)


@pytest.mark.parametrize("kind", ["fixed", "revolute", "prismatic", "planar"])
def test_slopes_are_derivatives_of_gaps(tmp_path, kind):
    robot = on_a_ball(tmp_path, kind, (0.3, -0.2, 0.5))
    directions, rng, h = robot.directions, np.random.default_rng(4), 1e-6
    q = robot.q_near + 0.3 * rng.normal(size=robot.model.nq)
    v = rng.normal(size=robot.model.nv)
    ahead, back = (
        direction_gaps(directions, frames_at(robot, integrate(robot, q, side * h * v)[None]))[0]
        for side in (1, -1)
    )
    slope = direction_gap_derivatives(directions, frames_at(robot, q[None]))[0] @ v
    assert slope.shape == (2 if kind in ("fixed", "prismatic") else 1, 3)
    np.testing.assert_allclose(slope, (ahead - back) / (2 * h), atol=1e-9)  # h^2 and eps / h
