"""The slider-crank against its loop equation solved in closed form, and against Lagrange in 60 digits."""

from dataclasses import replace
from xml.etree import ElementTree

import mpmath as mp
import numpy as np
import pytest

import robots
from framework import (
    Line,
    OutOfReach,
    ParallelRobot,
    Type1Singularity,
    assemble,
    locate_singularities,
    velocity_matrices,
)
from framework.atlas.nearest import nearest_singular_pose
from framework.model.description import Actuator, Closure, Platform
from framework.planning.scenes import scene_path
from tests.oracles.closed_form import Kinematics
from tests.oracles.one_degree import OneDegree

CRANK, ROD, OFFSET = 0.04, 0.12, -0.02  # [m], Norton, Design of Machinery, Example 4-2
CROSSED = "dead_centre"
NEAR, STIFFNESS = -0.1, 1e5  # [rad], [N/m] of the elastic screw
SCENE = {"ends": (1.0, -0.8), "duration": 1.0, "time": 0.57, "speed": 1.5}
OUTER = np.arcsin(OFFSET / (ROD + CRANK))  # dead centres: crank and rod on one line through the slider [rad]
INNER = -np.pi - np.arcsin(-OFFSET / (ROD - CRANK))
REACH = np.sqrt((ROD + CRANK) ** 2 - OFFSET**2)  # [m] of the slider, at the outer one


def rod_angle(crank):
    """Angle of the rod from the crank's pin to the slider [rad]."""
    m = mp if isinstance(crank, mp.mpf) else np
    sine = (OFFSET - CRANK * m.sin(crank)) / ROD
    return m.asin(sine) if m is mp else np.arcsin(sine)


def slider_position(crank):
    """Coordinate of the slider, right of the crank [m]."""
    m = mp if isinstance(crank, mp.mpf) else np
    return CRANK * m.cos(crank) + ROD * m.cos(rod_angle(crank))


def linkage() -> OneDegree:
    """Masses as in the URDF: the rod a bar with its centre of mass in the middle."""

    def inertia(x):
        rod = rod_angle(x)
        turn = -CRANK * mp.cos(x) / (ROD * mp.cos(rod))  # rod's rate over the crank's
        slide = -CRANK * mp.sin(x) - ROD * mp.sin(rod) * turn
        centre = CRANK**2 + (0.06 * turn) ** 2 + 2 * CRANK * 0.06 * turn * mp.cos(rod - x)
        crank = mp.mpf(0.0082) + mp.mpf(2.05) * mp.mpf(0.001) ** 2
        return crank + 0.12 * centre + mp.mpf(1.5e-4) * turn**2 + 0.3 * slide**2

    def potential(x):
        height = CRANK * mp.sin(x) + 0.06 * mp.sin(rod_angle(x))
        return mp.mpf(9.81) * (2.05 * mp.mpf(0.001) * mp.sin(x) + 0.12 * height)

    return OneDegree(slider_position, inertia, potential, mp.mpf(314.1592653589793), mp.mpf(5e-6))


def driven_at_the_crank() -> ParallelRobot:
    """The same mechanism the other way round: motor on the crank, the slider is the platform."""
    description = robots.load("slider_crank").description
    turned = replace(
        description, platform=Platform("slider", ("x",)), actuators=(Actuator("crank_bearing"),), springs=()
    )
    return ParallelRobot.from_description(turned)


def with_rod_as_distance() -> ParallelRobot:
    """The same with the rod a distance from the crank's pin to the slider: one passive joint, the crank."""
    description = robots.load("slider_crank").description
    root = ElementTree.fromstring(description.urdf_text)
    for name in ("crank_pin", "rod"):
        root.remove(root.find(f"*[@name='{name}']"))
    end = root.find("joint[@name='rod_end']")
    end.find("parent").set("link", "crank")
    end.find("origin").set("xyz", f"{CRANK} 0 0")
    reference = {name: description.reference[name] for name in ("crank_bearing", "slide")}
    closure = Closure("rod", ("rod_tip", "slider"), ("distance",), ROD)
    text = ElementTree.tostring(root, encoding="unicode")
    changed = replace(description, urdf_text=text, closures=(closure,), springs=(), reference=reference)
    return ParallelRobot.from_description(changed)


def test_with_one_passive_joint_the_nearest_singular_pose_is_a_dead_centre():
    robot = with_rod_as_distance()
    assert robot.n_p == 1
    found = nearest_singular_pose(robot, assemble(robot, [0.1]), within=0.3, max_cells=20)
    assert found.x[0] == pytest.approx(OUTER, abs=1e-9)
    assert 0.8 * found.distance < found.at_least <= found.distance


def velocity_ratio(x):
    """Of A x' = B q'."""
    rod = rod_angle(x[0])
    return np.array([[CRANK * np.sin(rod - x[0]) / np.cos(rod)]])


PLACES = np.random.default_rng(1).uniform(-5.2, 1.0, (8, 1))
KINEMATICS = Kinematics(PLACES, slider_position, velocity_ratio, 1e-12, 1e-12)


def test_the_textbook_example():
    # Norton's printed answers for a crank at 60 degrees: the branch whose slider is on the right at 126.8 mm,
    # its rod at 152.91 degrees measured from the slider
    q = assemble(robots.load("slider_crank"), [np.radians(60)]).q
    assert np.degrees(q[0] + q[1]) + 180 == pytest.approx(152.91, abs=0.01)
    assert 1e3 * q[2] == pytest.approx(126.8, abs=0.1)


def test_dead_centres_have_their_closed_form():
    robot = robots.load("slider_crank")
    points = locate_singularities(robot, scene_path(robot.description.scenes["full_turn"]))
    expected = [(1.0 - dead) / (2 * np.pi) for dead in (OUTER, INNER)]
    np.testing.assert_allclose([point.s for point in points], expected, rtol=0, atol=1e-12)
    for point in points:
        assert (point.kind, point.contact, point.corank) == ("type_2", "transversal", 1)
    assert not locate_singularities(robot, scene_path(robot.description.scenes["clear"]))


def test_driven_at_the_crank_a_dead_centre_is_type_1_and_the_end_of_the_way():
    robot = driven_at_the_crank()
    start = assemble(robot).x[0]
    assert not locate_singularities(robot, Line([start], [REACH - 1e-3]))
    with pytest.raises(Type1Singularity) as caught:
        locate_singularities(robot, Line([start], [REACH]))
    assert caught.value.s == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(OutOfReach) as caught:
        locate_singularities(robot, Line([start], [REACH + 0.01]))
    assert caught.value.platform[0] == pytest.approx(REACH, abs=1e-6)
    # A x' = B q' with B = 0 there, and A not
    near = velocity_matrices(robot, assemble(robot, [REACH - 1e-10]).q)
    assert abs(near.B[0, 0]) < 1e-4 * abs(near.A[0, 0])
