"""framework/README.md leads a reader to files that exist, by one or two of them for each question."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

GUIDE = Path(__file__).parents[1] / "framework" / "README.md"
ROWS = [line for line in GUIDE.read_text(encoding="utf-8").splitlines() if "](" in line and line[0] == "|"]
TWO_FILES_AT_MOST = 14  # the questions about a plan, and what is new


def links(row: str) -> list[str]:
    """The files that a row of a table links to, from the guide."""
    return re.findall(r"\]\(([^)]+)\)", row)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.split("|")[1].strip())
def test_what_the_guide_links_to_is_there(row: str) -> None:
    for link in links(row):
        assert (GUIDE.parent / link).exists(), link


def test_each_question_is_answered_by_two_files_at_most() -> None:
    for row in ROWS[:TWO_FILES_AT_MOST]:
        assert len(links(row)) <= 2, row


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.split("|")[1].strip())
def test_the_names_that_the_guide_gives_are_in_the_files_it_links_to(row: str) -> None:
    texts = [(GUIDE.parent / link) for link in links(row)]
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
