"""Forward dynamics in all coordinates: what the robot does when given torques drive it."""

from framework.dynamics.simulation.drive import PlannedMotion
from framework.dynamics.simulation.events import Event, Occurrence
from framework.dynamics.simulation.result import Simulation
from framework.dynamics.simulation.schemes import State
from framework.dynamics.simulation.simulate import simulate
from framework.dynamics.simulation.stepper import Stepper

__all__ = ["Event", "Occurrence", "PlannedMotion", "Simulation", "State", "Stepper", "simulate"]
