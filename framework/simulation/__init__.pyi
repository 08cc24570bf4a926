from framework.simulation.drive import PlannedMotion
from framework.simulation.equations import State
from framework.simulation.simulate import Simulation, simulate
from framework.simulation.stepper import Stepper
from framework.simulation.trajectory import Event, Occurrence

__all__ = ["Event", "Occurrence", "PlannedMotion", "Simulation", "State", "Stepper", "simulate"]
