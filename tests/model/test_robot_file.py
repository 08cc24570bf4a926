"""Robot files: a good one becomes records, a bad one an error that lets its author mend it."""

import math

import pytest
import yaml

import robots
from framework import InvalidInput, ParallelRobot, RobotFileError, load_robot
from framework.model import read_robot_file
from framework.model.description import Actuator, Closure, Platform, Scene, Spring
from tests.conftest import FIVE_BAR, REMOVED

PATHS = [[0.1, 0.345], [-0.05, 0.195]]
ROD = {"name": "rod", "part": "link", "after": "left_rod_tip", "motion": "x", "stiffness": 350000}
TIPS = ("left_tip", "right_tip")
ELBOWS = {"joints": ["left_elbow", "right_elbow"]}
ROD_OF = {"name": "rod", "frames": [*TIPS], "kind": "distance", "length": 0.25}
SOFT = {**ROD, "name": "soft", "motion": ["x", "rz"], "stiffness": [2, 3]}


# ------------------------------------------------------------------ a good file


def test_the_robot_file_of_the_5r_becomes_records():
    found = read_robot_file(FIVE_BAR)
    assert found.name == "five_bar"
    assert found.urdf_text == FIVE_BAR.with_suffix(".urdf").read_text(encoding="utf-8")
    assert found.platform == Platform("left_tip", ("x", "y"))
    assert found.actuators[1] == Actuator("right_motor", 50.0, 6.4e-6, None, None)
    assert found.closures == (Closure("tip", ("left_tip", "right_tip"), ("x", "y", "z")),)
    assert [spring.name for spring in found.springs] == ["left_drive", "right_drive", "left_rod", "right_rod"]
    assert found.springs[0] == Spring("left_drive", "joint", "left_motor", (), (25000.0,))
    assert found.springs[2] == Spring("left_rod", "link", "left_rod_tip", ("x",), (350000.0,))
    assert found.gravity == (0.0, 0.0, -9.81)
    assert list(found.scenes) == ["A", "B", "C", "C-printed", "bow"]
    points = ((0.1, 0.345), (-0.05, 0.195))
    assert found.scenes["B"] == Scene("B", "line", points, 1.5, (), None, None)  # no crossing condition
    assert found.scenes["A"].times is None  # left open
    assert found.scenes["C-printed"] == Scene("C-printed", "line", points, 1.5, (1.0,), (1.5,), (2 / 3,))


@pytest.mark.parametrize(
    ("key", "value", "read"),
    [
        ("gravity", [0, -9.81, 0], lambda d: d.gravity == (0.0, -9.81, 0.0)),
        ("platform.axes", ["y", "x"], lambda d: d.platform.axes == ("y", "x")),
        ("platform.axes", ["ry", "rx"], lambda d: d.platform.axes == ("ry", "rx")),
        (
            "platform",
            ELBOWS,
            lambda d: d.platform == Platform("right_rod", (), ("left_elbow", "right_elbow")),
        ),
        ("actuators.0", {"joint": "left_motor"}, lambda d: d.actuators[0] == Actuator("left_motor", 1, 0)),
        ("actuators.0.torque_limit", 2, lambda d: d.actuators[0].torque_limit == 2.0),
        ("actuators.0.speed_limit", "3e2", lambda d: d.actuators[0].speed_limit == 300.0),  # text in YAML 1.1
        ("springs", REMOVED, lambda d: d.springs == ()),
        ("scenes", REMOVED, lambda d: d.scenes == {}),
        ("reference", REMOVED, lambda d: d.reference == {}),
        ("scenes.C.at", [0.5], lambda d: d.scenes["C"].at == (0.5,)),
        ("scenes.C", {"arc": [*PATHS, [0.1, 0]], "duration": 1}, lambda d: d.scenes["C"].kind == "arc"),
        ("scenes.C", {"spline": [*PATHS, *PATHS], "duration": 1}, lambda d: d.scenes["C"].kind == "spline"),
        (
            "scenes.C",
            {"polyline": [*PATHS, [0.1, 0]], "blend": 0.01, "optimize": "time"},
            lambda d: (d.scenes["C"].blend, d.scenes["C"].duration) == (0.01, None),
        ),
        ("closures.0", ROD_OF, lambda d: d.closures == (Closure("rod", TIPS, ("distance",), 0.25),)),
        ("springs.2.motion", ["x"], lambda d: d.springs[2].coordinates == ("left_rod",)),
        ("springs.2", SOFT, lambda d: d.springs[2].coordinates == ("soft_x", "soft_rz")),
        ("springs.2", SOFT, lambda d: d.springs[2].stiffness == (2.0, 3.0)),
    ],
)
def test_what_may_be_left_out_or_said_in_another_way(write_robot, key, value, read):
    assert read(read_robot_file(write_robot((key, value))))


