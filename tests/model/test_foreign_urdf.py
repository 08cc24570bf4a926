"""URDFs of somebody else: found in installed packages, joints locked, bodies added, complaints that help."""

import json
import xml.etree.ElementTree as ElementTree
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import framework.model.urdf_elements as urdf
import robots
from framework import MissingPackage, ParallelRobot, RobotFileError, cli
from framework.model import read_robot_file
from framework.model.description import Coupling, JointDynamics
from framework.model.urdf_edits import lock_joints
from framework.model.urdf_elements import locate_urdf
from tests.conftest import REMOVED
from tests.oracles.placements import placements
from tests.urdf_edits import edited

SOLO12 = "package://example-robot-data/robots/solo_description/robots/solo12.urdf"
MIMIC = ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><mimic joint="left_motor"/>')
CHAIN = """<robot name="chain">
  <link name="base"/><link name="arm"/><link name="hand"/><link name="tip"/>
  <joint name="turn" type="{kind}"><parent link="base"/><child link="arm"/>
    <origin xyz="0.1 -0.2 0.3" rpy="0.4 -0.5 0.6"/><axis xyz="1 -2 2"/>{limit}</joint>
  <joint name="free" type="continuous"><parent link="arm"/><child link="hand"/>
    <origin xyz="0 0 1"/><axis xyz="0 1 0"/></joint>
  <joint name="end" type="fixed"><parent link="hand"/><child link="tip"/><origin xyz="1 0 0"/></joint>
</robot>"""
LIMIT = '<limit lower="-9" upper="9" effort="1" velocity="1"/>'


@pytest.fixture
def nothing_installed(monkeypatch, tmp_path):
    def files(package):
        raise PackageNotFoundError(package)

    monkeypatch.setattr("importlib.metadata.files", files)
    monkeypatch.setattr(urdf.sysconfig, "get_path", lambda name: str(tmp_path))
    return tmp_path


def test_a_file_of_an_installed_package_is_found():
    found = locate_urdf(Path("anywhere"), SOLO12)
    assert found.is_file()
    assert found.name == "solo12.urdf"
    assert locate_urdf(Path("here"), "robot.urdf") == Path("here/robot.urdf")


def test_a_package_without_metadata_is_found_under_the_prefix(nothing_installed):
    place = nothing_installed / "share" / "some_robots" / "arm" / "arm.urdf"
    place.parent.mkdir(parents=True)
    place.write_text("<robot/>")
    assert locate_urdf(Path(), "package://some_robots/arm/arm.urdf") == place
    with pytest.raises(RobotFileError, match=r"no file share/some_robots/arm/leg\.urdf") as caught:
        locate_urdf(Path(), "package://some_robots/arm/leg.urdf")
    assert not isinstance(caught.value, MissingPackage)


def test_a_missing_package_is_named_with_what_to_do(nothing_installed):
    with pytest.raises(MissingPackage, match="pip install example-robot-data") as caught:
        robots.CATALOGUE["standing_quadruped"].load()
    assert caught.value.package == "example-robot-data"
    assert "standing_quadruped.yaml: urdf: " in str(caught.value)


