"""The standard deviation of platform and torques in the closed loop, by one linear recursion, without runs.

The robot's true deviations z, the filter's prediction z^ and the torques under way form one linear system:
with the readings y = C z + noise, of which the part of the torques is known,

    estimate    z~ = z^ + L (y - C z^)
    command     u = -gain (z~, predicted through the torques under way)
    next        z = F z + G (torque that acts),        z^ = F z~ + G (torque that acts).

Its covariance starts with the spread of payload, friction and springs of the robots, which are parts of z.
The filter's own covariance would be too hopeful, since it knows only of what it estimates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.control.linear_model import LinearModel
from framework.numerics.arrays import Array


class Observer(NamedTuple):
    """A filter of s readings."""

    C: Array  # (K, s, N)
    gain: Array  # (K, N, s)
    deviation: Array  # (s,) standard deviations of the readings


class Feedback(NamedTuple):
    """The torque -gain z of a known delay, from an estimate of z or, without observer, from z itself."""

    gain: Array  # (K, n_a, N)
    delay: int  # [periods]
    observer: Observer | None
    predicts: bool  # whether z is predicted through the delay


class Deviation(NamedTuple):
    """Standard deviations along the plan."""

    z: Array  # (K, N)
    torque: Array  # (K, n_a) of the torques less the planned ones [N m, N], motor side


def closed_loop_deviation(
    model: LinearModel, feedback: Feedback, start: Array, *, true: LinearModel | None = None
) -> Deviation:
    """Compute the standard deviations of z and of the torques in the closed loop.

    Args:
        model: linear model with K instants and N states.
        feedback: torques by z.
        start: standard deviations (N,) of z at the start.
        true: model of the robot, if it differs from that of the controller.
    """
    true = true or model
    count, N, n_a = model.G.shape
    observer, delay = feedback.observer, feedback.delay
    states = N if observer is None else 2 * N  # z, and z^
    size = states + delay * n_a  # and the torques under way
    covariance = np.zeros((size, size))
    covariance[range(N), range(N)] = start**2
    unit = np.eye(size)
    waiting = [unit[states + j * n_a : states + (j + 1) * n_a] for j in range(delay)]
    z, torque = np.empty((count, N)), np.empty((count, n_a))
    for k in range(count):
        z[k] = np.sqrt(np.maximum(np.diagonal(covariance)[:N], 0.0))
        estimate = unit[:N]  # (N, size) z~ by the state
        noise = np.zeros((N, 0))  # (N, s) z~ by the noise of the readings
        if observer is not None:
            L = observer.gain[k]
            estimate = unit[N:states] + L @ observer.C[k] @ (unit[:N] - unit[N:states])
            noise = L * observer.deviation
        # through the torques under way to the period in which the command acts
        target = min(k + delay, count - 1)
        ahead, ahead_noise = estimate, noise
        for j in range(target - k if feedback.predicts else 0):
            ahead = model.F[k + j] @ ahead + model.G[k + j] @ waiting[j]
            ahead_noise = model.F[k + j] @ ahead_noise
        command, command_noise = -feedback.gain[target] @ ahead, -feedback.gain[target] @ ahead_noise
        acting, acting_noise = (waiting[0], 0 * command_noise) if delay else (command, command_noise)

        rows = [true.F[k] @ unit[:N] + true.G[k] @ acting]
        noise_rows = [true.G[k] @ acting_noise]
        if observer is not None:
            rows.append(model.F[k] @ estimate + model.G[k] @ acting)
            noise_rows.append(model.F[k] @ noise + model.G[k] @ acting_noise)
        if delay:
            rows += [*waiting[1:], command]
            noise_rows += [*(0 * command_noise for _ in waiting[1:]), command_noise]
        variance = np.einsum("ij,jk,ik->i", command, covariance, command) + (command_noise**2).sum(axis=1)
        torque[k] = np.sqrt(np.maximum(variance, 0.0))
        step, step_noise = np.concatenate(rows), np.concatenate(noise_rows)
        with np.errstate(over="ignore", invalid="ignore"):  # of a loop that diverges
            covariance = step @ covariance @ step.T + step_noise @ step_noise.T
        if not np.abs(covariance).max() < 1e30:
            z[k + 1 :], torque[k + 1 :] = np.inf, np.inf
            break
    return Deviation(z, torque)
