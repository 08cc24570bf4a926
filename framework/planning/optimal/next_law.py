"""The next law of an elastic robot: quadratic programs about a motion in balance.

Torques T are linear in the squared speed z about the motion (`torque_response`). About any law z_0 with
torques T_0 and d = (z - z_0) / z_0, to second order,

    duration = integral of z_0^(-1/2) (1 - d/2 + 3 d^2/8),
    energy = integral of z_0^(-1/2) ((T - T_0 d/2)^2 + T_0^2 ((d + 2)^2/8 - 1/2)),

and the peak torque is an unknown. The cost is this goal over its value at z_0, and
SMOOTHNESS_WEIGHT (r / MODERATE_ROUGHNESS)^(1/4) with the roughness r, the integral of (z")^2 over the squared
mean of z. It has no unit, and grows slowly, so that one weight serves rough and smooth laws.
"""

from __future__ import annotations

from functools import reduce

import numpy as np

from framework.laws.optimal_law import OptimalLaw
from framework.numerics.arrays import Array
from framework.numerics.cone_program import AffineRows, Unsolved
from framework.numerics.sparse_rows import SparseRows
from framework.planning.optimal.best_law import Best, make_best
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.least_cost import NoneFound, cost_of
from framework.planning.optimal.smooth_search import NEARLY_SETTLED, SAME_DURATION, find_exceeded_places
from framework.planning.optimal.speed_program import Bounds, Speed, SpeedProgram, Units
from framework.tolerances import LIMIT_MARGIN

SMOOTHNESS_WEIGHT, INERTIA_FACTOR = 8e-4, 2.0  # the factor if springs carry inertia, which rough laws shake
ROUGHNESS_POWER, MODERATE_ROUGHNESS = 0.25, 100.0
MAX_PROGRAMS, SETTLED_COST = 5, 1e-3  # about one motion; relative change of the cost in the last of these
TOLERANCE = 1e-7  # of a program


def evaluate_in_balance(best: Best, law: OptimalLaw, problem: LawProblem) -> Best:
    """Compute the costs of a law in balance, with rows where its motion is near to limits.

    Args:
        best: the optimum to which the law is nearest, with the cells of its search.
        problem: a problem with the response of the motion.
    """
    program = SpeedProgram.on_cells(problem, best.program.cells)
    speed = program.evaluate_speed(law.coefficients)
    near = find_exceeded_places(program, speed, Bounds(peak=(1.0 - 2.0 * LIMIT_MARGIN) * speed.peak))
    if len(near):
        program = program.extend(near)
        speed = program.evaluate_speed(law.coefficients)
    units = Units(speed.duration, 1.0 if problem.specification.limited else speed.peak)
    return Best(law, best.search._replace(program=program, units=units), speed)


