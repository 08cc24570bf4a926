"""Robots and films as pictures for paper, slides and READMEs."""

import io

import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar
from PIL import Image
from scipy.spatial import ConvexHull

import robots
from framework import InvalidInput, plan_scene
from framework.atlas import survey_window, workspace_map
from framework.dynamics import platform_stiffness
from framework.kinematics.placements import frame_positions, joint_poses
from framework.show.drawing import ARROW_LENGTH, convex_hull, draw_robot, gallery_picture, plot_still
from framework.show.moving import film_picture
from framework.show.shapes import body_shapes
from framework.show.sight import robot_sight
from framework.show.style import PATH
from framework.show.vibration_figures import plot_modes
from tests.browser.pages import filmed


def test_the_hull_is_that_of_qhull():
    rng = np.random.default_rng(0)
    for points in (rng.normal(size=(50, 2)), rng.integers(0, 4, (60, 2)).astype(float)):
        x, y = convex_hull(points).T
        area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
        assert area == pytest.approx(ConvexHull(points).volume, rel=1e-12)  # in a plane its area


@pytest.mark.parametrize("name", ["n_four_bar", "delta", "gough_stewart"])
def test_all_joints_of_a_drawn_robot_lie_within_what_is_drawn(name):
    robot = robots.load(name)
    q, sight = robot.reference.q, robot_sight(robot)
    (bodies,) = draw_robot(robot, q, sight=sight).collections
    drawn = np.concatenate([path.vertices for path in bodies.get_paths()])
    places = sight.onto(frame_positions(robot, joint_poses(robot, q[None])))
    beyond = np.maximum(drawn.min(axis=0) - places, places - drawn.max(axis=0))
    assert beyond.max() < 0.03 * robot.length  # a joint of no size may lie beside its body
    assert np.all(np.isfinite(drawn))


def test_a_planar_robot_is_drawn_to_the_scale_of_its_axes():
    robot = robots.load("five_bar")
    ax = draw_robot(robot)
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_aspect()) == ("x  [m]", "y  [m]", 1.0)
    (payload,) = [shape for shape in body_shapes(robot) if shape.color[0] > 0.9]  # the yellow one
    rounds = [path.vertices for path in ax.collections[0].get_paths()]
    centers = np.array([line[:-1].mean(axis=0) for line in rounds])
    there = np.linalg.norm(centers - robot.reference.x, axis=1) < 1e-6
    wide = max(np.ptp(line[:, 0]) for line, here in zip(rounds, there, strict=True) if here)
    across = 2 * payload.size[0]
    assert np.cos(np.pi / 32) * across <= wide <= across  # a round outline has 32 corners


def test_a_still_shows_the_path_and_the_singular_place():
    film = filmed("five_bar", "C")
    lines = {line.get_color(): line.get_xydata() for line in plot_still(film).lines}
    np.testing.assert_allclose(lines[PATH], film.x, atol=1e-9)
    assert film.instants[0].platform == pytest.approx([0.0, np.sqrt(0.06)], abs=1e-4)


def test_a_robot_in_space_is_drawn_with_the_scale_and_one_in_a_plane_with_axes():
    for name, scene in (("delta", "pick"), ("five_bar", "C")):
        ax = plot_still(filmed(name, scene))
        bars = [artist for artist in ax.artists if isinstance(artist, AnchoredSizeBar)]
        if name == "five_bar":
            assert not bars
            assert ax.get_xlabel() == "x  [m]"
            continue
        (bar,) = bars
        length = float(bar.txt_label.get_text().removesuffix(" m"))
        (line,) = bar.size_bar.get_children()
        assert line.get_width() == pytest.approx(length)
        assert 0.1 < length / ax.get_window_extent().width * ax.bbox.width / np.ptp(ax.get_xlim()) < 0.5


@pytest.mark.parametrize(
    ("name", "scene", "turns"), [("three_rrr", "crossing", True), ("five_bar", "C", False)]
)
def test_the_turn_of_t_s_is_an_arc_about_the_platform(name, scene, turns):
    film = filmed(name, scene)
    ax, k = plot_still(film), film.key_frame
    centre = film.platform[k][:2]
    patches = [patch for patch in ax.patches if isinstance(patch, FancyArrowPatch) and patch._path_original]
    rings = [patch._path_original.vertices - centre for patch in patches]
    assert len(rings) == turns
    for arc in rings:
        radius = np.linalg.norm(arc, axis=1)
        np.testing.assert_allclose(radius, radius[0], rtol=1e-9)
        shift, turn = film.twists[k, :2], film.twists[k, 5]
        angles = np.unwrap(np.arctan2(*arc.T[::-1]))
        travelled = 0.32 * film.robot.length / np.linalg.norm(shift)  # [s] to the end of its arrow
        assert angles[-1] - angles[0] == pytest.approx(2 * np.sign(turn) * min(abs(turn) * travelled, 2.6))


