"""A film on paper: its pages as pictures."""

import numpy as np
import pytest

from framework.show.page import film_page
from tests.browser.pages import filmed

pdfium = pytest.importorskip("pypdfium2", reason="pages are drawn by pypdfium2, of the extra `browser`")
pytestmark = pytest.mark.browser

DOTS = 1.5  # a point of 1/72 inch
MARGIN = int(0.9 * 14 / 25.4 * 72 * DOTS)  # nine tenths of the 14 mm of the page's style


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
