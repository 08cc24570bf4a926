"""The lesson's numbers: its series against the dynamics at one instant, and whom it refuses."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebval

import robots
from framework import InvalidInput, Line, NoAnswer, ParallelRobot, dynamics_at
from framework.cli import main
from framework.planning.planar_crossing import PATH_SMOOTHNESS
from framework.planning.scenes import scene, scene_path
from framework.show.lesson import lesson_page
from framework.singularity.points_on_path import search_path

KEPT = Path(__file__).parents[2] / "notebooks" / "lesson.html"  # what the README links to
SCENES = (("five_bar", "C"), pytest.param("five_bar_heavy", "C", marks=pytest.mark.slow))


@cache
def written(name: str, scene_name: str) -> tuple[str, dict[str, Any]]:
    """The page that the command writes, without its document, and the document."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "lesson.html"
        assert main(["export", name, "--scene", scene_name, "--to", "lesson", "--out", str(file)]) == 0
        page = file.read_text(encoding="utf-8")
    assert len(page.encode()) < 300_000
    return parts(page)


def parts(page: str) -> tuple[str, dict[str, Any]]:
    """The page without its document, and the document."""
    begin, rest = page.split('<script type="application/json" id="document">')
    text, end = rest.split("</script>", maxsplit=1)
    return begin + end, json.loads(text)


def along(content: dict[str, Any], key: str, s: float | np.ndarray) -> np.ndarray:
    """Values of a quantity at s, (K,) or (K, M)."""
    begin, end = content["slices"][key]
    return np.array([chebval(2 * s - 1, column) for column in content["series"][begin:end]])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "scene_name"), SCENES)
def test_torques_of_the_page_are_those_of_the_dynamics_with_and_without_gravity(name, scene_name):
    robot, (_, content) = robots.load(name), written(name, scene_name)
    path = scene_path(scene(robot, scene_name))
    branch = search_path(robot, path).branch
    for gravity, size in (("off", 0.0), ("on", 9.81)):
        weighed = ParallelRobot.from_description(replace(robot.description, gravity=(0.0, -size, 0.0)))
        for s, v, a in ((0.1, 1.3, -2.0), (0.45, 0.4, 5.0), (0.9, 2.0, 0.0)):
            place = np.array([s])
            slope, bend = path(place, 1)[0], path(place, 2)[0]
            q = branch.close(place).q[0]
            instant = dynamics_at(weighed, q, dx=slope * v, ddx=slope * a + bend * v**2)
            parts = along(content, f"torque_{gravity}", s).reshape(3, -1)
            torque = np.array([1.0, v**2, a]) @ parts / along(content, "g", s)
            np.testing.assert_allclose(torque, instant.torque, rtol=1e-9)
            # W_p of massless legs is the payload's: what the motors' forces add up to, rotors apart
            force = along(content, "torque_of_force", s).reshape(2, 2) / along(content, "g", s)
            np.testing.assert_allclose(
                along(content, "motor_speed", s).reshape(2, 2).T @ force, np.eye(2), atol=1e-9
            )


def test_the_best_law_of_the_page_threads_the_eye_within_its_peak():
    _, content = written("five_bar", "C")
    sigma = np.linspace(0.0, 1.0, 4002)[1:-1]
    s = sigma**3 * (10 - 15 * sigma + 6 * sigma**2)
    slope, bend = 30 * (sigma * (1 - sigma)) ** 2, 60 * sigma * (1 - sigma) * (1 - 2 * sigma)
    assert PATH_SMOOTHNESS == 2  # which these are made for
    for gravity, best in content["best"].items():
        z = chebval(2 * sigma - 1, best["squared_speed"])
        assert np.trapezoid(1 / np.sqrt(z), sigma) == pytest.approx(content["duration"], rel=2e-3)
        u = chebval(2 * sigma - 1, np.polynomial.chebyshev.chebder(best["squared_speed"]))
        parts = along(content, f"torque_{gravity}", s).T.reshape(len(s), 3, -1)
        g = along(content, "g", s)[0]
        terms = np.stack([np.ones_like(s), slope**2 * z, slope * u + bend * z], axis=1)
        torque = np.einsum("mk,mka->ma", terms, parts) / g[:, None]
        clear = np.abs(s - content["crossing"]) > 1e-3
        assert np.abs(torque[clear]).max() == pytest.approx(best["peak"], rel=1e-3)