def test_the_index_sets_split_the_velocities():
    robot = robots.load("five_bar", flexibility="flexible_links")
    assert sorted([*robot.actuated, *robot.elastic, *robot.passive]) == list(range(robot.model.nv))
    assert [robot.coordinates.name_of(k) for k in robot.actuated] == ["left_motor", "right_motor"]
    assert [robot.coordinates.name_of(k) for k in robot.elastic] == list(robot.elastic_names)
    assert [robot.coordinates.name_of(k) for k in robot.passive] == ["left_elbow", "right_elbow"]
    assert list(robot.stiffness) == [25000.0, 25000.0, 350000.0, 350000.0]


@pytest.mark.parametrize(
    ("flexibility", "springs"),
    [
        ("rigid", ()),
        ("flexible_joints", ("left_drive", "right_drive")),
        ("flexible_links", ("left_drive", "right_drive", "left_rod", "right_rod")),
    ],
)
def test_flexibility_is_a_list_of_springs(flexibility, springs):
    assert robots.load("five_bar", flexibility=flexibility).elastic_names == springs


# ------------------------------------------------------------------ a bad one

# key, what stands there instead, words that the message must have
MALFORMED = [
    ("version", REMOVED, ["version: missing"]),
    ("version", 2, ["version", "2", "reads version 1"]),
    ("version", "1", ["version", "whole number", "'1'"]),
    ("version", True, ["version", "whole number", "True"]),
    ("colour", "red", ["colour: unknown key", "platform", "actuators"]),
    ("urdf", REMOVED, ["urdf: missing"]),
    ("urdf", 5, ["urdf", "needs a text", "5"]),
    ("urdf", "other.urdf", ["urdf", "other.urdf", "No such file"]),
    ("urdf", ".", ["urdf", "cannot read"]),
    ("urdf", "five\0bar.urdf", ["urdf"]),
    ("platform", REMOVED, ["platform: missing"]),
    ("platform", ["left_tip"], ["platform", "mapping", "left_tip"]),
    ("platform.frame", "tip", ["platform.frame", "unknown frame 'tip'", "left_tip"]),
    ("platform.frame", ["left_tip"], ["platform.frame", "frame", "left_tip"]),
    ("platform.axes", REMOVED, ["platform.axes: missing", "frame"]),
    ("platform.axes", ["x", "w"], ["platform.axes[1]", "unknown axis 'w'", "rx, ry, rz, x, y, z"]),
    ("platform.axes", ["x", "x"], ["platform.axes", "each once"]),
    ("platform.axes", [], ["platform.axes", "[]"]),
    ("platform.joints", ["left_elbow"], ["platform", "either axes or joints"]),
    ("platform", {"joints": ["elbow"]}, ["platform.joints", "unknown joint 'elbow'", "left_elbow"]),
    ("platform", {"joints": ["left_elbow", "left_elbow"]}, ["platform.joints", "each once"]),
    ("platform", {"joints": []}, ["platform.joints", "at least one joint", "[]"]),
    ("platform", {"joints": ["left_elbow"], "frame": "leg"}, ["platform.frame", "unknown frame 'leg'"]),
    ("platform.axis", "x", ["platform.axis", "did you mean 'axes'"]),
    ("actuators", [], ["actuators", "at least one"]),
    ("actuators", {"joint": "left_motor"}, ["actuators", "needs a list"]),
    ("actuators.0", "left_motor", ["actuators[0]", "mapping", "left_motor"]),
    ("actuators.0.joint", "motor", ["actuators[0].joint", "unknown joint 'motor'", "left_motor"]),
    ("actuators.0.joint", "left_rod_tip", ["actuators", "'left_rod_tip' is fixed", "revolute"]),
    ("actuators.0.joint", "right_motor", ["actuators", "'right_motor'", "duplicate"]),
    ("actuators.0.gear_ratio", 0, ["actuators[0].gear_ratio", "greater than zero", "0"]),
    ("actuators.0.gear_ratio", "fifty", ["actuators[0].gear_ratio", "number", "'fifty'"]),
    ("actuators.0.gear_ratio", True, ["actuators[0].gear_ratio", "number", "True"]),
    ("actuators.0.gear_ratio", 10**400, ["actuators[0].gear_ratio", "finite number"]),
    ("actuators.0.gear_ratio", 1e300, ["actuators[0].gear_ratio", "at most 1e+30"]),
    ("reference.left_motor", -1e300, ["reference.left_motor", "at most 1e+30"]),
    ("actuators.0.rotor_inertia", -1e-6, ["actuators[0].rotor_inertia", "negative", "-1e-06"]),
    ("actuators.0.torque_limit", 0, ["actuators[0].torque_limit", "greater than zero"]),
    ("actuators.1.gears_ratio", 50, ["actuators[1].gears_ratio", "did you mean 'gear_ratio'"]),
    ("closures", REMOVED, ["closures: missing"]),
    ("closures.0.name", REMOVED, ["closures[0].name: missing"]),
    ("closures.0.frames", ["left_tip"], ["closures[0].frames", "two different frames", "left_tip"]),
    ("closures.0.frames", ["left_tip", "left_tip"], ["closures[0].frames", "two different frames"]),
    ("closures.0.frames", ["left_tip", "tip"], ["closures[0].frames[1]", "unknown frame 'tip'", "right_tip"]),
    ("closures.0.frames", "left_tip", ["closures[0].frames", "needs a list"]),
    # no joint lies between these two
    ("closures.0.frames", ["left_tip", "left_rod"], ["closures[0]", "left_tip", "left_rod"]),
    ("closures.0.kind", "weld", ["closures[0].kind", "unknown closure kind 'weld'", "revolute"]),
    ("closures.0.kind", REMOVED, ["closures[0]", "either kind or axes"]),
    ("closures.0.axes", ["x"], ["closures[0]", "either kind or axes"]),
    ("closures.0.kind", "distance", ["closures[0].length: missing"]),
    ("closures.0.length", 0.25, ["closures[0].length: unknown key"]),
    ("closures.0", {**ROD_OF, "length": 0}, ["closures[0].length", "greater than zero"]),
    ("closures.0.axis", "w", ["closures[0]", "unknown closure axis 'w'", "x, y, z"]),
    ("closures.1", {"name": "tip", "frames": ["base", "left_rod"], "axes": "z"}, ["'tip'", "duplicate"]),
    ("springs", "soft", ["springs", "needs a list"]),
    ("springs.0.stiffness", 0, ["springs[0].stiffness", "greater than zero", "0"]),
    ("springs.0.stiffness", -25000, ["springs[0].stiffness", "greater than zero", "-25000"]),
    ("springs.0.stiffness", math.nan, ["springs[0].stiffness", "finite", "nan"]),
    ("springs.0.stiffness", math.inf, ["springs[0].stiffness", "finite", "inf"]),
    ("springs.0.stiffness", "stiff", ["springs[0].stiffness", "number", "'stiff'"]),
    ("springs.0.stiffness", REMOVED, ["springs[0].stiffness: missing"]),
    ("springs.2.stiffness", [1.0, 2.0], ["springs[2].stiffness", "one value an axis", "2"]),
    ("springs.0.part", "rope", ["springs[0].part", "unknown part 'rope'", "joint, link"]),
    ("springs.0.after", "left", ["springs[0].after", "unknown joint 'left'", "left_motor"]),
    ("springs.2.motion", REMOVED, ["springs[2].motion", "'left_rod_tip' is fixed", "x, y, z"]),
    ("springs.2.motion", "u", ["springs[2].motion[0]", "unknown axis 'u'", "rx"]),
    ("springs.0.name", "left_motor", ["springs", "'left_motor'", "already a joint"]),
    ("springs.0.name", "right_drive", ["springs", "'right_drive'", "duplicate"]),
    ("springs.0.name", "", ["springs[0].name", "needs a text"]),
    ("springs", [SOFT, {**ROD, "name": "soft_x"}], ["springs", "'soft_x'", "duplicate"]),
    ("springs.0.motion", 5, ["springs[0].motion[0]", "unknown axis 5", "rx, ry, rz, x, y, z"]),
    ("springs.0", {"name": "s", "joint": "left_elbow", "stiffness": 1, "part": "link"}, ["springs[0].part"]),
    ("frames", None, ["frames", "at least one entry", "None"]),
    (
        "frames",
        [{"name": "left_rod", "parent": "base"}],
        ["urdf: ", "five_bar.urdf", "duplicate link 'left_rod'"],
    ),
    ("frames", [{"name": "a", "parent": "nobody"}], ["frames[0].parent", "unknown link 'nobody'", "base"]),
    ("frames", [{"name": "a", "parent": "base", "inertia": [1, 1, 1]}], ["frames[0].inertia", "mass"]),
    ("locked", {"left_elbow": "up"}, ["locked.left_elbow", "number", "'up'"]),
    ("locked", {"left_rod_tip": 0}, ["locked.left_rod_tip", "unknown joint", "left_elbow"]),
    ("root", "loose", ["root", "unknown root 'loose'", "fixed, free"]),
    ("gravity", [0, -9.81], ["gravity", "three numbers", "[0, -9.81]"]),
    ("gravity", [0, 0, math.nan], ["gravity[2]", "finite", "nan"]),
    ("gravity", -9.81, ["gravity", "needs a list", "-9.81"]),
    ("reference.elbow", 0.1, ["reference.elbow", "unknown joint 'elbow'", "left_elbow"]),
    ("reference.left_rod_tip", 0.1, ["reference.left_rod_tip", "left_elbow", "right_motor"]),  # it is fixed
    ("reference.left_motor", "up", ["reference.left_motor", "number", "'up'"]),
    ("reference.left_motor", math.inf, ["reference.left_motor", "finite", "inf"]),
    ("scenes", ["C"], ["scenes", "mapping"]),
    ("scenes.C", None, ["scenes.C", "mapping", "None"]),
    ("scenes.C.line", REMOVED, ["scenes.C", "exactly one path", "line, arc, spline", "none"]),
    ("scenes.C.arc", PATHS, ["scenes.C", "exactly one path", "'line', 'arc'"]),
    ("scenes.C.blend", 0.01, ["scenes.C.blend", "polyline"]),
    ("scenes.C", {"polyline": [*PATHS, [0.1, 0]], "duration": 1}, ["scenes.C.blend", "polyline"]),
    ("scenes.C.optimize", "time", ["scenes.C.duration", "optimize: time"]),
    ("scenes.C", {"line": PATHS}, ["scenes.C.duration", "optimize: time"]),
    ("scenes.C.line", PATHS[:1], ["scenes.C.line", "2 points", "got 1"]),
    ("scenes.C.line", [*PATHS, [0, 0]], ["scenes.C.line", "2 points", "got 3"]),
    ("scenes.C.line", [[0.1, 0.345], "end"], ["scenes.C.line[1]", "needs a list", "'end'"]),
    ("scenes.C.line", [[0.1, 0.345], [math.nan, 0]], ["scenes.C.line[1][0]", "finite", "nan"]),
    ("scenes.C.line", [[0.1, 0.345], [0.1]], ["scenes.C.line", "2"]),  # as many coordinates as the platform
    ("scenes.C.line", [[0.1, 0.345, 0], [0.1, 0.2, 0]], ["scenes.C.line", "2", "3"]),
    ("scenes.C.duration", REMOVED, ["scenes.C.duration: missing"]),
    ("scenes.C.duration", 0, ["scenes.C.duration", "greater than zero"]),
    ("scenes.C.times", 1.0, ["scenes.C.times", "needs a list", "1.0"]),
    ("scenes.C.times", [math.inf], ["scenes.C.times[0]", "finite", "inf"]),
    ("scenes.C.speeds", [0], ["scenes.C.speeds[0]", "greater than zero"]),
    ("scenes.C.at", ["half"], ["scenes.C.at[0]", "number", "'half'"]),
    ("scenes.C.time", [1.0], ["scenes.C.time", "did you mean 'duration' or 'times'"]),
]


