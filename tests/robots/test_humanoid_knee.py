"""The four-bar knee against its loop solved in closed form, and against Lagrange in 60 digits."""

from xml.etree import ElementTree

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import brentq

from framework import locate_singularities, plan_scene
from framework.planning.scenes import scene_path
from tests.oracles.closed_form import Kinematics
from tests.oracles.one_degree import OneDegree, crossing, instants

ROBOT = "humanoid_knee"
THIGH, CRANK, ROD, PIN, BEHIND = 0.22, 0.045, 0.21, 0.045, 0.5  # [m], and the pin below straight back [rad]
GEAR, ROTOR = 18, 1.963e-4
SCENE = {"ends": (1.2, 2.4), "duration": 0.6}


def pin(x):
    """The pin (x, z) of the shank at flexion x, the knee in (0, 0)."""
    m = mp if isinstance(x, mp.mpf) else np
    return -PIN * m.cos(x - BEHIND), PIN * m.sin(x - BEHIND)


def motor(x):
    """Angle of the crank whose tip (-cos q, sin q) is a rod above the pin: where two circles meet [rad]."""
    m = mp if isinstance(x, mp.mpf) else np
    px, pz = pin(x)
    dx, dz = -px, pz - THIGH  # from the motor to the pin, x backward
    reach = m.sqrt(dx * dx + dz * dz)
    along = m.atan2(dz, dx) if m is mp else np.arctan2(dz, dx)
    return along + m.acos((CRANK**2 + reach**2 - ROD**2) / (2 * CRANK * reach))


def tip(x):
    m = mp if isinstance(x, mp.mpf) else np
    return -CRANK * m.cos(motor(x)), THIGH + CRANK * m.sin(motor(x))


def linkage(urdf) -> OneDegree:
    """Masses of the URDF, which are read from it: every body moves in a plane."""
    masses = {}
    for body in urdf.findall("link"):
        if body.find("inertial") is not None:
            at = [float(v) for v in body.find("inertial/origin").get("xyz").split()]
            mass = float(body.find("inertial/mass").get("value"))
            masses[body.get("name")] = (at[0], at[2], mass, float(body.find("inertial/inertia").get("iyy")))

    def turned(angle, px, pz):
        return mp.cos(angle) * px + mp.sin(angle) * pz, -mp.sin(angle) * px + mp.cos(angle) * pz

    def places(x):
        """Centre (x, z) and angle of each body, about y."""
        (tx, tz), (px, pz) = tip(x), pin(x)
        rod = mp.atan2(tx - px, tz - pz)
        (sx, sz), (fx, fz) = (turned(x, *masses[name][:2]) for name in ("shank", "foot"))
        ax, az = turned(x, mp.mpf(0), -mp.mpf("0.28"))
        cx, cz = turned(motor(x), *masses["crank"][:2])
        rx, rz = turned(rod, *masses["rod"][:2])
        return {
            "shank": (sx, sz, x),
            "foot": (ax + fx, az + fz, x),
            "crank": (cx, THIGH + cz, motor(x)),
            "rod": (tx + rx, tz + rz, rod),
        }

    def inertia(x):
        total = mp.mpf(0)
        for name, (_, _, mass, moment) in masses.items():
            dx, dz, turn = (mp.diff(lambda y, k=k, name=name: places(y)[name][k], x) for k in range(3))
            total += mass * (dx**2 + dz**2) + moment * turn**2
        return total

    def potential(x):
        return mp.mpf(9.81) * sum(masses[name][2] * place[1] for name, place in places(x).items())

    return OneDegree(motor, inertia, potential, mp.mpf(GEAR), mp.mpf(ROTOR))


def aligned(x):
    """Zero where tip, pin and knee are in line."""
    (tx, tz), (px, pz) = tip(x), pin(x)
    return tx * pz - tz * px


PLACES = np.random.default_rng(1).uniform(0.0, 2.6, (6, 1))
KINEMATICS = Kinematics(PLACES, motor, lambda x: [[float(mp.diff(motor, mp.mpf(x[0])))]], 1e-12, 1e-12)


def test_the_motor_loses_the_knee_where_the_rod_points_at_it(robot):
    exact = brentq(aligned, 1.5, 2.4, xtol=1e-15)
    (point,) = locate_singularities(robot, scene_path(robot.description.scenes["deep"]))
    assert point.s == pytest.approx((exact - 1.2) / 1.2, abs=1e-12)
    assert (point.kind, point.contact, point.corank) == ("type_2", "transversal", 1)
    np.testing.assert_allclose(point.twist, [1.0])
    assert not locate_singularities(robot, scene_path(robot.description.scenes["swing"]))


@pytest.mark.slow  # 60 digits of four bodies: 3 s
def test_torque_agrees_with_lagrange_at_the_crossing_too(robot):
    plan = plan_scene(robot, "deep")
    (there,) = plan.crossings
    urdf = ElementTree.fromstring(robot.description.urdf_text)
    exact = crossing(linkage(urdf), near=1.95, smoothness=2, time=there.time, speed=there.speed, **SCENE)
    assert there.s == pytest.approx(float(exact.s), abs=1e-12)
    assert there.residual < 1e-12
    times = instants(0.6, there.time, 4)
    expected = [exact.torque(t) for t in times]
    np.testing.assert_allclose(plan.torque(times)[:, 0], expected, rtol=0, atol=1e-9)  # of 0.77 N m
