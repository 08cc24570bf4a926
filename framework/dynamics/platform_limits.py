"""The admissible wrenches and speeds of the platform at one pose, within the motors' limits.

G (n_a, n) are the motor speeds for unit velocities v of the platform. With motor torques tau the platform
exerts the wrench

    U = G' tau - W_g,        |tau_k| <= limit of motor k,

on its surroundings, where W_g balances the weight of all bodies and the springs on their joints at rest.
These U form a zonotope. Admissible velocities v have |G v| <= speed limits. If the platform coordinates are
joints, as the pitch and roll of an ankle, the set of U has the true limits of the joints' torques. They
depend on the pose and on one another, while a file that describes the tree alone has independent limits. At a
Type 2 singularity G t_s = 0: the zonotope has no width along t_s, and the speed along t_s has no limit.

Assumptions: all parts are rigid, springs keep their deflections, there are no contacts, and motors reach
their torque limit at every speed. The limits hold at this pose only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.dynamics.forces import tree_forces
from framework.dynamics.motor_limits import Limit, motor_limits
from framework.dynamics.platform_wrench import motor_speeds
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import assembled_at
from framework.kinematics.motion_rates import motion_at
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.numerics.polytope import Polytope, slabs, zonotope


@dataclass(frozen=True, eq=False)
class PlatformLimits(ReadOnlyArrays):
    """The admissible wrenches U and speeds v of the platform at one pose.

    U has forces [N] and moments [N m] along the components of v, so that the power is U . v. For a platform
    of joints they are the joints' forces and torques.
    """

    robot: ParallelRobot
    wrenches: Polytope | None  # U at rest; None if a motor has no torque limit
    speeds: Polytope | None  # v [m/s, rad/s]; None if a motor has no speed limit
    weight: Array  # (n,) W_g, the wrench that balances the weight

    @property
    def polytopes(self) -> dict[str, Polytope]:
        """The polytopes that exist, under the keys "wrench" and "speed"."""
        polytopes = {"wrench": self.wrenches, "speed": self.speeds}
        return {name: polytope for name, polytope in polytopes.items() if polytope is not None}


def platform_limits(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    torque_limit: Limit = None,
    speed_limit: Limit = None,
) -> PlatformLimits:
    """Compute the admissible wrenches and speeds of the platform at an assembled configuration q (nq,).

    Wrenches are U = G' tau - W_g for all torques tau within the torque limits. Speeds are all v for which G v
    is within the speed limits.

    Args:
        q: as returned by `assemble` or `forward_kinematics`.
        torque_limit: limit [N m], motor side, of all motors; or one for each motor; or limits by joint. By
            default, limits are those of the robot file, see `motor_limits`.
        speed_limit: limits [rad/s] in the same forms.

    Raises:
        InvalidInput: q leaves the loops open; limits have the wrong length or are not positive; the platform
            does not determine the joints.
        NotAssembled: the platform does not determine the joints at this pose (Type 1).
    """
    expect_robot(robot)
    require_square(robot)
    closed = assembled_at(robot, q)
    torque = motor_limits(robot, "torque_limit", torque_limit)
    speed = motor_limits(robot, "speed_limit", speed_limit)
    G, rates = motor_speeds(robot, closed.linearised)
    at_rest = np.zeros((1, robot.n))
    motion = motion_at(robot, closed, at_rest, at_rest)
    weight = (tree_forces(robot, motion) @ rates[0])[0]  # (n,) W_g = (dq/dv)' r
    scale = robot.platform_scale  # the polytopes of scale * U and of v / scale are well conditioned
    wrenches = speeds = None
    if np.isfinite(torque).all():
        scaled_wrenches = zonotope(-weight * scale, torque[:, None] * G[0] * scale)
        wrenches = _unscale_polytope(scaled_wrenches, scale)
    if np.isfinite(speed).all():
        speeds = _unscale_polytope(slabs(G[0] * scale, speed), 1.0 / scale)
    return PlatformLimits(robot, wrenches, speeds, weight)


def _unscale_polytope(scaled: Polytope, scale: Array) -> Polytope:
    """Convert a polytope of scale * y to a polytope of y, with scale (n,).

    Normals are scaled to unit length, and free directions to an orthonormal basis.
    """
    normals = scaled.normals * scale
    lengths = np.linalg.norm(normals, axis=1)
    free = np.linalg.qr((scaled.free / scale).T)[0].T if len(scaled.free) else scaled.free
    return Polytope(normals / lengths[:, None], scaled.offsets / lengths, scaled.vertices / scale, free)
