"""The numbers by which a motion with its torques proves itself."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Certificate:
    """How well a result is resolved.

    nodes: Chebyshev nodes in time, all panels together.
    tail: largest of the last Chebyshev coefficients of torques and deflections over the largest one.
        A pole leaves coefficients of the size of its residue, which do not fall with more nodes.
    passes: how often forces and deflections were computed in turn.
    change: largest change of a deflection in the last pass [m or rad].
    max_closure_error: largest loop or platform equation, half-way between the nodes, of the
        coordinates as functions of time [m or rad].
    end_speed: largest motor speed at both ends over the largest one on the way. Zero when the law is
        smooth enough; an elastic robot whose springs carry inertia needs more smoothness than its default.
    monotone: the law advances at all instants between its ends.
    """

    nodes: int
    tail: float
    passes: int
    change: float
    max_closure_error: float
    end_speed: float
    monotone: bool
