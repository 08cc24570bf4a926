"""The numbers by which a motion with its torques proves itself."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Certificate:
    """The numbers by which a result proves itself.

    nodes: Chebyshev nodes in time, all panels together.
    tail: largest of the last Chebyshev coefficients of torques and deflections over the largest one.
        A pole leaves coefficients of the size of its residue, which do not fall with more nodes.
    passes: how often forces and deflections were computed in turn, on all grids together.
    change: what one more pass would change the deflections or the spring forces by, over the largest of them;
        0 with rigid geometry, whose hypothesis is that it does not matter.
    max_closure_error: largest loop or platform equation, on the nodes and half-way between them, of the
        coordinates as functions of time [m or rad]; all loop equations, redundant ones too.
    max_residual_torque: largest torque that a joint would still have to give, beside motors and springs, for
        the motion to be as planned, half-way between the nodes [N m or N]. Joints without motor or spring
        have none to give; those that are idle are counted apart.
    max_held_torque: largest torque that would hold the joints whose motion moves no centre of mass, such as
        a rod's about its own line, as planned: still, or turning as damping or armature of its balls drives
        it [N m or N]; the motors' torques are wrong by its order.
        0 without such joints; at most `tolerances.HELD_IDLE` of a motor's largest torque on the joint side.
    end_speed: largest motor speed at both ends over the largest one on the way. Zero when the law is
        smooth enough; an elastic robot whose springs carry inertia needs more smoothness than its default.
    monotone: the law advances at all instants between its ends.
    rounded_gap: largest loop equation, of those that repeat others but for rounding and were left aside [m or
        rad]; 0 without such.
    """

    nodes: int
    tail: float
    passes: int
    change: float
    max_closure_error: float
    max_residual_torque: float
    max_held_torque: float
    end_speed: float
    monotone: bool
    rounded_gap: float = 0.0
