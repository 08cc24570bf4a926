"""What the command line says is one line, or one document, of printable letters, whatever happens."""

import json
import os
import subprocess
import sys
import unicodedata

import pytest

from framework.cli import main
from framework.cli.console import (
    DEBUG_VARIABLE,
    MAX_MESSAGE_LENGTH,
    UNEXPECTED_EXIT_CODE,
    one_line,
    printable,
)
from tests.watchdog import PATIENCE

RED = "\x1b[31mred\x1b[0m"
ODD = ["a\nb", "a\r\nb", RED, "\x00", "\x07", "\u202egnp", "\u2028", "\udcff", "\x85", "\xa0", "\u200b"]


def run(*arguments: str, **options) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **options.pop("env", {})}
    command = [sys.executable, "-m", "framework", *arguments]
    return subprocess.run(
        command, stderr=subprocess.PIPE, text=True, env=environment, timeout=PATIENCE, check=False, **options
    )


def is_one_line(message: str) -> bool:
    """Whether a complaint is one line that a terminal shows as it stands."""
    line = message.removesuffix("\n")
    plain = all(unicodedata.category(letter) not in ("Cc", "Cf", "Cs", "Zl", "Zp") for letter in line)
    return plain and len(line) <= MAX_MESSAGE_LENGTH + len("crossing: ") and message.endswith("\n")


@pytest.mark.parametrize("text", ODD)
def test_what_is_not_printable_is_escaped(text):
    assert is_one_line(one_line(f"unknown robot {text}") + "\n")
    assert printable(text).replace("\n", "").isprintable()
    assert one_line(one_line(text)) == one_line(text)


def test_what_is_printable_is_left_as_it_is():
    text = "t_s · W_p = 1,5 N, s″ = ∞, joint 'élan', 関節"
    assert one_line(text) == printable(text) == text
    assert printable("a\nb") == "a\nb"  # a report has lines


@pytest.mark.parametrize("length", [MAX_MESSAGE_LENGTH, MAX_MESSAGE_LENGTH + 1, 5000, 100_000])
def test_a_long_message_keeps_its_ends(length):
    text = "begin" + "." * (length - 8) + "end"
    line = one_line(text)
    assert len(line) == MAX_MESSAGE_LENGTH
    assert line.startswith("begin")
    assert line.endswith("end")
    assert (line == text) is (length == MAX_MESSAGE_LENGTH)
    assert str(length) in line or length == MAX_MESSAGE_LENGTH


@pytest.mark.parametrize(
    "command",
    [
        "check {}",
        "check {}.yaml",
        "check {0}/{0}.yaml",
        "show {} --no-open",
        "report {}",
        "simulate {}",
        "robustness {}",
        "convert {} --out out",
        "plan five_bar --scene {}",
        "plan five_bar --scene A --out {}",
        "plan five_bar --scene A --samples {}",
        "show five_bar --scene A --html {}",
        "check five_bar --platform {}",
        "check five_bar --motors {}",
        "check five_bar --axes {}",
        "check five_bar --reference {}=1",
        "check five_bar --flexibility {}",
        "{}",
    ],
)
def test_long_names_are_refused_in_one_line(capfd, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    assert main([word.format("n" * 5000) for word in command.split()]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert is_one_line(err)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", [*ODD, "\udcff.yaml"])
def test_odd_names_are_refused_in_one_line(capfd, name):
    assert main(["check", name, "--json"]) == 2
    out, err = capfd.readouterr()
    assert is_one_line(err)
    assert err == f"crossing: {json.loads(out)['error']['message']}\n"


def test_names_in_a_report_cannot_steer_the_terminal(capfd, write_robot):
    file = write_robot(("closures.0.name", RED), ("scenes", {}))
    assert main(["check", os.fspath(file)]) == 0
    out, err = capfd.readouterr()
    assert "\x1b" not in out + err
    assert "\\x1b[31mred" in out


@pytest.mark.parametrize(
    "command",
    [
        "plan five_bar --scene C --samples 1000000000000",
        "plan five_bar --scene C --raw --samples 1000000000000",
        "robustness five_bar --scene C --runs 1000000000000",
        f"robustness five_bar --scene C --runs {'9' * 400}",
    ],
)
def test_counts_beyond_all_memory_are_refused(capfd, command):
    assert main(command.split()) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert "at most" in err
    assert is_one_line(err)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
@pytest.mark.parametrize("words", [[], pytest.param(["--json"], marks=pytest.mark.slow)])
def test_an_answer_that_cannot_be_written_is_no_answer(words):
    with open("/dev/full", "w") as full:
        done = run("check", "five_bar", *words, stdout=full)
    assert done.returncode == 2
    assert done.stderr == "crossing: cannot write the answer: No space left on device\n"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
def test_a_complaint_that_cannot_be_written_leaves_the_exit_code(capfd, monkeypatch):
    with open("/dev/full", "w") as full:
        monkeypatch.setattr("sys.stderr", full)
        assert main(["check", "nothing"]) == 2
        with pytest.raises(OSError, match="No space"):
            full.close()


def test_letters_that_a_terminal_does_not_have_are_escaped(tmp_path, write_robot):
    file = write_robot(("closures.0.name", "élan"))
    done = run("check", os.fspath(file), stdout=subprocess.PIPE, env={"PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, "")
    assert "\\xe9lan.z" in done.stdout


def test_a_backend_that_there_is_not_is_misuse(tmp_path):
    done = run(
        *["plan", "five_bar", "--scene", "A", "--out", os.fspath(tmp_path / "out")],
        stdout=subprocess.PIPE,
        env={"MPLBACKEND": "nonsense"},
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("crossing: MPLBACKEND: ")
    assert is_one_line(done.stderr)
    assert list(tmp_path.iterdir()) == []


class Fault(Exception):
    """Something else."""


@pytest.fixture
def faulty(monkeypatch):
    """Makes `check` fail in a way that nobody meant."""

    def fail(options):
        raise Fault(f"a {RED}\nmistake" + "." * 3000)

    monkeypatch.setattr("framework.cli.robots.run_check", fail)


@pytest.mark.usefixtures("faulty")
@pytest.mark.parametrize("machine", [False, True])
def test_an_unexpected_error_is_one_line_and_asks_to_be_reported(capfd, monkeypatch, machine):
    monkeypatch.delenv(DEBUG_VARIABLE, raising=False)
    assert main(["check", "five_bar", *(["--json"] if machine else [])]) == UNEXPECTED_EXIT_CODE == 70
    out, err = capfd.readouterr()
    assert is_one_line(err)
    for words in (
        "unexpected Fault: a \\x1b[31mred",
        "framework/cli/console.py, line ",
        "report it",
        DEBUG_VARIABLE,
    ):
        assert words in err
    if machine:
        error = json.loads(out)["error"]
        assert (error["kind"], f"crossing: {error['message']}\n") == ("Fault", err)


@pytest.mark.usefixtures("faulty")
def test_the_traceback_is_there_for_those_who_ask(monkeypatch):
    monkeypatch.setenv(DEBUG_VARIABLE, "1")
    with pytest.raises(Fault):
        main(["check", "five_bar"])
