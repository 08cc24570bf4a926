"""`crossing show` and `crossing report` at the command line: pages, refusals, and a clean end."""

import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
from html import unescape

import numpy as np
import pytest

import robots
from framework import Line, load_plan, plan_crossing, plan_scene
from framework.planning.saved import plan_document
from framework.show.report import _certificate_html
from tests.watchdog import PATIENCE


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What `crossing plan --out` leaves, without the figures, which take seconds."""
    out = tmp_path_factory.mktemp("plans") / "C"
    out.mkdir()
    plan = plan_scene(robots.load("five_bar", flexibility="flexible_links"), "C")
    (out / "plan.json").write_text(json.dumps(plan_document(plan)), encoding="utf-8")
    return out


def scenes(file) -> list[dict]:
    text = file.read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="document">(.*?)</script>', text, re.DOTALL)
    return json.loads(found[1])


def test_scenes_side_by_side_go_into_one_file(crossing, tmp_path):
    file = tmp_path / "new" / "abc.html"
    code, out, err = crossing("show", "five_bar", "--scene", "A", "B", "C", "--html", file, "--json")
    assert (code, err) == (0, "")
    rigid = {"flexibility": "rigid"}
    assert json.loads(out) == {
        "file": str(file),
        "bytes": file.stat().st_size,
        "films": [
            {"name": "Scene A", **rigid, "proved": True},
            {"name": "Scene B", **rigid, "proved": False},
            {"name": "Scene C", **rigid, "proved": True},
        ],
    }
    assert [(scene["title"], scene["proved"]) for scene in scenes(file)] == [
        ("Scene A", True),
        ("Scene B", False),
        ("Scene C", True),
    ]


def test_a_file_without_a_scene_plays_the_crossing(crossing, tmp_path):
    file = tmp_path / "page.html"
    code, out, _ = crossing("show", "five_bar", "--flexibility", "flexible_links", "--html", file)
    assert code == 0
    assert out.startswith("no scene given: filmed Scene C\n")
    assert "Scene C (flexible links, deformed geometry): written to" in out
    assert [scene["title"] for scene in scenes(file)] == ["Scene C"]


def test_a_line_is_shown_as_it_is_planned(crossing, tmp_path):
    file = tmp_path / "page.html"
    line = ["--from", "0.1", "0.345", "--to", "-0.05", "0.295", "--duration", "2"]
    assert crossing("show", "five_bar", *line, "--flexibility", "flexible_joints", "--html", file)[0] == 0
    (scene,) = scenes(file)
    assert (scene["duration"], scene["flexibility"]) == (2.0, "flexible_joints")


def test_a_saved_plan_is_shown(crossing, folder, tmp_path):
    file = tmp_path / "page.html"
    assert crossing("show", folder, "--html", file)[0] == 0
    (scene,) = scenes(file)
    assert (scene["title"], scene["flexibility"]) == ("Scene C", "flexible_links")
    assert len(scene["instants"]) == 1


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["five_bar", "--scene", "Z"], "unknown scene 'Z'"),
        (["no_robot"], "unknown robot"),
        (["five_bar", "--times", "1"], "--times: needs a motion"),
        (["five_bar", "--from", "0", "0.3"], "--from and --to"),
        (["five_bar", "--scene", "C", "--html", ""], "argument --html: needs a name"),
        (["five_bar", "--scene", "C", "--html", "/dev/null/page.html"], "--html: cannot write"),
    ],
)
def test_misuse_is_one_line(refusal, arguments, complaint):
    assert complaint in refusal(2, "show", *arguments, "--no-open")


def test_a_saved_plan_takes_no_other_motion(refusal, folder):
    err = refusal(2, "show", folder, "--scene", "C", "--no-open")
    assert "--scene" in err
    assert "has its own" in err


def test_a_motion_that_has_no_law_is_no_film(refusal):
    line = "show five_bar --from 0.1 0.345 --to 2 2 --duration 1 --no-open"
    err = refusal(1, *line.split())
    assert "leaves the workspace" in err or "Type 1" in err


@pytest.mark.parametrize(
    ("end", "machine"),
    [
        (signal.SIGTERM, False),
        pytest.param(signal.SIGINT, False, marks=pytest.mark.slow),
        pytest.param(signal.SIGINT, True, marks=pytest.mark.slow),
    ],
)
def test_it_serves_until_it_is_told_to_end(end, machine):
    command = [
        sys.executable,
        "-m",
        "framework",
        "show",
        "five_bar",
        "--no-open",
        *(["--json"] if machine else []),
    ]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # a shell may ignore it
    ) as process:
        try:
            line = (process.stderr if machine else process.stdout).readline()
            address = re.match(r"http://127\.0\.0\.1:\d+/", line)[0]
            with urllib.request.urlopen(address, timeout=PATIENCE) as reply:
                assert b"five bar" in reply.read()
            process.send_signal(end)
            out, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert process.returncode == 0
    assert err == ""
    if machine:
        assert json.loads(out) == {"address": address, "ended": True}


@pytest.mark.slow
def test_a_report_says_what_the_plan_is_and_how_to_have_it_again(crossing, folder, tmp_path):
    code, out, _ = crossing("report", folder, "--json")
    file = folder / "report.html"
    assert code == 0
    assert json.loads(out)["file"] == str(file)
    text = unescape(file.read_text(encoding="utf-8"))
    plan = load_plan(folder)
    for said in (
        f"polynomial of degree {plan.law.degree}",
        f"on {plan.certificate.nodes} nodes",
        f"{plan.crossings[0].s:.15f}",
        "gear ratio 50",
        "<td>350000</td><td>N/m</td>",
        "<td>25000</td><td>N m/rad</td>",
    ):
        assert said in text
    for key in ("tail", "max_closure_error", "max_residual_torque", "change"):
        assert f"<td>{getattr(plan.certificate, key):.1e}</td>" in text
    assert text.count("data:image/svg+xml;base64,") == text.count("<figcaption><b>Figure ") == 6
    assert len(text) < 5e6
    # the call in the report, run as it stands, makes the same plan
    names = {}
    exec(re.search(r'<pre tabindex="0">(from framework import .*?)</pre>', text, re.DOTALL)[1], names)
    np.testing.assert_allclose(names["plan"].law.coefficients, plan.law.coefficients, atol=1e-9)
    assert names["plan"].robot.description == plan.robot.description


def test_the_certificate_claims_what_holds_of_this_plan_alone(folder):
    overshooting = plan_scene(robots.load("five_bar"), "C")
    assert not overshooting.certificate.monotone
    clear = plan_crossing(robots.load("five_bar"), Line([0.1, 0.345], [-0.05, 0.295]), duration=1.5)
    assert not clear.crossings
    crosses, elastic, overshoots = "At each crossing", "Forces", "overshoots the ends"
    for plan, sentences in (
        (load_plan(folder), (crosses, elastic)),
        (overshooting, (crosses, overshoots)),
        (clear, ()),
    ):
        said = _certificate_html(plan)
        assert [one in said for one in (crosses, elastic, overshoots)] == [
            one in sentences for one in (crosses, elastic, overshoots)
        ]


@pytest.mark.slow
def test_an_optimal_law_is_filmed_and_reported_as_any_other(crossing, tmp_path):
    path = Line([0.1, 0.345], [-0.05, 0.195])
    plan = plan_crossing(robots.load("five_bar"), path, optimize="time", torque_limit=0.165)
    (tmp_path / "plan.json").write_text(json.dumps(plan_document(plan)), encoding="utf-8")
    file = tmp_path / "film.html"
    assert crossing("show", tmp_path, "--html", file)[0] == 0
    (scene,) = scenes(file)
    assert scene["proved"]
    assert crossing("report", tmp_path)[0] == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert 'alt="The phase plane: ' in page


def test_a_report_needs_a_plan(crossing, tmp_path):
    code, _, err = crossing("report", tmp_path)
    assert code == 2
    assert "plan.json" in err


def test_a_picture_of_a_film_is_written_by_its_ending(crossing, tmp_path):
    file = tmp_path / "eye.png"
    code, out, _ = crossing("show", "five_bar", "--scene", "B", "C", "--picture", file)
    assert code == 0
    assert f"Scene B (rigid parts), Scene C (rigid parts): written to {file}" in out
    assert file.read_bytes().startswith(b"\x89PNG")
    code, _, error = crossing("show", "five_bar", "--scene", "C", "--picture", tmp_path / "eye.jpg")
    assert code == 2
    assert "unknown kind of picture 'jpg'" in error
