"""Files are written together or not at all."""

from __future__ import annotations

import pytest

from framework.errors import OutputError
from framework.output import written_together

FILES = {"plan.json": "{}\n", "motion.csv": "time\n0\n"}


def write(folder, error: type[BaseException] | None = None) -> None:
    """Write the files into the folder, and stop after the last one if there is an error."""
    with written_together(folder) as temporary:
        for name, text in FILES.items():
            (temporary / name).write_text(text)
        if error is not None:
            raise error


def everything_in(folder) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


@pytest.mark.parametrize("place", [".", "new", "new/deeper/still"])
def test_the_files_and_nothing_else_are_in_the_folder(tmp_path, place):
    folder = tmp_path / place
    write(folder)
    assert {path.name: path.read_text() for path in folder.iterdir()} == FILES


def test_a_second_time_replaces_the_files_and_leaves_the_others(tmp_path):
    (tmp_path / "plan.json").write_text("old")
    (tmp_path / "notes.txt").write_text("mine")
    write(tmp_path)
    assert (tmp_path / "plan.json").read_text() == FILES["plan.json"]
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("place", [".", "new", "new/deeper/still"])
@pytest.mark.parametrize("error", [ArithmeticError, KeyboardInterrupt])
def test_an_error_half_way_leaves_the_disk_as_it_was(tmp_path, place, error):
    (tmp_path / "plan.json").write_text("old")
    with pytest.raises(error):
        write(tmp_path / place, error)
    assert everything_in(tmp_path) == {"plan.json"}
    assert (tmp_path / "plan.json").read_text() == "old"


@pytest.mark.parametrize("place", ["file", "file/below"])
def test_a_file_in_the_way_is_found_before_the_work_begins(tmp_path, place):
    (tmp_path / "file").write_text("mine")
    refused = pytest.raises(OutputError, match=f"--out: cannot write into .*{place}")
    with refused, written_together(tmp_path / place):
        pytest.fail("the work has begun")
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("blocked", FILES)
def test_when_one_file_cannot_be_placed_none_is(tmp_path, blocked):
    (tmp_path / blocked).mkdir()  # a folder where the file should go
    with pytest.raises(OutputError, match="--out: cannot write into"):
        write(tmp_path)
    assert everything_in(tmp_path) == {blocked}
