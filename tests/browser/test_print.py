"""A report on paper: its pages as pictures."""

import numpy as np
import pytest

import robots
from framework import plan_scene
from framework.show.page import film_page
from framework.show.report import report_page
from tests.browser.pages import filmed

pdfium = pytest.importorskip("pypdfium2", reason="pages are drawn by pypdfium2, of the extra `browser`")
pytestmark = pytest.mark.browser

DOTS = 1.5  # a point of 1/72 inch
# Whatever is printed belongs to one of these.
KINDS = {
    "pictures": "figure img",
    "captions": "figcaption",
    "headings": "h1, h2",
    "rest": "p, li, table, pre",
}
MARGIN = int(0.9 * 14 / 25.4 * 72 * DOTS)  # nine tenths of the 14 mm of the page's style


def pages(tab, shown: str) -> list[np.ndarray]:
    """The pages of the PDF as pictures, True where there is ink, with all but some elements invisible."""
    tab.evaluate(
        """(shown) => {
          let style = document.getElementById("only");
          if (!style) {
            style = document.head.appendChild(document.createElement("style"));
            style.id = "only";
          }
          style.textContent = shown && `
            .report *, body { visibility: hidden; border-color: transparent !important; }
            :is(${shown}), :is(${shown}) * { visibility: visible !important; }`;
        }""",
        shown,
    )
    document = pdfium.PdfDocument(tab.pdf(prefer_css_page_size=True))
    pictures = [page.render(scale=DOTS, grayscale=True).to_numpy() for page in document]
    return [np.asarray(picture).squeeze() < 200 for picture in pictures]


@pytest.mark.parametrize("scenes", [["C"], ["A", "B", "C"]])
def test_a_printed_film_has_a_page_a_scene_with_the_whole_robot(opened, scenes):
    tab = opened(film_page([filmed("five_bar", scene) for scene in scenes]))
    tab.click("button.telling")
    document = pdfium.PdfDocument(tab.pdf(prefer_css_page_size=True))
    assert len(document) == len(scenes)
    for page in document:
        red, green, blue = np.moveaxis(page.render(scale=DOTS).to_numpy().astype(int)[..., :3], -1, 0)[::-1]
        rods = [(blue - red > 90) & (green < 150), (red - blue > 150) & (green < 140)]  # blue and orange
        assert all(colour.sum() > 200 for colour in rods)
        assert not any(colour[:, -MARGIN:].any() for colour in rods)


def test_nothing_of_a_printed_report_lies_over_anything_else(opened):
    plan = plan_scene(robots.load("five_bar", flexibility="flexible_links"), "C")
    tab = opened(report_page(plan, name="Scene C"))
    whole = pages(tab, "")
    parts = {kind: pages(tab, shown) for kind, shown in KINDS.items()}
    assert 2 <= len(whole) <= 12
    for found in parts.values():
        assert len(found) == len(whole)  # what is invisible keeps its place
        assert any(page.any() for page in found)
    together = [sum(found[k].astype(int) for found in parts.values()) for k in range(len(whole))]
    for page, count in zip(whole, together, strict=True):
        assert count.max(initial=0) <= 1  # no ink over other ink
        assert page.any()  # no page is empty
        missing = page & (count == 0)  # borders of tables, greyed edges of letters
        assert missing.sum() < 0.05 * page.sum()
        # nothing beyond the margins
        assert not page[:, :MARGIN].any()
        assert not page[:, -MARGIN:].any()
    # no heading stands alone at the foot of a page
    for k, page in enumerate(parts["headings"]):
        if page.any():
            others = whole[k] & ~page
            assert np.flatnonzero(others.any(axis=1)).max() > np.flatnonzero(page.any(axis=1)).max()
