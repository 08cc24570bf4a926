"""Configurations in many small steps from the reference, closed by Newton's method without a certificate.

What follows paths and motors in as few steps as it dares is held against these: `lead` goes along platform
coordinates, `turn` along motors. Where two results differ more steps are tried, since beside a singularity
few leave the branch.
"""

from collections.abc import Callable

import numpy as np

from framework import NoAnswer, ParallelRobot
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import frames_at, integrate
from framework.kinematics.linearised_loops import linearised_at, type1_matrix

SAME = 1e-6  # [rad, robot lengths] between two ways to a pose of one branch
STEPS = (64, 1024, 16384)  # the finer ones where the others do not agree
CLOSINGS = 20  # steps of Newton's method: far from closed beside a Type 1 singularity, each halves the error
CLOSED = 1e-8  # [rad, robot lengths]: a step of Newton's method this small leaves its square
PLACES = np.linspace(0.0, 1.0, 9)  # of a path, where configurations are compared
# of the least singular value at the reference: a way that ends within 1e-7 of its length before a Type 1
# singularity is as near as the square root of that
SINGULAR = 0.02


class Cubic:
    """The path x(s) = c0 + c1 s + c2 s^2 + c3 s^3 with coefficients (4, n)."""

    knots = np.zeros(0)

    def __init__(self, coefficients: np.ndarray) -> None:
        self.coefficients, self.n = coefficients, coefficients.shape[1]

    def __call__(self, s, order: int = 0) -> np.ndarray:
        derived = np.polynomial.polynomial.polyder(self.coefficients, order)
        return np.moveaxis(np.polynomial.polynomial.polyval(np.asarray(s, dtype=float), derived), 0, -1)


def draw_path(robot: ParallelRobot, k: int, rng: np.random.Generator) -> Cubic:
    """A path as far as 0.6 radians and robot lengths; straight and curved by turns, half from the reference.

    Many cross the singular locus, many leave the workspace. Curved ones are passed at an uneven speed.
    """
    reach = rng.uniform(0.02, 0.6) * robot.platform_scale
    start = robot.reference.x + (k // 2 % 2) * 0.5 * reach * rng.uniform(-1, 1, robot.n)
    return Cubic(np.vstack([start, rng.uniform(-1, 1, (3, robot.n)) * reach * [[1.0], [k % 2], [k % 2]]]))


def lead(robot: ParallelRobot, course: np.ndarray, closings: int = CLOSINGS) -> np.ndarray:
    """Configurations (K, nq) at platform coordinates (K, n), of which the first is near the reference."""
    q, moved = robot.reference.q[None], np.zeros((1, robot.model.nv))
    passed = np.empty((len(course), q.shape[1]))
    for k, x in enumerate(course):
        for _ in range(closings):
            linearised = linearised_at(robot, q, x[None])
            jacobian = linearised.jacobian[:, :, robot.moving]
            moved[:, robot.moving] = -np.linalg.solve(jacobian, linearised.residual[..., None])[..., 0]
            q = integrate(robot, q, moved)
            if np.abs(moved / robot.column_scale).max() < CLOSED:
                break
        passed[k] = q[0]
    return passed


def turn(robot: ParallelRobot, turns: np.ndarray, steps: int) -> np.ndarray:
    """Configurations (T, nq) to which motors lead that turn by `turns` (T, n_a) in so many steps of Euler."""
    q = np.repeat(robot.reference.q[None], len(turns), axis=0)
    moved = np.zeros((len(turns), robot.model.nv))

    def passive(jacobian: np.ndarray, gap: np.ndarray) -> np.ndarray:
        return -np.linalg.solve(jacobian[:, :, robot.following], gap[..., None])[..., 0]

    for k in range(steps):
        moved[:, robot.actuated], moved[:, robot.following] = turns / steps, 0.0
        jacobian = loop_equations(robot.loops, frames_at(robot, q)).jacobian
        moved[:, robot.following] = passive(jacobian, np.einsum("tmv,tv->tm", jacobian, moved))
        q = q + moved
        for _ in range(2 if k < steps - 1 else 6):  # beside a singularity two are too few at the end
            loops = loop_equations(robot.loops, frames_at(robot, q))
            q[:, robot.following] += passive(loops.jacobian, loops.residual)
    return q


def are_same(robot: ParallelRobot, q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Which configurations (..., nq) are of one branch."""
    return np.abs((q - other) / robot.column_scale).max(axis=-1) < SAME


def is_followed(robot: ParallelRobot, path: Callable, q: np.ndarray) -> bool:
    """Whether small steps lead along a path to its configurations q (9, nq) at `PLACES`."""
    for steps in STEPS:
        first = np.linspace(robot.reference.x, path(0.0), steps // 4 + 1)
        course = np.concatenate([first, path(np.linspace(0.0, 1.0, steps + 1))])
        passed = lead(robot, course, 2 if steps < STEPS[-1] else CLOSINGS)
        if are_same(robot, passed[-steps - 1 :: steps // 8], q).all():
            return True
    return False


def ends_at_singularity(robot: ParallelRobot, path: Callable, refusal: NoAnswer) -> bool:
    """Whether small steps come to where the platform hardly determines the joints, when a path is refused."""
    usual = least_singular_value(robot, robot.reference.q)
    to_path = "the way from the reference" in str(refusal)
    for steps in STEPS:
        first = np.linspace(robot.reference.x, path(0.0), steps // 4 + 1)
        s = refusal.s * np.minimum(np.linspace(0.0, 1.0, steps + 1) * (steps + 1) / (steps - 7), 1.0)
        last = robot.reference.x + s[:, None] * (path(0.0) - robot.reference.x) if to_path else path(s)
        passed = lead(robot, last if to_path else np.concatenate([first, last]), 2)
        if least_singular_value(robot, passed[-1]) < SINGULAR * usual:
            return True
    return False


def least_singular_value(robot: ParallelRobot, q: np.ndarray) -> float:
    """Of the equations along the joints that move, without dimension."""
    matrix = type1_matrix(robot, linearised_at(robot, q[None], None))
    return float(np.linalg.svd(matrix, compute_uv=False)[0, -1])
