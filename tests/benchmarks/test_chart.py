"""The chart as a program, its tables and its figures."""

import json

import pytest

from framework import InvalidInput
from tests.benchmarks.chart import measure, stages, table
from tests.benchmarks.chart.__main__ import main
from tests.benchmarks.chart.figures import chart_figure, map_figure, short_figure
from tests.benchmarks.chart.measure import Effort, Judged, Method, Row, Stage, rows_of, singles
from tests.benchmarks.chart.reading import sentence, time_to


def invented(stage) -> tuple[Row, ...]:
    """Rows of a stage that nothing was measured for."""
    return tuple(
        Row(
            stage.name,
            method.name,
            setting,
            1e-3 * (k + 1),
            2e-3 * (k + 1),
            10.0**-k,
            tuple(1e-9 for _ in stage.profile),
        )
        for method in stage.methods
        for k, setting in enumerate(method.settings)
    )


def test_a_row_is_made_again_by_its_key(capsys):
    key = "torque:chebyshev:24"
    made = stages.made_again(key)[1]
    assert made.key == key
    main(["--row", key])
    assert f"{made.error:.3e}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("key", "named"),
    [
        ("torque:chebyshev", "STAGE:METHOD:SETTING"),
        ("torques:chebyshev:24", "torque"),
        ("torque:chebychev:24", "chebyshev"),
        ("torque:chebyshev:many", "number"),
        ("torque:chebyshev:1,2", "nodes"),
        ("torque:chebyshev:nan", "16 20 24"),
        ("torque:pointwise:0,3", "samples"),
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
    assert all(method.source for method in stage.methods if method.kind == "peer")
    rows = invented(stage)
    assert len({row.key for row in rows}) == len(rows)
    for row in rows:
        parts = row.key.split(":")
        assert stage.method(parts[1]).name == row.method
        assert measure.read_setting(parts[2]) == pytest.approx(row.setting)
    text = table.markdown(stage, rows)
    assert all(text.count(f"`{row.key}`") == 1 for row in rows)


def test_a_map_has_a_cell_for_each_row():
    stage = stages.stage("failure")
    figure = map_figure(stage, invented(stage))
    assert [ax.get_title(loc="left") for ax in figure.axes] == [method.label for method in stage.methods]
    for ax, method in zip(figure.axes, stage.methods, strict=True):
        assert len(ax.texts) == len(method.settings)


def test_peers_that_are_not_installed_are_left_out_and_named(monkeypatch):
    monkeypatch.setattr(measure, "find_spec", lambda name: None)
    stage = stages.stage("torque")
    assert stage.missing == ("mujoco",)
    rows = tuple(row for row in invented(stage) if not row.method.startswith("mujoco"))
    assert "not installed: mujoco" in table.markdown(stage, rows)
    assert any("mujoco" in text.get_text() for text in chart_figure(stage, rows).texts)
    with pytest.raises(InvalidInput, match="mujoco"):
        stages.made_again("torque:mujoco:17")


def curves(**points) -> list[Row]:
    """Rows of the stage torque from (seconds, error) of its methods, without spread."""
    return [
        Row("torque", name, (float(k),), seconds, seconds, error)
        for name, pairs in points.items()
        for k, (seconds, error) in enumerate(pairs)
    ]


def test_times_are_read_off_straight_lines_in_logarithms():
    """And off what no other row of the method beats: the third row is slower than the fourth, and worse."""
    stage = stages.stage("torque")
    rows = curves(chebyshev=[(1.0, 1e-2), (10.0, 1e-8), (100.0, 1e-9), (50.0, 1e-12)])
    assert time_to(stage, rows, "chebyshev", 1e-5).least == pytest.approx(10**0.5)
    assert time_to(stage, rows, "chebyshev", 1e-10).least == pytest.approx(10 * 5**0.5)
    assert time_to(stage, rows, "chebyshev", 1e-1).least == 1.0
    assert time_to(stage, rows, "chebyshev", 1e-13) is None


def test_the_sentence_names_who_is_quicker_and_who_never_comes_to_it():
    stage = stages.stage("torque")
    ours, slow = [(1.0, 1e-11)], [(2.0, 1e-7)]
    words = sentence(stage, curves(chebyshev=ours, pointwise=slow))
    assert "2 times less for ours" in words
    assert "no other comes to it" in words
    words = sentence(stage, curves(chebyshev=slow, mujoco=ours))
    assert "2 times more for ours" in words
    assert "ours does not come to it" in words
    near = [row._replace(upper=3.0) for row in curves(chebyshev=ours, pointwise=slow)]
    assert "equal within the spread" in sentence(stage, near)


@pytest.mark.parametrize(
    ("errors", "tried"),
    [
        ((1e-3, 1e-6, 1e-14, 1e-15), 3),  # passes 1e-13
        ((1e-3, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2), 5),  # bends up
        ((1e-3, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6), 6),  # stays
    ],
)
def test_a_grid_is_refined_until_it_bends_up_or_is_fine(errors, tried):
    method = Method("m", "m", lambda setting: lambda: setting[0], "", "", singles(*range(len(errors))))
    stage = Stage("s", "", "", "", (method,), lambda m, s, r: Judged(errors[int(r)]), goals=(1e-6,))
    assert len(rows_of(stage, Effort(1, 1.0, 99))) == tried


def test_a_method_without_a_result_is_a_row_that_says_so():
    stage = stages.stage("torque")
    lost = Row("torque", "chebyshev", (16.0,), float("nan"), float("nan"), float("inf"), note="no answer")
    assert "none: no answer" in table.markdown(stage, [lost])
    assert table.row_document(lost)["error"] is None


@pytest.mark.slow
def test_the_whole_chart_in_a_quick_run(tmp_path, capsys):
    main(["--quick", "--out", str(tmp_path)])
    printed = capsys.readouterr().out
    for name in stages.NAMES:
        assert f"{name}: {stages.stage(name).title}" in printed
        made = json.loads((tmp_path / f"{name}.json").read_text())
        assert made["stage"] == name
        assert made["sentence"] in (tmp_path / f"{name}.md").read_text()
        for suffix in ("md", "json", "png", "pdf"):
            assert (tmp_path / f"{name}.{suffix}").stat().st_size > 200


def test_the_figure_at_a_glance_has_at_most_five_named_curves_of_one_panel():
    stage = stages.stage("torque")
    drawn = short_figure(stage, invented(stage))
    (axes,) = drawn.axes
    assert [text.get_text() for text in axes.get_legend().get_texts()] == list(stage.short.values())
    assert len(axes.lines) == len(stage.short) <= 5
    assert len({stage.method(name).panel for name in stage.short}) == 1
    for curve, name in zip(axes.lines, stage.short, strict=True):
        first = 1e3 * next(row.seconds for row in invented(stage) if row.method == name)
        assert curve.get_xdata()[0] == first
