"""Andrews' squeezer, program 2: one degree of freedom, and time as an integral over the crank's angle.

The crank never turns back, so its angle beta alone says where all bodies are, by the triangles of the loops.
The work of the constant torque is what the spring and the bodies have:

    A(beta) beta'^2 / 2 = torque (beta - beta_0) - V(beta) + V(beta_0),   t = integral of dbeta / beta'

with A from the velocities of the centres of mass in the axes of the base. beta = beta_0 + u^2 takes away the
root at the start; Gauss and Legendre's rule on equal pieces of u, and Newton's method for the u at which t is
the duration. Dimensions: W. Schiehlen (ed.), Multibody Systems Handbook, Springer 1990. No differential
equation, no multiplier; nothing is shared with `descriptor.py`, nor with the framework.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from mpmath.ctx_mp import MPContext

mp = MPContext()  # of its own: the precision of the others is left alone
mp.dps = 34
mpf, mpc = mp.mpf, mp.mpc
T, TORQUE = mpf("0.03"), mpf("0.033")  # [s], [N m]
A, B, C = (
    mpc("-0.06934", "-0.00227"),
    mpc("-0.03635", "0.03273"),
    mpc("0.014", "0.072"),
)  # hinges on the ground [m]
SHAPES = (  # of K1 to K7: centre of mass in the body's axes [m], mass [kg], moment of inertia [kg m^2]
    (mpc("0.00092"), mpf("0.04325"), mpf("2.194e-6")),
    (mpc("-0.0115"), mpf("0.00365"), mpf("4.410e-7")),
    (mpc("0.01874", "0.01043"), mpf("0.02373"), mpf("5.255e-6")),
    (mpc("0", "-0.00579"), mpf("0.00706"), mpf("5.667e-7")),
    (mpc("0.02308", "0.00916"), mpf("0.07050"), mpf("1.169e-5")),
    (mpc("0.00579"), mpf("0.00706"), mpf("5.667e-7")),
    (mpc("0.01228", "0.00449"), mpf("0.05498"), mpf("1.912e-5")),
)
CRANK, ROD, SWING, LONG, SHORT = (mpf(size) for size in ("0.007", "0.028", "0.035", "0.04", "0.02"))  # [m]
HOOK = mpc("0.02", "-0.018")  # of the spring, on K3 [m]
STIFFNESS, REST = mpf(4530), mpf("0.07785")  # [N/m], [m]


class Body(NamedTuple):
    """A rigid body: exp(i angle), a point of it and where that is, and both rates by beta."""

    axis: Any
    spin: Any  # d angle / d beta
    origin: Any
    velocity: Any  # d origin / d beta


def met(one: Any, near: Any, other: Any, far: Any, side: int) -> Any:
    """The point at `near` from one and `far` from other, left (1) or right (-1) of the way between them."""
    way = other - one
    square = abs(way) ** 2
    along = (near**2 - far**2 + square) / (2 * square)
    return one + (along + 1j * side * mp.sqrt(near**2 / square - along**2)) * way


def turned(bar: Any, bar_rate: Any) -> Any:
    """The angular rate of a bar of constant length with that rate."""
    return (mp.conj(bar) * bar_rate).imag / abs(bar) ** 2


def joined(one: Any, one_rate: Any, other: Any, other_rate: Any, joint: Any) -> Any:
    """The rate of the joint of two bars from points that move: both lengths stay."""
    p, q = joint - one, joint - other
    a, b = (mp.conj(p) * one_rate).real, (mp.conj(q) * other_rate).real  # p . w = a, q . w = b
    return 1j * (b * p - a * q) / (mp.conj(p) * q).imag


def bodies(beta: Any) -> tuple[Body, ...]:
    """All bodies, K1 to K7."""
    crank = mp.expj(beta)
    tip, tip_rate = CRANK * crank, 1j * CRANK * crank
    P = met(tip, ROD, B, SWING, 1)
    P_rate = joined(tip, tip_rate, B, 0, P)
    found = [
        Body(crank, mpf(1), mpc(0), mpc(0)),
        Body((tip - P) / ROD, turned(tip - P, tip_rate - P_rate), tip, tip_rate),
        Body((P - B) / SWING * 1j, turned(P - B, P_rate), B, mpc(0)),
    ]
    for side, upper, lower in (
        (1, 1j, 1),
        (-1, 1, 1j),
    ):  # K4 on K5, K6 on K7, and how their axes stand on them
        elbow = met(A, LONG, P, SHORT, side)
        rate = joined(A, 0, P, P_rate, elbow)
        found.append(Body((P - elbow) / SHORT * upper, turned(P - elbow, P_rate - rate), elbow, rate))
        found.append(Body((elbow - A) / LONG * lower, turned(elbow - A, rate), A, mpc(0)))
    return tuple(found)


def speed(beta: Any, begun: Any) -> Any:
    """beta' [rad/s] there, from rest at `begun`."""
    inertia = mpf(0)
    for body, (centre, mass, moment) in zip(bodies(beta), SHAPES, strict=True):
        rate = body.velocity + 1j * body.spin * body.axis * centre
        inertia += mass * abs(rate) ** 2 + moment * body.spin**2
    return mp.sqrt(2 * (TORQUE * (beta - begun) - stored(beta) + stored(begun)) / inertia)


def stored(beta: Any) -> Any:
    """Energy of the spring [N m]."""
    swing = bodies(beta)[2]
    return STIFFNESS * (abs(B + swing.axis * HOOK - C) - REST) ** 2 / 2


def begun() -> Any:
    """The crank's angle with the rod folded back on it (theta = 0)."""
    P = met(mpc(0), ROD - CRANK, B, SWING, 1)
    return mp.arg(-P)


def gauss(count: int) -> list[tuple[Any, Any]]:
    """Nodes and weights of Gauss and Legendre's rule on [-1, 1]."""
    rule = []
    for k in range(count):
        x = mp.cos(mp.pi * (k + mpf("0.75")) / (count + mpf("0.5")))
        for _ in range(7):
            value = mp.legendre(count, x)
            slope = count * (x * value - mp.legendre(count - 1, x)) / (x**2 - 1)
            x -= value / slope
        rule.append((x, 2 / ((1 - x**2) * slope**2)))
    return rule


def angles(pieces: int, nodes: int = 24) -> list[Any]:
    """beta, theta, gamma, phi, delta, omega, epsilon [rad] at the end; `pieces` a unit of u."""
    first = begun()
    rule = gauss(nodes)

    def rate(u: Any) -> Any:
        return 2 * u / speed(first + u**2, first)

    def spent(low: Any, high: Any) -> Any:
        half = (high - low) / 2
        return half * mp.fsum(weight * rate(low + half * (1 + x)) for x, weight in rule)

    u, t, piece = mpf(0), mpf(0), mpf(1) / pieces
    while t < T:
        u, t = u + piece, t + spent(u, u + piece)
    end = u
    for _ in range(8):
        end += (T - t - spent(u, end)) / rate(end)
    return printed(first + end**2)


def printed(beta: Any) -> list[Any]:
    """The angles of the test set, each next to zero but beta's and theta's, which go on turning."""
    k1, k2, k3, k4, k5, k6, k7 = (mp.arg(body.axis) for body in bodies(beta))
    theta = k2 - k1
    theta += 2 * mp.pi * mp.nint((-beta + begun() - theta) / (2 * mp.pi))
    return [beta, theta, k3, k4 - k5, k5, k6 - k7, k7]
