"""A malformed file of any dialect gives one clear error that names the file and what is wrong in it.

The corpus: changes made to the good files of tests/data/dialects, each with the words its error must have.
Our own robot file, and what all URDFs have in common: test_robot_file. Torn files, mutations: tests/fuzz.
"""

from pathlib import Path

import pytest

from framework import ParallelRobot, RobotFileError
from framework.model.readers import read_any
from tests.watchdog import bounded

DATA = Path(__file__).parents[2] / "data" / "dialects"
LIMIT = 5.0  # [s] of processor time that reading any of these files may take
SAID = {"platform": "left_rod", "axes": ["x", "y"], "motors": ["left_motor", "right_motor"]}
GOOD = {
    "yaml": DATA / "gepetto" / "robot.yaml",
    "pair": DATA / "gepetto" / "robot.urdf",
    "plus": DATA / "five_bar_plus.urdf",
    "ros": DATA / "five_bar_ros.urdf",
    "loop_joint": DATA / "five_bar_loop_joint.urdf",
    "sites": DATA / "five_bar_sites.xml",
    "anchor": DATA / "five_bar_anchor.xml",
}

# by file: what is there, what stands there instead, what the error says
CHANGES = {
    # Gepetto's YAML
    "yaml": [
        ("closed_loop", "closed_loops", "unknown key 'closed_loops'; did you mean 'closed_loop'"),
        ("[['tip_A', 'tip_B']]", "[]", "closed_loop: needs a list with at least one entry"),
        ("[['tip_A', 'tip_B']]", "tip", "needs a list with at least one entry, got 'tip'"),
        ("[['tip_A', 'tip_B']]", "[tip_A]", "closed_loop[0]: needs a list, got 'tip_A'"),
        ("'tip_A', ", "", "closed_loop[0]: needs two frames"),
        ("'tip_A', ", "'tip_A', 'base', ", "closed_loop[0]: needs two frames"),
        ("'tip_A', ", "'tip_C', ", "closed_loop[0][0]: unknown frame 'tip_C'"),
        ("'tip_A', ", "'tip_B', ", "joins 'tip_B' with itself"),
        ("'tip_A', ", "3, ", "closed_loop[0][0]: unknown frame 3"),
        ("type: ['3d']\n", "", "type: missing"),
        ("['3d']", "['3d', '6d']", "type: needs one entry a pair of closed_loop (1), got 2"),
        ("['3d']", "['4d']", "type[0]: unknown type '4d'"),
        ("['3d']", "[3]", "type[0]: unknown type 3"),
        ("'left_motor', ", "'left_moter', ", "name_mot[0]: unknown movable joint 'left_moter'"),
        ("'left_motor', ", "'tip_A_frame', ", "name_mot[0]: unknown movable joint 'tip_A_frame'"),
        ("'left_motor', ", "'right_motor', ", "name_mot: duplicate 'right_motor'"),
        ("name_mot: [", "name_mot: [[", "not valid YAML"),
        ("name_mot:", "type:", "duplicate key"),
        ("name_mot:", "joint_name: [left_elbow]\nname_mot:", "joint_type: needs one entry a joint"),
        ("name_mot:", "joint_name: [elbow]\njoint_type: [FIXED]\nname_mot:", "joint_name[0]: unknown joint"),
        (
            "name_mot:",
            "joint_name: [left_elbow]\njoint_type: [BALL]\nname_mot:",
            "joint_type[0]: unknown joint type 'BALL'",
        ),
        (
            "name_mot:",
            "joint_name: [left_elbow, left_elbow]\njoint_type: [FIXED, FIXED]\nname_mot:",
            "joint_name: duplicate 'left_elbow'",
        ),
        (
            "name_mot:",
            "joint_name: [left_motor]\njoint_type: [SPHERICAL]\nname_mot:",
            "name_mot[0]: unknown movable joint 'left_motor'",
        ),
    ],
    # Gepetto's URDF
    "pair": [
        ('<link name="tip_B"/>', "", "<child>: unknown link 'tip_B'"),
        (
            'name="tip_B_frame" type="fixed"',
            'name="tip_B_frame" type="planar"',
            "planar joints are only read where they are held",
        ),
        ('name="tip_B_frame"', 'name="tip_A_frame"', "duplicate joint 'tip_A_frame'"),
        ('<parent link="right_rod"/>', '<parent link="tip_B"/>', "joins 'tip_B' with itself"),
        ('xyz="0.2 0 0"', 'xyx="0.2 0 0"', "unknown attribute 'xyx'; did you mean 'xyz'"),
        ("<robot name", "<robot nam", "<robot>: attribute 'name' is missing"),
        ('effort="1"', 'effort="-1"', "<limit>: needs lower <= upper, effort"),
        ('effort="1"', 'lower="1" upper="0" effort="1"', "<limit>: needs lower <= upper"),
        ('ixx="0"', 'ixx="-1"', "link 'tip_A': <inertia>: has the principal moments -1, 0, 0 kg m^2"),
        ('<link name="base"/>', '<link name="base"/><link name="b2"/>', "exactly one root link"),
        ('<link name="base"/>', '<lnik name="base"/>', "unknown element 'lnik'; did you mean 'link'"),
    ],
    # URDF+
    "plus": [
        (
            'type="revolute">\n    <predecessor',
            'type="hinge">\n    <predecessor',
            "loop 'tip': unknown type 'hinge'",
        ),
        ('<loop name="tip"', "<loop", "<loop>: attribute 'name' is missing"),
        ('successor link="right_rod"', 'successor link="right"', "<successor>: unknown link 'right'"),
        ('successor link="right_rod"', 'successor lnk="right_rod"', "unknown attribute 'lnk'"),
        ('    <axis xyz="0 0 1"/>\n  </loop>', "  </loop>", "loop 'tip': <axis> is missing"),
        ("</loop>", "<gap/></loop>", "loop 'tip': unknown element 'gap'"),
        ("</loop>", '<axis xyz="1 0 0"/></loop>', "loop 'tip': duplicate <axis>"),
        ("</robot>", '<loop name="tip" type="revolute"/></robot>', "loop 'tip': <axis> is missing"),
        (
            "</robot>",
            '<coupling name="c"><predecessor link="base"/><successor link="base"/><ratio value="1"/>'
            "</coupling></robot>",
            "couples 'base' with itself",
        ),
        (
            "</robot>",
            '<coupling name="c"><predecessor link="base"/><successor link="left_rod"/></coupling></robot>',
            "coupling 'c': <ratio> is missing",
        ),
        (
            "</robot>",
            '<coupling name="c"><predecessor link="base"/><successor link="left_rod"/><ratio value="x"/>'
            "</coupling></robot>",
            "<ratio> value: needs finite numbers, got 'x'",
        ),
    ],
    # Isaac Sim's loop joints
    "loop_joint": [
        ('type="spherical"', 'type="planar"', "loop_joint 'loop': unknown type 'planar'"),
        ('type="spherical"', 'type="revolute"', "loop_joint 'loop': <axis> is missing"),
        ('<link1 link="right_rod"', '<link3 link="right_rod"', "unknown element 'link3'"),
        ('link1 link="right_rod"', 'link1 link="rod"', "unknown link 'rod'"),
    ],
    # the proposal for ROS
    "ros": [
        ('type="spherical"', 'type="ball"', "constraint 'tip': unknown type 'ball'"),
        ('type="spherical"', "", "constraint 'tip': attribute 'type' is missing"),
        ('type="spherical"', 'type="revolute"', "constraint 'tip': <parent_axis> is missing"),
        ('type="spherical"', 'type="universal"', "constraint 'tip': <parent_axis> is missing"),
        ("child_origin", "child_orign", "unknown element 'child_orign'; did you mean 'child_origin'"),
        ('<child link="right_rod"/>\n    <child_o', "<child_o", "constraint 'tip': <child> is missing"),
        (
            '<child link="right_rod"/>\n    <child_o',
            '<child link="left_rod"/><child_o',
            "no joint moves between",
        ),
        (
            '<joint name="left_motor"> <command',
            '<joint name="motor"> <command',
            "unknown movable joint 'motor'",
        ),
        (
            'type="spherical">',
            'type="prismatic"><parent_axis xyz="0 0 1"/><child_axis xyz="0 1 0"/>',
            "<child_axis>: differs from <parent_axis>",
        ),
        (
            "<robot ",
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:a/></robot><r ',
            "not well-formed",
        ),
        (
            '<robot name="five_bar">',
            '<robot name="five_bar" xmlns:xacro="http://ros.org/xacro"><xacro:include/>',
            "<include>: expand the xacro macros first",
        ),
    ],
    # MJCF, where MuJoCo says what is wrong
    "sites": [
        ("<connect ", "<conect ", "line 33: 'conect': MuJoCo: "),
        ('site1="left_tip"', 'site1="tip"', "line 33: 'tip': MuJoCo: unknown element 'tip'"),
        ('site2="right_tip"', 'site2="left_tip"', "is repeated in equality"),
        ('name="left_motor" class="driven"', 'name="left_motor" class="drive"', "line 13: 'joint': MuJoCo: "),
        ('name="left_elbow"', 'name="left_motor"', "line 16: 'joint': MuJoCo: repeated name 'left_motor'"),
        ('<joint name="left_elbow"/>', "<freejoint/>", "line 15: 'left_rod': MuJoCo: "),
        ('<joint name="left_elbow"/>', '<joint axis="0 0 0"/>', "line 16: MuJoCo: axis"),
        ('<joint name="left_elbow"/>', '<joint name="left_elbow" type="ball"/>', "<key> 'home' qpos: needs"),
        ('<joint name="left_elbow"/>', '<joint stiffness="-1"/>', "stiffness must not be negative"),
        ("1.271863 ", "", "<key> 'home' qpos: needs 4 numbers"),
        ('size="0.008"', 'size="0"', "line 14: MuJoCo: size 0 must be positive"),
        ('mass="10"', 'mass="-10"', "has a mass of -10 kg"),
        ("<worldbody>", '<include file="a.xml"/><worldbody>', "line 10: 'include': MuJoCo: "),
        ('angle="radian"', 'angle="radian" autolimits="nan"', "<compiler> autolimits: needs finite"),
    ],
    "anchor": [
        ('body2="right_rod"', 'body2="rod"', "line 21: MuJoCo: unknown element 'rod'"),
        ("<equality>", '<equality><joint joint1="elbow"/>', "line 20: MuJoCo: unknown element 'elbow'"),
        ('euler="0 0 1.2718628575352207"', 'xyaxes="1 0 0 2 0 0"', "line 5: 'left_crank': MuJoCo: "),
        ('<connect body1="left_rod" body2="right_rod" anchor="0.25 0 0"/>', "", "there is no loop in it"),
    ],
}


