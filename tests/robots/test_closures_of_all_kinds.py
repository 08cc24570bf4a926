"""The witnesses of the generated tests, for the kinds of closure that the catalogue has not.

A closure is written three times: rows in the framework, rows in `tests.oracles.closure_rows`, and a chain
of real joints in `tests.oracles.joint_chain`. They must say the same.
"""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import ParallelRobot, plan_scene
from framework.model.description import CLOSURE_KINDS, Closure, locked_axes
from tests.oracles.closure_rows import closure_errors, closure_rows
from tests.oracles.forward_simulation import kinematics
from tests.oracles.joint_chain import chain, urdf
from tests.oracles.placements import placements
from tests.robots.back_on_path import BACK, misses
from tests.robots.cut_elsewhere import cut_elsewhere, openings
from tests.robots.every_robot import assert_same_torques
from tests.urdf_edits import add_fixed_link

PAIR = '<robot name="pair"><link name="ground"/><link name="one"/><link name="two"/></robot>'
KINDS = {f"{kind} {axis}": locked_axes(kind, axis) for kind in CLOSURE_KINDS for axis in "xyz"}
KINDS |= {"rotations": ("rx", "ry", "rz"), "list": ("x", "rz"), "free": ()}
CLOSURES = {
    name: Closure("joint", ("one", "two"), axes, 0.7 if "distance" in axes else None)
    for name, axes in KINDS.items()
}
FLOATING = Closure("float", ("ground", "one"), ())


def start(closure):
    """A pose that the closure allows."""
    return pin.SE3(np.eye(3), np.array([0.0, 0.0, closure.length or 0.0]))


def pair(closure, pose):
    """Two bodies on the chain of the closure, the first of them free; the model and q at the pose."""
    edges, values = chain(FLOATING, "ground", "one", pin.SE3.Identity())
    joints, more = chain(closure, "one", "two", pose)
    model = pin.buildModelFromXML(urdf(PAIR, [*edges, *joints]))
    q = pin.neutral(model)
    for name, value in (values | more).items():
        q[model.joints[model.getJointId(name)].idx_q] = value
    return model, q


@pytest.mark.parametrize("kind", CLOSURES)
def test_a_chain_of_joints_moves_as_the_rows_allow(kind):
    closure = CLOSURES[kind]
    model, q = pair(closure, start(closure))
    data, rng = model.createData(), np.random.default_rng(3)
    for _ in range(4):
        q, v = q + 0.5 * rng.standard_normal(model.nq), rng.standard_normal(model.nv)
        kinematics(model, data, q, v)
        rows = closure_rows(model, data, [closure])
        np.testing.assert_allclose(closure_errors(model, data, [closure]), 0, atol=1e-14)
        np.testing.assert_allclose(rows.jacobian, 0, atol=1e-14)
        np.testing.assert_allclose(rows.drift, 0, atol=1e-12)  # products of ten rates of order one
        again = data.oMf[model.getFrameId("one")].actInv(data.oMf[model.getFrameId("two")])
        other, there = pair(closure, again)
        one, two = placements(other, ("one", "two"), there)
        np.testing.assert_allclose(one.actInv(two).homogeneous, again.homogeneous, atol=1e-14)


@pytest.mark.parametrize("kind", CLOSURES)
def test_rows_are_the_derivatives_of_the_errors_and_as_many_as_are_locked(kind):
    closure = CLOSURES[kind]
    through, q = pair(closure, start(closure))
    data, rng = through.createData(), np.random.default_rng(4)
    kinematics(through, data, q + 0.5 * rng.standard_normal(through.nq), np.zeros(through.nv))
    pose = data.oMf[through.getFrameId("one")].actInv(data.oMf[through.getFrameId("two")])
    free = replace(closure, axes=(), length=None)
    model, q = pair(free, pose)
    q[:6] += rng.standard_normal(6)
    data, v, h = model.createData(), rng.standard_normal(model.nv), 1e-6

    def errors(at):
        kinematics(model, data, at, np.zeros(model.nv))
        return closure_errors(model, data, [closure])

    rate = (errors(q + h * v) - errors(q - h * v)) / (2 * h)
    np.testing.assert_allclose(errors(q), 0, atol=1e-14)
    jacobian = closure_rows(model, data, [closure]).jacobian
    np.testing.assert_allclose(jacobian @ v, rate, atol=1e-8)  # h^2 and eps / h
    assert np.linalg.matrix_rank(jacobian, tol=1e-9) == 12 - through.nv


def without_right_rod(description):
    """The 5R whose right rod, which has no mass, is a distance."""
    root = ElementTree.fromstring(description.urdf_text)
    for name in ("right_rod", "right_tip"):
        root.remove(root.find(f"link[@name='{name}']"))
    for name in ("right_elbow", "right_rod_tip"):
        root.remove(root.find(f"joint[@name='{name}']"))
    add_fixed_link(root, "right_end", "right_crank", "0.25 0 0")
    return replace(
        description,
        urdf_text=ElementTree.tostring(root, encoding="unicode"),
        closures=(Closure("rod", ("right_end", "left_tip"), locked_axes("distance"), 0.25),),
        springs=(),
        reference={k: v for k, v in description.reference.items() if k != "right_elbow"},
    )


@pytest.mark.parametrize("kind", ["cylindrical z", "universal x", "distance"])
def test_the_5r_with_another_closure_of_its_plane_is_the_same_robot(kind):
    plan = plan_scene(robots.load("five_bar"), "C")
    description = plan.robot.description
    if kind == "distance":
        description = without_right_rod(description)
    else:
        axes = KINDS.get(kind, ("x", "y"))
        description = replace(description, closures=(replace(description.closures[0], axes=axes),))
    robot = ParallelRobot.from_description(description)
    other = plan_scene(robot, "C")
    assert_same_torques(plan, other)
    assert np.abs(misses(robot, other, rtol=1e-11)).max() < BACK
    (closure,) = description.closures
    for opening in openings(description, closure):
        cut = ParallelRobot.from_description(cut_elsewhere(description, closure, opening))
        assert_same_torques(plan, plan_scene(cut, "C"))
