"""Figures and pages of maps say what they show, and hold the numbers of the map."""

import base64
import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import robots
from framework.atlas.survey import Window
from framework.atlas.workspace_map import workspace_map
from framework.planning.scenes import scene, scene_path
from framework.show.map import map_page, plot_map, save_map_figures


@cache
def found():
    robot = robots.load("five_bar", flexibility="flexible_links")
    window = Window((0, 1), np.array([-0.3, -0.1]), np.array([0.3, 0.5]), (25, 25), robot.reference.x)
    return workspace_map(robot, window)


def path():
    return scene_path(scene(found().robot, "C"))


@pytest.mark.parametrize("key", ["g", "torque"])
def test_a_figure_names_quantity_unit_mode_and_what_is_drawn(key):
    ax = plot_map(found(), key, path=path())
    name, title = ax.figure.get_suptitle().split("\n")
    assert [one.name for one in found().quantities if one.key == key] == [name]
    assert title == "five bar, flexible links: working mode of the reference"
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x  [m]", "y  [m]")
    legend = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert legend == ["singular locus (Type 2)", "path", "not reached"]
    (scale,) = ax.child_axes
    assert scale.get_ylabel() == {"g": "g  (no unit)", "torque": "torque  [N m/N]"}[key]


def test_colours_are_those_of_the_colour_blind_and_bright_is_good():
    for key in ("conditioning", "torque", "stiffness", "frequency"):
        mesh = plot_map(found(), key).images[0]
        values = np.ma.asarray(mesh.get_array()).ravel()
        best = values.argmin() if key == "torque" else values.argmax()
        worst = values.argmax() if key == "torque" else values.argmin()
        grey = [np.dot(mesh.to_rgba(values[k])[:3], [0.299, 0.587, 0.114]) for k in (worst, best)]
        assert grey[1] - grey[0] > 0.5, key


@pytest.mark.slow
def test_nothing_of_a_figure_is_cut_off(tmp_path):
    from PIL import Image

    files = save_map_figures(replace(found(), quantities=found().quantities[3:4]), tmp_path, path=path())
    assert [file.name for file in files] == ["map_stiffness.pdf", "map_stiffness.png"]
    pixels = np.asarray(Image.open(files[1]).convert("L"))
    assert min(pixels[:3].min(), pixels[-3:].min(), pixels[:, :3].min(), pixels[:, -3:].min()) > 250


def test_the_page_is_one_file_with_the_values_of_every_pose():
    page = map_page(found(), path=path())
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    document = json.loads(re.search(r'id="document">(.*?)</script>', page, re.DOTALL)[1])
    for one in document["quantities"]:
        values = np.frombuffer(base64.b64decode(one["values"]), dtype="<f4").reshape(25, 25)
        np.testing.assert_allclose(values, found().values[one["key"]], rtol=1e-6)
    assert [entry[0] for entry in document["legend"]] == [
        "singular locus (Type 2)",
        "path, from the dot on",
        "not reached",
    ]


def test_a_stroke_is_a_curve_over_its_coordinate_with_its_singular_points(tmp_path):
    stroke = workspace_map(robots.load("slider_crank"))
    ax = plot_map(stroke, "g")
    assert ax.get_xlabel() == "rz  [rad]"
    assert ax.get_ylabel() == "g  (no unit)"
    np.testing.assert_array_equal(ax.lines[0].get_xydata()[:, 1], stroke.values["g"][:, 0])
    legend = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert legend == ["singular locus (Type 2)", "reference"]
