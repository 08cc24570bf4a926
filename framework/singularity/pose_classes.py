"""All kinds of singularity of a pose, with its freedoms and its distances from singularities.

The kinds are defined by the rates (v, dq_a, dq_p) of platform, motors and passive joints that the loops
allow:

type_1       motors move while the platform rests: B singular, "first kind" of Gosselin and Angeles (1990);
             redundant input and impossible output (RI, IO) of Zlatanov, Fenton and Benhabib (1994). `legs`
             names the motors that move.
type_2       the platform moves along t_s while the motors rest: A singular, "second kind" of Gosselin and
             Angeles (1990); redundant output and impossible input (RO, II) of Zlatanov et al. (1994).
leg_passive  passive joints move while motors and platform rest: redundant passive motion (RPM) of Zlatanov et
             al. (1994), leg singularity of Conconi and Carricato (2009), LPJTS singularity (of the leg's
             passive-joint twist system) of Briot, Caro and Germain (2016): the inverse dynamics has a pole
             there that no motion along the platform's path removes.
constraint   the platform gains freedoms that it has nowhere else (Zlatanov, Bonev and Gosselin 2002): either
             the loops lose rank and its instantaneous mobility increases (IIM), or with locked motors it can
             leave the platform's axes.
closure      the loop equations lose rank, and only bodies other than the platform gain a freedom: increased
             instantaneous mobility (IIM) of Zlatanov et al. (1994).
architectural  type_2, leg_passive or constraint at every pose, not at this one alone: g = 0 everywhere
             (Ma and Angeles 1992). No path leaves it.

Type 1 and Type 2 together are the "third kind" of Gosselin and Angeles (1990): `kinds` then lists both.

C. Gosselin and J. Angeles, IEEE Trans. Robotics and Automation 6(3), 1990. D. Zlatanov, R. G. Fenton and B.
Benhabib, ASME DETC 1994. M. Conconi and M. Carricato, IEEE Trans. Robotics 25(6), 2009. S. Briot, S. Caro and
C. Germain, Nonlinear Dynamics 83, 2016. O. Ma and J. Angeles, Int. J. Robotics and Automation 7(1), 1992.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.errors import InvalidInput, finite_numbers
from framework.kinematics.assembly import nearby_configurations
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    assembled_at,
    clearance,
    linearised_at,
    linearised_at_reference,
    type1_matrix,
    type2_matrix,
)
from framework.kinematics.loop_structure import null_directions
from framework.kinematics.motion_rates import joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, Names, ReadOnlyArrays
from framework.numerics.ordered_sums import least_singular_values
from framework.singularity.bordered_system import DIFFERENCE_STEP, Border, solve_bordered
from framework.singularity.distances import Distances, pressure_angles
from framework.singularity.type2 import signed_measure, twist_norm, uncontrolled_space
from framework.tolerances import RANK_LOST, TANGENTIAL_SLOPE

NAMES = {
    "type_1": "Type 1",
    "type_2": "Type 2",
    "leg_passive": "leg-passive",
    "constraint": "constraint",
    "closure": "closures",
    "architectural": "architectural",
}


@dataclass(frozen=True, eq=False)
class Classification(ReadOnlyArrays):
    """The kinds of singularity of a pose of a robot with c uncontrolled motions, and its distances.

    Torques per newton balance a force on the platform in the worst direction of its translations. They are
    infinite if t_s moves the platform's point, and NaN for a platform that only turns.
    """

    kinds: Names  # of NAMES, in this order; empty for a regular pose
    legs: Names  # Type 1: actuators that can move while the platform rests
    twists: Array  # (k, n) Type 2: independent twists t_s on the platform's axes, of unit size (`twist_norm`)
    corank: int  # number of independent motions that locked motors do not hold, of platform or joints
    corank_inverse: int  # number of independent motions of the joints with the platform locked
    gained: int  # number of instantaneous freedoms of the loops beyond the platform's n
    contact: str  # of the direction `along` with the locus: transversal or tangential; "" without a direction
    g: float  # signed, zero at Type 2, leg-passive and constraint singularities
    sigma_A: float  # smallest singular value of A, dimensionless, 0 .. 1
    length: float  # [m] characteristic length of all dimensionless quantities
    torque_norm: float  # largest 2-norm of all motor torques per newton, joint side [N m/N, N/N for slides]
    torque_largest: float  # largest torque of a single motor per newton, joint side
    motor_torque_norm: float  # `torque_norm` on the motor side of the gears
    motor_torque_largest: float  # `torque_largest` on the motor side
    pressure_angle: Array  # (n_a,) [rad], NaN where undefined
    transmission_angle: Array  # (n_a,) [rad], complement of the pressure angle

    @property
    def regular(self) -> bool:
        """Whether the pose is not singular at all."""
        return not self.kinds

    @property
    def sentence(self) -> str:
        """The kinds of singularity in one line."""
        if self.regular:
            return "regular"
        names = " and ".join(NAMES[kind] for kind in self.kinds)
        details = [f"corank {self.corank}"] if self.corank > 1 else []
        details += [f"motors {', '.join(self.legs)} move while the platform rests"] if self.legs else []
        details += [f"{self.contact} contact"] if self.contact else []
        return f"{names} singularity" + (f" ({'; '.join(details)})" if details else "")


def classify(robot: ParallelRobot, q: ArrayLike, *, along: ArrayLike | None = None) -> Classification:
    """Classify the singularities of an assembled configuration, and compute its distances.

    A pose is singular if a singular value, in radians and characteristic lengths, is below 1e-7. A pose with
    a least value of 4e-5, for instance, is regular, although near a singularity. Springs keep the deflections
    of q.

    Args:
        q: an assembled configuration (nq,), or a result of `assemble` or `forward_kinematics`.
        along: rates (n,) of the platform's coordinates. With them the contact is classified: a path in this
            direction crosses the locus (transversal: g changes at first order) or touches it (tangential).

    Raises:
        InvalidInput: q has the wrong length, is not finite, or leaves the loops open; the number of platform
            axes differs from that of the degrees of freedom; or `along` is given at a pose where the platform
            does not determine the joints.
    """
    linearised = assembled_at(robot, q)
    require_square(robot)
    space = uncontrolled_space(robot, linearised)
    # (k, n + m) unit motions of the joints with the platform locked, motors first
    locked_motions = null_directions(type1_matrix(robot, linearised)[0])
    gained = max(space.freedoms - robot.n, 0)

    kinds = set(space.kinds)
    legs: Names = ()  # the motors that move while the platform rests
    motor_rates = locked_motions[:, : robot.n_a]
    # as many independent motions of the motors as the loops gain freedoms are not of Type 1
    if np.linalg.matrix_rank(motor_rates, tol=RANK_LOST) > gained:
        kinds.add("type_1")
        # null vectors are less accurate than singular values, hence the higher level
        moves = np.linalg.norm(motor_rates, axis=0) > RANK_LOST**0.5  # (n_a,)
        legs = tuple(np.array(robot.actuator_names)[moves].tolist())
    if space.corank and _is_singular_everywhere(robot, linearised.q[0]):
        kinds.add("architectural")

    contact = ""
    if along is not None and space.corank:
        if len(locked_motions):
            raise InvalidInput(
                f"along: the platform of {robot.name} does not determine its joints there (a Type 1 "
                f"singularity, or of its loops), so no path is followed"
            )
        contact = _classify_contact(robot, linearised, along, space.corank)

    twists = np.zeros((0, robot.n))
    if "type_2" in kinds:
        # unit twists (k, n) that span the space of those of the motions
        _, values, V_rows = np.linalg.svd(space.motions @ linearised.platform[0].T / robot.platform_scale)
        basis = V_rows[: np.count_nonzero(values > RANK_LOST)] * robot.platform_scale
        twists = np.array([twist / twist_norm(robot, twist) for twist in basis]).reshape(-1, robot.n)
    distances = Distances(robot, linearised)
    pressure_angle = pressure_angles(robot, distances.J)[0]
    norm, largest = distances.worst_torques(np.ones(robot.n_a))
    motor_norm, motor_largest = distances.worst_torques(robot.gear_ratio)
    return Classification(
        kinds=tuple(kind for kind in NAMES if kind in kinds),
        legs=legs,
        twists=twists,
        corank=space.corank,
        corank_inverse=len(locked_motions),
        gained=gained,
        contact=contact,
        length=robot.length,
        pressure_angle=pressure_angle,
        transmission_angle=np.pi / 2 - pressure_angle,
        g=float(signed_measure(robot, linearised)[0]),
        sigma_A=float(distances.sigma_A[0]),
        torque_norm=float(norm[0]),
        torque_largest=float(largest[0]),
        motor_torque_norm=float(motor_norm[0]),
        motor_torque_largest=float(motor_largest[0]),
    )


def _is_singular_everywhere(robot: ParallelRobot, q: Array) -> bool:
    """Return whether P has lost rank at the reference and at random poses near the reference and q (nq,).

    g is an analytic function of the pose. If it vanishes at a random pose, then with probability one it
    vanishes at all poses connected to that pose.
    """
    if clearance(robot, linearised_at_reference(robot))[0] >= RANK_LOST:
        return False
    poses = [*nearby_configurations(robot, robot.reference.q), *nearby_configurations(robot, q)]
    return bool(poses) and bool((clearance(robot, linearised_at(robot, np.array(poses))) < RANK_LOST).all())


def _classify_contact(robot: ParallelRobot, closed: LinearisedLoops, along: ArrayLike, corank: int) -> str:
    """Return the contact of a direction with the locus at a `closed` pose (T = 1): transversal or tangential.

    The contact is transversal if all `corank` vanishing singular values change at first order. With the
    border of the pose itself, their slopes are the singular values of dG along a unit motion of the joints.

    Args:
        along: rates (n,) of the platform's coordinates in the direction.
        corank: number of uncontrolled motions.
    """
    dx = finite_numbers(f"along ({', '.join(robot.axis_names)})", along, robot.n)
    twist, _ = robot.platform.twist(closed.x, dx[None])
    rates = joint_rates(robot, closed, twist)[0]
    size = np.linalg.norm(rates / robot.column_scale)  # dimensionless
    if size == 0.0:
        raise InvalidInput(f"along ({', '.join(robot.axis_names)}): must not be zero")
    unit_rates = rates / size  # (nv,)
    # central differences of G; to first order the loops stay closed
    steps = DIFFERENCE_STEP * np.array([-1.0, 0.0, 1.0])  # along the unit motion
    poses = integrate(robot, np.repeat(closed.q, 3, axis=0), steps[:, None] * unit_rates)
    matrices = type2_matrix(robot, linearised_at(robot, poses))
    G_back, _, G_ahead = solve_bordered(matrices, Border.of(matrices[1], corank)).G
    slope = (G_ahead - G_back) / (2 * DIFFERENCE_STEP)
    return "transversal" if least_singular_values(slope) > TANGENTIAL_SLOPE else "tangential"