def shown(value) -> str:
    return "removed" if value is REMOVED else str(value)[:30]


def refused(file) -> str:
    """The message of the one-line RobotFileError, which starts with the file."""
    with pytest.raises(RobotFileError) as caught:
        ParallelRobot.from_file(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert message.splitlines() == [message]
    return message.removeprefix(f"{file}: ")


@pytest.mark.parametrize(
    ("key", "value", "words"), MALFORMED, ids=[f"{key}={shown(value)}" for key, value, _ in MALFORMED]
)
def test_a_malformed_robot_file_is_refused_and_told_why(write_robot, key, value, words):
    message = refused(write_robot((key, value)))
    for word in words:
        assert word in message


def mappings(content, place=()):
    """Places of the mappings whose keys have meanings, and not names, in a robot file."""
    if isinstance(content, list):
        for i, item in enumerate(content):
            yield from mappings(item, (*place, str(i)))
    elif isinstance(content, dict):
        if place not in (("reference",), ("scenes",)):
            yield place
        for key, value in content.items():
            yield from mappings(value, (*place, key))


@pytest.mark.parametrize("place", list(mappings(yaml.safe_load(FIVE_BAR.read_text(encoding="utf-8")))))
def test_a_key_that_no_table_has_is_named_with_its_place(write_robot, place):
    name = "".join(f"[{part}]" if part.isdigit() else f".{part}" for part in (*place, "colour"))
    message = refused(write_robot((".".join((*place, "colour")), "red")))
    assert message.startswith(f"{name[1:]}: unknown key 'colour'")


def test_a_missing_key_points_to_its_misspelling_and_to_no_key_that_is_right(write_robot):
    assert "misspelling" not in refused(write_robot(("closures.0.name", REMOVED)))  # `frames` is near it
    message = refused(write_robot(("platform.axes", REMOVED), ("platform.axis", ["x", "y"])))
    assert message.startswith("platform.axes: missing; is 'axis' a misspelling?")


# the whole text of the robot file, words
NO_ROBOT_FILES = [
    (b"", ["is empty"]),
    (b"- version: 1\n- urdf: five_bar.urdf\n", ["mapping"]),
    (b"five_bar\n", ["mapping", "five_bar"]),
    (b"\xff\xfe\x00\x93 robot", ["cannot read", "UTF-8"]),
    (b"version: [1\n", ["not valid YAML", "line 2"]),
    (b"version: 1\nurdf:\tfive\n\t- bar\n", ["not valid YAML"]),
    (b"version: 1\nversion: 1\n", ["'version'", "duplicate", "line 1"]),
    (b"version: 1\nplatform: {frame: base, frame: left_tip}\n", ["'frame'", "duplicate", "line 2"]),
    (b"version: 1\nname: !!python/object/apply:os.getcwd []\n", ["not valid YAML"]),
    (b"? {version: 1}\n: 1\n", ["not valid YAML"]),
]


@pytest.mark.parametrize(("content", "words"), NO_ROBOT_FILES, ids=[repr(c[:24]) for c, _ in NO_ROBOT_FILES])
def test_a_file_that_is_no_robot_file_is_refused(tmp_path, content, words):
    file = tmp_path / "my_robot.yaml"
    file.write_bytes(content)
    message = refused(file)
    for word in words:
        assert word in message


ELBOW = '<joint name="left_elbow" type="revolute">'
AT_ELBOW = f'{ELBOW}\n    <parent link="left_crank"/>\n    <child link="left_rod"/>'
ORIGIN = '<origin xyz="0.25 0 0" rpy="0 0 0"/>'
LIMIT = '<limit lower="-6.28" upper="6.28" effort="200" velocity="20"/>'

# text of the URDF, what stands there instead, words
MALFORMED_URDFS = [
    ("</robot>", "", ["not well-formed XML"]),
    ('<robot name="five_bar">', '<sdf name="five_bar">', ["not well-formed XML"]),
    ('<link name="base">', '<link name="left_tip">', ["'left_tip'", "duplicate"]),
    ('<link name="base">', "<link>", ["<link>", "'name'", "empty"]),
    (ELBOW, '<joint name="left_motor" type="revolute">', ["'left_motor'", "duplicate"]),
    (AT_ELBOW, AT_ELBOW.replace('"left_crank"', '"crank"'), ["left_elbow", "parent", "'crank'", "left_rod"]),
    (AT_ELBOW, AT_ELBOW.replace('"left_rod"', '"right_rod"'), ["'right_rod' has two parents", "closures"]),
    (AT_ELBOW, ELBOW, ["left_elbow", "<parent>", "missing"]),
    (AT_ELBOW, AT_ELBOW.replace('"left_crank"', '"left_rod"'), ["left_rod"]),  # its own parent
    (AT_ELBOW, AT_ELBOW.replace('"left_crank"', '"left_tip"'), ["left_rod"]),  # a ring beside the tree
    ("</robot>", '<link name="alone"/></robot>', ["one root link", "base", "alone"]),
    (ELBOW, f'{ELBOW}<mimic joint="motor"/>', ["left_elbow", "mimic", "unknown movable joint 'motor'"]),
    (ELBOW, ELBOW.replace("revolute", "planar"), ["left_elbow", "'planar'", "continuous"]),
    (ELBOW, '<joint name="left_elbow">', ["left_elbow", "'type'", "missing"]),
    ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', ["left_motor", "axis", "zero"]),
    ('<axis xyz="0 0 1"/>', '<axis xyz="0 0"/>', ["left_motor", "<axis> xyz", "3 numbers", "'0 0'"]),
    ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 one"/>', ["left_motor", "<axis> xyz", "'0 0 one'"]),
    (ORIGIN, '<origin xyz="nan 0 0"/>', ["left_elbow", "<origin> xyz", "'nan 0 0'"]),
    (ORIGIN, '<origin rpy="0 inf 0"/>', ["left_elbow", "<origin> rpy", "'0 inf 0'"]),
    ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1e-300"/>', ["left_motor", "axis", "zero"]),
    (ORIGIN, '<origin xyz="1e300 0 0"/>', ["left_elbow", "<origin> xyz", "at most 1e+30", "1e300"]),
    ('<mass value="10"/>', '<mass value="heavy"/>', ["mass", "'heavy'"]),
    ('<mass value="10"/>', '<mass value="-10"/>', ["mass", "-10"]),
    ('<mass value="10"/>', "", ["mass"]),
    ('ixx="0" ixy', 'ixx="nan" ixy', ["ixx", "nan"]),
    ('ixx="0" ixy', "ixy", ["ixx"]),
    (LIMIT, "", ["left_motor", "limit"]),
    (LIMIT, '<limit effort="strong" velocity="20"/>', ["left_motor", "effort", "strong"]),
]


@pytest.mark.parametrize(
    ("old", "new", "words"), MALFORMED_URDFS, ids=[new[:40] or "nothing" for _, new, _ in MALFORMED_URDFS]
)
def test_a_malformed_urdf_is_refused_and_told_why(write_robot, capfd, old, new, words):
    message = refused(write_robot(urdf=((old, new),)))
    assert "urdf" in message
    for word in words:
        assert word in message
    assert capfd.readouterr() == ("", "")  # parsers in C++ must not print beside the message


def test_a_spring_must_not_need_a_name_that_the_urdf_has(write_robot):
    file = write_robot(("springs.0.name", "left"), urdf=(('"left_crank"', '"left_base"'),) * 3)
    message = refused(file)
    assert "'left'" in message
    assert "'left_base'" in message


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"<sdf/>", ["not a URDF", "<sdf>", "<robot>"]),
        (b"", ["not well-formed XML"]),
        (b"\x89PNG\r\n\x1a\n\x00", ["five_bar.urdf"]),
        (b"<robot name='r'/>", ["root link"]),
    ],
)
def test_a_file_that_is_no_urdf_is_refused(write_robot, content, words):
    file = write_robot()
    file.with_name("five_bar.urdf").write_bytes(content)
    message = refused(file)
    assert "urdf" in message
    for word in words:
        assert word in message


@pytest.mark.parametrize("name", ["flexible_link", "", None, ["rigid"]])
def test_an_unknown_flexibility_lists_the_known_ones(name):
    with pytest.raises(InvalidInput, match=r"flexibility.*flexible_joints, flexible_links, rigid"):
        load_robot("five_bar", flexibility=name)


def test_an_unknown_robot_lists_the_catalogue():
    with pytest.raises(InvalidInput, match=r"'five_bare'; did you mean 'five_bar'.*five_bar_heavy"):
        robots.load("five_bare")
