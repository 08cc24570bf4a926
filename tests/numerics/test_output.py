"""Files are written together or not at all."""

import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from framework import OutputError
from framework.cli import main
from framework.numerics.interruption import Terminated, interruptible
from framework.numerics.output import PROGRAM, write_files, written_together
from tests.watchdog import PATIENCE

FILES = {"plan.json": "{}\n", "motion.csv": "time\n0\n"}


def write(folder, error: type[BaseException] | None = None, **options) -> None:
    """Write the files into the folder, and stop after the last one if there is an error."""
    with written_together(folder, **options) as temporary:
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


@contextmanager
def disk_that_fills_up(size: int) -> Iterator[None]:
    """Within, a file cannot grow beyond so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_disk_that_fills_up_leaves_the_old_files(tmp_path):
    (tmp_path / "plan.json").write_text("old")
    refused = pytest.raises(OutputError, match=r"--out: .*too large")
    with disk_that_fills_up(1000), refused, written_together(tmp_path) as temporary:
        (temporary / "motion.csv").write_text("0")
        (temporary / "plan.json").write_text("0" * 5000)
    assert everything_in(tmp_path) == {"plan.json"}
    assert (tmp_path / "plan.json").read_text() == "old"


@pytest.mark.parametrize("name", ["a" * 300, "a" * 5000, "a" * 300 + "/b", "a\0b"])
def test_what_is_no_name_is_refused(tmp_path, name):
    with pytest.raises(OutputError, match="--out: cannot write"), written_together(tmp_path / name):
        pytest.fail("the work has begun")
    with pytest.raises(OutputError, match="--html: cannot write"):
        write_files({tmp_path / name: "page"})
    assert everything_in(tmp_path) == set()


@pytest.mark.parametrize(
    ("there", "named"),
    [
        ({"plan.json": "mine"}, "plan.json"),
        ({"plan.json": "{}"}, "plan.json"),
        ({"plan.json": '["robot"]', "motion.csv": "mine"}, "plan.json"),
        ({"plan.json": "[" * 5000}, "plan.json"),
        ({"motion.csv": "mine"}, "motion.csv"),
    ],
)
def test_files_of_others_are_kept(tmp_path, there, named):
    for name, text in there.items():
        (tmp_path / name).write_text(text)
    complaint = f"--out: cannot write into .*: {named} is there already, and not of this program"
    with pytest.raises(OutputError, match=complaint):
        write(tmp_path, document="plan.json")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == there


def test_a_document_of_others_is_refused_before_the_work(tmp_path):
    (tmp_path / "plan.json").write_text("{}")
    refused = pytest.raises(OutputError, match="not of this program")
    with refused, written_together(tmp_path, document="plan.json"):
        pytest.fail("the work has begun")


# a command, the work that it is not to begin, and a file of somebody else in its way
@pytest.mark.parametrize(
    ("words", "work", "foreign"),
    [
        ("map five_bar --window 0 0.1 0.3 0.4", "workspace_map.workspace_map", "map_g.png"),
        (
            "map five_bar --window 0 0.1 0.3 0.4 --nearest 0.1 0.3",
            "workspace_map.nearest_singular_pose",
            "map.csv",
        ),
        ("transmission humanoid_ankle", "transmission.transmission", "limits.pdf"),
        ("simulate five_bar --scene A --sensors", "arguments.load_or_plan", "sensors.csv"),
        ("robustness five_bar --scene A", "arguments.load_or_plan", "runs.csv"),
        ("fidelity five_bar --scene A", "fidelity.fidelity_study", "fidelity.png"),
        ("plan five_bar --scene A", "plan._make_plan", "motion.csv"),
        ("plan five_bar --scene A --raw", "plan.report_raw", "raw.csv"),
        ("identify five_bar data.csv", "identification.identify", "five_bar.urdf"),
        ("calibrate five_bar data.csv", "identification.calibrate", "five_bar.yaml"),
        ("excite five_bar", "identification.excite", "a.csv"),
        ("export five_bar --scene A --to csv", "export._plan_of", "a.csv"),
        ("export five_bar --scene A --to ros2_control", "export._plan_of", "a.json"),
        ("export five_bar --scene A --to controller", "export._plan_of", "a_run.py"),
        ("export five_bar --scene A --to lesson", "arguments.load", "a.html"),
    ],
)
def test_commands_refuse_files_of_others_before_the_work(words, work, foreign, tmp_path, monkeypatch, capsys):
    (tmp_path / foreign).write_text("mine")
    module, name = work.split(".")
    monkeypatch.setattr(f"framework.cli.{module}.{name}", lambda *_, **__: pytest.fail("the work has begun"))
    out = tmp_path / foreign.replace("_run.py", ".csv") if foreign.startswith("a") else tmp_path
    assert main([*words.split(), "--out", str(out)]) == 2
    assert f"{foreign} is " in capsys.readouterr().err
    assert everything_in(tmp_path) == {foreign}


def test_files_beside_a_document_of_ours_are_replaced(tmp_path):
    (tmp_path / "motion.csv").write_text("old")
    (tmp_path / "plan.json").write_text('{"robot": "five_bar"}')
    write(tmp_path, document="plan.json")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == FILES


KILLED = """
import os, signal, sys
from pathlib import Path
from framework.numerics.output import written_together
with written_together(Path(sys.argv[1])) as temporary:
    (temporary / "plan.json").write_text("{")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    killed = subprocess.run(
        [sys.executable, "-c", KILLED, tmp_path], env=environment, check=False, timeout=PATIENCE
    )
    assert killed.returncode == -signal.SIGKILL
    (tmp_path / ".unfinished-chapters").mkdir()  # somebody else's
    assert len(list(tmp_path.iterdir())) == 2
    write(tmp_path)
    assert everything_in(tmp_path) == {*FILES, ".unfinished-chapters"}