def find_next_law(best: Best, trust: float, share: float) -> Best | NoneFound:
    """Find the law of least cost and roughness near a motion in balance.

    Each program models the cost and required durations about the law of the last one, and has rows where that
    law exceeds limits between the points.

    Args:
        best: the law of the motion (`evaluate_in_balance`).
        trust: share of z by which the law may differ.
        share: of the limits that may be used.
    """
    program, units, speed = best.program, best.search.units, best.speed
    problem = program.problem
    assert problem.response is not None
    goal = problem.specification.goal
    is_required = np.isfinite(problem.stages)  # (m,)
    longest = None if goal == "time" else problem.specification.longest or best.search.duration_limit
    if longest is not None:  # by the quadrature of the program, which differs from that of the law
        longest *= 1.0 - SAME_DURATION
    stages = problem.bound_stages(longest)
    if stages is not None:  # required durations are tangents
        stages = np.where(is_required, np.inf, stages)
    bounds = Bounds(stages if stages is not None and np.isfinite(stages).any() else None, share=share)
    z_0 = program.positive_rows @ speed.y  # (m,) of the motion about which torques are linear
    floor, cap = (1.0 - trust) * z_0, (1.0 + trust) * z_0

    def solve(about: Array, smoothness: float) -> Speed | Unsolved:
        """Solve the program with models of cost and required durations about y (n,)."""
        model = _model_cost(program, about, units, smoothness)
        tangents = (about, problem.stages, True) if is_required.any() else None
        rows = "peak_torque" if goal == "peak_torque" else "curvature"
        return program.minimise(
            rows, bounds, units, floor=floor, cap=cap, about=tangents, tolerance=TOLERANCE, model=model
        )

    exceeded = np.empty(0)
    weight = SMOOTHNESS_WEIGHT * (INERTIA_FACTOR if problem.response.holds_rest else 1.0)
    for _ in range(MAX_PROGRAMS):
        program = program.extend(exceeded) if len(exceeded) else program
        former = speed
        found = solve(former.y, weight)
        if isinstance(found, Unsolved) or not np.isfinite(found.duration):
            return NoneFound(program, found.status if isinstance(found, Unsolved) else "z is not positive")
        speed = found
        peak = speed.peak if goal == "peak_torque" else None
        exceeded = find_exceeded_places(program, speed, bounds._replace(peak=peak))
        is_settled = abs(cost_of(goal, speed) / cost_of(goal, former) - 1.0) < SETTLED_COST
        if is_settled and not len(exceeded):
            break
    least = solve(speed.y, 0.0)
    if isinstance(least, Unsolved) or cost_of(goal, least) > cost_of(goal, speed):
        least = speed
    least = least._replace(least_duration=least.duration)
    search = best.search._replace(program=program, least=least)
    adjusted = search.adjust(speed, NEARLY_SETTLED) if is_required.any() else speed
    if adjusted is None:
        return NoneFound(program, "required durations are not met")
    return make_best(search, adjusted)


def _model_cost(
    program: SpeedProgram, y_0: Array, units: Units, smoothness: float
) -> tuple[dict[str, Array], AffineRows]:
    """Return linear cost and square rows on y, for `SpeedProgram.minimise`, of goal and roughness about y_0.

    Args:
        smoothness: weight of the roughness.
    """
    problem = program.problem
    weights = program.weights[1:-1]  # (P,)
    z_0 = program.z @ y_0  # (P,) [1/s^2]
    relative = program.z.scale(1.0 / (z_0 * units.time**2))  # (P, n) rows of z / z_0
    time = weights * z_0**-0.5  # (P,) [s]
    # roughness: the derivative of weight r^power is that of weight power r_0^(power - 1) r
    squared_mean = float(weights @ z_0) ** 2
    roughness = float(np.sum((program.bends @ y_0) ** 2)) / squared_mean + 1.0  # 1 of a straight z
    weight = smoothness * ROUGHNESS_POWER * (roughness / MODERATE_ROUGHNESS) ** ROUGHNESS_POWER / roughness
    bends = program.bends * (np.sqrt(weight / squared_mean) / units.time**2)
    squares = [(bends, np.zeros(len(z_0)))]  # rows (P, n) and constants (P,)

    cost = dict[str, Array]()
    if problem.specification.goal == "time":
        share = time / time.sum()
        root = np.sqrt(0.375 * share)
        cost["y"] = -0.5 * share @ relative
        squares.append((relative.scale(root), -root))
    elif problem.specification.goal == "energy":
        torques = [
            (matrix[1 : len(time) + 1] / reference, offset[1 : len(time) + 1] / reference)
            for (matrix, offset), reference in zip(program.rows.torque, problem.reference, strict=True)
        ]  # over the reference, (P, n) and (P,) of each motor
        values = [matrix @ y_0 + offset for matrix, offset in torques]  # T_0 (P,)
        root = np.sqrt(time / (time @ np.sum(np.square(values), axis=0)))
        for T_0, (matrix, offset) in zip(values, torques, strict=True):
            change = matrix / units.time**2 + relative.scale(-0.5 * T_0)
            squares.append((change.scale(root), root * (offset + 0.5 * T_0)))
            root_of_second = root * T_0 / np.sqrt(8.0)
            squares.append((relative.scale(root_of_second), root_of_second))
    else:
        cost["peak"] = np.array([units.torque / program.evaluate_speed(y_0).peak])
    matrices, constants = zip(*squares, strict=True)
    return cost, AffineRows({"y": reduce(SparseRows.append, matrices)}, np.concatenate(constants))
