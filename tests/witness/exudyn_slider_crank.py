"""The slider-crank of the catalogue in Exudyn, driven by the force of its screw, elastic or not.

Lengths of Norton, "Design of Machinery", Example 4-2, masses as in the catalogue's file; crank, rod and
slider are bodies in a vertical plane, y up. An elastic rod has a massless slider at its tip, an elastic
screw the inertia of its rotor ahead of it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tests.benchmarks.chart.peers.exudyn_parts import ANGLE, Mechanism, X

CRANK, ROD, OFFSET = 0.04, 0.12, -0.02  # [m]
CRANK_MASS, CRANK_CENTRE, CRANK_INERTIA = 2.05, 0.001, 0.0082  # [kg], [m], [kg m^2] about its centre of mass
ROD_MASS, ROD_CENTRE, ROD_INERTIA = 0.12, 0.06, 1.5e-4
SLIDER_MASS = 0.3
GEAR_RATIO = 2 * np.pi / 0.02  # [rad/m], a lead of 20 mm
ROTOR_INERTIA = 5e-6 * GEAR_RATIO**2  # as a mass at the slider [kg]


class Springs(NamedTuple):
    """Stiffness [N/m] and deflection at the start [m]; None is rigid."""

    screw: tuple[float, float] | None = None
    rod: tuple[float, float] | None = None
    rotor_speed: float = 0.0  # of a rotor ahead of an elastic screw, at the start [m/s]


def simulate(
    springs: Springs, force: Callable[[np.ndarray], np.ndarray], start: float, *, step: float, duration: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times (T,) [s] and crank angles (T,) [rad], from rest at the crank angle `start` [rad].

    `force` maps times (T,) [s] to motor torques (T,) [N m].
    """
    steps = round(duration / step)
    step = duration / steps
    length = ROD + (springs.rod[1] if springs.rod else 0.0)
    pin = CRANK * np.array([np.cos(start), np.sin(start)])
    rod_angle = np.arcsin((OFFSET - pin[1]) / length)
    along = np.array([np.cos(rod_angle), np.sin(rod_angle)])
    tip = pin + length * along

    mechanism = Mechanism(gravity=(0.0, -9.81))
    crank = mechanism.link(CRANK_MASS, CRANK_INERTIA, CRANK_CENTRE / CRANK * pin, start)
    mechanism.pin(mechanism.point(mechanism.ground((0, 0))), mechanism.point(crank, -CRANK_CENTRE))
    rod = mechanism.link(ROD_MASS, ROD_INERTIA, pin + ROD_CENTRE * along, rod_angle)
    crank_pin = mechanism.point(crank, CRANK - CRANK_CENTRE)
    mechanism.pin(crank_pin, mechanism.point(rod, -ROD_CENTRE))
    slider_mass = SLIDER_MASS + (0.0 if springs.screw else ROTOR_INERTIA)
    slider = mechanism.link(slider_mass, 0.0, tip, 0.0)
    mechanism.slide(mechanism.ground((0, OFFSET)), 0.0, slider)
    end = mechanism.point(rod, ROD - ROD_CENTRE)
    if springs.rod:
        sleeve = mechanism.link(0.0, 0.0, tip, rod_angle)
        mechanism.slide(rod, ROD - ROD_CENTRE, sleeve)
        end = mechanism.point(sleeve)
        mechanism.spring([crank_pin, end], ROD, springs.rod[0])
    mechanism.pin(end, mechanism.point(slider))
    motor = mechanism.coordinate(slider, X)
    if springs.screw:
        stiffness, ahead = springs.screw
        motor = mechanism.rotor(ROTOR_INERTIA, motor, stiffness, offset=ahead, speed=springs.rotor_speed)
    mechanism.drive(motor, GEAR_RATIO * force(step * np.arange(steps + 1)), step)
    times, moved, _ = mechanism.run(crank, steps=steps, duration=duration)
    return times, start + moved[:, ANGLE]
