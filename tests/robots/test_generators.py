"""The URDFs that generators write, and the elements that they write them with."""

from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework.catalogue import URDF
from robots.generators.elements import (
    COMPACT,
    SPACED,
    document,
    inertial,
    link,
    oriented,
    origin,
    shape,
    sphere,
)

HERE = Path(robots.__file__).parent / "generators"
GENERATORS = sorted(path.stem for path in HERE.glob("[!_]*.py") if path.stem != "elements")
SAID = "Written by robots/generators/"


@pytest.mark.parametrize("name", GENERATORS)
def test_the_kept_files_are_what_the_generator_writes(name):
    files = import_module(f"robots.generators.{name}").files()
    assert files
    for place, text in files.items():
        assert (URDF / place).read_text(encoding="utf-8") == text
        assert f"{SAID}{name}.py" in text


def test_every_file_that_says_so_is_kept_by_a_generator():
    kept = {place for name in GENERATORS for place in import_module(f"robots.generators.{name}").files()}
    said = {
        path.relative_to(URDF).as_posix()
        for path in URDF.glob("*/*.*")
        if path.suffix in (".urdf", ".yaml") and SAID in path.read_text(encoding="utf-8")
    }
    assert said == kept


@pytest.mark.parametrize("layout", [SPACED, COMPACT], ids=["spaced", "compact"])
def test_an_element_is_what_an_xml_parser_finds_in_either_layout(layout):
    body = link(
        "ball",
        inertial(2.5, (0, 0.25, 0), np.array([[1, 0.5, 0.25], [0.5, 2, 0.125], [0.25, 0.125, 3]])),
        shape(sphere(0.5), origin((1, 2, 3)), "steel"),
    )
    root = ElementTree.fromstring(document('<robot name="one">\n', [body, "  <!-- end -->"], layout))
    (found,) = root
    assert [child.tag for child in found] == ["inertial", "visual", "collision"]
    inertia = found.find("inertial/inertia")
    expected = {"ixx": 1, "ixy": 0.5, "ixz": 0.25, "iyy": 2, "iyz": 0.125, "izz": 3}
    assert {name: float(value) for name, value in inertia.attrib.items()} == expected
    assert found.find("visual/origin").attrib == {"xyz": "1 2 3", "rpy": "0 0 0"}
    assert found.find("visual/geometry/sphere").get("radius") == "0.5"
    assert found.find("visual/material").get("name") == "steel"
    assert found.find("collision/material") is None


@pytest.mark.parametrize("pitch", [0.0, 0.7, np.pi / 2, -np.pi / 2])
def test_axes_are_the_turns_that_pinocchio_reads(pitch):
    axes = pin.rpy.rpyToMatrix(0.4, pitch, -1.1)
    rpy = np.array(oriented((0, 0, 0), axes).attributes["rpy"])
    np.testing.assert_allclose(pin.rpy.rpyToMatrix(rpy), axes, rtol=0, atol=1e-15 if abs(pitch) < 1 else 1e-9)
