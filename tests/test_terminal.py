"""What a person sees in a terminal: lines that fit, colours where it has them, a word while work lasts."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
import time
from types import SimpleNamespace

import pytest

from framework.cli.console import FIRST, Progress, lay_out, shows_colours
from tests.watchdog import PATIENCE

STYLE = re.compile(r"\x1b\[[0-9;]*m")
ERASED = re.compile(r"[^\n]*\r\x1b\[K")  # the progress line, where it came up
TEXT = """five_bar, rigid: a law of degree 8
  peak torque       left_motor 0.147119 N m, right_motor 0.162094 N m
  crossing          t = 1 s at s = 0.667006874764298, x, y = (-5.10312e-05, 0.244949)
  warning           what is left out is worth more than the plan's own torques: plan with it
  controller\tpassed\tpeak torque
  lqr\t100.0%\t0.176
  computed_torque\t5.0%\t12.4
  below             the table"""


def in_terminal(*arguments: str, columns: int, **environment: str) -> tuple[int, str]:
    """Run the command in a terminal of so many columns: its exit code, and what stands there in the end."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    kept = {
        key: value for key, value in os.environ.items() if key not in ("COLUMNS", "NO_COLOR", "FORCE_COLOR")
    }
    running = subprocess.Popen(
        [sys.executable, "-m", "framework", *arguments],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={**kept, "TERM": "xterm", "PYTHONPATH": os.pathsep.join(sys.path), **environment},
    )
    os.close(theirs)
    parts = []
    try:
        while part := os.read(ours, 65536):
            parts.append(part)
    except OSError:  # the program has ended
        pass
    os.close(ours)
    shown = b"".join(parts).decode().replace("\r\n", "\n")
    return running.wait(timeout=PATIENCE), ERASED.sub("", shown)


@pytest.mark.parametrize("columns", [60, 80, 100, 120])
def test_lines_are_broken_between_words_and_keep_all_of_them(columns):
    shown = lay_out(TEXT, columns)
    assert max(map(len, shown.splitlines())) <= columns
    assert shown.split() == TEXT.split()
    for whole in ("0.147119 N m", "t = 1 s", "x, y = (-5.10312e-05,", "0.667006874764298"):
        assert whole in shown


def test_without_a_terminal_each_line_is_whole():
    lines = lay_out(TEXT, None).splitlines()
    assert lines[:4] == TEXT.splitlines()[:4]
    assert lines[4:] == [
        "  controller       passed  peak torque",
        "  lqr              100.0%        0.176",
        "  computed_torque    5.0%         12.4",
        "  below             the table",
    ]


def test_a_long_line_goes_on_under_its_text():
    lines = lay_out(TEXT.splitlines()[3], 60).splitlines()
    assert len(lines) > 1
    assert all(line.startswith(" " * 20) and line[20] != " " for line in lines[1:])


def test_a_table_that_is_too_wide_gives_way_in_words_and_then_in_columns():
    table = "  name\twhy\tleast [N m]\n  first\tout of reach of its legs\t1.5\n  second\tnone\t-22.25"
    for columns in (30, 24, 20):
        shown = lay_out(table, columns)
        assert max(map(len, shown.splitlines())) <= columns
        assert set(table.split()) <= set(shown.split())
    assert lay_out(table, 20).count("second") == 2  # the first column stands before the rest once more


class Stream:
    """A stream that is a terminal or none."""

    def __init__(self, terminal: bool) -> None:
        self.isatty = lambda: terminal


