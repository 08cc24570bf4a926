"""Studies of dimensions: areas by the geometry of the 5R, and the same files whatever computes them."""

import csv
import json

import numpy as np
import pytest

import robots
from framework.atlas.design_study import (
    StudyTask,
    column_names,
    column_units,
    design_study,
    map_designs,
    read_designs,
    study_setup,
)
from framework.atlas.map_files import value_range
from framework.cli import main
from framework.numerics.kept import KeptChunks
from framework.show.study_figures import plot_study
from tests.oracles import five_bar_pose
from tests.urdf_edits import parametric_five_bar


def lens(radius):
    """Area common to two discs about the motors of the 5R, 0.4 m apart."""
    return 2 * radius**2 * np.arccos(0.2 / radius) - 0.4 * np.sqrt(radius**2 - 0.04)


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    file = parametric_five_bar(tmp_path_factory.mktemp("named"))
    task = StudyTask(
        str(file), ("l1", "l2"), "rigid", ("x", "y"), (-0.36, 0.36, -0.56, 0.56), 17, ("g", "torque")
    )
    return task, read_designs(file)


@pytest.fixture(scope="module")
def found(given):
    return design_study(*given)


def test_the_area_is_that_of_both_legs_reach(given, found):
    for (l1, l2), area, why in zip(given[1].values, found.columns["area"], found.why, strict=True):
        if l2 == 0.6:  # too long for the reference
            assert "reference is not near" in why
            assert np.isnan(area)
            continue
        hole = np.pi * (l1 - l2) ** 2
        # of about 17 x 17 cells those on the rim count or do not
        assert area == pytest.approx(lens(l1 + l2) - 2 * hole, rel=0.08)
    # with equal lengths: the cells in which the rods are on the reference's side of one line
    x, y = (np.linspace(-far, far, 17) for far in (0.36, 0.56))
    places = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
    sine = five_bar_pose.pose(places[five_bar_pose.reachable(places) > 0]).sine
    cell = (x[1] - x[0]) * (y[1] - y[0])
    assert (found.columns["free_area"][:2] < found.columns["area"][:2]).all()
    assert found.columns["free_area"][0] == pytest.approx(cell * np.sum(sine > 0))
    assert found.units["area"] == "m^2"
    assert found.units["torque_median"] == "N m/N"


@pytest.mark.parametrize("wrong", ["columns", pytest.param("designs", marks=pytest.mark.slow)])
def test_a_kept_chunk_of_other_columns_or_designs_is_computed_anew(given, tmp_path, wrong):
    task, designs = given[0]._replace(size=3), given[1]._replace(values=given[1].values[:2])
    kept = KeptChunks.of(tmp_path, study_setup(task, designs))
    chunk = map_designs(task, designs.values)
    less = {key: values for key, values in chunk.items() if key != "area"}
    kept.keep("0000000-0000002", less if wrong == "columns" else {key: chunk[key][:1] for key in chunk})
    calls = []
    again = design_study(task, designs, keeper=kept, progress=calls.append)
    assert calls == [0, 2]
    np.testing.assert_array_equal(again.columns["area"], chunk["area"])


def test_the_figure_of_a_study_has_each_design_in_each_cell_and_units(found):
    drawing = plot_study(found).figure
    rows = ["area reached", "area on the reference's side", "signed measure of Type 2", "worst motor torques"]
    cells = drawing.axes[:-1]  # the last is the scale of colours
    assert len(cells) == len(rows) * 2
    for row, first in zip(rows, cells[::2], strict=True):
        assert " ".join(first.get_ylabel().split()).startswith(row)
        assert first.get_ylabel().endswith("]")
    assert [ax.get_xlabel() for ax in cells[-2:]] == ["l1", "l2"]
    sound = np.isfinite(found.columns["area"])
    for k, ax in enumerate(cells[:2]):
        shown = np.asarray(ax.collections[0].get_offsets())
        expected = np.column_stack([found.designs.values[:, k], found.columns["area"]])
        np.testing.assert_array_equal(shown[sound], expected[sound])
    assert "2 of them make no robot" in drawing.get_suptitle()


@pytest.mark.parametrize(
    ("name", "axes", "unit"),
    [
        ("four_bar", ("rz",), "rad"),
        ("five_bar", ("x", "y"), "m^2"),
        ("three_rrr", ("x", "rz"), "m rad"),
    ],
)
def test_what_is_reached_has_the_unit_of_a_product_of_the_axes(name, axes, unit):
    units = column_units(robots.load(name), StudyTask("", (), "rigid", axes, None, 5, ("g",)))
    assert set(units) == {*column_names(StudyTask("", (), "rigid", axes, None, 5, ("g",)))}
    assert [units[key] for key in units if not key.startswith("g_")] == [unit, unit]


@pytest.mark.slow
def test_a_study_by_command_tells_one_line_a_design(given, tmp_path, capsys):
    task, _ = given
    table = tmp_path / "table.csv"
    table.write_text("l1\n0.25\n0.24\n")
    command = ["map", task.file, "--study", "--table", str(table), "--size", "9", "--quantity", "g"]
    command += ["--window", "-0.45", "0.45", "-0.5", "0.5"]
    assert main([*command, "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "named: 2 designs, 9 x 9 poses each, 0 make no robot"
    rows = list(csv.DictReader((tmp_path / "out" / "study.csv").read_text().splitlines()))
    assert [row["l1"] for row in rows] == ["0.25", "0.24"]
    assert {"study.pdf", "study.png"} < {file.name for file in (tmp_path / "out").iterdir()}
    assert float(rows[0]["area"]) > float(rows[1]["area"])
    for more, told in ((["--scene", "C"], "--scene"), (["--at", "1", "2"], "--at")):
        assert main([*command, *more, "--json"]) == 2
        assert told in json.loads(capsys.readouterr().out)["error"]["message"]
    assert main(["map", "five_bar", "--table", str(table), "--json"]) == 2
    assert main(["map", "five_bar", "--study", "--json"]) == 2


def test_ranges_have_least_median_and_greatest_of_what_is_a_number():
    values = np.array([[3.0, np.nan], [1.0, 7.0]])
    assert list(value_range(values).values()) == [1.0, 3.0, 7.0]
    assert set(value_range(values[:1, 1:]).values()) == {None}
