"""A film says what the plan says: places, forces, singular instants, in frames whose loops are closed."""

from __future__ import annotations

import numpy as np
import pytest

import robots
from framework.crossing.scenes import scene_request
from framework.dynamics.wrench import wrench_along
from framework.show.film import film_motion


def filmed(name: str, scene_name: str, flexibility: str = "rigid"):
    robot = robots.load(name, flexibility=flexibility)
    return film_motion(robot, scene_request(robot, scene_name), name=scene_name)


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
    g, wrench = wrench_along(crossing.plan.dynamics, crossing.time)
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
