"""Elastic robots on which plain passes oscillate, diverge or stall, simulated back onto their paths."""

import re

import pytest
import yaml

import robots
from framework import ParallelRobot, plan_crossing, simulate
from framework.model.beams import Material, Section, beam_spring, split_beam
from framework.planning.scenes import scene_path
from tests.dynamics.random_five_bars import five_bar

pytestmark = pytest.mark.slow
ALUMINIUM = Material.isotropic(70e9, 0.33)


@pytest.fixture(scope="module")
def delta(tmp_path_factory) -> ParallelRobot:
    """The Delta with its elastic drives, its arms solid bars of aluminium, 20 x 30 mm."""
    folder = tmp_path_factory.mktemp("delta")
    file = robots.load("delta").description.file
    urdf = file.with_suffix(".urdf").read_text()
    springs = []
    for i in (1, 2, 3):
        for rod in "ab":  # they swing at the end of the bar, not at its motor
            urdf, found = re.subn(
                rf'(<joint name="swing_{i}{rod}" type="revolute">\s*<parent link=")arm_{i}("/>.*?'
                r'<origin xyz=")0.524 ',
                rf"\g<1>arm_end_{i}\g<2>0 ",
                urdf,
                flags=re.DOTALL,
            )
            assert found == 1
        urdf = urdf.replace(
            "</robot>",
            f'<link name="arm_end_{i}"/><joint name="arm_tip_{i}" type="fixed"><parent link="arm_{i}"/>'
            f'<child link="arm_end_{i}"/><origin xyz="0.524 0 0"/></joint></robot>',
        )
    for i in (1, 2, 3):
        split = split_beam(urdf, f"arm_tip_{i}")
        urdf, axes = split.urdf_text, ("x", "y", "z", "rx", "ry", "rz")
        section = Section.rectangle(0.02, 0.03)
        bar = beam_spring(f"arm_flex_{i}", split.middle, section, ALUMINIUM, split.length, axes)
        springs.append(
            {
                "name": bar.name,
                "part": "link",
                "after": bar.after,
                "motion": list(bar.motion),
                "stiffness": list(bar.stiffness),
            }
        )
    data = yaml.safe_load(file.read_text())
    data["springs"] = data["springs"][:3] + springs
    (folder / "delta.urdf").write_text(urdf)
    (folder / "delta.yaml").write_text(yaml.safe_dump(data))
    return ParallelRobot.from_file(folder / "delta.yaml", flexibility="flexible_links")


@pytest.mark.parametrize("duration", [0.9, 1.0, 1.2])
def test_a_delta_with_arms_of_aluminium(delta, duration):
    path = scene_path(delta.description.scenes["cross"])
    plan = plan_crossing(delta, path, duration=duration, law="polynomial")
    assert max(plan.certificate.tail, plan.certificate.change) < 1e-10
    assert plan.certificate.max_residual_torque < 1e-9  # 2e-5 N m with plain passes, and accepted
    assert simulate(delta, plan).tracking_error < 1e-9


@pytest.mark.parametrize(("inertia", "seed"), [(False, 1), (False, 19), (False, 20), (True, 13), (True, 25)])
def test_a_random_five_bar_on_soft_springs(inertia, seed, tmp_path):
    drawn = five_bar(seed, (1e-4, 1e-3), tmp_path, inertia=inertia)
    robot = drawn.robot(tmp_path)
    plan = plan_crossing(robot, drawn.path, duration=drawn.duration, law="polynomial")
    assert max(plan.certificate.tail, plan.certificate.change) < 1e-10
    assert simulate(robot, plan).tracking_error < 1e-9
