"""The page of a map: the value under the pointer is the map's, by mouse and by keys, on any width."""

import re
from functools import cache

import numpy as np
import pytest

import robots
from framework.atlas.survey import Window
from framework.atlas.workspace_map import workspace_map
from framework.dynamics.loading import LOAD_WORDS, LoadReason
from framework.show.map import map_page

pytestmark = pytest.mark.browser

SIZE = 41


@cache
def found():
    robot = robots.load("five_bar", flexibility="flexible_links")
    window = Window((0, 1), np.array([-0.3, -0.45]), np.array([0.3, 0.45]), (SIZE, SIZE), robot.reference.x)
    return workspace_map(robot, window)


def told(tab):
    """The table under the map, by name without the unit."""
    rows = tab.evaluate(
        "[...document.querySelectorAll('#values tr')].map(r => [...r.children].map(c => c.innerText))"
    )
    return {re.sub(r" \[.*", "", name): text for name, text in rows}


def number(text):
    """A number as the page writes it: 2.31·10⁵, −0.04."""
    digits, _, power = text.replace("−", "-").partition("·10")
    power = power.translate(str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-"))
    return float(digits) * 10.0 ** int(power or 0)


def same(tab, i, j):
    shown = told(tab)
    x, y = (span[k] for span, k in zip(found().window.spans, (i, j), strict=True))
    assert (number(shown["x"]), number(shown["y"])) == pytest.approx((x, y), rel=1e-3, abs=1e-9)
    for one in found().quantities:
        assert number(shown[one.name]) == pytest.approx(found().values[one.key][i, j], rel=6e-3), one.key


@pytest.mark.parametrize("width", [1280, 390])
def test_the_pointer_tells_the_values_of_its_pose(opened, width):
    tab = opened(map_page(found()), width=width)
    assert tab.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    for i, j in ((20, 30), (12, 14), (30, 25)):
        box = tab.locator("#map").bounding_box()
        frame = tab.evaluate(
            "(({left, top, across, high}) => [left, top, across, high])(crossing.map.frame())"
        )
        left, top, across, high = frame
        tab.mouse.move(
            box["x"] + left + (i + 0.5) / SIZE * across, box["y"] + top + (1 - (j + 0.5) / SIZE) * high
        )
        same(tab, i, j)
    tab.keyboard.press("Tab")
    tab.locator("#map").focus()
    tab.keyboard.press("ArrowRight")
    tab.keyboard.press("ArrowDown")
    same(tab, 31, 24)


def test_another_quantity_is_painted_and_what_is_not_reached_says_why(opened):
    tab = opened(map_page(found()))
    before = tab.evaluate("document.getElementById('map').toDataURL()")
    assert tab.inner_text("#reading").startswith("White is 0")  # g, at first
    tab.locator("#quantity").select_option("torque")
    assert tab.evaluate("document.getElementById('map').toDataURL()") != before
    assert tab.inner_text("#reading") == "Bright is small, and good."
    tab.evaluate("crossing.map.move([0, 0])")
    assert set(told(tab)) == {"x", "y", "pose"}
    assert told(tab)["pose"] in found().counts


def test_all_quantities_are_shown_in_small_beside_the_map_and_chosen_there(opened):
    tab = opened(map_page(found()), width=1600)
    buttons = tab.locator("#others button")
    assert buttons.count() == len(found().quantities)
    cards = [tab.locator(card).bounding_box() for card in (".picture", ".others")]
    assert cards[0]["x"] < 50
    assert cards[1]["x"] + cards[1]["width"] > 1550  # the whole width of the screen
    for k, one in enumerate(found().quantities):
        buttons.nth(k).click()
        assert tab.input_value("#quantity") == one.key
        assert buttons.nth(k).get_attribute("aria-pressed") == "true"


def test_where_a_load_is_not_carried_the_pointer_tells_why(opened):
    robot = robots.load("five_bar", flexibility="flexible_links")
    window = Window((0, 1), np.array([-0.02, 0.2]), np.array([0.02, 0.36]), (5, 5), robot.reference.x)
    loaded = workspace_map(robot, window, ["loaded_stiffness"], wrench=[0.0, -300.0])
    tab = opened(map_page(loaded))
    name = next(one.name for one in loaded.quantities if one.loaded)
    tab.locator("#quantity").select_option("loaded_stiffness")
    for i, j in np.ndindex(5, 5):
        tab.evaluate(f"crossing.map.move([{i}, {j}])")
        if loaded.load[i, j]:
            assert told(tab)[name] == LOAD_WORDS[LoadReason(int(loaded.load[i, j]))]
        else:
            value = loaded.values["loaded_stiffness"][i, j]
            assert number(told(tab)[name]) == pytest.approx(value, rel=6e-3)
