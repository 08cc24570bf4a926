"""The visuals of a URDF as shapes: what cannot be drawn is left out, without a line on the console."""

import os

import numpy as np
import pytest

import robots
from framework import ParallelRobot
from framework.show.shapes import body_shapes

MESH = '<mesh filename="{}"/>'
TETRAHEDRON = """v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 2 3
f 1 2 4
f 1 3 4
f 2 3 4
"""


BASE = '<link name="base">'  # the first of the URDF: what stands in it first is drawn first


@pytest.fixture
def visuals(write_robot, capfd):
    """Shapes that the base of the 5R gets from a URDF text, nothing printed meanwhile."""

    def read(visual: str, material: str = ""):
        before = body_shapes(robots.load("five_bar"))
        changes = ((BASE, f"{BASE}{visual}"), ("</robot>", f"{material}</robot>"))
        shapes = body_shapes(ParallelRobot.from_file(write_robot(urdf=changes)))
        assert capfd.readouterr() == ("", "")
        return shapes[: len(shapes) - len(before)]

    return read


def visual(geometry: str, before: str = '<origin xyz="1 2 3" rpy="0 0 0.5"/>', after: str = "") -> str:
    return f"<visual>{before}<geometry>{geometry}</geometry>{after}</visual>"


def test_a_shape_stands_where_its_origin_says(visuals):
    (shape,) = visuals(visual('<box size="1 2 3"/>'))
    c, s = np.cos(0.5), np.sin(0.5)
    expected = [[c, -s, 0, 1], [s, c, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(shape.placement, expected, atol=1e-15)
    assert (shape.kind, shape.size) == ("box", (1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("after", "material", "color"),
    [
        ("", "", (0.9, 0.9, 0.9, 1.0)),
        ('<material name="a"><color rgba="1 0 0 0.5"/></material>', "", (1.0, 0.0, 0.0, 0.5)),
        ('<material name="m"/>', '<material name="m"><color rgba="0 1 0 1"/></material>', (0, 1, 0, 1)),
        ('<material name="other"/>', "", (0.9, 0.9, 0.9, 1.0)),
    ],
)
def test_a_shape_has_its_own_colour_or_that_of_its_material(visuals, after, material, color):
    (shape,) = visuals(visual('<sphere radius="1"/>', after=after), material)
    assert shape.color == color


MALFORMED = (
    "<visual/>",
    visual(""),
    visual("<cone/>"),
    visual('<box size="1 2"/>'),
    visual('<box size="1 2 nan"/>'),
    visual('<box size="1 2 -3"/>'),
    visual('<cylinder radius="1"/>'),
    visual('<sphere radius="x"/>'),
    visual('<sphere radius="1"/>', after='<material name="a"><color rgba="1"/></material>'),
    visual("<mesh/>"),
    visual(MESH.format("nowhere.stl")),
    visual(MESH.format(".")),
    visual(MESH.format("package://nowhere/a.stl")),
    visual(MESH.format("five_bar.urdf")),
    visual(MESH.format("/dev/zero")),
)


def test_a_malformed_visual_is_left_out_and_its_neighbour_drawn(visuals):
    spheres = [visual(f'<sphere radius="{k + 1}"/>') for k in range(len(MALFORMED))]
    shapes = visuals("".join(part for pair in zip(MALFORMED, spheres, strict=True) for part in pair))
    assert [shape.kind for shape in shapes] == ["sphere"] * len(MALFORMED)
    assert [shape.size[0] for shape in shapes] == [k + 1.0 for k in range(len(MALFORMED))]


def test_a_mesh_is_found_beside_its_robot_file(visuals, tmp_path):
    (tmp_path / "solid.obj").write_text(TETRAHEDRON)
    (shape,) = visuals(visual('<mesh filename="solid.obj" scale="2 2 2"/>'))
    assert shape.kind == "mesh"
    assert len(shape.faces) == 4
    np.testing.assert_allclose(shape.vertices.max(axis=0), [2.0, 2.0, 2.0], atol=1e-6)


def test_a_robot_file_given_by_a_relative_path_finds_its_meshes_too(write_robot, tmp_path, monkeypatch):
    (tmp_path / "solid.obj").write_text(TETRAHEDRON)
    file = write_robot(urdf=((BASE, f"{BASE}{visual(MESH.format('solid.obj'))}"),))
    monkeypatch.chdir(tmp_path)
    shapes = body_shapes(ParallelRobot.from_file(os.path.basename(file)))
    assert "mesh" in {shape.kind for shape in shapes}


@pytest.mark.slow
def test_a_body_of_the_robot_file_is_the_box_that_its_inertia_says():
    robot = robots.load("two_arms")
    (box,) = [shape for shape in body_shapes(robot) if shape.color == (0.93, 0.72, 0.13, 1.0)]
    np.testing.assert_allclose(box.size, [0.2, 0.4, 0.2], atol=1e-3)  # its inertia is rounded to 0.0001
