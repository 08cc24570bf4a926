"""Guides lead to files that exist, one or two for each question, and their commands run."""

import ast
import re
import shlex
from itertools import pairwise
from pathlib import Path

import pytest

from framework.cli import main
from framework.cli.commands import parser_of
from tests.test_help import EXAMPLES

ROOT = Path(__file__).parents[1]
GUIDE = ROOT / "framework" / "README.md"
QUESTIONS_ABOUT_A_PLAN = 11


def rows_of(file: Path) -> list[tuple[Path, str]]:
    """The rows of its tables that link to files, with the folder that links start from."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return [(file.parent, line) for line in lines if "](" in line and line[0] == "|"]


NEW = rows_of(ROOT / "CONTRIBUTING.md")
ROWS = [*rows_of(GUIDE), *NEW]
NAMES = [row.split("|")[1].strip() for _, row in ROWS]
each_row = pytest.mark.parametrize(("folder", "row"), ROWS, ids=NAMES)


def links(row: str) -> list[str]:
    """The files that a row of a table links to."""
    return re.findall(r"\]\(([^)]+)\)", row)


@each_row
def test_what_a_row_links_to_is_there(folder: Path, row: str) -> None:
    for link in links(row):
        assert (folder / link).exists(), link


def test_each_question_is_answered_by_two_files_at_most() -> None:
    assert len(NEW) == 10
    for _, row in [*ROWS[:QUESTIONS_ABOUT_A_PLAN], *NEW]:
        assert len(links(row)) <= 2, row


def test_the_tests_that_hold_something_new_are_there() -> None:
    named = {name for _, row in NEW for name in re.findall(r"`(tests/[\w/]+(?:\.py)?)`", row)}
    assert len(named) > 6
    assert all((ROOT / name).exists() for name in named - {"tests/robots/test_NAME.py"})


@each_row
def test_the_names_that_a_row_gives_are_in_the_files_it_links_to(folder: Path, row: str) -> None:
    texts = [folder / link for link in links(row)]
    whole = "".join(path.read_text(encoding="utf-8") for path in texts if path.is_file())
    for name in re.findall(r"(?<!\[)`([A-Za-z_]+)`(?!\])", row.split("|")[2]):
        assert name in whole, name


# in linalg each file stands for itself
ROOMS = [path.parent for path in sorted(GUIDE.parent.rglob("*/__init__.py")) if path.parent.name != "linalg"]


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.relative_to(GUIDE.parent).as_posix())
def test_a_room_says_which_of_its_files_to_open_first(room: Path) -> None:
    module = ast.parse((room / "__init__.py").read_text(encoding="utf-8"))
    text = " ".join((ast.get_docstring(module) or "").split())
    opened = re.search(r"Open(?: first)? `(\w+)`", text)
    assert opened is not None
    assert (room / f"{opened[1]}.py").exists()


def commands_of(file: Path) -> list[list[str]]:
    """The words of the command lines in its blocks of sh, without comments."""
    blocks = re.findall(r"```sh\n(.*?)```", file.read_text(encoding="utf-8"), re.S)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    split = [shlex.split(line, comments=True) for line in lines]
    return [words[1:] for words in split if words[:1] == ["crossing"]]


# the tutorials have files of their own: tests/test_docs.py
PAGES = [ROOT / "README.md", ROOT / "docs" / "first_crossing.md", *sorted(ROOT.glob("docs/how_to/*.md"))]
COMMANDS_OF_GUIDES = [words for page in PAGES for words in commands_of(page)]
ALONE = [  # those that need no file that a reader has, and end by themselves
    words
    for words in COMMANDS_OF_GUIDES
    if not {"cassie.xml", "leg/cassie.yaml", "my_robot.yaml", "move"} & set(words)
    and (words[0] != "show" or {"--html", "--picture"} & set(words))
]
# examples of the help that write nothing for others; tests/test_help.py runs them
ELSEWHERE = [words for words in map(shlex.split, EXAMPLES) if not {"--out", "--html"} & set(words)]
FEWER = {("--runs", "200"): "20", ("--size", "100"): "24"}  # runs and poses, for the same words
ANSWERS_NO = [["plan", "five_bar", "--scene", "B"]]


@pytest.mark.parametrize("words", COMMANDS_OF_GUIDES, ids=" ".join)
def test_the_commands_of_the_guides_have_the_options_that_they_say(words: list[str]) -> None:
    options = parser_of(words).parse_args(words)  # raises Misuse for an option that there is not
    assert callable(options.run)


@pytest.mark.slow
def test_the_commands_of_the_guides_run_in_their_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for words in ALONE:
        if ["crossing", *words] not in ELSEWHERE:
            code = main([FEWER.get(pair, pair[1]) for pair in pairwise(["", *words])])
            assert code == (words in ANSWERS_NO), (words, capsys.readouterr().err)
    assert len(ALONE) >= 30
