"""What is said about a film is what the film shows."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import ParallelRobot
from framework.show.captions import (
    describe_film,
    describe_film_briefly,
    describe_flexibility,
    describe_proof,
    describe_saved_plan,
    explain_crossing,
    why_singular,
)
from tests.browser.pages import filmed


@pytest.mark.parametrize(
    ("name", "scene", "said"),
    [
        ("five_bar", "A", "keeps clear of the singularity"),
        ("five_bar", "B", "goes through while it asks for force along t_s: fails"),
        ("five_bar", "C", "goes through coasting: works"),
        ("biglide", "bow", "goes through while it asks for no force along t_s: works"),
        ("two_arms", "lift", "every joint has a motor: no Type 2 singularity"),
    ],
)
def test_a_subtitle_tells_the_scenes_apart(name, scene, said):
    assert describe_film_briefly(filmed(name, scene)) == said


@pytest.mark.parametrize(
    ("name", "scene", "how_so"),
    [
        ("five_bar", "C", "it coasts across"),
        ("biglide", "bow", "W_p stands at a right angle to t_s"),
        ("four_bar", "dead_point", "it needs none at all"),
        ("gough_stewart", "turn", "W_p does no work along t_s"),
    ],
)
def test_how_the_condition_is_met_is_how_the_motion_is_there(name, scene, how_so):
    film = filmed(name, scene)
    (instant,) = film.instants
    assert how_so in explain_crossing(film, instant)
    k = int(np.argmin(np.abs(film.time - instant.time)))
    acceleration = film.path(film.law(instant.time), 1) * film.law(instant.time, 2)
    force, most = np.linalg.norm(film.W_p[k]), np.linalg.norm(film.W_p, axis=1).max()
    still = np.abs(acceleration).max() < 1e-4
    assert ("coasts" in how_so) == (still and force < 1e-4 * most)
    assert ("right angle" in how_so or "work" in how_so) == (force > 1e-2 * most)


def test_a_motion_without_proof_has_none_and_says_when_its_springs_are_left_out():
    rigid, flexible = filmed("five_bar", "B"), filmed("five_bar", "B", "flexible_links")
    assert describe_proof(rigid) == explain_crossing(rigid, rigid.instants[0]) == ""
    assert "rigid" not in describe_film(rigid)
    assert "drawn with rigid parts" in describe_film(flexible)


def test_peak_torque_and_proof_are_said_with_their_flexibility():
    film = filmed("five_bar", "C", "flexible_links")
    assert describe_flexibility(film) == "flexible links, deformed geometry"
    assert f"{np.abs(film.torque).max():.3g} N m (flexible links, deformed geometry)" in describe_film(film)
    assert f"on {film.plan.certificate.nodes} nodes" in describe_proof(film)


def test_why_is_told_of_the_catalogue_s_own_robot_only(write_robot):
    assert "one line" in why_singular(robots.load("five_bar"))
    assert why_singular(robots.load("two_arms")) == ""
    assert why_singular(ParallelRobot.from_file(write_robot())) == ""


def test_each_robot_that_crosses_says_why_it_is_singular():
    """In words that tests/robots/test_why.py proves."""
    for name, entry in robots.CATALOGUE.items():
        names = {"across", "cross", "crossing", "C", "turn", "dead_point", "dead_centre"}
        meets = "type_2" in entry.singularities and name != "three_upu"  # which has no scene that crosses
        crosses = meets and names & set(robots.load(name).description.scenes)
        assert entry.why or not crosses, name


def test_an_unnamed_film_has_the_name_of_its_robot():
    from framework.show.scene import film_documents

    (document,) = film_documents([replace(filmed("five_bar", "A"), name="")])
    assert document["title"] == "five bar"


def test_a_saved_plan_is_called_as_its_scene():
    from framework import plan_scene

    robot = robots.load("five_bar")
    assert describe_saved_plan(plan_scene(robot, "C"), "folder") == "Scene C"
    assert describe_saved_plan(plan_scene(robot, "A"), "folder") == "Scene A"
    assert describe_saved_plan(plan_scene(robot, "C", speeds=[1.4]), "folder") == "Plan folder"
    assert describe_saved_plan(plan_scene(robot, "A", duration=1.6), "folder") == "Plan folder"
