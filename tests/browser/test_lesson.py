"""The lesson in a browser: its JavaScript against the framework's own numbers, and each of its steps."""

from __future__ import annotations

import numpy as np
import pytest

import robots
from framework import plan_scene
from framework.crossing.scenes import scene, scene_path
from framework.dynamics.wrench import wrench_along
from framework.show.lesson import lesson_page

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def page() -> str:
    robot = robots.load("five_bar")
    return lesson_page(robot, scene_path(scene(robot, "C")), duration=1.5, name="Scene C")


def test_its_torques_are_those_of_the_plan(opened, page):
    tab = opened(page)
    plan = plan_scene(robots.load("five_bar"), "C")
    times = np.array([0.2, 0.7, 0.99, 1.01, 1.4])
    asked = [[float(plan.law(t, order)) for order in range(3)] for t in times]
    told = tab.evaluate("asked => asked.map((each) => crossing.lesson.torques(...each, 'off'))", asked)
    np.testing.assert_allclose(told, plan.torque(times), rtol=1e-9)
    power = tab.evaluate("asked => asked.map((each) => crossing.lesson.power(...each, 'off'))", asked)
    np.testing.assert_allclose(np.abs(power), np.abs(wrench_along(plan.dynamics, times)[1]), rtol=1e-3)


def test_each_step_can_be_done_by_mouse_and_by_keyboard(opened, page):
    tab = opened(page)
    # 1: locked motors hold a push at the start, and none on the locus
    tab.locator(".platform").focus()
    tab.keyboard.down("ArrowUp")
    assert "The motors hold it." in tab.inner_text("#score")
    tab.keyboard.up("ArrowUp")
    tab.locator("#place").focus()
    tab.evaluate(
        "(place) => { place.value = 0.668; place.dispatchEvent(new Event('input')); }",
        tab.query_selector("#place"),
    )
    tab.locator(".platform").focus()
    tab.keyboard.down("ArrowUp")
    assert "It gives way. No torque is large enough." in tab.inner_text("#score")
    tab.keyboard.up("ArrowUp")
    # 2: unprepared
    tab.get_by_role("button", name="Next: Go through").click()
    assert "Misses the eye by 1.76 N" in tab.inner_text("#score")
    # 3: a handle behind the singular point is pulled up until the curve goes through the eye
    tab.get_by_role("button", name="Next: Thread the needle").click()
    tab.locator("[data-handle='4']").focus()
    for _ in range(40):
        if "Through the eye" in tab.inner_text("#score"):
            break
        tab.keyboard.press("ArrowUp")
    assert "Through the eye" in tab.inner_text("#score")
    state = tab.evaluate("(({ miss, largest, peak }) => [miss / largest, peak])(crossing.lesson.curves())")
    assert abs(state[0]) < 1e-9
    assert 0.0398 < state[1] < 0.5
    before = tab.evaluate("crossing.lesson.state.logarithms[5]")
    box = tab.locator("[data-handle='5']").bounding_box()
    tab.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    tab.mouse.down()
    tab.mouse.move(box["x"] + box["width"] / 2, box["y"] - 20)
    tab.mouse.up()
    assert tab.evaluate("crossing.lesson.state.logarithms[5]") > before
    # 4 and 5: the best law, of which the page says the peak
    for name, peak in (("With gravity", "3.21 N m"), ("Beat the best", "0.0398 N m")):
        tab.get_by_role("button", name=f"Next: {name}").click()
        assert "Misses the eye" in tab.inner_text("#score")
        tab.get_by_role("button", name="Show the best law").click()
        assert "Through the eye" in tab.inner_text("#score")
        assert f"{peak}, of the best law" in tab.inner_text("#score")


@pytest.mark.parametrize("width", [1440, 1024, 390])
def test_it_fits_its_window(opened, page, width):
    tab = opened(page, width=width, height=844)
    for step in range(5):
        tab.evaluate(f"crossing.lesson.choose({step})")
        assert tab.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        if width > 900:
            assert tab.evaluate("document.documentElement.scrollHeight - innerHeight") <= 0
