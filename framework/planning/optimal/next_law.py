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

import numpy as np

from framework.numerics.arrays import Array
from framework.numerics.cone_program import AffineRows, Unsolved
from framework.numerics.sparse_rows import SparseRows
from framework.planning.optimal.best_law import Best, make_best
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.least_cost import NoneFound, cost_of
from framework.planning.optimal.smooth_search import NEARLY_SETTLED, find_exceeded_places
from framework.planning.optimal.speed_program import Bounds, Speed, SpeedProgram, Units
from framework.tolerances import LIMIT_MARGIN

SMOOTHNESS_WEIGHT, INERTIA_FACTOR = 8e-4, 2.0  # the factor if springs carry inertia, which rough laws shake
ROUGHNESS_POWER, MODERATE_ROUGHNESS = 0.25, 100.0
MAX_PROGRAMS, SETTLED_COST = 5, 1e-3  # about one motion; relative change of the cost in the last of these
TOLERANCE = 1e-7  # of a program

Model = tuple[dict[str, Array], AffineRows]  # linear cost and square rows, of `SpeedProgram.minimise`


def find_next_law(best: Best, problem: LawProblem) -> Best | NoneFound:
    """Find the law of least cost and roughness near a motion in balance.

    Each program models the cost and required durations about the law of the last one, and has rows where that
    law exceeds limits between the points.

    Args:
        best: a similar law, with the cells and the longest duration of its search.
        problem: a problem with the response of the motion.
    """
    assert problem.response is not None
    specification = problem.specification
    goal = specification.goal
    program = SpeedProgram.on_cells(problem, best.program.cells)
    speed = program.evaluate_speed(problem.response.y)
    units = Units(speed.duration, 1.0 if specification.limited else speed.peak)
    is_required = np.isfinite(problem.stages)
    longest = None if goal == "time" else specification.longest or best.search.duration_limit
    stages = problem.bound_stages(longest)
    if stages is not None:  # required durations are tangents
        stages = np.where(is_required, np.inf, stages)
    bounds = Bounds(stages if stages is not None and np.isfinite(stages).any() else None)

    def solve(program: SpeedProgram, former: Speed, model: Model) -> Speed | Unsolved:
        """Solve the program with a model about a former law, and the tangents of required durations there."""
        rows = "peak_torque" if goal == "peak_torque" else "curvature"
        about = (former.y, problem.stages, True) if is_required.any() else None
        return program.minimise(rows, bounds, units, about=about, tolerance=TOLERANCE, model=model)

    # at first, rows where the motion itself is near to a limit or its peak
    exceeded = find_exceeded_places(program, speed, Bounds(peak=(1.0 - 2.0 * LIMIT_MARGIN) * speed.peak))
    for _ in range(MAX_PROGRAMS):
        program = program.extend(exceeded) if len(exceeded) else program
        former = speed
        found = solve(program, former, _model_cost(program, former.y, units))
        if isinstance(found, Unsolved) or not np.isfinite(found.duration):
            return NoneFound(program, found.status if isinstance(found, Unsolved) else "z is not positive")
        speed = found
        peak = speed.peak if goal == "peak_torque" else None
        exceeded = find_exceeded_places(program, speed, bounds._replace(peak=peak))
        is_settled = abs(cost_of(goal, speed) / cost_of(goal, former) - 1.0) < SETTLED_COST
        if is_settled and not len(exceeded):
            break
    least = solve(program, speed, _model_cost(program, speed.y, units, smoothness=0.0))
    if isinstance(least, Unsolved) or cost_of(goal, least) > cost_of(goal, speed):
        least = speed
    least = least._replace(least_duration=least.duration)
    search = best.search._replace(program=program, units=units, least=least)
    adjusted = search.adjust(speed, NEARLY_SETTLED) if is_required.any() else speed
    if adjusted is None:
        return NoneFound(program, "required durations are not met")
    return make_best(search, adjusted)


def _model_cost(
    program: SpeedProgram, y_0: Array, units: Units, smoothness: float = SMOOTHNESS_WEIGHT
) -> Model:
    """Return linear cost and square rows on y of goal and roughness about y_0 (n,)."""
    problem = program.problem
    assert problem.response is not None
    weights = program.weights[1:-1]  # (P,)
    z_0 = program.z @ y_0  # (P,) [1/s^2]
    relative = program.z.scale(1.0 / (z_0 * units.time**2))  # (P, n) rows of z / z_0
    time = weights * z_0**-0.5  # (P,) [s]
    cost = dict[str, Array]()
    # roughness: the derivative of weight r^power is that of weight power r_0^(power - 1) r
    bends = program.bends  # (P, n)
    squared_mean = float(weights @ z_0) ** 2
    roughness = float(np.sum((bends @ y_0) ** 2)) / squared_mean + 1.0  # 1 of a straight z
    weight = smoothness * (INERTIA_FACTOR if problem.response.holds_rest else 1.0)
    weight *= ROUGHNESS_POWER * (roughness / MODERATE_ROUGHNESS) ** ROUGHNESS_POWER / roughness
    matrix = bends * (np.sqrt(weight / squared_mean) / units.time**2)
    offset = np.zeros(len(weights))

    def add_squares(rows: SparseRows, constant: Array, root: Array) -> None:
        """Add the squares of root (P,) times rows (P, n) plus constant (P,)."""
        nonlocal matrix, offset
        matrix = matrix.append(rows.scale(root))
        offset = np.append(offset, root * constant)

    if problem.specification.goal == "time":
        share = time / time.sum()
        cost["y"] = -0.5 * share @ relative
        add_squares(relative, -np.ones(len(share)), np.sqrt(0.375 * share))
    elif problem.specification.goal == "energy":
        inner = slice(1, len(time) + 1)
        torques = [torque(y_0)[inner] for torque in program.rows.torque] / problem.reference[:, None]
        energy = time @ (torques**2).sum(axis=0)
        for T_0, (by_y, rest), reference in zip(torques, program.rows.torque, problem.reference, strict=True):
            change = by_y[inner] / (reference * units.time**2) + relative.scale(-0.5 * T_0)
            add_squares(change, rest[inner] / reference + 0.5 * T_0, np.sqrt(time / energy))
            add_squares(relative, np.ones(len(time)), np.sqrt(time / (8.0 * energy)) * T_0)
    else:
        cost["peak"] = np.array([units.torque / program.evaluate_speed(y_0).peak])
    return cost, AffineRows({"y": matrix}, offset)
