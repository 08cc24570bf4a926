"""Standard deviations of platform and torques in the closed loop, from the linear equations, without runs.

A robot's deviations z from the plan, the filter's prediction z^ and the torques under way follow

    innovation  i = C z + D u - (C^ z^ + D^ u) + noise,   u the torque that acts, less the planned one
    estimate    z~ = z^ + L i
    command     -gain (z~, predicted through the torques under way)
    next        z = F z + G u,        z^ = F^ z~ + G^ u,

where F^, G^, C^, D^ are those of the controller's model, and F, G, C, D those of the robot, whose springs may
be others and whose z may have disturbances that the controller does not know. The spread of payload, friction
and springs are parts of z at the start. Independent starts, each of one standard deviation, and NOISE_SAMPLES
sequences of noise are advanced together, as columns of one matrix; the variance is the sum of squares over
the starts and the mean of squares over the noise. The filter's own covariance would be too hopeful, since it
knows only of what it estimates.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from framework.control.linear_model import LinearModel
from framework.numerics.arrays import Array

NOISE_SAMPLES = 32  # sequences of noise; the deviation that they cause is known to 1 / sqrt(64) = 12 %
NOISE_SEED = 20261129
LOST = 1e15  # deviation in units of z and of torques; larger ones are infinite, as the loop diverges


class Plant(NamedTuple):
    """A robot in discrete time, z_(k+1) = F_k z_k + G_k u_k, with readings y = C z + D u."""

    F: Array  # (K, N, N)
    G: Array  # (K, N, n_a)
    C: Array  # (K, s, N)
    D: Array  # (K, s, n_a)

    @staticmethod
    def of(model: LinearModel) -> Plant:
        """Return the plant of a linear model, without readings."""
        count, N, n_a = model.G.shape
        return Plant(model.F, model.G, np.zeros((count, 0, N)), np.zeros((count, 0, n_a)))


class Observer(NamedTuple):
    """A filter of s readings."""

    plant: Plant  # the controller's model, F^, G^, C^, D^
    gain: Array  # (K, N, s)
    noise: Array  # (s,) standard deviations of the readings


class Feedback(NamedTuple):
    """The torque -gain z: of z as observed and predicted through a known delay, or of z itself, late."""

    gain: Array  # (K, n_a, N), or (K, R, n_a, N) of R robots each with a gain of its own
    delay: int  # [periods]
    observer: Observer | None = None


class Deviation(NamedTuple):
    """Standard deviations of R robots along the plan; infinite after a loop diverges."""

    z: Array  # (R, K, N)
    torque: Array  # (R, K, n_a) of the torques less the planned ones [N m, N], motor side


def closed_loop_deviation(feedback: Feedback, robots: Sequence[Plant], start: Array) -> Deviation:
    """Compute the standard deviations of z and of the torques in the closed loop.

    Args:
        feedback: torques by z.
        robots: the R robots, of one structure.
        start: independent starts (N, c) of their z, each of one standard deviation.
    """
    count, N, n_a = robots[0].G.shape
    observer, delay = feedback.observer, feedback.delay
    model = robots[0] if observer is None else observer.plant
    random = np.random.default_rng(NOISE_SEED)
    start = start[:, start.any(axis=0)]
    starts = start.shape[1]
    samples = 0 if observer is None else NOISE_SAMPLES
    columns = starts + samples
    state = np.zeros((len(robots), N, columns))  # z
    state[:, :, :starts] = start
    predicted = np.zeros((len(robots), model.G.shape[1], columns))  # z^
    sent: list[Array] = []  # (R, n_a, columns) torques
    none = np.zeros((len(robots), n_a, columns))
    acting = none
    is_lost = np.zeros(len(robots), dtype=bool)
    shares = np.repeat([1.0, 1.0 / NOISE_SAMPLES], [starts, samples])  # (columns,) of squares in variances
    # variances, of which the roots are taken at the end
    z, torque = np.empty((len(robots), count, N)), np.empty((len(robots), count, n_a))
    parts = [list(zip(*part, strict=True)) for part in zip(*robots, strict=True)]  # by instant
    for k in range(count):
        F, G, C, D = (np.array(part[k]) for part in parts)
        z[:, k] = (state * state) @ shares
        estimate = state
        if observer is not None:
            innovation = C @ state - model.C[k] @ predicted + (D - model.D[k]) @ acting
            drawn = random.standard_normal((len(observer.noise), samples))
            innovation[..., starts:] += observer.noise[:, None] * drawn
            estimate = predicted + observer.gain[k] @ innovation
        # through the torques under way to the period in which the command acts
        target = min(k + delay, count - 1)
        ahead = estimate
        for j in range(k, k if observer is None else target):
            ahead = model.F[j] @ ahead + model.G[j] @ (sent[j - delay] if j >= delay else none)
        command = -feedback.gain[target] @ ahead
        is_lost |= ~(np.abs(command).max(axis=(1, 2)) < LOST)  # true for NaN
        command[is_lost] = 0.0  # later torques would grow from it without end
        torque[:, k] = (command * command) @ shares
        z[is_lost, k] = torque[is_lost, k] = np.inf
        sent.append(command)
        acting = sent[k - delay] if k >= delay else none
        state = F @ state + G @ acting
        predicted = model.F[k] @ estimate + model.G[k] @ acting
        is_lost |= ~(np.abs(state).max(axis=(1, 2)) < LOST)  # true for NaN
        state[is_lost], predicted[is_lost] = 0.0, 0.0
        if is_lost.all():
            z[:, k + 1 :], torque[:, k + 1 :] = np.inf, np.inf
            break
    return Deviation(np.sqrt(z), np.sqrt(torque))
