"""A command that is told to end says one line and leaves nothing: no process, no half file, and soon."""

import json
import os
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import cycle
from pathlib import Path

import pytest

from framework import InvalidInput
from framework.cli import main, robots
from framework.numerics.interruption import Terminated, defer_signals, exit_code, interruptible
from framework.numerics.output import written_together
from tests.watchdog import PATIENCE, wait_for

# what is sent before the program has begun to import is Python's own affair
PROGRAM = (
    "import sys; from framework.cli import main\n"
    "if __name__ == '__main__': print('begun', flush=True); sys.exit(main(sys.argv[1:]))"
)
# matplotlib leaves Python objects in a static map if it is interrupted between loading and filling a module
INTERRUPTED_IMPORT = """
import signal, sys
from importlib.machinery import ExtensionFileLoader
from framework.cli import main

create = ExtensionFileLoader.create_module


def create_and_interrupt(loader, spec):
    module = create(loader, spec)
    if spec.name == "matplotlib.ft2font":
        signal.raise_signal(signal.SIGINT)
    return module


ExtensionFileLoader.create_module = create_and_interrupt
sys.exit(main(sys.argv[1:]))
"""
SIGNALS = {signal.SIGINT: (130, "interrupted"), signal.SIGTERM: (143, "terminated")}
STUDY = ["robustness", "five_bar", "--scene", "C", "--smoothness", "4", "--period", "2e-4", "--runs", "500"]
FIGURES = ("eye", "law", "robot", "singularity", "torques", "vibrations", "wrench")
TABLES = ("motion.csv", "motion.csv-metadata.json", "response.csv", "vibrations.csv")
FILES = {"plan.json", "figures.pdf", *TABLES, *(f"{name}.png" for name in FIGURES)}
COMMANDS = {
    "plan": ["plan", "gough_stewart", "--scene", "turn", "--flexibility", "flexible_links"],
    "simulate": ["simulate", "five_bar", "--scene", "C", "--method", "fast", "--step", "2e-6"],
    "show": [
        "show",
        "gough_stewart",
        "--scene",
        "turn",
        "tilt",
        "--flexibility",
        "flexible_links",
        "--no-open",
    ],
    "robustness": STUDY,
    "robustness with workers": [*STUDY, "--workers", "3"],
}
pytestmark = pytest.mark.usefixtures("hearing")
AT_ONCE = [("plan", signal.SIGTERM)]


def started(*arguments: str) -> subprocess.Popen[str]:
    """Python with these arguments in a process group of its own, as a shell has it."""
    return subprocess.Popen(
        [sys.executable, *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


@contextmanager
def begun(arguments: list[str]) -> Iterator[subprocess.Popen[str]]:
    """A command in a process group of its own, just begun."""
    process = started("-c", PROGRAM, *arguments)
    with process:
        try:
            assert process.stdout.readline() == "begun\n"
            yield process
        finally:
            process.kill()


def members(group: int) -> dict[int, str]:
    """Processes of a group with what they run, zombies aside."""
    found = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                state, _, their_group = (folder / "stat").read_text().rpartition(")")[2].split()[:3]
                words = (folder / "cmdline").read_text().replace("\0", " ")
            except OSError:
                continue
            if int(their_group) == group and state != "Z":
                found[int(folder.name)] = words
    return found


def workers(group: int, count: int) -> list[int]:
    """Worker processes, once there are as many."""
    found = [pid for pid, words in members(group).items() if "spawn_main" in words]
    return found if len(found) == count else []


needs_proc = pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="there is no /proc")


@needs_proc
@pytest.mark.parametrize(
    ("command", "number"),
    [
        pytest.param(command, number, marks=() if (command, number) in AT_ONCE else pytest.mark.slow)
        for command in COMMANDS
        for number in SIGNALS
    ],
)
def test_a_command_that_is_told_to_end_ends(tmp_path, command, number):
    writes = command in ("plan", "robustness", "robustness with workers")
    out = ["--out", os.fspath(tmp_path / "new" / "out")] if writes else []
    with begun([*COMMANDS[command], *out]) as process:
        if writes:
            wait_for(lambda: list(tmp_path.glob("new/out/.*")))  # it is at work
        if "workers" in command:
            wait_for(lambda: workers(process.pid, 2))
        time.sleep(0.5)
        asked = time.monotonic()
        os.killpg(process.pid, number)  # as Ctrl-C does: all processes hear it
        os.killpg(process.pid, number)
        out, err = process.communicate(timeout=PATIENCE)
        assert time.monotonic() - asked < PATIENCE / 4
    code, word = SIGNALS[number]
    assert (process.returncode, out, err) == (code, "", f"crossing: {word}\n")
    wait_for(lambda: not members(process.pid))
    assert list(tmp_path.iterdir()) == []


def state(process: subprocess.Popen[str]) -> str:
    """R, S, ... or T if a process is stopped, Z if it has ended."""
    return Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[0]


def hears(process: subprocess.Popen[str]) -> bool:
    """Whether a process catches SIGTERM by now."""
    status = Path(f"/proc/{process.pid}/status").read_text().splitlines()
    caught = next(int(line.split()[1], 16) for line in status if line.startswith("SigCgt"))
    return bool(caught >> (signal.SIGTERM - 1) & 1)


@needs_proc
@pytest.mark.parametrize(
    ("delay", "number"),
    [
        pytest.param(delay, number, marks=pytest.mark.slow if delay > 0.15 else ())
        for delay, number in zip([0.0, 0.15, *(0.1 * k for k in range(3, 20))], cycle(SIGNALS))
    ],
)
def test_from_its_first_import_on_a_command_ends_with_one_line(tmp_path, delay, number):
    """Half a second of imports, then a plan, then matplotlib's imports and figures."""
    command = ["plan", "five_bar", "--scene", "C", "--flexibility", "flexible_links"]
    with started("-m", "framework", *command, "--out", os.fspath(tmp_path / "out")) as process:
        wait_for(lambda: hears(process))
        time.sleep(delay)
        process.send_signal(signal.SIGSTOP)
        wait_for(lambda: state(process) in "TZ")
        at_work = hears(process)  # a quick machine has done the work by now
        process.send_signal(number)
        process.send_signal(signal.SIGCONT)
        out, err = process.communicate(timeout=PATIENCE)
    code, word = SIGNALS[number]
    assert (process.returncode != 0) == at_work
    if at_work:
        assert (process.returncode, out, err) == (code, "", f"crossing: {word}\n")
        if list(tmp_path.iterdir()):  # told to end after the files were in place: they are whole
            assert {file.name for file in (tmp_path / "out").iterdir()} == FILES


@pytest.mark.slow
@needs_proc
def test_a_worker_that_is_interrupted_while_it_imports_says_nothing():
    with begun(COMMANDS["robustness with workers"]) as process:
        wait_for(lambda: workers(process.pid, 1) or workers(process.pid, 2))
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, out, err) == (130, "", "crossing: interrupted\n")