def test_what_another_process_is_writing_is_left_alone(tmp_path):
    with written_together(tmp_path) as temporary:
        (temporary / "mine").write_text("mine")
        write(tmp_path)
    assert everything_in(tmp_path) == {*FILES, "mine"}


@pytest.mark.usefixtures("hearing")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_the_folder_is_made_leaves_nothing(tmp_path, monkeypatch, number):
    make = tempfile.mkdtemp

    def and_signal(**options):
        made = make(**options)
        signal.raise_signal(number)
        return made

    monkeypatch.setattr(tempfile, "mkdtemp", and_signal)
    with interruptible(), pytest.raises(KeyboardInterrupt):
        write(tmp_path / "new")
    assert everything_in(tmp_path) == set()


@pytest.mark.usefixtures("hearing")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_between_two_files_nobody_is_interrupted(tmp_path, monkeypatch, number):
    replace = os.replace

    def and_signal(old, new):
        replace(old, new)
        signal.raise_signal(number)

    monkeypatch.setattr(os, "replace", and_signal)
    with interruptible(), pytest.raises(Terminated if number == signal.SIGTERM else KeyboardInterrupt):
        write(tmp_path)
    assert everything_in(tmp_path) == set(FILES)


@pytest.mark.parametrize("place", ["page.html", "new/deeper/page.html"])
def test_one_file_is_written_whole(tmp_path, place):
    write_files({tmp_path / place: "page é"})
    write_files({tmp_path / place: "another page é"}, overwrite=True)
    assert (tmp_path / place).read_text(encoding="utf-8") == "another page é"
    assert [path.name for path in (tmp_path / place).parent.iterdir()] == ["page.html"]


def test_one_file_that_cannot_be_written_whole_is_left_as_it_was(tmp_path):
    page = tmp_path / "page.html"
    page.write_text("0" * 30)
    with disk_that_fills_up(1000), pytest.raises(OutputError, match=r"--html: cannot write .*page.html: "):
        write_files({page: "0" * 5000})
    with disk_that_fills_up(1000), pytest.raises(OutputError, match=r"new\.html"):
        write_files({tmp_path / "new" / "new.html": "0" * 5000})
    assert everything_in(tmp_path) == {"page.html"}
    assert page.read_text() == "0" * 30


@pytest.mark.parametrize(
    ("there", "new", "replaced"),
    [
        ("<html>notes</html>", f"<html>{PROGRAM}</html>", False),
        (f"<html>{PROGRAM} 0.1</html>", f"<html>{PROGRAM}</html>", True),
        ("time,s,ds,dds,platform_x,1", "time,s,ds,dds,platform_x,2", True),
        ("time,price", "time,s,ds,dds,platform_x", False),
        ("", "time,s", True),
    ],
)
def test_a_file_of_another_origin_is_not_replaced_unless_asked_for(tmp_path, there, new, replaced):
    file = tmp_path / "file"
    file.write_text(there)
    if not replaced:
        with pytest.raises(OutputError, match=r"is there already, and not of this program; .* --overwrite"):
            write_files({file: new})
        assert file.read_text() == there
    write_files({file: new}, overwrite=not replaced)
    assert file.read_text() == new


def test_one_file_is_written_through_a_link(tmp_path):
    (tmp_path / "page.html").write_text("old")
    (tmp_path / "link.html").symlink_to(tmp_path / "page.html")
    write_files({tmp_path / "link.html": "new"}, overwrite=True)
    assert (tmp_path / "link.html").is_symlink()
    assert (tmp_path / "page.html").read_text() == "new"


@pytest.mark.parametrize("place", [".", "fifo", "/dev/null", "/dev/full"])
def test_what_is_no_file_is_not_replaced_by_one(tmp_path, place):
    os.mkfifo(tmp_path / "fifo")
    before = os.stat(tmp_path / place).st_mode
    with pytest.raises(OutputError, match="not a regular file"):
        write_files({tmp_path / place: "page"})
    assert os.stat(tmp_path / place).st_mode == before


def test_a_path_that_is_not_utf_8_is_a_path(tmp_path):
    """Where the file system takes UTF-8 only, it is refused as any other path that cannot be written."""
    file = Path(os.fsdecode(os.fsencode(tmp_path) + b"/a\xff.html"))
    try:
        file.touch()
    except OSError:
        with pytest.raises(OutputError, match="cannot write"):
            write_files({file: "page"})
        assert list(tmp_path.iterdir()) == []
    else:
        write_files({file: f"page about {file}"})
        assert file.read_text(encoding="utf-8").endswith("/a?.html")
