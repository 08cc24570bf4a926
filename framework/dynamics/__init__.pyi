from framework.dynamics.finite_differences import FiniteDifferenceTorques, finite_difference_torques
from framework.dynamics.forward_dynamics import ForwardDerivatives, forward_derivatives
from framework.dynamics.instant import Instant
from framework.dynamics.loaded_measure import LoadedPoint
from framework.dynamics.loading import LOAD_WORDS, LoadedStack, LoadReason, loaded_stack
from framework.dynamics.motor_friction import PlannedFriction
from framework.dynamics.platform_wrench import (
    ActionLines,
    Hold,
    PlatformLimits,
    PlatformWrench,
    hold_at,
    platform_limits,
)
from framework.dynamics.pointwise_dynamics import DynamicsDerivatives, dynamics_at, dynamics_derivatives
from framework.dynamics.result import Certificate, InverseDynamics, SingularityCrossing
from framework.dynamics.stiffness import PlatformStiffness, platform_stiffness
from framework.dynamics.vibrations import Vibrations, platform_vibrations

__all__ = [
    "LOAD_WORDS",
    "ActionLines",
    "Certificate",
    "DynamicsDerivatives",
    "FiniteDifferenceTorques",
    "ForwardDerivatives",
    "Hold",
    "Instant",
    "InverseDynamics",
    "LoadReason",
    "LoadedPoint",
    "LoadedStack",
    "PlannedFriction",
    "PlatformLimits",
    "PlatformStiffness",
    "PlatformWrench",
    "SingularityCrossing",
    "Vibrations",
    "dynamics_at",
    "dynamics_derivatives",
    "finite_difference_torques",
    "forward_derivatives",
    "hold_at",
    "loaded_stack",
    "platform_limits",
    "platform_stiffness",
    "platform_vibrations",
]