@pytest.mark.slow
def test_an_interruption_while_matplotlib_is_imported_ends_with_one_line(tmp_path):
    with started("-c", INTERRUPTED_IMPORT, "robots", "--picture", os.fspath(tmp_path / "all.png")) as process:
        out, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, out, err) == (130, "", "crossing: interrupted\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("other", [ImportError("half imported"), InvalidInput("MPLBACKEND: nonsense"), None])
def test_an_interruption_that_other_code_makes_something_else_of_is_one_all_the_same(
    monkeypatch, capsys, number, other
):
    def run(options):
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt:
            if other is not None:
                raise other from None
        return {}, "done"

    monkeypatch.setattr(robots, "run_robots", run)
    code, word = SIGNALS[number]
    assert main(["robots"]) == code
    assert capsys.readouterr() == ("", f"crossing: {word}\n")


@needs_proc
@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_no_worker_outlives_the_command(tmp_path, number):
    with begun([*COMMANDS["robustness with workers"], "--out", os.fspath(tmp_path)]) as process:
        wait_for(lambda: workers(process.pid, 2))
        time.sleep(0.5)
        os.kill(process.pid, number)  # it alone
        process.wait(PATIENCE)
        wait_for(lambda: not members(process.pid))


@pytest.mark.slow
@needs_proc
def test_a_worker_that_is_killed_costs_no_run(tmp_path):
    arguments = [*STUDY[:-4], "--period", "2e-2", "--runs", "400", "--workers", "3", "--json"]
    with begun(arguments) as process:
        os.kill(wait_for(lambda: workers(process.pid, 2))[0], signal.SIGKILL)
        out, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, err) == (0, "")
    assert json.loads(out)["runs"] == 400


def test_the_first_signal_interrupts_and_the_others_do_not():
    with interruptible():
        with pytest.raises(Terminated) as caught:
            signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
    assert exit_code(caught.value) == 143
    with interruptible(), pytest.raises(KeyboardInterrupt) as caught:
        signal.raise_signal(signal.SIGINT)
    assert exit_code(caught.value) == 130


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_in_a_callback_where_python_loses_exceptions_interrupts_what_comes_next(number):
    class Referred:
        pass

    referred, stops = [Referred()], []
    callback = weakref.ref(referred[0], lambda gone: signal.raise_signal(number))

    def lose_and_go_on():
        referred.clear()
        stops.append(heard.stop)  # it has arrived, and was lost
        time.sleep(PATIENCE)
        stops.append("never again")

    with interruptible() as heard, pytest.raises(KeyboardInterrupt) as caught:
        lose_and_go_on()
    assert callback() is None
    assert [exit_code(stop) for stop in (*stops, caught.value)] == 2 * [SIGNALS[number][0]]


@pytest.mark.parametrize("number", SIGNALS)
def test_no_file_is_written_after_an_interruption_that_other_code_has_caught(tmp_path, number):
    def write():
        with interruptible(), written_together(tmp_path / "new" / "out") as folder:
            (folder / "plan.json").write_text("{}")
            with suppress(KeyboardInterrupt):
                signal.raise_signal(number)

    with pytest.raises(KeyboardInterrupt) as caught:
        write()
    assert exit_code(caught.value) == SIGNALS[number][0]
    assert list(tmp_path.iterdir()) == []


def test_what_the_caller_ignores_stays_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruptible():
            signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_where_it_must_not_be_interrupted_a_signal_waits():
    done = []

    def work():
        with interruptible():
            with defer_signals():
                signal.raise_signal(signal.SIGINT)
                done.append("first")
            done.append("second")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["first"]
