"""Forces of the undeformed robot on the robot as it deforms.

What goes wrong: planned with small displacements, the crossing lies where the rigid robot is singular. The
rods stretch by 0.07 mm, the locus moves with them, and in a band about the old point the deformed robot has
no equilibrium at all: the equation for the stretch is quadratic there, with a negative discriminant.
Why: condition (8) holds at a point that is no longer singular, not at the one that is. The band is as wide
as the deflections: it goes as 1/k and never closes.
What we do: singular point, condition and deflections are found together, in a few passes. The equilibrium
then holds through the crossing, at each instant.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import robots
from framework import NoAnswer, ParallelRobot, inverse_dynamics, plan_crossing
from tests.oracles.planar import (
    CROSSING_SPEED,
    CROSSING_TIME,
    DURATION,
    END,
    LINE,
    PAYLOAD,
    START,
    crossing_coordinate,
    exact,
    legs,
    mp,
    on_line,
    power_law,
    value,
)

STIFFNESS = 350000.0  # [N/m] of the paper's rods
PATH_LENGTH = float(np.hypot(0.15, 0.15))  # [m]


def with_rods(stiffness: float) -> ParallelRobot:
    """The flexible 5R with rods of this stiffness [N/m]."""
    description = robots.load("five_bar").description
    springs = tuple(
        replace(spring, stiffness=(stiffness,)) if spring.part == "link" else spring
        for spring in description.springs
    )
    return ParallelRobot.from_description(replace(description, springs=springs), flexibility="flexible_links")


@cache
def plan(geometry: str, stiffness: float = STIFFNESS):
    return plan_crossing(
        with_rods(stiffness),
        LINE,
        duration=DURATION,
        times=[CROSSING_TIME],
        speeds=[CROSSING_SPEED],
        geometry=geometry,
    )


def imbalance(x, y, push, stretch, stiffness):
    """W_p + k (e_1 u_1 + e_2 u_2) [N] on the deformed robot: zero in equilibrium, smooth everywhere."""
    total = list(push)
    for (_, (px, py)), longer in zip(legs(x, y, stretch), stretch, strict=True):
        size = (px**2 + py**2) ** 0.5
        total[0] += stiffness * longer * px / size
        total[1] += stiffness * longer * py / size
    return total


@cache
def band(stiffness: float) -> tuple[float, float]:
    """Instants [s] between which no equilibrium exists when the crossing is left at the rigid point.

    Both are folds: equilibrium with a singular derivative, found with fifty digits from the last equilibria
    that can be followed towards the crossing.
    """
    law = power_law((crossing_coordinate(), mp.mpf(CROSSING_SPEED), mp.zero), smoothness=4)
    direction = [exact(END[k]) - exact(START[k]) for k in range(2)]
    k = mp.mpf(stiffness)

    def equations(first, second, t):
        x, y = on_line(mp.mpf(value(law, t)))
        push = [PAYLOAD * value(law, t, 2) * d for d in direction]

        def balance(a, b):
            return [part / k for part in imbalance(x, y, push, (a, b), k)]

        h = mp.mpf(10) ** -20
        here = balance(first, second)
        across = [
            [(p - q) / h for p, q in zip(balance(*moved), here, strict=True)]
            for moved in ((first + h, second), (first, second + h))
        ]
        return [*here, across[0][0] * across[1][1] - across[0][1] * across[1][0]]

    found = []
    for first, second, t in _near_folds(law, direction, float(k)):
        root = mp.findroot(equations, (mp.mpf(first), mp.mpf(second), mp.mpf(t)), tol=1e-60, maxsteps=60)
        found.append(float(root[2]))
    return min(found), max(found)


def _near_folds(law, direction, k):
    """Last equilibria that can be followed towards the crossing, from before and from behind."""
    powers = [float(c) for c in law]
    for side in (-1.0, 1.0):
        step, stretch = 1e-2, np.zeros(2)
        gap = 0.02
        while step > 1e-9:
            t = CROSSING_TIME + side * (gap - step)
            new = _equilibrium(powers, direction, k, t, stretch)
            if new is None or gap - step < -0.1:
                step *= 0.5
                continue
            gap, stretch = gap - step, new
        yield (*stretch, CROSSING_TIME + side * gap)


def _equilibrium(powers, direction, k, t, stretch):
    """Newton's method on the balance at one instant; None where it does not settle nearby."""
    law = np.polynomial.Polynomial(powers)
    s, dds = float(law(t)), float(law.deriv(2)(t))
    x, y = on_line(s)
    push = [PAYLOAD * dds * float(d) for d in direction]
    e = np.array(stretch)
    for _ in range(30):
        here = np.array(imbalance(x, y, push, e, k)) / k
        slope = np.column_stack(
            [(np.array(imbalance(x, y, push, e + h, k)) / k - here) / 1e-7 for h in 1e-7 * np.eye(2)]
        )
        step = np.linalg.solve(slope, -here)
        e = e + step
        if np.abs(e).max() > 1e-2:
            return None
        if np.abs(step).max() < 1e-13:
            return e if np.abs(e - stretch).max() < 1e-3 + 0.5 * np.abs(stretch).max() else None
    return None


def unbalanced(
    geometry: str, stiffness: float = STIFFNESS, count: int = 201
) -> tuple[np.ndarray, np.ndarray]:
    """Instants [s] within 10 ms of the crossing and |imbalance| [N] of a plan's deflections there.

    Taken on the deformed robot, in the closed form.
    """
    motion = plan(geometry, stiffness)
    times, left = np.linspace(CROSSING_TIME - 0.01, CROSSING_TIME + 0.01, count), []
    for t in times:
        x, push = motion.platform(t), PAYLOAD * motion.platform(t, 2)
        left.append(imbalance(float(x[0]), float(x[1]), push, motion.deflection(t)[2:], stiffness))
    return times, np.abs(left).max(axis=1)


def test_left_at_the_rigid_point_the_deformed_robot_has_no_torques():
    law = plan("rigid").law
    with pytest.raises(NoAnswer):
        inverse_dynamics(with_rods(STIFFNESS), LINE, law, geometry="deformed")


@pytest.mark.parametrize("stiffness", [STIFFNESS, 1e3 * STIFFNESS])
def test_our_deflections_balance_through_the_crossing(stiffness):
    small_displacements, ours = (unbalanced(geometry, stiffness)[1] for geometry in ("rigid", "deformed"))
    load = PAYLOAD * np.abs(plan("deformed", stiffness).platform(np.linspace(0, DURATION, 99), 2)).max()
    assert ours.max() < 1e-11 * load
    assert small_displacements.max() > 1e-5 * load * STIFFNESS / stiffness
