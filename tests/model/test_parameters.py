"""Named parameters of robot files: arithmetic in the text of the file and of its URDF, and nothing else."""

import json
import math

import numpy as np
import pytest

import robots
from framework import InvalidInput, ParallelRobot, RobotFileError, load_plan, load_robot, velocity_matrices
from framework.atlas.design_study import read_designs
from framework.cli import main
from framework.model.parameters import declared_parameters, fill_parameters, fill_placeholders
from framework.model.robot_file import unused_parameters
from framework.show.report import python_call
from tests.urdf_edits import parametric_five_bar

VALUES = {"a": 0.25, "b": 2.0}


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("a", 0.25),
        (" -a + 3 * b ", 5.75),
        ("(a / b)**2", 0.015625),
        ("sqrt(b) * sin(pi / 2)", math.sqrt(2.0)),
        ("atan2(a, -a)", 0.75 * math.pi),
        ("1e-3", 1e-3),
    ],
)
def test_a_placeholder_is_arithmetic(expression, value):
    assert float(fill_placeholders("${" + expression + "}", VALUES)) == pytest.approx(value, rel=1e-15)


REFUSED = (
    *("", "c", "a.real", "__import__('os')", "a if b else a", "[a]", "'a'", "a; b", "1/0", "9**9**9**9"),
    *("sqrt(-1)", "True", "a == b", "lambda: a", "a" * 300, "sqrt(x=a)", "1e999", "open('x')"),
)


@pytest.mark.parametrize("expression", REFUSED)
def test_whatever_else_stands_in_a_placeholder_is_refused(expression):
    with pytest.raises(RobotFileError, match=r"\$\{"):
        fill_placeholders("<joint x='${" + expression + "}'/>", VALUES)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("parameters: [1, 2]", "a mapping"),
        ("parameters: {l1: []}", "needs a number or a list"),
        ("parameters: {l1: [1, x]}", "parameters.l1: needs a number"),
        ("parameters: {l1: .inf}", "finite number"),
        ("parameters: {2: 1}", "not a parameter name"),
        ("parameters: {sin: 1}", "not a parameter name"),
    ],
)
def test_what_is_no_parameter_is_refused(given, told):
    with pytest.raises(RobotFileError, match=told):
        declared_parameters(given)


def test_the_first_value_is_the_robots_own_and_others_may_be_given():
    text = "parameters: {l1: [0.2, 0.3], k: 7}\nlength: ${l1 * k}"
    assert fill_parameters(text)[1] == {"l1": 0.2, "k": 7.0}
    assert fill_parameters(text, {"l1": 0.3})[0].endswith(repr(0.3 * 7))
    with pytest.raises(RobotFileError, match="unknown parameter 'l2'"):
        fill_parameters(text, {"l2": 0.3})


@pytest.mark.parametrize("text", ["1e6", "[1e6, 2E+6]", "[1.0e6]", "1000000"])
def test_a_number_with_an_exponent_is_one_though_yaml_reads_a_text(text):
    assert fill_parameters(f"parameters: {{k: {text}}}\nstiffness: ${{2 * k}}")[0].endswith("2000000.0")


def test_a_parameter_that_is_given_is_a_finite_number():
    for value in (float("nan"), "many", None, [1.0, 2.0]):
        with pytest.raises(RobotFileError, match=r"parameters\.k: needs a"):
            fill_parameters("parameters: {k: 1}", {"k": value})


@pytest.mark.usefixtures("quick_figures")
def test_parameters_are_set_in_python_and_on_the_command_line_and_kept_with_a_plan(tmp_path, capsys):
    """The singular point is that of the rods of 0.255 m."""
    file, folder = str(parametric_five_bar(tmp_path)), tmp_path / "plan"
    robot = load_robot(file, parameters={"l2": 0.255})
    assert robot.description.parameters == {"l1": 0.25, "l2": 0.255}
    words = [file, "--scene", "C", "--set", "l1=0.25", "--set", "l2=0.255", "--json"]
    assert main(["locate", *words]) == 0
    point = json.loads(capsys.readouterr().out)["singularities"][0]
    rod = 0.255 * np.array([-point["twist"][1], point["twist"][0]])  # at Type 2 both rods are normal to t_s
    for side in (-1.0, 1.0):
        crank = point["platform"] + side * rod - [side * 0.2, 0.0]
        assert np.linalg.norm(crank) == pytest.approx(0.25, abs=1e-9)
    assert main(["plan", *words, "--out", str(folder)]) == 0
    assert load_plan(folder).robot.description.parameters == robot.description.parameters
    assert "parameters={'l1': 0.25, 'l2': 0.255}" in python_call(load_plan(folder))
    assert main(["locate", file, "--scene", "C", "--set", "l3=1"]) == 2
    assert "unknown parameter 'l3' (valid: l1, l2)" in capsys.readouterr().err
    assert main(["simulate", str(folder), "--set", "l2=1"]) == 2
    assert "has its own" in capsys.readouterr().err


def test_a_file_with_parameters_is_the_robot_with_these_numbers(tmp_path):
    file = parametric_five_bar(tmp_path)
    plain, named = robots.load("five_bar"), ParallelRobot.from_file(file)
    assert named.description.parameters == {"l1": 0.25, "l2": 0.25}
    np.testing.assert_allclose(named.reference.q, plain.reference.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        velocity_matrices(named, named.reference).A, velocity_matrices(plain, plain.reference).A, atol=1e-9
    )
    longer = ParallelRobot.from_file(file, parameters={"l2": 0.27})
    rod = longer.model.jointPlacements[longer.model.getJointId("left_elbow")].translation
    assert np.linalg.norm(rod) == pytest.approx(0.25)
    assert longer.description.parameters == {"l1": 0.25, "l2": 0.27}
    with pytest.raises(RobotFileError, match="unknown parameter"):
        ParallelRobot.from_file(file, parameters={"l3": 1.0})


def test_a_parameter_that_is_used_nowhere_is_told(tmp_path):
    file = parametric_five_bar(tmp_path)
    assert unused_parameters(load_robot(file).description) == []
    file.write_text(file.read_text().replace("parameters: {", "parameters: {spare: 2, stiff: 9, "))
    urdf = tmp_path / "named.urdf"
    urdf.write_text(urdf.read_text().replace("${l2}", "${l2 * stiff / 9}"))
    assert unused_parameters(load_robot(file).description) == ["spare"]
    assert unused_parameters(load_robot("five_bar").description) == []


def test_the_designs_are_the_grid_of_all_values_or_the_rows_of_a_table(tmp_path):
    file = parametric_five_bar(tmp_path)
    assert read_designs(file).values.tolist() == [[a, b] for a in (0.25, 0.23) for b in (0.25, 0.27, 0.6)]
    table = tmp_path / "table.csv"
    table.write_text("l2,l1\n0.26,0.24\n0.27,0.25\n")
    names, values = read_designs(file, table)
    assert (names, values.tolist()) == (("l2", "l1"), [[0.26, 0.24], [0.27, 0.25]])
    for content, told in (
        ("l3\n1\n", "unknown parameter"),
        ("l1\nx\n", "table.csv"),
        ("l1\n", "line of values"),
        ("l1,l1\n1,2\n", "each parameter once"),
        ("l1,l2\n1\n", "table.csv"),
        ("l1\ninf\n", "finite"),
    ):
        table.write_text(content)
        with pytest.raises(InvalidInput, match=told):
            read_designs(file, table)
    with pytest.raises(InvalidInput, match="needs named parameters"):
        read_designs(robots.load("five_bar").description.file)