def test_a_gallery_names_its_robots():
    svg = gallery_picture([robots.load(name) for name in ("five_bar", "delta")], "svg").decode()
    assert all(f">{name}<" in svg for name in ("five bar", "delta"))
    with pytest.raises(InvalidInput, match="pdf, png, svg"):
        gallery_picture([], "gif")


def test_a_picture_is_of_the_kind_asked_for():
    films = [filmed("five_bar", "B"), filmed("five_bar", "C")]
    assert Image.open(io.BytesIO(film_picture(films, "png"))).size == (840, 360)
    svg = film_picture(films, "svg").decode()
    assert "misses the eye" in svg
    assert "threads the eye" in svg
    with pytest.raises(InvalidInput, match="apng, gif, pdf, png, svg"):
        film_picture(films, "jpg")
    with pytest.raises(InvalidInput, match="one path"):
        film_picture([films[0], filmed("five_bar", "bow")], "png")


@pytest.mark.slow
def test_a_picture_says_of_each_scene_whether_it_passes():
    films = [filmed("five_bar", scene) for scene in "ABC"]  # A has no eye
    svg = film_picture(films, "svg").decode()
    assert all(words in svg for words in ("keeps clear", "no torque is large enough", "coasting: works"))


@pytest.mark.slow
def test_a_moving_picture_stands_two_seconds_at_the_singular_instant():
    film = filmed("five_bar", "C")
    moving = Image.open(io.BytesIO(film_picture([film], "gif")))
    lasting, wide = [], []
    for k in range(moving.n_frames):
        moving.seek(k)
        lasting.append(moving.info["duration"])
        pixels = np.array(moving.convert("RGB"), dtype=int)[:, :400]
        base = np.abs(pixels - [64, 68, 76]).max(axis=2) < 12  # the colour of the base in the URDF
        wide.append(np.ptp(np.flatnonzero(base.any(axis=0))))
    assert min(wide) > 200  # of 400 pixels: the robot fills its place
    assert np.ptp(wide) <= 2  # and does not change its size
    assert lasting.count(2000) == 2  # there, and at the end
    assert abs(lasting.index(2000) / (moving.n_frames - 1) - film.instants[0].time / film.time[-1]) < 0.03


@pytest.mark.slow
def test_several_films_move_side_by_side(monkeypatch):
    monkeypatch.setattr("framework.show.moving.GIF_FRAMES", 10)
    films = [filmed("five_bar", name) for name in "ABC"]
    moving = Image.open(io.BytesIO(film_picture(films, "gif")))
    assert moving.size == (840, 420)
    lasting, thirds = [], []
    for k in range(moving.n_frames):
        moving.seek(k)
        lasting.append(moving.info["duration"])
        thirds.append(np.array(moving.convert("RGB"))[:250].reshape(250, 3, 280, 3))
    long = [k for k, milliseconds in enumerate(lasting) if milliseconds >= 2000]
    assert len(long) == 3  # where B and C are singular, and at the end
    singular = long[0]
    assert np.array_equal(thirds[singular][:, 1], thirds[-1][:, 1])  # B ends there
    for scene in (0, 2):
        assert not np.array_equal(thirds[singular][:, scene], thirds[-1][:, scene])


@pytest.mark.slow
def test_robots_plans_and_maps_show_themselves_in_notebooks():
    formatters = pytest.importorskip("IPython.core.formatters")
    robot = robots.load("five_bar")
    window = survey_window(robot, size=6)
    for shown in (robot, plan_scene(robot, "C"), workspace_map(robot, window)):
        found, described = formatters.DisplayFormatter().format(shown)
        assert found["image/png"].startswith(b"\x89PNG")
        assert found["text/plain"] == repr(shown)
        assert len(described["image/png"]["alt"]) > 20


@pytest.mark.slow
def test_the_softest_direction_of_a_spatial_robot_is_drawn_at_most_of_its_length():
    robot = robots.load("delta", flexibility="flexible_links")
    softest, *_ = plot_modes(platform_stiffness(robot, robot.reference.q)).axes
    drawn = np.linalg.norm(np.diff(softest.lines[0].get_xydata(), axis=0))
    assert 0.8 < drawn / (2 * ARROW_LENGTH * robot.length) <= 1.0 + 1e-12
