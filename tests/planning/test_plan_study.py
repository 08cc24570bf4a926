"""A study of plans: every set of parameters has its own robot, and a refusal says why."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import robots
from framework import InvalidInput, plan_study

STIFFNESS = (1e4, 2e4, 4e4)


def largest_deflection(plan):
    return np.abs(plan.deflection(np.linspace(0.0, plan.duration, 101))).max()


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The 5R with the stiffness of both drives as a parameter."""
    folder = tmp_path_factory.mktemp("study")
    entry = robots.CATALOGUE["five_bar"].file
    text = entry.read_text()
    drives = text.count("stiffness: 25000")
    assert drives
    text = text.replace("stiffness: 25000", "stiffness: ${drive}")
    (folder / "five_bar.yaml").write_text(f"{text}\nparameters: {{drive: 25000}}\n")
    (folder / "five_bar.urdf").write_text(entry.with_suffix(".urdf").read_text())
    return folder / "five_bar.yaml"


def test_small_deflections_are_inversely_proportional_to_stiffness(file):
    done = []
    study = plan_study(
        file,
        "C",
        {"drive": STIFFNESS},
        quantities={"deflection": largest_deflection},
        flexibility="flexible_joints",
        geometry="rigid",
        executor=ThreadPoolExecutor(2),
        progress=done.append,
    )
    product = study.quantities["deflection"] * study.parameters["drive"]
    np.testing.assert_allclose(product, product[0], rtol=1e-9)
    np.testing.assert_array_equal(study.parameters["drive"], STIFFNESS)
    assert study.why == ("", "", "")
    assert done[-1] == len(STIFFNESS)


def test_a_set_without_a_plan_says_why_and_the_others_go_on(file):
    study = plan_study(
        file,
        "C",
        {"drive": [1e-3, 25000.0]},
        quantities={"duration": lambda plan: plan.duration},
        flexibility="flexible_joints",
        law="polynomial",
    )
    assert "too soft" in study.why[0]
    assert study.why[1] == ""
    np.testing.assert_array_equal(study.quantities["duration"], [np.nan, 1.5])


def test_what_is_no_parameter_or_no_option_is_told(file):
    with pytest.raises(InvalidInput, match=r"unknown parameter 'drives'; did you mean 'drive'\?"):
        plan_study(file, "C", {"drives": [1.0]}, quantities={})
    with pytest.raises(InvalidInput, match="smoothness"):
        plan_study(file, "C", {"drive": [4e3]}, smoothness=-1, quantities={})
    with pytest.raises(InvalidInput, match="quantities: 'why'"):
        plan_study(file, "C", {"drive": [4e3]}, quantities={"why": largest_deflection})
    with pytest.raises(InvalidInput, match="at least one value"):
        plan_study(file, "C", {"drive": []}, quantities={})
