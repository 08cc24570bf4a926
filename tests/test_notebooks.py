"""Notebooks as they are stored: every picture has a description, and nothing needs a script to be seen."""

import base64
import io
import json
from pathlib import Path

import pytest
from PIL import Image

from tests.notebook_outputs import differences, texts

FOLDER = Path(__file__).parents[1] / "notebooks"
NOTEBOOKS = {file.stem: json.loads(file.read_text()) for file in sorted(FOLDER.glob("*.ipynb"))}
LARGEST = 1_000_000  # bytes; pre-commit takes no larger file
# What nbconvert and GitHub both show: of scripts, frames and image/gif one of them shows nothing.
SHOWN_ANYWHERE = {"image/png", "text/plain"}
WORDS_A_MINUTE = 200  # below the 238 of silent reading in English (Brysbaert 2019), for there are formulas
SECONDS_A_LINE, SECONDS_A_PICTURE = 3.0, 15.0


def cells(name, kind):
    return [cell for cell in NOTEBOOKS[name]["cells"] if cell["cell_type"] == kind]


def pictures(name):
    outputs = [output for cell in cells(name, "code") for output in cell["outputs"]]
    return [output for output in outputs if "image/png" in output.get("data", {})]


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_is_stored_with_outputs_that_are_shown_anywhere(name):
    assert (FOLDER / f"{name}.ipynb").stat().st_size < LARGEST
    ran = [cell for cell in cells(name, "code") if cell["outputs"]]
    assert ran
    for cell in ran:
        for output in cell["outputs"]:
            assert output["output_type"] != "error"
            assert set(output.get("data", {})) <= SHOWN_ANYWHERE


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_every_picture_has_a_description_of_its_own(name):
    described = [output["metadata"]["image/png"]["alt"] for output in pictures(name)]
    assert len(set(described)) == len(described)
    for text in described:
        assert text.endswith((".", "reference"))
        assert 5 < len(text.split()) < 60


def test_the_film_moves_where_pngs_move_and_else_shows_the_singular_instant():
    (film,) = (
        image
        for image in (
            Image.open(io.BytesIO(base64.b64decode("".join(output["data"]["image/png"]))))
            for output in pictures("01_the_paper_in_ten_minutes")
        )
        if getattr(image, "is_animated", False)
    )
    assert film.format == "PNG"
    assert film.default_image  # what is shown where it does not move
    still = film.convert("RGB").tobytes()
    lasting, frames = [], []
    for frame in range(1, film.n_frames):
        film.seek(frame)
        lasting.append(film.info["duration"])
        frames.append(film.convert("RGB").tobytes())
    assert frames.index(still) == lasting.index(max(lasting))


def test_the_paper_is_read_in_ten_minutes():
    name = "01_the_paper_in_ten_minutes"
    words = sum(len("".join(cell["source"]).split()) for cell in cells(name, "markdown"))
    words += sum(len(text.split()) for text, _ in texts(NOTEBOOKS[name]))
    lines = sum(bool(line.strip()) for cell in cells(name, "code") for line in cell["source"])
    seconds = 60 * words / WORDS_A_MINUTE + SECONDS_A_LINE * lines + SECONDS_A_PICTURE * len(pictures(name))
    assert seconds < 600


@pytest.mark.parametrize(
    ("stored", "fresh"),
    [
        ("tail 1.2e-14 on 66 nodes", "tail 7.0e-13 on 66  nodes\n"),  # rounding is noise
        ("slope 2.007", "slope 2.008"),  # the last digit printed
        ("s = 0.667006874764298", "s = 0.667006874761"),
        ("gap 9e+14", "gap 2e+15"),
    ],
)
def test_outputs_agree_up_to_rounding(stored, fresh):
    assert differences(stored, fresh) == []


@pytest.mark.parametrize(
    ("stored", "fresh", "told"),
    [
        ("slope 2.007", "slope 2.010", "'2.007' is '2.010' now"),
        ("tail 1e-12", "tail 1e-3", "'1e-12' is '1e-3' now"),
        ("UnboundedTorque at 1 s", "NoLaw at 1 s", "'UnboundedTorque at' is 'NoLaw at' now"),
        ("3 crossings", "3 crossings of 4", "'crossings' is 'crossings of' now"),
    ],
)
def test_outputs_that_have_changed_are_told(stored, fresh, told):
    assert differences(stored, fresh)[0] == told


def test_times_are_not_compared_and_words_are():
    assert differences("took 34.3 ms", "took 99.1 ms", times=True) == []
    assert differences("took 34.3 ms", "took 99.1 s", times=True) == ["'ms' is 's' now"]