def written(tmp_path: Path, name: str, text: str) -> Path:
    """A file of the corpus, with its good other half where it is one of a pair."""
    if name not in ("yaml", "pair"):
        file = tmp_path / GOOD[name].name
        file.write_text(text, encoding="utf-8")
        return file
    for key, suffix in (("yaml", "yaml"), ("pair", "urdf")):
        content = text if key == name else GOOD[key].read_text(encoding="utf-8")
        (tmp_path / f"robot.{suffix}").write_text(content, encoding="utf-8")
    return tmp_path / "robot.yaml"


def options(name: str) -> dict[str, object]:
    """Options that leave to the files what they say."""
    return {key: value for key, value in SAID.items() if key != "motors" or name == "plus"}


def refused(file: Path, **given: object) -> str:
    """The one-line error of a file, given within the limit."""
    with bounded(LIMIT), pytest.raises(RobotFileError) as caught:
        ParallelRobot.from_description(read_any(file, **given))
    message = str(caught.value)
    assert message.startswith(str(file)), message
    assert "\n" not in message
    assert len(message) < 1000
    return message


@pytest.mark.parametrize(
    ("name", "old", "new", "expected"), [(name, *change) for name in CHANGES for change in CHANGES[name]]
)
def test_a_changed_file_gives_its_error(name, old, new, expected, tmp_path):
    text = GOOD[name].read_text(encoding="utf-8")
    assert old in text, f"{name} has no {old!r}"
    message = refused(written(tmp_path, name, text.replace(old, new, 1)), **options(name))
    assert expected in message
    if name == "pair":
        assert ": robot.urdf: " in message


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("empty.yaml", "", "is empty"),
        ("empty.xml", "\n", "is empty"),
        ("pointer.urdf", "version https://git-lfs.github.com/spec/v1\nsize 9", "a pointer of Git LFS"),
        ("text.yaml", "hello", "needs a mapping of keys, got 'hello'"),
        ("keys.yaml", "colour: red", "unknown dialect: has neither version"),
        ("date.yaml", "closed_loop: 2024-99-99", "not valid YAML"),
        ("long.yaml", "closed_loop: [" + "a, " * 200_000 + "]", "characters of YAML; at most"),
        ("lonely.yaml", "closed_loop: [[a, b]]", "lonely.urdf: cannot read it: No such file"),
        ("html.xml", "<!DOCTYPE html><html/>", "a page of HTML: download the file itself"),
        ("other.xml", "<model/>", "unknown dialect: unknown root element 'model'"),
        ("sdf.sdf", "<sdf version='1.9'/>", "there is no joint in it"),
        ("plain.urdf", "<robot name='r'><link name='a'/></robot>", "a URDF without loops"),
        (
            "half.urdf",
            "<robot name='r'><link name='closing_tip_2_z'/></robot>",
            "link 'closing_tip_2_z': the other end of its loop, 'closing_tip_1_z', is missing",
        ),
        ("nothing.urdf", "<robot name='r'/>", "needs exactly one root link, got none"),
        ("nothing.xml", "<mujoco/>", "there is no loop in it"),
        ("entity.xml", '<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "document types and entities are not read"),
        (
            "deep.xml",
            "<mujoco><worldbody>" + "<body>" * 3000 + "</body>" * 3000 + "</worldbody></mujoco>",
            "MuJoCo: ",
        ),
        (
            "defaults.xml",
            "<mujoco>" + "<default class='a'>" * 900 + "</default>" * 900 + "</mujoco>",
            "MuJoCo: ",
        ),
        (
            "circle.urdf",
            "<robot name='r'><link name='o'/><link name='a'/><link name='b'/>"
            "<joint name='j' type='fixed'><parent link='a'/><child link='b'/></joint>"
            "<joint name='k' type='fixed'><parent link='b'/><child link='a'/></joint></robot>",
            "link 'a' hangs in a circle of joints without a root",
        ),
        (
            "many.urdf",
            "<robot name='r'>" + "".join(f"<link name='{i}'/>" for i in range(5001)) + "</robot>",
            "5001 links or joints; at most 5000",
        ),
        ("loop_closures.yaml", "closures: []", "a list of closures: give the URDF that they are of"),
    ],
)
def test_a_file_written_by_hand_gives_its_error(name, content, expected, tmp_path):
    (tmp_path / name).write_text(content, encoding="utf-8")
    assert expected in refused(tmp_path / name, **SAID)


