"""A film says what the plan says: places, forces, singular instants, in frames whose loops are closed."""

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import plan_scene
from framework.dynamics.platform_wrench import wrench_curves
from framework.show import film_plan
from tests.browser.pages import filmed


@pytest.fixture(scope="module")
def crossing():
    return filmed("five_bar", "C", "flexible_links")


def test_a_crossing_is_a_frame_of_its_own(crossing):
    (instant,) = crossing.instants
    k = int(np.argmin(np.abs(crossing.time - instant.time)))
    assert crossing.time[k] == instant.time
    assert np.all(np.diff(crossing.time) > 0)
    # g is a smooth function with slope about 1 /s and zero at the instant
    assert abs(crossing.g[k]) < 1e-12
    np.testing.assert_allclose(crossing.t_s[k] @ crossing.W_p[k], 0.0, atol=1e-11)


def test_the_wrench_of_massless_legs_is_the_payload_s(crossing):
    # 10 kg at the tip, moving in the plane: W_p = m a (the paper's Eq. (10)); rotors are no part of it
    acceleration = crossing.plan.platform(crossing.time, 2)
    np.testing.assert_allclose(crossing.W_p, 10.0 * acceleration, atol=1e-9)


def test_the_force_along_t_s_is_the_one_of_the_figures(crossing):
    g, _, wrench = wrench_curves(crossing.robot, crossing.plan.dynamics.motion(crossing.time))
    np.testing.assert_array_equal(crossing.g, g)
    # where legs have no mass, eta . r_p = t_s . W_p all along, not only on the locus
    np.testing.assert_allclose(np.sum(crossing.t_s * crossing.W_p, axis=1), wrench, atol=1e-9)


def test_t_s_is_the_twist_of_the_crossing(crossing):
    k = int(np.argmin(np.abs(crossing.g)))
    cosine = crossing.t_s[k] @ crossing.plan.crossings[0].twist
    assert abs(cosine) == pytest.approx(1.0, abs=1e-12)


def test_an_unproved_motion_says_so_and_keeps_its_pole():
    film = filmed("five_bar", "B", "flexible_links")
    assert not film.proved
    assert "unbounded torque" in film.refusal
    (instant,) = film.instants
    assert instant.s == pytest.approx(0.667006874764298)  # the root of the oracle
    before, after = (film.torque[np.searchsorted(film.time, instant.time) + k, 0] for k in (-1, 0))
    assert before * after < 0  # it changes sign through infinity
    assert min(abs(before), abs(after)) > 3 * np.median(np.abs(film.torque[:, 0]))


def test_a_robot_without_passive_joints_has_no_measure():
    film = filmed("two_arms", "lift")
    assert np.isnan(film.g).all()
    assert film.instants == ()


@pytest.mark.parametrize(
    ("name", "scene_name"), [("five_bar", "C"), ("five_bar", "bow"), ("orthoglide", "cross")]
)
def test_motors_that_a_motion_takes_reach_all_that_it_asks_for_along_t_s(name, scene_name):
    film = filmed(name, scene_name)
    power = np.sum(film.t_s * film.W_p, axis=1)
    low, high = film.motors.band(film.t_s, np.abs(film.torque).max(axis=0)).T
    slack = 1e-9 * np.abs(power).max()
    assert np.all(low <= power + slack)
    assert np.all(power <= high + slack)
    for instant in film.instants:  # the eye of the needle: a point, and it is 0
        k = int(np.argmin(np.abs(film.time - instant.time)))
        assert np.abs([low[k], high[k], power[k]]).max() < 1e-8 * np.abs(high).max()


def test_an_unproved_motion_misses_the_eye_whatever_the_motors():
    film = filmed("five_bar", "B")
    (instant,) = film.instants
    power = np.sum(film.t_s * film.W_p, axis=1)
    widths = []
    for limit in (0.1, 0.3):
        low, high = film.motors.band(film.t_s, np.full(2, limit)).T
        missed = film.time[(power < low) | (power > high)]
        assert missed.min() < instant.time < missed.max()
        widths.append(np.ptp(missed))
    assert widths[1] < 0.5 * widths[0]  # the stronger the motors, the nearer they come, and no further


def test_films_side_by_side_are_shown_with_the_same_motors():
    from framework.show.scene import film_documents

    works, fails = filmed("five_bar", "C"), filmed("five_bar", "B")
    documents = film_documents([fails, works])
    assert documents[0]["stated"] == documents[1]["stated"]
    size = f"{1.5 * np.abs(works.torque).max():.3g} N m"
    assert documents[1]["stated"] == f"motors of {size} (1.5 × peak, no limit given)"


def test_a_picture_shows_the_limit_that_its_plan_was_given():
    from framework.show.scene import film_documents

    film = film_plan(plan_scene(robots.load("five_bar"), "A", torque_limit=0.5))
    (document,) = film_documents([film])
    assert document["stated"].startswith("motors of 0.5 N m (")
    assert "no limit" not in document["stated"]


@pytest.mark.parametrize("scene_name", ["A", "B"])  # with a proof, and without one
def test_wrenches_of_the_world_are_filmed_where_they_act(scene_name):
    rows = np.array([[0.0, 3, 0, 0, 0, 0, 0], [1.0, 5, -2, 0, 0, 0, 0.5]])
    wrenches = {"left_tip": rows.tolist(), "right_crank": {"wrench": [0, 1.0, 0, 0, 0, 0], "axes": "tool"}}
    film = filmed("five_bar", scene_name, wrenches=wrenches)
    assert film.proved == (scene_name == "A")
    tip, crank = film.wrenches
    s = film.law(film.time)
    np.testing.assert_allclose(tip.at_origin, rows[0, 1:] + s[:, None] * (rows[1] - rows[0])[1:], atol=1e-12)
    model, data = film.robot.model, film.robot.model.createData()
    for k in range(0, len(film.q), 60):
        pin.framesForwardKinematics(model, data, film.q[k])
        for wrench in (tip, crank):
            placement = data.oMf[model.getFrameId(wrench.frame)]
            np.testing.assert_allclose(wrench.origin[k], placement.translation, atol=1e-12)
        np.testing.assert_allclose(crank.at_origin[k, :3], placement.rotation[:, 1], atol=1e-12)
        np.testing.assert_allclose(crank.at_origin[k, 3:], 0.0, atol=1e-12)
