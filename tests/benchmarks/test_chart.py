"""The chart as a program, its tables and its figures."""

from __future__ import annotations

import csv
import json
import time

import pytest

from framework.errors import InvalidInput
from tests.benchmarks.chart import measure, stages, table
from tests.benchmarks.chart.__main__ import main
from tests.benchmarks.chart.figures import chart_figure, map_figure, styles
from tests.benchmarks.chart.measure import Row
from tests.benchmarks.chart.reading import gain


def invented(stage) -> tuple[Row, ...]:
    """Rows of a stage that nothing was measured for."""
    return tuple(
        Row(stage.name, method.name, setting, 1e-3 * (k + 1), 10.0**-k, tuple(1e-9 for _ in stage.profile))
        for method in stage.methods
        for k, setting in enumerate(method.settings)
    )


def test_a_row_made_again_has_the_same_error(capsys):
    key = "torque:chebyshev:24"
    first = stages.made_again(key)[1]
    assert first.key == key
    main(["--row", key])
    assert f"{first.error:.3e}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("key", "named"),
    [
        ("torque:chebyshev", "STAGE:METHOD:SETTING"),
        ("torques:chebyshev:24", "torque"),
        ("torque:chebychev:24", "chebyshev"),
        ("torque:chebyshev:many", "number"),
        ("torque:chebyshev:1,2", "nodes"),
        ("torque:chebyshev:nan", "16 24 32"),
        ("torque:pointwise:0", "samples"),
    ],
)
def test_a_row_that_is_none_is_refused_with_what_would_be_one(key, named, capsys):
    with pytest.raises(InvalidInput, match=named):
        stages.made_again(key)
    with pytest.raises(SystemExit, match="2"):
        main(["--row", key])
    assert named in capsys.readouterr().err


@pytest.mark.parametrize("name", stages.NAMES)
def test_every_row_has_a_key_that_finds_its_method_again(name):
    stage = stages.stage(name)
    rows = invented(stage)
    assert len({row.key for row in rows}) == len(rows)
    read = list(csv.DictReader(table.csv_text(stage, rows).splitlines()))
    assert [line["row"] for line in read] == [row.key for row in rows]
    assert all(line["given"] and line["method"] for line in read)
    for row in rows:
        parts = row.key.split(":")
        assert stage.method(parts[1]).name == row.method
        assert measure.read_setting(parts[2]) == pytest.approx(row.setting)
    assert table.markdown(stage, rows).count("\n| ") == len(rows) + 1


CURVES = [name for name in stages.NAMES if stages.stage(name).map_axes is None]
MAPS = [name for name in stages.NAMES if name not in CURVES]


@pytest.mark.parametrize("name", CURVES)
def test_curves_are_told_apart_without_colour(name):
    stage = stages.stage(name)
    found = styles(stage)
    labels = {method.label for method in stage.methods}
    assert len({style["marker"] for style in found.values()}) == len(labels)
    for panel in stage.panels:
        drawn = [found[method.name]["marker"] for method in stage.methods if method.panel == panel]
        assert len(set(drawn)) == len(drawn)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] if name != "torque" else []) for name in CURVES],
)
def test_legend_and_sentence_stand_below_the_axes(name):
    stage = stages.stage(name)
    figure = chart_figure(stage, invented(stage))
    figure.draw_without_rendering()
    legends = [legend.get_window_extent() for legend in figure.legends]
    texts = [text.get_window_extent() for text in figure.texts]
    lowest = min(ax.get_tightbbox().y0 for ax in figure.axes)
    for box in (*legends, *texts):
        assert box.y1 < lowest
        assert box.x0 > 0
        assert box.x1 < figure.bbox.x1
    for legend in legends:
        assert all(text.y1 < legend.y0 for text in texts)


@pytest.mark.parametrize("name", MAPS)
def test_a_map_has_a_cell_for_each_row(name):
    stage = stages.stage(name)
    rows = invented(stage)
    figure = map_figure(stage, rows)
    shown = [method for method in stage.methods if len({y for _, y in method.settings}) > 1]
    assert [ax.get_title(loc="left") for ax in figure.axes] == [method.label for method in shown]
    for ax, method in zip(figure.axes, shown, strict=True):
        assert len(ax.texts) == len(method.settings)


def test_peers_that_are_not_installed_are_left_out_and_named(monkeypatch):
    monkeypatch.setattr(measure, "find_spec", lambda name: None)
    stage = stages.stage("torque")
    assert stage.missing == ("mujoco",)
    rows = tuple(row for row in invented(stage) if row.method != "mujoco")
    assert "not installed: mujoco" in table.markdown(stage, rows)
    assert any("mujoco" in text.get_text() for text in chart_figure(stage, rows).texts)
    with pytest.raises(InvalidInput, match="mujoco"):
        stages.made_again("torque:mujoco:17")


def test_factors_are_read_off_the_curves():
    """1e-2 in 1 s and 1e-8 in 10 s, against 1e-2 in 10 s and 1e-4 in 1000 s, straight lines in logarithms."""
    curves = {"one": [(1.0, 1e-2), (10.0, 1e-8)], "other": [(10.0, 1e-2), (1000.0, 1e-4)]}
    rows = [
        Row("torque", name, (float(k),), seconds, error)
        for name, points in curves.items()
        for k, (seconds, error) in enumerate(points)
    ]
    found = gain(rows, "one", "other")
    assert found.error == 1e-4
    assert found.time == pytest.approx(1000 / 10 ** (1 / 3))
    assert found.within == 10.0
    assert found.accuracy == pytest.approx(1e-2 / 1e-8)
    assert gain(rows, "other", "one") is None


def test_a_method_without_a_result_is_a_row_that_says_so():
    stage = stages.stage("torque")
    lost = Row("torque", "chebyshev", (16.0,), float("nan"), float("inf"), note="no answer")
    assert "none: no answer" in table.markdown(stage, [lost])
    assert table.row_document(lost)["error"] is None


@pytest.mark.slow
def test_the_whole_chart_in_five_minutes(tmp_path, capsys):
    began = time.process_time()
    main(["--out", str(tmp_path)])
    assert time.process_time() - began < 300
    printed = capsys.readouterr().out
    for name in stages.NAMES:
        assert f"{name}: {stages.stage(name).title}" in printed
        assert json.loads((tmp_path / f"{name}.json").read_text())["stage"] == name
    for name in stages.NAMES:
        for suffix in ("csv", "md", "json", "png", "pdf"):
            assert (tmp_path / f"{name}.{suffix}").stat().st_size > 500