def test_a_pair_whose_urdf_is_none_is_refused_by_its_root(tmp_path):
    for file in (GOOD["yaml"], GOOD["pair"]):
        text = file.read_text(encoding="utf-8")
        (tmp_path / file.name).write_text(text.replace("<robot", "<model").replace("</robot", "</model"))
    assert "robot.urdf: <model>: the root of a URDF is <robot>" in refused(tmp_path / "robot.yaml", **SAID)


def test_what_is_no_file_is_refused(tmp_path):
    assert "No such file" in refused(tmp_path / "nowhere.urdf")
    assert "a folder without robot.yaml" in refused(tmp_path)
    (tmp_path / "latin.xml").write_bytes(b"<mujoco>\xe9</mujoco>")
    assert "not UTF-8" in refused(tmp_path / "latin.xml")
    (tmp_path / "large.xml").write_bytes(b" " * 10_000_001)
    assert "10000001 bytes; at most" in refused(tmp_path / "large.xml")


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("sites", 'site name="left_tip" pos="0.25 0 0"', 'site name="left_tip" pos="a"'),
        ("ros", 'type="spherical"', 'type="ball"'),
        ("loop_joint", 'type="spherical"', 'type="planar"'),
    ],
)
def test_the_line_of_an_element_that_cannot_be_read_is_named(name, old, new, tmp_path):
    text = GOOD[name].read_text().replace(old, new, 1)
    message = refused(written(tmp_path, name, text), **options(name))
    assert f": line {text[: text.index(new)].count(chr(10)) + 1}: " in message


