"""Andrews' squeezer, program 1: the published equations in descriptor form, integrated in 34 digits.

M(p) p'' + G(p)' lambda = f(p, p'), G(p) p'' = -G' p', with the seven relative angles p and six multipliers as
printed in F. Mazzia and C. Magherini, Test Set for Initial Value Problem Solvers, release 2.4, University of
Bari 2008 (Hairer and Wanner, Solving Ordinary Differential Equations II, section VII.7): the midpoint rule,
extrapolated (Gragg, Bulirsch and Stoer). Nothing is shared with `energy.py`, nor with the framework.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from mpmath.ctx_mp import MPContext

DIGITS = 34
NAMES = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
COLUMNS = 12  # of the extrapolation, from 2, 4, .. 24 steps of the midpoint rule: order 24
mp = MPContext()  # of its own: the precision of the others is left alone
mp.dps = DIGITS
mpf = mp.mpf


def numbers(text: str) -> Iterator[Any]:
    return map(mpf, text.split())


MOM, DURATION = mpf("0.033"), mpf("0.03")  # [N m], [s]
m1, m2, m3, m4, m5, m6, m7 = numbers("0.04325 0.00365 0.02373 0.00706 0.0705 0.00706 0.05498")  # [kg]
i1, i2, i3, i4, i5, i6, i7 = numbers("2.194e-6 4.41e-7 5.255e-6 5.667e-7 1.169e-5 5.667e-7 1.912e-5")
xa, ya, xb, yb, xc, yc = numbers("-0.06934 -0.00227 -0.03635 0.03273 0.014 0.072")  # [m]
d, da, e, ea, zf, fa, rr, ra = numbers("0.028 0.0115 0.02 0.01421 0.02 0.01421 0.007 0.00092")
ss, sa, sb, sc, sd, ta, tb = numbers("0.035 0.01874 0.01043 0.018 0.02 0.02308 0.00916")
u, ua, ub, zt, l0, c0 = numbers("0.04 0.01228 0.00449 0.04 0.07785 4530")  # [m], c0 [N/m]

Vector = list[Any]  # of mpmath's numbers


def loops(p: Vector) -> Vector:
    """g(p) [m]."""
    beta, theta, gamma, phi, delta, omega, epsilon = p
    x = rr * mp.cos(beta) - d * mp.cos(beta + theta)
    y = rr * mp.sin(beta) - d * mp.sin(beta + theta)
    return [
        x - ss * mp.sin(gamma) - xb,
        y + ss * mp.cos(gamma) - yb,
        x - e * mp.sin(phi + delta) - zt * mp.cos(delta) - xa,
        y + e * mp.cos(phi + delta) - zt * mp.sin(delta) - ya,
        x - zf * mp.cos(omega + epsilon) - u * mp.sin(epsilon) - xa,
        y - zf * mp.sin(omega + epsilon) + u * mp.cos(epsilon) - ya,
    ]


def start() -> Vector:
    """Angles with theta = 0 that close the loops, next to the printed ones."""
    printed = numbers("-0.06171389 0.45527982 0.22266839 0.48736498 -0.22266839 1.23054744")
    beta, *others = mp.findroot(lambda *q: loops([q[0], mpf(0), *q[1:]]), list(printed))
    return [beta, mpf(0), *others]


def accelerations(p: Vector, v: Vector) -> Vector:
    """p'' (7,) [rad/s^2]."""
    beta, theta, gamma, phi, delta, omega, epsilon = p
    dbeta, dtheta, dgamma, dphi, ddelta, domega, depsilon = v
    (cb, sb_), (cbt, sbt), (cg, sg) = (mp.cos_sin(a) for a in (beta, beta + theta, gamma))
    (cd, sd_), (cpd, spd), (ce, se), (coe, soe) = (
        mp.cos_sin(a) for a in (delta, phi + delta, epsilon, omega + epsilon)
    )
    (ct, st), (cp, sp), (co, so) = (mp.cos_sin(a) for a in (theta, phi, omega))
    n, w = e - ea, zf - fa
    a = mp.matrix(13, 13)
    a[0, 0] = m1 * ra**2 + m2 * (rr**2 - 2 * da * rr * ct + da**2) + i1 + i2
    a[0, 1] = a[1, 0] = m2 * (da**2 - da * rr * ct) + i2
    a[1, 1] = m2 * da**2 + i2
    a[2, 2] = m3 * (sa**2 + sb**2) + i3
    a[3, 3] = m4 * n**2 + i4
    a[3, 4] = a[4, 3] = m4 * (n**2 + zt * n * sp) + i4
    a[4, 4] = m4 * (zt**2 + 2 * zt * n * sp + n**2) + m5 * (ta**2 + tb**2) + i4 + i5
    a[5, 5] = m6 * w**2 + i6
    a[5, 6] = a[6, 5] = m6 * (w**2 - u * w * so) + i6
    a[6, 6] = m6 * (w**2 - 2 * u * w * so + u**2) + m7 * (ua**2 + ub**2) + i6 + i7
    xd, yd = sd * cg + sc * sg + xb, sd * sg - sc * cg + yb
    length = mp.hypot(xd - xc, yd - yc)
    force = -c0 * (length - l0) / length
    fx, fy = force * (xd - xc), force * (yd - yc)
    right = [
        MOM - m2 * da * rr * dtheta * (dtheta + 2 * dbeta) * st,
        m2 * da * rr * dbeta**2 * st,
        fx * (sc * cg - sd * sg) + fy * (sd * cg + sc * sg),
        m4 * zt * n * ddelta**2 * cp,
        -m4 * zt * n * dphi * (dphi + 2 * ddelta) * cp,
        -m6 * u * w * depsilon**2 * co,
        m6 * u * w * domega * (domega + 2 * depsilon) * co,
    ]
    crank = (-rr * sb_ + d * sbt, d * sbt, rr * cb - d * cbt, -d * cbt)  # dx/dbeta, dx/dtheta, dy/..
    bt, pd, oe = dbeta + dtheta, dphi + ddelta, domega + depsilon
    xx = -rr * cb * dbeta**2 + d * cbt * bt**2  # what of x'' and y'' has no p''
    yy = -rr * sb_ * dbeta**2 + d * sbt * bt**2
    for row in range(6):
        for column in (0, 1):
            a[7 + row, column] = crank[column + 2 * (row % 2)]
    a[7, 2], a[8, 2] = -ss * cg, -ss * sg
    a[9, 3], a[9, 4], a[10, 3], a[10, 4] = -e * cpd, -e * cpd + zt * sd_, -e * spd, -e * spd - zt * cd
    a[11, 5], a[11, 6], a[12, 5], a[12, 6] = zf * soe, zf * soe - u * ce, -zf * coe, -zf * coe - u * se
    for row in range(7, 13):
        for column in range(7):
            a[column, row] = a[row, column]
    right += [
        -(xx + ss * sg * dgamma**2),
        -(yy - ss * cg * dgamma**2),
        -(xx + e * spd * pd**2 + zt * cd * ddelta**2),
        -(yy - e * cpd * pd**2 + zt * sd_ * ddelta**2),
        -(xx + zf * coe * oe**2 + u * se * depsilon**2),
        -(yy + zf * soe * oe**2 - u * ce * depsilon**2),
    ]
    return list(mp.lu_solve(a, right))[:7]


def slope(y: Vector) -> Vector:
    """d(p, p')/dt."""
    return [*y[7:], *accelerations(y[:7], y[7:])]


def moved(y: Vector, h: Any, by: Vector) -> Vector:
    return [a + h * b for a, b in zip(y, by, strict=True)]


def midpoint(y: Vector, first: Vector, step: Any, count: int) -> Vector:
    """Gragg's rule over a step in so many parts, with its smoothing."""
    h = step / count
    before, here = y, moved(y, h, first)
    for _ in range(count - 1):
        before, here = here, moved(before, 2 * h, slope(here))
    return [(a + b + h * c) / 2 for a, b, c in zip(before, here, slope(here), strict=True)]


def extrapolated(y: Vector, step: Any) -> Vector:
    """One step of order 2 COLUMNS."""
    first, rows = slope(y), list[list[Vector]]()
    for i in range(COLUMNS):
        row = [midpoint(y, first, step, 2 * (i + 1))]
        for j in range(i):
            factor = 1 / ((mpf(i + 1) / (i - j)) ** 2 - 1)
            row.append([a + (a - b) * factor for a, b in zip(row[j], rows[i - 1][j], strict=True)])
        rows.append(row)
    return list(rows[-1][-1])


def angles(steps: int) -> Vector:
    """The angles (7,) [rad] at the end."""
    y = [*start(), *[mpf(0)] * 7]
    for _ in range(steps):
        y = extrapolated(y, DURATION / steps)
    return y[:7]
