"""The document of a scene and the page around it, for every robot of the catalogue."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import robots
from framework.show.jogging import hand_document
from framework.show.page import film_page, hand_page
from framework.show.scene import encode_floats, film_documents
from framework.show.shapes import body_shapes, thin_mesh
from tests.browser.pages import filmed

# The others, whose meshes may take seconds to read, are slow.
QUICK = ("five_bar", "delta", "gough_stewart", "agile_eye")
ROBOTS = [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in robots.CATALOGUE]


def decoded(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4")


def documents(page: str) -> list[dict]:
    found = re.search(r'<script type="application/json" id="document">(.*?)</script>', page, re.DOTALL)
    return json.loads(found[1])


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_has_a_body_to_show(name):
    robot = robots.load(name)
    document = hand_document(robot)
    json.dumps(document, allow_nan=False)
    poses = decoded(document["poses"]).reshape(1, robot.model.njoints, 7)
    np.testing.assert_allclose(np.linalg.norm(poses[0, :, 3:], axis=1), 1.0, atol=1e-6)
    assert len(document["motors"]) == robot.n_a
    # every joint that carries mass carries a shape
    heavy = {j for j in range(1, robot.model.njoints) if robot.model.inertias[j].mass > 0}
    assert heavy <= {shape["node"] for shape in document["shapes"]}
    view = document["view"]
    assert np.linalg.norm(view["from"]) == pytest.approx(1.0)
    offsets = poses[0, 1:, :3] - view["center"]
    assert np.linalg.norm(offsets, axis=1).max() <= view["radius"] * (1 + 1e-6)


def test_wrenches_of_the_world_are_drawn_to_the_scale_of_w_p():
    wrenches = {"left_tip": [30.0, -40.0, 0, 0, 0, 0], "right_crank": [0, 0, 0, 0, 0, 2.0], "base": [0] * 6}
    film = filmed("five_bar", "A", wrenches=wrenches)
    (document,) = film_documents([film])
    drawn = document["world"]
    assert [wrench["frame"] for wrench in drawn] == ["left tip", "right crank"]  # what is zero has no arrow
    for wrench, applied in zip(drawn, film.wrenches, strict=False):
        parts = [decoded(wrench[key]).reshape(-1, 3) for key in ("linear", "angular", "origin")]
        given = wrenches[applied.frame]
        np.testing.assert_allclose(parts[0], np.tile(given[:3], (len(film.time), 1)), atol=1e-5)
        np.testing.assert_allclose(parts[1], np.tile(given[3:], (len(film.time), 1)), atol=1e-5)
        np.testing.assert_allclose(parts[2], applied.origin, atol=1e-6)
        assert wrench["largest"] == document["W_p"]["largest"]
    assert document["W_p"]["largest"] == pytest.approx(
        [max(50.0, np.linalg.norm(film.W_p, axis=1).max()), 2.0]
    )
    assert film_documents([filmed("five_bar", "A")])[0]["world"] == []


def test_a_proven_film_tells_its_numbers():
    film = filmed("five_bar", "C", "flexible_links")
    (document,) = film_documents([film])
    np.testing.assert_allclose(decoded(document["torque"]).reshape(-1, 2), film.torque, rtol=1e-6, atol=1e-9)
    assert document["torque_limit"] == np.abs(film.torque).max()
    assert [instant["time"] for instant in document["instants"]] == [film.instants[0].time]
    assert "finite torque" in document["summary"]
    factors, coils = document["springs"]["factors"], document["springs"]["coils"]
    largest = np.abs(film.deflection).max(axis=0)
    for coil in coils:  # what is drawn can be seen, and stays within the coil
        shown = largest[coil["column"]] * factors["slide" if coil["slides"] else "turn"]
        assert 0 < shown <= 0.35 * (document["springs"]["length"] if coil["slides"] else 1.0) * (1 + 1e-9)
    for factor in factors.values():
        assert float(f"{factor:.0e}"[0]) in (1, 2, 5)


def test_an_unproved_film_is_clipped_and_says_so():
    film = filmed("five_bar", "B")
    (document,) = film_documents([film])
    assert document["torque_limit"] < np.abs(film.torque).max() / 10
    assert document["torque_limit"] > 2 * np.median(np.abs(film.torque))
    assert "goes off the scale" in document["summary"]
    assert not document["proved"]


@pytest.mark.parametrize(("name", "scene"), [("five_bar", "B"), ("four_bar", "unprepared")])
def test_what_a_motion_asks_for_at_its_singular_instant_lies_on_its_curve(name, scene):
    film = filmed(name, scene)
    (document,) = film_documents([film])
    (instant,) = document["instants"]
    power = decoded(document["power"])
    at = float(np.interp(instant["time"], film.time, power))
    step = float(np.abs(np.diff(power)).max())  # from frame to frame
    assert instant["wrench"] == pytest.approx(at, abs=step)
    assert abs(at) > 5 * step


def test_the_page_is_one_file_without_a_network():
    page = film_page([filmed("five_bar", name) for name in ("A", "B", "C")])
    assert [document["title"] for document in documents(page)] == ["A", "B", "C"]
    assert len(page) < 5e6
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=\"(?!data:)", page)
    assert "default-src 'none'" in page
    assert "MIT" in page  # the viewer's licence goes with it
    assert "$" not in re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)  # no place left unfilled


def test_a_name_cannot_break_out_of_the_page():
    film = filmed("five_bar", "A")
    page = film_page([replace(film, name="</script><b>")])
    assert documents(page)[0]["title"] == "</script><b>"
    assert "</script><b>" not in page


def test_a_robot_to_move_by_hand_has_its_sliders():
    (document,) = documents(hand_page(robots.load("five_bar")))
    assert [slider["name"] for slider in document["sliders"]["platform"]] == ["x", "y"]
    assert [slider["name"] for slider in document["sliders"]["motor"]] == ["left_motor", "right_motor"]
    for part, values in document["sliders"].items():
        for slider, value in zip(values, document["start"][part], strict=True):
            assert slider["low"] < value < slider["high"]


def test_bodies_without_visuals_get_sticks_from_joint_to_joint(write_robot):
    from framework import ParallelRobot

    robot = ParallelRobot.from_file(write_robot(urdf=()))
    bare = re.sub(r"<visual>.*?</visual>", "", robot.description.urdf_text, flags=re.DOTALL)
    naked = ParallelRobot.from_description(
        type(robot.description)(**{**vars(robot.description), "urdf_text": bare})
    )
    sticks = [shape for shape in body_shapes(naked) if shape.kind == "cylinder"]
    # two cranks and two rods of 0.25 m
    np.testing.assert_allclose([shape.size[1] for shape in sticks], 0.25)
    assert {shape.node for shape in sticks} == {1, 2, 3, 4}


def test_a_thinned_mesh_keeps_its_shape_and_has_no_collapsed_faces():
    angles = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    heights = np.linspace(0, 1, 100)
    vertices = np.array([[np.cos(a), np.sin(a), h] for h in heights for a in angles])
    faces = np.array([[i, i + 1, i + 400] for i in range(400 * 99 - 1)])
    less, kept = thin_mesh(vertices, faces)
    assert len(less) < len(vertices) / 10
    assert kept.max() < len(less)
    assert all(len(set(face)) == 3 for face in kept.tolist())
    np.testing.assert_allclose(np.linalg.norm(less[:, :2], axis=1), 1.0, atol=0.02)


def test_floats_travel_as_little_endian_singles():
    assert decoded(encode_floats([[1.5, -2.0], [0.25, 1e-3]])).tolist() == [1.5, -2.0, 0.25, np.float32(1e-3)]
