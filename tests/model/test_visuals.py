"""The solids of a robot stand where its URDF puts them."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

import robots
from framework.model.visuals import Shape, read_visuals


def written(robot):
    """Kind, sizes and place in the base of each primitive of the URDF, links at the neutral configuration."""
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    found = []
    for link in ElementTree.fromstring(robot.description.urdf_text).findall("link"):
        at = data.oMf[model.getFrameId(link.get("name"), pin.FrameType.BODY)]
        for visual in link.findall("visual"):
            (solid,) = visual.find("geometry")
            origin = visual.find("origin")
            place = {"xyz": "0 0 0", "rpy": "0 0 0", **({} if origin is None else origin.attrib)}
            xyz, rpy = (np.array(place[key].split(), float) for key in ("xyz", "rpy"))
            size = [float(v) for key in ("size", "radius", "length") for v in solid.get(key, "").split()]
            found.append((solid.tag, size, (at * pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)).homogeneous))
    return found


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_links"])
@pytest.mark.parametrize("name", ["five_bar", "delta", "gough_stewart", "slider_crank"])
def test_every_solid_of_the_urdf_hangs_on_its_joint(name, flexibility):
    robot = robots.load(name, flexibility=flexibility)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, pin.neutral(robot.model))
    shapes = read_visuals(robot.description, robot.model)
    expected = written(robot)
    assert len(shapes) == len(expected) > 0
    for kind, size, place in expected:
        same = [
            shape
            for shape in shapes
            if shape.kind == kind
            and np.allclose(shape.size, size)
            and np.allclose(data.oMi[shape.node].homogeneous @ shape.placement, place, atol=1e-12)
        ]
        assert same, f"{kind} {size} at {place[:3, 3]}"


def test_the_corners_of_a_solid_bound_it():
    turned = pin.SE3(pin.exp3(np.array([0.3, -0.5, 0.8])), np.array([1.0, 2.0, 3.0])).homogeneous
    rng, color = np.random.default_rng(3), (0.0, 0.0, 0.0, 1.0)
    points = rng.uniform(-1.0, 1.0, (500, 3)) * [0.1, 0.2, 0.3]
    for shape in (
        Shape(1, "box", (0.2, 0.4, 0.6), turned, color),
        Shape(1, "mesh", (), turned, color, points, np.empty((0, 3), dtype=np.intp)),
        Shape(1, "cylinder", (0.2, 0.6), turned, color),
        Shape(1, "sphere", (0.3,), turned, color),
    ):
        corners = (shape.corners() - turned[:3, 3]) @ turned[:3, :3]
        assert np.all(corners.min(axis=0) <= points.min(axis=0) + 1e-12)
        assert np.all(corners.max(axis=0) >= points.max(axis=0) - 1e-12)
        assert np.ptp(corners, axis=0)[2] == pytest.approx(0.6, rel=0.02)


def test_a_mesh_has_the_corners_and_triangles_of_its_file(tmp_path):
    """A tetrahedron with edges along the axes, each with its own scale, moved and turned by its origin."""
    corners, faces = np.vstack([np.zeros(3), np.eye(3)]), [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    lines = ["v {} {} {}".format(*corner) for corner in corners]
    lines += ["f {} {} {}".format(*(k + 1 for k in face)) for face in faces]
    (tmp_path / "tetrahedron.obj").write_text("\n".join(lines) + "\n")
    mesh = '<geometry><mesh filename="tetrahedron.obj" scale="0.1 0.2 0.3"/></geometry>'
    origin = '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>'  # x to y, y to -x
    robot = robots.load("slider_crank")
    text = robot.description.urdf_text.replace(
        '<link name="crank">', f'<link name="crank"><visual>{origin}{mesh}</visual>', 1
    )
    description = replace(robot.description, urdf_text=text, file=tmp_path / "robot.yaml")
    (shape,) = [one for one in read_visuals(description, robot.model) if one.kind == "mesh"]
    assert robot.model.names[shape.node] == "crank_bearing"
    found = shape.to_node(shape.vertices)[shape.faces]
    expected = np.array([1, 2, 3]) + corners @ np.array([[0, 0.1, 0], [-0.2, 0, 0], [0, 0, 0.3]])
    np.testing.assert_allclose(found, expected[np.array(faces)], atol=1e-12)
    solids = replace(robot, description=description).visual_model.geometryObjects
    (solid,) = [one for one in solids if one.geometry.getNodeType() == coal.NODE_TYPE.BV_OBBRSS]
    assert solid.geometry.computeVolume() == pytest.approx(0.1 * 0.2 * 0.3 / 6)  # of all four triangles
    np.testing.assert_allclose(solid.placement.homogeneous, shape.placement)
