"""The help of every command: in groups, a unit for each number, examples that run."""

import argparse
import re
import shlex
from importlib.util import find_spec

import pytest

from framework.cli import main
from framework.cli.commands import COMMANDS, FIRST_EXAMPLES, parser_of

UNIT = re.compile(r"\[[^\]]+\]|share")  # a share has none
EXAMPLES = [example for command in COMMANDS.values() for example in command.examples]


def words(example: str) -> list[str]:
    """The arguments of an example."""
    program, *arguments = shlex.split(example)
    assert program == "crossing"
    return arguments


def parser(name: str) -> argparse.ArgumentParser:
    """The parser of one command."""
    (subparsers,) = (
        action for action in parser_of([name])._actions if isinstance(action, argparse._SubParsersAction)
    )
    return subparsers.choices[name]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_number_has_a_unit_and_every_option_a_text(name):
    for action in parser(name)._actions:
        assert action.help, action.option_strings
        if action.type is float:
            assert UNIT.search(action.help), action.option_strings


@pytest.mark.parametrize("name", COMMANDS)
def test_a_help_has_a_line_of_usage_its_groups_and_two_examples_and_fits(name, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit) as ended:
        main([name, "--help"])
    assert ended.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"usage: crossing {name} ")
    assert lines[0].endswith(" [options]")
    assert lines[1] == ""
    assert max(map(len, lines)) <= 80
    at = lines.index("examples:")
    assert [line.strip() for line in lines[at + 1 :]] == list(COMMANDS[name].examples)
    assert len(COMMANDS[name].examples) == 2
    assert "output:" in lines[:at]
    if name == "plan":
        for title in ("what to plan:", "the law:", "the model:", "limits:"):
            assert title in lines[:at]


@pytest.mark.parametrize("example", [*FIRST_EXAMPLES, *EXAMPLES])
def test_every_example_is_a_command(example):
    arguments = words(example)
    assert callable(parser_of(arguments).parse_args(arguments).run)


ENDLESS = "crossing show five_bar --scene A B C"  # serves a page until Ctrl-C


@pytest.mark.slow
def test_every_example_does_what_it_says(tmp_path, monkeypatch, capsys):
    """In the order of the list, in one folder: each finds what those before it have written."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("framework.fidelity.capacity.BRACKET_RATIO", 1.0)  # doubling will do here
    for example in (*FIRST_EXAMPLES, *EXAMPLES):
        if example != ENDLESS and (find_spec("shtab") or "completion" not in example):
            code = main(words(example))
            assert code == 0, (example, capsys.readouterr().err)
    capsys.readouterr()
