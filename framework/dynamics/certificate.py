"""The numbers by which a motion with its torques proves itself."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Certificate:
    """How well a result is resolved.

    nodes: Chebyshev nodes in time, all panels together.
    tail: largest of the last Chebyshev coefficients of the torques over the largest one. A torque
        with a pole, however narrow, cannot have a small tail.
    passes: how often forces and deflections were computed in turn.
    change: largest change of a deflection in the last pass [m or rad].
    max_closure_error: largest loop or platform equation, half-way between the nodes, of the
        coordinates as functions of time [m or rad].
    monotone: the law advances at all instants between its ends.
    """

    nodes: int
    tail: float
    passes: int
    change: float
    max_closure_error: float
    monotone: bool