def test_the_lesson_that_is_kept_is_the_one_that_is_written_today():
    """If not: crossing export five_bar --scene C --to lesson --out notebooks/lesson.html"""
    (kept_shell, kept), (shell, today) = parts(KEPT.read_text(encoding="utf-8")), written("five_bar", "C")
    assert kept_shell == shell
    assert structure(kept) == structure(today)
    assert not today["upright"]  # it lies in a plane
    for key in kept["slices"]:
        before, now = (along(content, key, np.linspace(0.0, 1.0, 33)) for content in (kept, today))
        np.testing.assert_allclose(before, now, atol=1e-9 * np.abs(now).max(), err_msg=key)
    for gravity, best in kept["best"].items():  # flat optima: another BLAS kernel moved one by 3e-5
        assert best["peak"] == pytest.approx(today["best"][gravity]["peak"], rel=1e-3)
    # outlines and traced curves may have other points on them
    outlines = [[np.ptp(shape["points"], axis=0) for shape in content["shapes"]] for content in (kept, today)]
    np.testing.assert_allclose(*outlines, atol=1e-5)
    loci = [[np.ptp(curve, axis=0) for curve in content["locus"]] for content in (kept, today)]
    np.testing.assert_allclose(*loci, rtol=1e-3)


def structure(content: dict[str, Any]) -> dict[str, Any]:
    """What of a lesson is no series, no optimum, no outline and no traced curve, to nine digits."""
    rest = {key: value for key, value in content.items() if key not in ("series", "shapes", "best", "locus")}
    shapes = [(shape["node"], shape["colour"]) for shape in content["shapes"]]
    return rest | {"shapes": shapes, "crossing": round(content["crossing"], 9)}


@pytest.mark.slow
def test_the_lesson_of_an_upright_robot_knows_that_its_weight_is_left_out():
    robot = robots.load("five_bar")
    # limits of the file do not count: the reader of the page sets them
    weak = tuple(replace(motor, torque_limit=1e-3) for motor in robot.description.actuators)
    stood = ParallelRobot.from_description(
        replace(robot.description, gravity=(0.0, -9.81, 0.0), actuators=weak)
    )
    page = lesson_page(stood, scene_path(scene(robot, "C")), duration=1.5)
    assert '"upright":true' in page.replace(" ", "")
    assert "its weight is left out" in page  # said by the page's script where upright is true


def test_whom_a_lesson_is_not_for_is_told_what_it_needs():
    line = Line([0.1, 0.345], [-0.05, 0.195])
    with pytest.raises(InvalidInput, match="a lesson needs a rigid robot"):
        lesson_page(robots.load("five_bar", flexibility="flexible_links"), line, duration=1.5)
    three_rrr = robots.load("three_rrr")
    with pytest.raises(InvalidInput, match="two translations"):
        lesson_page(three_rrr, scene_path(scene(three_rrr, "crossing")), duration=1.0)
    with pytest.raises(NoAnswer, match=r"crosses the singular locus once .*this one meets it nowhere"):
        lesson_page(robots.load("five_bar"), Line([0.1, 0.345], [0.05, 0.345]), duration=1.0)
    with pytest.raises(NoAnswer, match=r"meets it at s = 0\.\d+ \(transversal\), at s = 0\.\d+ \(transv"):
        lesson_page(robots.load("five_bar"), Line([0.0, 0.345], [0.0, -0.15]), duration=1.0)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["five_bar", "--scene", "A"], 1, "--scene A: five_bar: a lesson needs a path that crosses"),
        (["five_bar", "--scene", "Z"], 2, "unknown scene 'Z'"),
        (["three_rrr", "--scene", "crossing"], 2, "three_rrr, rigid: a lesson needs a platform with two"),
    ],
)
def test_no_lesson_is_an_answer_of_the_path_and_bad_input_of_the_robot(
    tmp_path, capsys, arguments, code, said
):
    file = tmp_path / "lesson.html"
    assert main(["export", *arguments, "--to", "lesson", "--out", str(file)]) == code
    assert said in " ".join(capsys.readouterr().err.split())
    assert not file.exists()
