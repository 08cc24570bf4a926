"""Files are read whole, as text, within limits; what is no file is not opened."""

import os

import pytest

import robots
from framework import InvalidInput, ParallelRobot, RobotFileError
from framework.model import read_robot_file
from framework.model.documents import MAX_XML_ELEMENTS, parse_xml, parse_yaml
from framework.model.readers import read_any
from framework.numerics.input import LARGEST_FILE, read_text
from tests.conftest import REMOVED
from tests.watchdog import bounded

QUICK = 5.0  # [s] of processor time in which anything is refused


def refused(file, reading=lambda file: read_text(file, "the file"), error=InvalidInput) -> str:
    """The message with which reading a file is refused, soon."""
    with bounded(QUICK), pytest.raises(error) as caught:
        reading(file)
    return str(caught.value)


def test_a_text_is_read_as_python_reads_it(tmp_path):
    file = tmp_path / "text"
    file.write_bytes("é\r\nb\rc\n".encode("utf-8-sig"))
    assert read_text(file, "the file") == file.read_text(encoding="utf-8-sig") == "é\nb\nc\n"


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda file: None, "No such file"),
        (lambda file: file.mkdir(), "not a regular file"),
        (lambda file: os.mkfifo(file), "not a regular file"),  # nobody will ever write into it
        (lambda file: file.symlink_to("/dev/zero"), "not a regular file"),  # it never ends
        (lambda file: file.symlink_to(file), "symbolic links"),
        (lambda file: file.write_bytes(b"\xff"), "not UTF-8"),
        (lambda file: file.write_bytes(b" " * (LARGEST_FILE + 1)), f"{LARGEST_FILE + 1} bytes; at most"),
    ],
)
def test_what_cannot_be_read_is_refused_with_the_reason(tmp_path, make, reason):
    file = tmp_path / "file"
    make(file)
    message = refused(file)
    assert message.startswith("the file: ")
    assert reason in message


@pytest.mark.parametrize(
    ("name", "reason"),
    [("a\0b", "not a file name"), ("a" * 300, "File name too long"), ("a" * 5000, "File name too long")],
    ids=["null byte", "300 letters", "5000 letters"],
)
def test_what_is_no_file_name_is_refused_without_repeating_it(tmp_path, name, reason):
    assert refused(tmp_path / name) == f"the file: {reason}"


@pytest.mark.skipif(not os.path.exists("/proc/self/maps"), reason="Linux alone has such files")
def test_a_file_that_says_less_than_it_holds_is_cut_off():
    with open("/proc/self/maps", encoding="utf-8") as stream:  # 0 bytes, they say
        assert stream.read()
    assert "at most 10 are read" in refused(
        "/proc/self/maps", lambda file: read_text(file, "the file", largest=10)
    )


@pytest.mark.parametrize("beside", ["fifo", "/dev/zero"])
def test_the_urdf_beside_a_robot_file_is_read_within_limits_too(write_robot, beside):
    file = write_robot()
    urdf = file.with_name("five_bar.urdf")
    urdf.unlink()
    os.mkfifo(urdf) if beside == "fifo" else urdf.symlink_to(beside)
    for read in (read_robot_file, read_any):
        assert "five_bar.urdf: not a regular file" in refused(file, read, RobotFileError)


