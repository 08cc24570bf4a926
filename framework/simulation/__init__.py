"""Forward dynamics in all coordinates: what the robot does when given torques drive it."""

from framework.simulation.drive import PlannedMotion
from framework.simulation.events import Event, Occurrence
from framework.simulation.result import Simulation
from framework.simulation.schemes import State
from framework.simulation.simulate import simulate
from framework.simulation.stepper import Stepper

__all__ = ["Event", "Occurrence", "PlannedMotion", "Simulation", "State", "Stepper", "simulate"]
