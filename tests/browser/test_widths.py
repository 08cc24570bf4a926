"""Pages on a phone, on paper and for those who do not see colours or the picture."""

import numpy as np
import pytest

import robots
from framework import plan_scene
from framework.show.page import film_page
from framework.show.report import report_page
from tests.browser.conftest import wait_until
from tests.browser.pages import filmed

pytestmark = pytest.mark.browser

OVERFLOW = "document.documentElement.scrollWidth - innerWidth"


@pytest.fixture(scope="module")
def report() -> str:
    return report_page(plan_scene(robots.load("five_bar", flexibility="flexible_links"), "C"), name="Scene C")


@pytest.mark.parametrize("names", [["C"], ["A", "B", "C"]])
def test_a_phone_needs_no_scrolling_sideways(opened, names):
    tab = opened(film_page([filmed("five_bar", name) for name in names]), width=390, height=844)
    assert tab.evaluate(OVERFLOW) <= 0
    for view in tab.query_selector_all(".view"):
        assert view.bounding_box()["height"] >= 250
    # a column is as high as what is in it: the page scrolls, and nothing is cut off
    cut = "[...document.querySelectorAll('.column')].map((box) => box.scrollHeight - box.clientHeight)"
    assert max(tab.evaluate(cut)) <= 0
    assert tab.evaluate("document.documentElement.scrollHeight") > 844 * len(names) * 0.9


def test_a_report_fits_a_phone_and_its_figures_a_page(opened, report):
    tab = opened(report, width=390, height=844)
    assert tab.evaluate(OVERFLOW) <= 0
    tab.emulate_media(media="print")
    tab.set_viewport_size({"width": 794, "height": 1123})  # A4 at 96 dots an inch
    assert tab.evaluate(OVERFLOW) <= 0
    assert tab.locator("footer").is_hidden()
    boxes = [box.bounding_box() for box in tab.query_selector_all("figure, .report h2, .report table, pre")]
    boxes = [box for box in boxes if box]
    edges = np.array([[b["x"], b["y"], b["x"] + b["width"], b["y"] + b["height"]] for b in boxes])
    for k, (left, top, right, bottom) in enumerate(edges):
        for other in edges[:k]:
            apart = (
                left >= other[2] - 1 or other[0] >= right - 1 or top >= other[3] - 1 or other[1] >= bottom - 1
            )
            assert apart, (boxes[k], other)
    captions = [caption.inner_text() for caption in tab.query_selector_all("figcaption")]
    assert [text.split(".")[0] for text in captions] == [f"Figure {k}" for k in range(1, len(captions) + 1)]


def test_the_picture_has_a_name_and_what_happens_is_told(shared):
    tab = shared("five_bar", "C")
    assert tab.get_attribute("canvas", "role") == "img"
    assert tab.get_attribute("canvas", "aria-label") == "five bar, C: goes through coasting: works"
    tab.click("button.telling")
    assert "Singular now." in tab.text_content("[role=status]")


def test_a_curve_is_led_by_keyboard(shared):
    tab = shared("five_bar", "C")
    tab.locator(".chart").first.focus()
    for _ in range(10):
        tab.keyboard.press("ArrowRight")
    wait_until(tab, "Math.abs(crossing.clock.t - 0.15) < 1e-9")
    tab.keyboard.press("End")
    assert tab.evaluate("crossing.clock.t") == 1.5
