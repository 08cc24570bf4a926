"""The 5R with elastic rods and massless links, on the deformed robot: the reference of stage f.

Nothing of the framework but closed_form.py's legs. Without mass in the links the rods' elongations are,
instant by instant, the solution of two equations in two unknowns,

    k eps_i = l_i |p_i|,   l_1 p_1 + l_2 p_2 = -m x"     with p_i the rods of length L + eps_i,

solved by Newton's method in fifty digits. The point that is singular lies where the deformed rods are
parallel, and the law has to cross there: it is found by repeating law, elongations about the crossing,
singular point. The elongations at the crossing itself, where the equations are 0/0, come from the instants
around it.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from framework.numerics import Array
from tests.benchmarks.chart import closed_form as rigid

SMOOTHNESS = 4  # derivatives of s that vanish at both ends
AROUND, WIDTH = 44, Decimal("0.5")  # instants about the crossing, and how far they reach [s]
SETTLED = Decimal("1e-17")  # change of the singular point in s that ends the repetition
MOST, ENOUGH = 60, Decimal("1e-40")  # steps of Newton's method, and its last one [m]
Pair = tuple[Decimal, Decimal]


@dataclass(frozen=True)
class ElasticMotion:
    """Scene C on the deformed robot whose stiffnesses are `scale` times the paper's."""

    motion: rigid.ExactMotion
    scale: Decimal

    def rods(self, times: Array) -> Array:
        """Elongations of both rods (T, 2) [m] at times (T,) [s]."""
        with localcontext(prec=rigid.DIGITS):
            return np.array([self._at(Decimal(float(t))) for t in times], dtype=float)

    def _at(self, t: Decimal) -> Pair:
        return elongations(self.motion, t, rigid.ROD_STIFFNESS * self.scale)


def followed(motion: rigid.ExactMotion, times: Iterable[Decimal], stiffness: Decimal) -> list[Pair]:
    """eps (2,) [m] at each of the instants, from one to the next: extrapolated from the two before.

    Raises:
        ArithmeticError: as `elongations`.
    """
    known: list[tuple[Decimal, Pair]] = []
    for t in times:
        start = known[-1][1] if known else (Decimal(0), Decimal(0))
        if len(known) > 1:
            (t_0, (a_0, b_0)), (t_1, (a_1, b_1)) = known[-2:]
            share = (t - t_1) / (t_1 - t_0)
            start = a_1 + share * (a_1 - a_0), b_1 + share * (b_1 - b_0)
        known.append((t, elongations(motion, t, stiffness, start)))
    return [eps for _, eps in known]


def _load(motion: rigid.ExactMotion, t: Decimal) -> rigid.Vector:
    """What the rods have to give the payload, with the sign of `shares` [N]."""
    push, way = -rigid.PAYLOAD * motion.law(t, 2), rigid.on_line(Decimal(0), 1)
    return push * way[0], push * way[1]


def elongations(
    motion: rigid.ExactMotion, t: Decimal, stiffness: Decimal, start: Pair = (Decimal(0), Decimal(0))
) -> Pair:
    """eps (2,) [m] at one instant.

    Raises:
        ArithmeticError: Newton's method from `start`, the unloaded robot by default, finds none.
    """
    x, load = rigid.on_line(motion.law(t)), _load(motion, t)

    def lacking(eps: Pair) -> Pair:
        legs = rigid.legs(x, eps)
        share = rigid.shares(legs, load)
        lengths = (rigid.LENGTH + eps[0], rigid.LENGTH + eps[1])
        return eps[0] - share[0] * lengths[0] / stiffness, eps[1] - share[1] * lengths[1] / stiffness

    eps = start
    for _ in range(MOST):
        here = lacking(eps)
        one, two = lacking((eps[0] + rigid.STEP, eps[1])), lacking((eps[0], eps[1] + rigid.STEP))
        a, c = (one[0] - here[0]) / rigid.STEP, (one[1] - here[1]) / rigid.STEP
        b, d = (two[0] - here[0]) / rigid.STEP, (two[1] - here[1]) / rigid.STEP
        determinant = a * d - b * c
        step = (here[0] * d - here[1] * b) / determinant, (here[1] * a - here[0] * c) / determinant
        eps = eps[0] - step[0], eps[1] - step[1]
        if max(abs(step[0]), abs(step[1])) < ENOUGH:
            return eps
    raise ArithmeticError(f"no elongations found at t = {t:.6g} s")


@lru_cache(maxsize=32)
def elastic_motion(scale: float = 1.0) -> ElasticMotion:
    """The motion that crosses the deformed robot's singular point.

    Raises:
        ArithmeticError: the singular point does not settle.
    """
    nodes = np.cos(np.pi * (np.arange(AROUND) + 0.5) / AROUND)
    at_zero = chebyshev.chebvander(np.zeros(1), AROUND - 1) @ np.linalg.inv(
        chebyshev.chebvander(nodes, AROUND - 1)
    )
    with localcontext(prec=rigid.DIGITS):
        factor = Decimal(scale)
        s_c = rigid.singular_s()
        for _ in range(MOST):
            motion = rigid.ExactMotion(rigid.law_through(s_c, Decimal(0), SMOOTHNESS), s_c, Decimal(0))
            eps = [
                elongations(
                    motion, rigid.CROSSING_TIME + WIDTH * Decimal(float(x)), rigid.ROD_STIFFNESS * factor
                )
                for x in nodes
            ]
            there = [
                sum(
                    (Decimal(float(w)) * pair[k] for w, pair in zip(at_zero[0], eps, strict=True)), Decimal(0)
                )
                for k in (0, 1)
            ]
            before, s_c = s_c, rigid.singular_s(there)
            if abs(s_c - before) < SETTLED:
                return ElasticMotion(motion, factor)
    raise ArithmeticError(f"stiffness times {scale:g}: the singular point does not settle")
