"""Manners of the command line: stdout by `-`, robots of another package, completion."""

import json
import subprocess
import sys
from types import ModuleType

import pytest

import robots
from framework.catalogue import own_file
from framework.cli import main
from framework.cli.commands import COMMANDS, parser_of
from framework.cli.completion import SHELLS
from framework.files import mjcf_text


def test_export_writes_to_stdout(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "five_bar", "--to", "mjcf", "--out", "-"]) == 0
    assert capsys.readouterr().out.rstrip() == mjcf_text(robots.load("five_bar")).rstrip()
    assert (
        main(["export", "five_bar", "--scene", "A", "--to", "csv", "--samples", "3", "--out", "-", "--json"])
        == 0
    )
    assert len(json.loads(capsys.readouterr().out)["text"].splitlines()) == 4
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", ["plan five_bar --scene C --out -", "show five_bar --scene C --html -"])
def test_a_folder_or_a_page_is_not_written_to_stdout(words, capsys):
    assert main(words.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "needs a name, got '-'" in line
    assert "try:" not in line


def test_robots_of_robot_descriptions_are_converted_if_it_is_installed(capsys, tmp_path, monkeypatch):
    words = ["convert", "five_bar_description", "--out", str(tmp_path)]
    monkeypatch.setitem(sys.modules, "robot_descriptions", None)
    assert main(words) == 2
    assert "pip install robot_descriptions" in capsys.readouterr().err
    package, robot = ModuleType("robot_descriptions"), ModuleType("robot_descriptions.five_bar_description")
    package.DESCRIPTIONS = {"five_bar_description": None}
    package.__path__ = []
    robot.URDF_PATH = str(own_file("five_bar").with_suffix(".urdf"))
    monkeypatch.setitem(sys.modules, package.__name__, package)
    monkeypatch.setitem(sys.modules, robot.__name__, robot)
    assert main([*words, "--close", "left_tip", "right_tip", "spherical"]) == 0
    assert (tmp_path / "five_bar.yaml").exists()
    words[1] = "fife_bar_description"
    assert main(words) == 2
    assert "did you mean 'five_bar_description'" in capsys.readouterr().err


def test_the_whole_parser_has_all_commands_with_their_options():
    commands = parser_of([], whole=True)
    for name in COMMANDS:
        assert set(parser_of([name]).option_actions) <= set(commands.option_actions)


@pytest.mark.parametrize("shell", SHELLS)
def test_a_shell_completes(shell, capsys):
    pytest.importorskip("shtab")
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert "five_bar_heavy" in script
    assert "--torque-limit" in script or "torque-limit" in script
    if shell == "bash":
        completed = "_shtab_crossing crossing pl crossing; echo ${COMPREPLY[@]}"
        program = f"{script}\nCOMP_WORDS=(crossing pl); COMP_CWORD=1; {completed}"
        done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, check=False)
        assert done.stdout.strip() == "plan"
