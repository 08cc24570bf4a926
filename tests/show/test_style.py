"""The colours of figures and pages: told apart by everybody, readable, and written in one place."""

import re
from functools import cache
from importlib.resources import files
from itertools import combinations

import numpy as np
import pytest
from fontTools.subset import Options

from framework.show import style
from framework.show.plots import MISSES, THREADS
from framework.show.style import DARK_COLORS, PAGE_COLORS, line_style, page_colors


@cache
def colour_science():
    with np.printoptions():  # it sets how NumPy prints numbers, for good
        import colour
    return colour


VISIONS = (None, "Protanomaly", "Deuteranomaly", "Tritanomaly")  # of severity 1: one kind of cone is missing
LEAST_DIFFERENCE = 12.0  # CIEDE2000, of colours that are drawn together; 2.3 is just noticed
READABLE = 4.5  # WCAG 2.2, 1.4.3: of text on its ground
SCENE = ("LOCUS", "TWIST", "WRENCH", "world", "PATH", "path", "GIVEN", "ALARM")
ROBOT = ("#edb821", "#d65e1a", "#1f78b5")  # yellow, orange and blue of our URDFs
# what the paper itself says of its model
TRITANOPIA_APPROXIMATED = pytest.mark.filterwarnings(
    r"ignore:\s*.Machado et al. \(2009\). simulation of tritanomaly"
)
DARK = ("ink", "soft", "LOCUS", "TWIST", "WRENCH", "world", "ALARM", "GOOD", "warning")


def color(name: str) -> str:
    return name if name.startswith("#") else PAGE_COLORS.get(name) or getattr(style, name)


def linear(name: str) -> np.ndarray:
    """Linear sRGB."""
    return colour_science().cctf_decoding(colour_science().notation.HEX_to_RGB(color(name)), function="sRGB")


def difference(first: str, second: str, vision: str | None) -> float:
    """CIEDE2000 as one sees it who lacks a kind of cone (Machado, Oliveira and Fernandes 2009)."""
    labs = []
    for name in (first, second):
        rgb = linear(name)
        if vision is not None:
            rgb = np.clip(colour_science().blindness.matrix_cvd_Machado2009(vision, 1.0) @ rgb, 0.0, 1.0)
        white = colour_science().CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"]
        labs.append(colour_science().XYZ_to_Lab(colour_science().RGB_to_XYZ(rgb, "sRGB"), white))
    return float(colour_science().delta_E(*labs, method="CIE 2000"))


def contrast(text: str, ground: str) -> float:
    """WCAG's ratio of luminances."""
    low, high = sorted(float(linear(name) @ [0.2126, 0.7152, 0.0722]) for name in (text, ground))
    return (high + 0.05) / (low + 0.05)


@TRITANOPIA_APPROXIMATED
@pytest.mark.parametrize("vision", VISIONS)
def test_colours_drawn_together_are_told_apart(vision):
    together = [
        *combinations(SCENE, 2),
        *combinations(style.COLORS, 2),
        *combinations(("ALARM", "GOOD", "LOCUS", "GIVEN"), 2),
        *((name, body) for name in ("PATH", "LOCUS", "WRENCH") for body in ROBOT),
        ("UNREACHED", "NOT_CARRIED"),
        ("BEYOND", "NOT_CARRIED"),
        ("idle", "busy"),
        ("busy", "ALARM"),
    ]
    found = {pair: difference(*pair, vision) for pair in together}
    assert min(found.values()) > LEAST_DIFFERENCE, min(found.items(), key=lambda item: item[1])


def test_curves_of_one_plot_have_a_dash_each():
    dashes = [str(line_style(k)["linestyle"]) for k in range(len(style.COLORS))]
    assert len(set(dashes)) == len(dashes)
    assert THREADS[1] != MISSES[1]
    assert THREADS[2] != MISSES[2]


@pytest.mark.parametrize("name", DARK)
def test_text_is_readable_on_paper_and_paper_on_it(name):
    assert contrast(name, "paper") >= READABLE
    assert contrast(name, "ground") >= READABLE


@pytest.mark.parametrize("ground", ["good-ground", "alarm-ground", "warning-ground"])
def test_words_of_the_moment_are_readable(ground):
    assert contrast("ink", ground) >= READABLE


def test_pages_have_no_colours_of_their_own():
    asset = files("framework.show").joinpath("page")
    for file in asset.iterdir():
        if file.name.endswith((".css", ".js", ".html")):
            text = re.sub(r"&#[^;]*;", "", file.read_text(encoding="utf-8"))
            assert not re.findall(r"#[0-9a-fA-F]{3,8}\b|0x[0-9a-fA-F]{6}\b|\brgb\(\d", text), file.name
            named = re.findall(r"var\(--([a-z0-9-]+)", text) + re.findall(r'\bink\("([a-z0-9-]+)"\)', text)
            assert set(named) <= PAGE_COLORS.keys() | {"view-height"}, file.name
    light, dark = page_colors().split("@media screen")
    written = [dict(re.findall(r"--([a-z0-9-]+): (#[0-9a-f]{6});", part)) for part in (light, dark)]
    assert written == [PAGE_COLORS, DARK_COLORS]


@pytest.mark.parametrize(
    "name", sorted({*DARK, "ink", "soft", "locus", "alarm", "warning", "good"} & DARK_COLORS.keys())
)
def test_text_is_readable_on_dark_pages(name):
    for ground in ("paper", "ground"):
        assert contrast(DARK_COLORS[name], DARK_COLORS[ground]) >= READABLE


def test_fonts_of_others_keep_their_layout():
    """A program that draws our figures may write PDFs of its own, in scripts that need these tables."""
    tables = Options().drop_tables
    with style._fonts_without_layout():
        assert {"GPOS", "GSUB", *tables} <= {*Options().drop_tables}
    assert Options().drop_tables == tables


def test_twins_share_their_place_and_a_legend_above_takes_some():
    upper, lower = style.new_figure(2)
    twin = upper.twinx()
    upper.plot([0, 1], label="line")
    upper.figure.legend()  # above, by default
    upper.figure.get_layout_engine().execute(upper.figure)
    place = upper.get_position()
    np.testing.assert_array_equal(twin.get_position().get_points(), place.get_points())
    assert place.height == pytest.approx(lower.get_position().height)
    assert 0.0 < lower.get_position().y0 < lower.get_position().y1 < place.y0 < place.y1 < 0.97
