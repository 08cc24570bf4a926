"""Torques of converted files against MuJoCo's own reading of the same files, along the same motion.

MuJoCo reads the file itself. Its positions are set from the plan's, velocities and accelerations are central
differences of them (where balls drive idle turns, of our simulation under the planned torques, for the rods
turn there), `mj_inverse` says what the open tree needs, with the file's armature, damping and
springs, and the Jacobian of its equalities what the loops take off the joints without a motor.
"""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from framework import ParallelRobot, simulate
from framework.kinematics.diagnostics.proposal import propose
from framework.kinematics.inverse_kinematics import idle_turns
from framework.kinematics.linearised_loops import linearised_at_reference
from framework.model.readers import parse_any
from tests.model.readers.foreign_files import DATA, PLANNED, short_move, undamped, without_dry_friction
from tests.witness.installed import witness

mujoco = witness("mujoco", "mujoco")

BALL_AXES = ("_rx", "_ry", "_rz")
DIFFERENCE_STEP = 1e-4  # [s]


def mujoco_model(name):
    """MuJoCo's model of the file, without plugins, which only draw, and motors, whose torques are sought."""
    root = ElementTree.parse(DATA / name).getroot()
    for tag in ("extension", "actuator"):
        for element in root.findall(tag):
            root.remove(element)
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))


class SameMotion:
    """A motion, of a plan or simulated, in MuJoCo's coordinates; what is held rests where the file has it."""

    def __init__(self, model, plan, motion):
        self.model, self.data, self.plan, self.motion = model, mujoco.MjData(model), plan, motion
        self.names = plan.robot.coordinates.names
        joints = [model.joint(k) for k in range(model.njnt)]
        self.joints = {
            joint.name: joint
            for joint in joints
            if joint.name in self.names or joint.name + "_rx" in self.names
        }

    def qpos(self, t):
        q = self.motion.configuration(np.array([t]))
        value = dict(zip(self.names, self.plan.robot.coordinates.positions(q)[0], strict=True))
        qpos = (self.model.key_qpos[0] if self.model.nkey else self.model.qpos0).copy()
        for name, joint in self.joints.items():
            start = joint.qposadr[0]
            if name in value:
                qpos[start] = self.model.qpos0[start] + value[name]
            else:
                turn = pin.Quaternion(pin.exp3(np.array([value[name + axis] for axis in BALL_AXES])))
                qpos[start : start + 4] = turn.w, turn.x, turn.y, turn.z
        return qpos

    def rates(self, t):
        """Position, velocity and acceleration by central differences."""
        h = DIFFERENCE_STEP
        before, now, after = (self.qpos(t + k * h) for k in (-1, 0, 1))
        backward, forward = np.zeros(self.model.nv), np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, backward, h, before, now)
        mujoco.mj_differentiatePos(self.model, forward, h, now, after)
        return now, 0.5 * (backward + forward), (forward - backward) / h


