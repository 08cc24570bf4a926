"""The numbers by which a motion with its torques proves itself."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Certificate:
    """The numbers by which a result proves itself.

    nodes: Chebyshev nodes in time, all panels together.
    tail: largest of the last Chebyshev coefficients of torques and deflections over the largest one.
        A pole leaves coefficients of the size of its residue, which do not fall with more nodes.
    passes: evaluations of forces and deflections in turn, on all grids together.
    change: change of the deflections or the spring forces by one more pass, over the largest of them; 0 with
        rigid geometry, which neglects it.
    max_closure_error: largest loop or platform equation of the coordinates as functions of time [m or rad],
        on the nodes and half-way between them, redundant loop equations included.
    max_residual_torque: largest torque beside motors and springs that the planned motion would need in a
        joint, half-way between the nodes [N m or N]; idle joints are counted apart.
    max_held_torque: largest torque that would hold idle joints, such as a rod's spin about its own line, to
        their planned motion: at rest, or driven by damping or armature of balls [N m or N]. The motors'
        torques are wrong by its order. 0 without idle joints; at most `tolerances.HELD_IDLE` of a motor's
        largest torque on the joint side.
    end_speed: largest motor speed at both ends over the largest one on the way. Zero when the law is
        smooth enough; an elastic robot whose springs carry inertia needs more smoothness than its default.
    monotone: the law advances at all instants between its ends.
    rounded_gap: largest of the loop equations set aside because they repeat others but for rounding [m or
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