def tree(links: int, *, kind: str = "revolute", star: bool = True) -> str:
    """A URDF with so many links, all on the first one or each on the one before."""
    joint = (
        "<joint name='j{0}' type='{1}'><parent link='l{2}'/><child link='l{0}'/>"
        "<limit effort='1' velocity='1'/></joint>"
    )
    parts = [f"<link name='l{k}'/>" for k in range(links)]
    parts += [joint.format(k, kind, 0 if star else k - 1) for k in range(1, links)]
    return f"<robot name='large'>{''.join(parts)}</robot>"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (tree(5001), "5001 links or joints; at most 5000"),
        (tree(5000, kind="fixed", star=False), "more than 1000 joints in a row"),
        (
            "<robot name='r'>" + "<a/>" * MAX_XML_ELEMENTS + "</robot>",
            f"more than {MAX_XML_ELEMENTS} XML elements",
        ),
        ("<!DOCTYPE robot [<!ENTITY a 'a'>]><robot name='&a;'/>", "document types and entities"),
    ],
    ids=["links", "depth", "elements", "entities"],
)
def test_a_large_urdf_is_refused_before_it_takes_long(write_robot, text, reason):
    file = write_robot()
    file.with_name("five_bar.urdf").write_text(text, encoding="utf-8")
    assert reason in refused(file, read_robot_file, RobotFileError)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (tree(5000, kind="fixed", star=False).replace("</robot>", "<loop/></robot>"), "1000 joints in a row"),
        (tree(1500).replace("</robot>", "<loop/></robot>"), "1499 freedoms; at most 1000"),
        (tree(3).replace("</robot>", "<loop/>" * 1001 + "</robot>"), "1001 loops; at most 1000"),
    ],
)
def test_a_large_file_of_a_foreign_dialect_is_refused_before_it_takes_long(tmp_path, text, reason):
    file = tmp_path / "large.urdf"
    file.write_text(text, encoding="utf-8")
    assert reason in refused(file, read_any, RobotFileError)


def test_more_joints_than_pinocchio_has_memory_for_are_refused(write_robot):
    file = write_robot(
        ("platform.frame", "l1"),
        ("closures.0.frames", ["l1", "l2"]),
        ("actuators", [{"joint": "j1"}]),
        ("springs", REMOVED),
        ("reference", {}),
    )
    file.with_name("five_bar.urdf").write_text(tree(300), encoding="utf-8")
    assert "299 joints that move, springs included; at most 250" in refused(
        file, ParallelRobot.from_file, RobotFileError
    )


@pytest.mark.parametrize("levels", [5_000, 20_000])
def test_deep_nesting_is_refused(write_robot, levels):
    file = write_robot(("frames", [{"name": "extra", "parent": "base"}]))  # so that the text is written anew
    urdf = file.with_name("five_bar.urdf")
    deep = "<a>" * levels + "</a>" * levels
    urdf.write_text(urdf.read_text(encoding="utf-8").replace("</robot>", f"{deep}</robot>"), encoding="utf-8")
    assert "nested too deeply" in refused(file, read_robot_file, RobotFileError)
    file.write_text("version: " + "[" * levels, encoding="utf-8")
    assert "nested too deeply" in refused(file, read_robot_file, RobotFileError)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: 1\nb: 2\na: 3\n", "'a': duplicate key, in line 1 and in line 3"),
        ("{a: 1, a: 1}", "'a': duplicate key"),
        ("yes: 1\ntrue: 2\n", "True: duplicate key"),
        ('name: "\\ud800"', "invalid Unicode character escape code"),
        ("a: [" + "b, " * 21_000 + "]", "more than 20000 values"),
        ("? [a]\n: b", "not valid YAML"),
        ("a: !!int x", "not valid YAML"),
    ],
)
def test_a_yaml_text_that_cannot_be_meant_is_refused(text, reason):
    assert reason in refused(text, parse_yaml, RobotFileError)


def test_a_yaml_text_as_long_as_may_be_is_read_soon():
    text = "".join(f"k{i}: [1, 2.5, text, {{a: b}}]\n" for i in range(2200))
    with bounded(QUICK):
        assert len(parse_yaml(text)) == 2200
    assert parse_yaml("") is None


@pytest.mark.parametrize("before", ["\n", "\ufeff", "\ufeff \r\n"])
def test_a_urdf_is_read_behind_blanks_before_its_declaration(write_robot, before):
    file = write_robot()
    urdf = file.with_name("five_bar.urdf")
    text = urdf.read_text(encoding="utf-8")
    assert text.startswith("<?xml")
    urdf.write_text(before + text, encoding="utf-8")
    assert ParallelRobot.from_file(file).model == robots.load("five_bar").model


def test_xml_is_read_behind_a_byte_order_mark_and_a_doctype_in_a_comment_is_none():
    assert parse_xml("\ufeff <robot><!-- <!DOCTYPE --></robot>").tag == "robot"
