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


# Text of at least some letters, with its contrast to the nearest ground that is not transparent; WCAG 2.1.
CONTRASTS = """() => {
  const numbers = (color) => { // of rgb(247, 240, 240) and of color(srgb 0.97 0.94 0.94)
    const [r, g, b, ...rest] = (color.match(/[\\d.]+/g) || [0, 0, 0, 0]).map(Number);
    return [...[r, g, b].map((value) => (color.startsWith("color(") ? 255 * value : value)), ...rest];
  };
  const light = (color) => numbers(color).slice(0, 3).map((c) => c / 255)
    .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
    .reduce((sum, c, k) => sum + c * [0.2126, 0.7152, 0.0722][k], 0);
  const ground = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const color = getComputedStyle(at).backgroundColor, [, , , a = 1] = numbers(color);
      if (a > 0.8 && color !== "transparent") return color;
    }
    return "rgb(255, 255, 255)";
  };
  const written = (node) => node.nodeType === 3 && /\\w{2}/.test(node.data);
  return [...document.querySelectorAll("h1, h2, p, b, span, div, label, button, text, tspan, td, th")]
    .filter((element) => [...element.childNodes].some(written))
    .filter((element) => element.getBoundingClientRect().width > 1)
    .map((element) => {
      const style = getComputedStyle(element), svg = element instanceof SVGElement;
      const [a, b] = [light(svg ? style.fill : style.color), light(ground(element))];
      return [element.textContent.slice(0, 40), (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05)];
    });
}"""


@pytest.mark.parametrize(
    ("name", "scene_name", "wrenches"),
    [
        ("five_bar", "B", {"left_tip": [3.0, -4.0, 0, 0, 0, 0]}),
        ("five_bar", "C", None),
        ("gough_stewart", "turn", None),
    ],
)
def test_all_words_stand_out_from_their_ground(opened, name, scene_name, wrenches):
    tab = opened(film_page([filmed(name, scene_name, wrenches=wrenches)]))
    tab.click("button.telling")
    found = tab.evaluate(CONTRASTS)
    assert len(found) > 20
    assert [pair for pair in found if pair[1] < 4.5] == []


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