def equality_jacobian(model, data):
    """Jacobian (rows, nv) of the equalities where `data` stands."""
    if not mujoco.mj_isSparse(model):
        return data.efc_J.reshape(-1, model.nv)[: data.ne].copy()
    dense = np.zeros((data.nefc, model.nv))
    mujoco.mju_sparse2dense(dense, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    return dense[: data.ne]


def needed_torques(motion, t):
    """Torques (n_a,) of the motors by MuJoCo."""
    model, data, robot = motion.model, motion.data, motion.plan.robot
    data.qpos[:], data.qvel[:], acceleration = motion.rates(t)
    flags = model.opt.disableflags
    mujoco.mj_forward(model, data)
    jacobian = equality_jacobian(model, data)
    model.opt.disableflags = flags | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data.qacc[:] = acceleration
    mujoco.mj_inverse(model, data)
    model.opt.disableflags = flags
    motors = [motion.joints[name].dofadr[0] for name in robot.actuator_names]
    moved = [k for joint in motion.joints.values() for k in _columns(model, joint)]
    passive = np.setdiff1d(moved, motors)
    # rounded dimensions leave rows that all but repeat others: the least forces
    loop = np.linalg.lstsq(jacobian[:, passive].T, data.qfrc_inverse[passive], rcond=1e-5)[0]
    return (data.qfrc_inverse - jacobian.T @ loop)[motors] / robot.gear_ratio


def _columns(model, joint):
    """Places of a joint in MuJoCo's velocities."""
    ball = joint.type[0] == mujoco.mjtJoint.mjJNT_BALL
    return range(joint.dofadr[0], joint.dofadr[0] + (3 if ball else 1))


def greatest_difference(file, *, damped):
    """The largest difference of a torque over the largest torque, along a short move."""
    description = without_dry_friction(file.description())
    model = mujoco_model(file.name)
    if not damped:
        description = undamped(description)
        model.dof_damping[:] = 0.0
    return difference(description, model)


def difference(description, model):
    """The same of a description and MuJoCo's model."""
    plan = short_move(ParallelRobot.from_description(description))
    turning = idle_turns(plan.robot, linearised_at_reference(plan.robot)) is not None
    samples = round(plan.duration / DIFFERENCE_STEP) + 1
    followed = simulate(plan, samples=samples) if turning else plan
    motion, times = SameMotion(model, plan, followed), np.linspace(0.1, 0.9, 9)
    needed = np.array([needed_torques(motion, t) for t in times])
    return np.abs(needed - plan.torque(times)).max() / np.abs(needed).max()


@pytest.mark.parametrize(
    ("file", "damped"),
    [
        pytest.param(file, damped, id=f"{file.name}-{damped}", marks=() if damped else pytest.mark.slow)
        for file in PLANNED
        for damped in (True, False)
        if not (damped and file.freedoms == 6)  # which takes as long as all others
    ],
)
def test_torques_of_a_converted_file_are_those_of_mujoco(file, damped):
    assert greatest_difference(file, damped=damped) < 1e-4


NEW = {
    "armature": ("<position ", '<position armature="0.03" '),
    "damping": ("<position ", '<position damping="0.2" '),
    "damper": ("<worldbody>", '<option><flag damper="disable"/></option><worldbody>'),
    "spring": ("<worldbody>", '<option><flag spring="disable"/></option><worldbody>'),
}


@pytest.mark.parametrize(("old", "new"), NEW.values(), ids=NEW)
def test_what_is_new_in_mujoco_4_acts_as_mujoco_has_it(tmp_path, old, new):
    """On a five-bar whose joints are damped and sprung."""
    text = (DATA / "five_bar_defaults.xml").read_text()
    text = text.replace('<joint name="', '<joint damping="0.05" stiffness="0.4" springref="20" name="')
    assert old in text
    torques = []
    for name, content in (("plain.xml", text), ("changed.xml", text.replace(old, new))):
        (tmp_path / name).write_text(content)
        description = without_dry_friction(parse_any(tmp_path / name, propose=propose).description)
        model = mujoco.MjModel.from_xml_path(str(tmp_path / name))
        assert difference(description, model) < 1e-6
        plan = short_move(ParallelRobot.from_description(description))
        torques.append(plan.torque(np.linspace(0.1, 0.9, 9)))
    assert np.abs(torques[1] - torques[0]).max() > 1e-3 * np.abs(torques[0]).max()


def test_armature_of_a_joint_counts_whether_or_not_it_is_chosen_as_the_motor():
    """Both cranks of a parallelogram turn alike: 0.5 kg m2 on the second adds that times its acceleration."""
    file = next(file for file in PLANNED if file.name == "two_cranks.xml")
    both = file.description()
    one = replace(both, joints={name: joint for name, joint in both.joints.items() if name != "j2"})
    times = np.linspace(0.1, 0.9, 9)
    plans = [short_move(ParallelRobot.from_description(description)) for description in (both, one)]
    acceleration = plans[0].platform(times, 2)[:, 0]  # of j2, the platform's coordinate
    added = plans[0].torque(times)[:, 0] - plans[1].torque(times)[:, 0]
    np.testing.assert_allclose(added, 0.5 * acceleration, rtol=0, atol=1e-9 * np.abs(added).max())
