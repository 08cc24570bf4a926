"""`crossing simulate` on scenes and on folders of plans."""

import json

import numpy as np
import pytest

from framework.cli import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> str:
    place = str(tmp_path_factory.mktemp("plan"))
    words = ["plan", "five_bar", "--scene", "C", "--flexibility", "flexible_links"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("framework.show.plots.save_figures", lambda *_: None)  # which take seconds
        assert main([*words, "--out", place]) == 0
    return place


def test_a_scene_comes_back_on_its_path(document):
    found = document("simulate", "five_bar", "--scene", "C")
    assert found["method"] == "reference"
    assert found["tracking_error"] < 1e-11
    assert found["energy_error"] < 1e-10


def test_a_folder_is_read_and_the_run_is_written(crossing, folder, tmp_path):
    out = tmp_path / "run"
    text = crossing("simulate", folder, "--method", "stiff", "--out", out)[1]
    assert "flexible_links" in text
    assert "tracking error" in text
    assert json.loads((out / "simulation.json").read_text())["tracking_error"] < 1e-7
    header = (out / "simulation.csv").read_text().splitlines()[0].split(",")
    rows = np.loadtxt(out / "simulation.csv", delimiter=",", skiprows=1)
    at = {name: rows[:, k] for k, name in enumerate(header)}
    assert np.abs(at["platform_x"] - at["planned_x"]).max() < 1e-7
    assert "deflection_left_rod" in at


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["five_bar", "--scene", "B"], 1, "t_s . W_p"),
        (["five_bar"], 2, "--scene"),
        (["five_bar", "--scene", "C", "--method", "fast", "--tolerance", "1e-6"], 2, "tolerance"),
        (["five_bar", "--scene", "C", "--step", "0"], 2, "step"),
        (["five_bar", "--scene", "C", "--out", ""], 2, "--out"),
        (["five_bar", "--scene", "C", "--damping", "5"], 1, "do not bring the robot along its path"),
    ],
)
def test_a_no_and_a_misuse_in_one_line(refusal, arguments, code, message):
    assert message in refusal(code, "simulate", *arguments)


def test_a_folder_has_its_own_motion(refusal, folder):
    assert "--scene: the plan in" in refusal(2, "simulate", folder, "--scene", "C")