@pytest.mark.parametrize(
    ("environment", "terminal", "expected"),
    [
        ({}, True, True),
        ({}, False, False),
        ({"NO_COLOR": "1"}, True, False),
        ({"NO_COLOR": ""}, True, True),
        ({"NO_COLOR": "1", "FORCE_COLOR": "1"}, True, False),
        ({"FORCE_COLOR": "1"}, False, True),
        ({"FORCE_COLOR": "0"}, False, False),
        ({"TERM": "dumb"}, True, False),
    ],
)
def test_colours_are_shown_where_there_are_some(monkeypatch, environment, terminal, expected):
    for key in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(key, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for key, value in environment.items():
        monkeypatch.setenv(key, value)
    assert shows_colours(Stream(terminal)) is expected


def test_colours_change_no_letter():
    assert STYLE.sub("", lay_out(TEXT, 80, colour=True)) == lay_out(TEXT, 80)
    assert "\x1b[33mwarning\x1b[0m" in lay_out(TEXT, 80, colour=True)


@pytest.mark.parametrize("columns", [80, pytest.param(120, marks=pytest.mark.slow)])
def test_a_report_fits_the_terminal(columns):
    code, shown = in_terminal("plan", "five_bar", "--scene", "C", columns=columns)
    assert code == 0
    assert max(map(len, STYLE.sub("", shown).splitlines())) <= columns


@pytest.mark.parametrize("columns", [60, *(pytest.param(wide, marks=pytest.mark.slow) for wide in (80, 120))])
def test_a_complaint_fits_the_terminal(columns):
    code, shown = in_terminal("plan", "five_bar", "--scene", "nowhere", columns=columns)
    assert code == 2
    assert shown.startswith("\x1b[31;1mcrossing: \x1b[0m")
    assert max(map(len, STYLE.sub("", shown).splitlines())) <= columns


@pytest.mark.parametrize(
    "words", [["locate", "five_bar", "--scene", "C"], pytest.param(["robots"], marks=pytest.mark.slow)]
)
def test_json_is_one_line_without_colours_in_a_terminal_too(words):
    code, shown = in_terminal(*words, "--json", columns=80, FORCE_COLOR="1")
    assert (code, shown.count("\n")) == (0, 1)
    assert "\x1b" not in shown


def test_work_that_lasts_says_so_on_the_terminal_and_leaves_no_trace(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("framework.cli.console.FIRST", 0.05)
    monkeypatch.setattr("framework.cli.console.INTERVAL", 0.05)
    shown, latest = "", time.monotonic() + PATIENCE
    with Progress("at work") as progress:
        progress.start("mapping", 40.0, "poses")(10.0)
        while "mapping: 25 % of 40 poses in " not in shown and time.monotonic() < latest:
            time.sleep(0.05)
            shown += capsys.readouterr().err
    shown += capsys.readouterr().err
    assert re.search(r"\r\x1b\[Kmapping: 25 % of 40 poses in \d+ s, about \d+ s to go", shown)
    assert shown.endswith("\r\x1b[K")
    time.sleep(0.2)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("terminal", "term", "lasts"), [(False, "xterm", 0.3), (True, "dumb", 0.3), (True, "xterm", 0.0)]
)
def test_short_work_and_logs_are_spared(monkeypatch, capsys, terminal, term, lasts):
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal)
    monkeypatch.setenv("TERM", term)
    monkeypatch.setattr("framework.cli.console.FIRST", 0.05 if lasts else 60.0)
    assert FIRST <= 2.0
    with Progress("at work"):
        time.sleep(lasts)
    assert capsys.readouterr().err == ""


def test_how_far_it_is_is_told_in_words(monkeypatch):
    now = iter([0.0, 0.4, 1.0, 4.0, 5.0, 17.0, 20.0, 22.0])  # s, of each start and each sentence
    monkeypatch.setattr("framework.cli.console.time", SimpleNamespace(monotonic=lambda: next(now)))
    progress = Progress("at work")
    assert progress.sentence == "at work: 0 s"
    progress.start("planning", unit="plans")(3)
    assert progress.sentence == "planning: 3 plans, 3 s"
    progress.start("mapping", 40.0, "poses")(10.0)
    assert progress.sentence == "mapping: 25 % of 40 poses in 12 s, about 36 s to go"
    progress.start("simulating", 1.0, "the motion")(0.5)
    assert progress.sentence == "simulating: 50 % of the motion in 2 s, about 2 s to go"