def test_the_catalogue_works_without_the_package(nothing_installed, capsys, monkeypatch):
    two = {name: robots.CATALOGUE[name] for name in ("five_bar", "two_arms")}
    monkeypatch.setattr("framework.cli.robots.catalogue", lambda: two)
    assert cli.main(["robots", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["robots"]}
    assert rows["two_arms"]["needs"] == "example-robot-data"
    assert rows["five_bar"]["degrees_of_freedom"] == 2
    assert cli.main(["robots"]) == 0
    assert "not installed: pip install example-robot-data" in capsys.readouterr().out
    assert cli.main(["check", "two_arms"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "pip install example-robot-data" in err


@pytest.mark.parametrize(
    ("reference", "words"),
    [
        ("package://", ["NAME/FILE"]),
        ("package://example-robot-data", ["NAME/FILE"]),
        ("package://example-robot-data/robots/solo13.urdf", ["example-robot-data", "no file", "solo13.urdf"]),
        ("package://no-such-robots/a.urdf", ["pip install no-such-robots"]),
    ],
)
def test_a_wrong_reference_is_refused(write_robot, reference, words):
    with pytest.raises(RobotFileError) as caught:
        read_robot_file(write_robot(("urdf", reference)))
    for word in ["urdf: ", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
@pytest.mark.parametrize("value", [0.0, 0.7, -2.5, 3.0])
def test_a_locked_joint_stands_where_it_would_be_moved_to(kind, value):
    text = CHAIN.format(kind=kind, limit="" if kind == "continuous" else LIMIT)
    held = edited(text, (lock_joints, {"turn": value}))
    whole, locked = (pin.buildModelFromXML(urdf) for urdf in (text, held))
    assert (whole.njoints, locked.njoints) == (3, 2)
    tips = []
    for model in (whole, locked):
        q = pin.neutral(model)
        if model is whole:
            q[:2] = (np.cos(value), np.sin(value)) if kind == "continuous" else (value, q[1])
        tips += placements(model, ("tip",), q)
    np.testing.assert_allclose(tips[0].homogeneous, tips[1].homogeneous, atol=1e-15)


def test_a_mimic_joint_is_coupled_unless_locked(write_robot):
    mimic = '<axis xyz="0 0 1"/><mimic joint="left_elbow" multiplier="-2" offset="0.1"/>'
    coupled = read_robot_file(write_robot(urdf=((MIMIC[0], mimic),))).couplings
    assert coupled == (Coupling("left_motor", "left_elbow", -2.0, 0.1),)
    with pytest.raises(RobotFileError, match="joint 'left_motor': <mimic>: unknown movable joint"):
        read_robot_file(write_robot(urdf=(MIMIC,)))  # itself


def test_a_locked_mimic_joint_mimics_no_more(write_robot):
    file = write_robot(("locked", {"right_elbow": 1.5}), ("reference", {"left_motor": 1.27}))
    text = file.with_name("five_bar.urdf").read_text()
    head, tail = text.split('<child link="right_rod"/>')
    file.with_name("five_bar.urdf").write_text(head + '<child link="right_rod"/>' + tail.replace(*MIMIC, 1))
    assert "mimic" not in read_robot_file(file).urdf_text


@pytest.mark.parametrize(
    ("locked", "words"),
    [
        ({"left_elbo": 0}, ["locked.left_elbo", "did you mean 'left_elbow'"]),
        ({"left_rod_tip": 0}, ["locked.left_rod_tip", "unknown joint"]),  # fixed already
        ({"left_elbow": "bent"}, ["locked.left_elbow", "number"]),
        ({"left_elbow": float("inf")}, ["locked.left_elbow", "finite"]),
        (["left_elbow"], ["locked", "mapping"]),
        ({"left_motor": 1.0}, ["actuators: joint 'left_motor' is fixed"]),
    ],
)
def test_a_wrong_lock_is_refused(write_robot, locked, words):
    with pytest.raises(RobotFileError) as caught:
        read_robot_file(write_robot(("locked", locked), ("springs", REMOVED)))
    for word in words:
        assert word in str(caught.value)


def test_a_frame_may_carry_a_body(write_robot):
    frame = {"name": "load", "parent": "left_tip", "xyz": [0, 0, 0.1], "mass": 3, "inertia": [1, 2, 2.5]}
    robot = ParallelRobot.from_file(write_robot(("frames", [frame])))
    bare = robots.load("five_bar")
    assert pin.computeTotalMass(robot.model) == pin.computeTotalMass(bare.model) + 3
    k = robot.model.getJointId("left_elbow")
    added = robot.model.inertias[k] - bare.model.inertias[k]
    np.testing.assert_allclose(added.lever, [0.25, 0, 0.1], atol=1e-15)
    np.testing.assert_allclose(added.inertia, np.diag([1, 2, 2.5]), atol=1e-14)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"mass": -1}, "mass"),
        ({"inertia": [1, 1, 1]}, "inertia"),  # of nothing
        ({"mass": 1, "inertia": [1, 1, 3]}, "inertia"),  # of no body
        ({"mass": 1, "inertia": [-1, 1, 1]}, "inertia"),
        ({"mass": 1, "inertia": [1, 1]}, "inertia"),
    ],
)
def test_a_wrong_body_is_refused(write_robot, change, word):
    frame = {"name": "load", "parent": "left_tip", **change}
    with pytest.raises(RobotFileError, match=rf"frames\[0\]\.{word}"):
        read_robot_file(write_robot(("frames", [frame])))


def test_a_locked_joint_is_known_to_all_that_names_it(write_robot):
    """Its reference and springs say nothing any more; what a coupling holds with it is locked, too."""
    description = read_robot_file(
        write_robot(
            ("locked", {"right_elbow": 0.5}),
            ("reference", {"left_motor": 1.27, "right_elbow": 1.5, "left_elbow": 0.1}),
            ("joints", {"right_elbow": {"damping": 1.0}, "left_motor": {"damping": 2.0}}),
            ("springs", [{"joint": "right_elbow", "stiffness": 3.0}]),
            ("couplings", [{"joint": "left_elbow", "of": "right_elbow", "ratio": -2, "offset": 0.1}]),
        )
    )
    assert description.reference == {"left_motor": 1.27}
    assert description.joints == {"left_motor": JointDynamics(damping=2.0)}
    assert description.couplings == description.springs == ()
    fixed = ElementTree.fromstring(description.urdf_text).findall("joint[@type='fixed']")
    assert {"right_elbow", "left_elbow"} <= {joint.get("name") for joint in fixed}
