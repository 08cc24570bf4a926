"""From where robots are looked at: what has to be seen is seen."""

import io
from functools import cache

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from framework.kinematics.placements import joint_poses, platform_frame_twists, platform_positions
from framework.show.drawing import draw_robot
from framework.show.film import Film
from framework.show.sight import Sight, film_sight
from framework.singularity.drawn_locus import locus_patch
from tests.browser.pages import filmed

SCENES = {
    "delta": "cross",
    "gough_stewart": "turn",
    "humanoid_knee": "deep",
    "spherical_rrr": "cross",
}


@cache
def sight_of(name: str) -> tuple[Film, Sight]:
    film = filmed(name, SCENES[name])
    return film, film_sight(film)


def picture(film, sight) -> np.ndarray:
    """The singular instant, in shares of red, green and blue (height, width, 3)."""
    drawing = Figure(figsize=(4, 4), dpi=60)
    draw_robot(film.robot, film.q[film.key_frame], drawing.subplots(), sight=sight).set_axis_off()
    written = io.BytesIO()
    drawing.savefig(written, format="png")
    return np.asarray(Image.open(written).convert("RGB"), dtype=float) / 255


def pixels(seen, rgb) -> int:
    """How much of a picture is of a colour."""
    return int(np.sum(np.abs(seen - rgb).max(axis=2) < 0.02))


@pytest.mark.slow
def test_the_rod_of_the_knee_is_before_the_thigh():
    film, sight = sight_of("humanoid_knee")
    rod = (0.12, 0.47, 0.71)
    behind = sight._replace(toward=-sight.toward)
    assert pixels(picture(film, sight), rod) > 3 * pixels(picture(film, behind), rod)


def test_the_base_of_a_hexapod_hides_no_leg_and_fills_less_than_its_picture():
    film, sight = sight_of("gough_stewart")
    base, legs = (0.25, 0.27, 0.30), (0.12, 0.47, 0.71)
    corner = sight._replace(toward=np.array([0.75, -1.35, 0.65]) / np.linalg.norm([0.75, -1.35, 0.65]))
    ours, cornered = picture(film, sight), picture(film, corner)
    assert pixels(ours, base) < 0.5 * pixels(cornered, base)
    assert pixels(ours, legs) > pixels(cornered, legs)


@pytest.mark.parametrize("name", ["delta", "gough_stewart", "spherical_rrr"])
def test_path_and_t_s_lie_across_the_sight(name):
    film, sight = sight_of(name)
    q = film.q[film.key_frame][None]
    twist = platform_frame_twists(film.robot, q, film.t_s[film.key_frame][None])[0]
    arrow = twist[:3] if len(film.robot.platform.sliding) else twist[3:]
    assert np.linalg.norm(sight.onto(arrow)) > 0.7 * np.linalg.norm(arrow)
    steps = np.diff(platform_positions(film.robot, joint_poses(film.robot, film.q)), axis=0)
    seen = np.linalg.norm(sight.onto(steps), axis=1).sum()
    assert seen >= 0.6 * np.linalg.norm(steps, axis=1).sum()


@pytest.mark.parametrize("name", ["delta", "gough_stewart"])
def test_a_singular_surface_is_not_seen_from_its_edge(name):
    film, sight = sight_of(name)
    k = film.key_frame
    patch = locus_patch(film.robot, film.q[k], film.x[k])
    lines = np.stack(
        [patch[-1] - patch[0], patch[:, -1] - patch[:, 0]], axis=1
    )  # (m, 2, 3) from edge to edge
    whole = np.linalg.norm(np.cross(lines[:, 0], lines[:, 1]), axis=1).sum()
    assert np.abs(np.linalg.det(sight.onto(lines))).sum() > 0.35 * whole