@pytest.mark.parametrize(
    "text",
    [
        "<robot name='r'>" + "<!--" * 400_000,  # comments without an end, and two hyphens inside
        "<robot name='r'>" + "".join(f"<a{k}:b/>" for k in range(15_000)) + "</robot>",  # prefixes
        "<robot name='r'><!--" + "<joint " * 400_000 + "--><link name='a'/><joint name='j' type='bent'>"
        "<parent link='a'/><child link='a'/></joint></robot>",  # before the element that is named
    ],
    ids=["comments", "prefixes", "line"],
)
def test_the_time_to_refuse_grows_with_the_length_of_a_file_and_not_with_its_square(text, tmp_path):
    assert refused(written(tmp_path, "ros", text))


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ('<worldbody><replicate count="90000"><geom size="1"/></replicate>', "<replicate> count: 90000"),
        ("<worldbody>" + '<replicate count="99">' * 3 + '<geom size="1"/>' + "</replicate>" * 3, "copies"),
        ('<worldbody><flexcomp name="f" type="grid" count="99 99 99" dim="3"/>', "<flexcomp> count: 970299"),
        ('<asset><hfield name="h" nrow="9000" ncol="9000" size="1 1 1 1"/></asset><worldbody>', "<hfield>"),
        ('<size nuser_body="90000000"/><worldbody>', "<size> nuser_body: 9e+07 parts"),
    ],
)
def test_few_characters_that_mujoco_makes_many_parts_of_are_refused_first(part, words, tmp_path):
    text = GOOD["sites"].read_text().replace("<worldbody>", part, 1)
    assert words in refused(written(tmp_path, "sites", text), **SAID)
    (tmp_path / "part.xml").write_text(text)
    (tmp_path / "whole.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    assert words in refused(tmp_path / "whole.xml", **SAID)
