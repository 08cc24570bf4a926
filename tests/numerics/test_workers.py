"""Worker processes: what they are given comes back, whoever is killed, and none is left."""

import os
import pickle
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from framework import InvalidInput, LostWorkers, NotAssembled, errors
from framework.numerics.tasks import MAX_TRIES, Workers, iterate_results
from tests.numerics import chores
from tests.watchdog import PATIENCE, wait_for


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def text_of(file):
    return file.read_text() if file.exists() else ""


@pytest.fixture(scope="module")
def workers():
    with Workers(2) as two:
        yield two


def test_what_is_asked_comes_back(workers):
    assert list(workers.map(chores.square, range(20))) == [number**2 for number in range(20)]
    assert os.getpid() not in {workers.submit(chores.process).result() for _ in range(4)}


def test_a_call_is_sent_as_it_was_submitted(workers):
    """This process computes, too: what it caches meanwhile must not change what a thread is pickling."""
    numbers = [1]
    for _ in range(2):
        workers.submit(time.sleep, 0.05)
    waiting = workers.submit(sum, numbers)
    numbers.append(5)
    assert waiting.result() == 1


def test_an_error_comes_back_with_what_it_carries(workers):
    with pytest.raises(NotAssembled, match="open by a metre") as caught:
        workers.submit(chores.fail, "not assembled").result()
    assert caught.value.residual == 1.0
    np.testing.assert_array_equal(caught.value.q, np.ones(3))
    assert "chores.py" in caught.value.__notes__[0]  # where it happened
    with pytest.raises(ZeroDivisionError, match="by zero"):
        workers.submit(chores.fail, "").result()
    with pytest.raises(RuntimeError, match="Stubborn"):
        workers.submit(chores.fail, "stubborn").result()
    assert workers.submit(chores.square, 3).result() == 9


@pytest.mark.parametrize("count", [0, -1, 1.5])
def test_there_is_a_worker_at_least(count):
    with pytest.raises(InvalidInput, match="workers"):
        Workers(count)


def test_what_cannot_be_sent_is_said(workers):
    with pytest.raises((pickle.PicklingError, AttributeError)):
        workers.submit(lambda: 1).result()


def test_every_error_of_ours_can_be_sent():
    carried = {"message": "no", "s": 0.5, "joint": "motor", "count": 2}
    for kind in vars(errors).values():
        if isinstance(kind, type) and issubclass(kind, errors.FrameworkError):
            error = kind.__new__(kind, "no")
            error.__dict__.update(carried)
            again = pickle.loads(pickle.dumps(error))
            assert (type(again), str(again), vars(again)) == (kind, "no", carried)


@pytest.mark.parametrize("deaths", [1, pytest.param(MAX_TRIES - 1, marks=pytest.mark.slow)])
def test_a_task_whose_process_is_killed_is_begun_anew(workers, tmp_path, capfd, deaths):
    others = [workers.submit(chores.square, number) for number in range(5)]
    assert workers.submit(chores.die, str(tmp_path), deaths).result() == deaths
    assert [future.result() for future in others] == [0, 1, 4, 9, 16]
    assert capfd.readouterr().err == ""


@pytest.mark.slow
def test_a_task_that_kills_each_process_is_given_up_and_the_others_are_not(workers, tmp_path):
    with pytest.raises(LostWorkers, match="killed"):
        workers.submit(chores.die, str(tmp_path), 100).result()
    assert workers.submit(chores.square, 3).result() == 9


def test_what_waits_for_a_busy_process_is_done_here(tmp_path):
    one = Workers(1)
    one.submit(chores.sleep, str(tmp_path / "note"))
    tasks = {str(number): number for number in range(5)}
    try:
        found = dict(iterate_results(chores.square, tasks, one))
    finally:
        one.stop()
    assert found == {name: number**2 for name, number in tasks.items()}


def test_leaving_by_an_error_ends_processes_and_tasks_at_once(tmp_path):
    note, one = tmp_path / "note", Workers(1)

    def interrupted():
        with one:
            one.submit(chores.sleep, str(note))
            submitted.append(one.submit(chores.square, 3))
            pids.append(int(wait_for(lambda: text_of(note))))
            raise KeyboardInterrupt

    submitted, pids = [], []
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not is_alive(pids[0])
    assert submitted[0].cancelled()
    with pytest.raises(RuntimeError, match="after shutdown"):
        one.submit(chores.square, 3)


@pytest.mark.slow
def test_a_process_ends_with_the_one_that_began_it(tmp_path):
    note = tmp_path / "note"
    program = (
        "import sys; from framework.numerics.tasks import Workers; from tests.numerics import chores\n"
        "if __name__ == '__main__': Workers(1).submit(chores.sleep, sys.argv[1]).result()"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", program, os.fspath(note)]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as parent:
        pid = int(wait_for(lambda: text_of(note)))
        parent.send_signal(signal.SIGKILL)
        assert parent.wait(PATIENCE) == -signal.SIGKILL
        wait_for(lambda: not is_alive(pid))
        assert parent.stderr.read() == ""


@pytest.mark.slow
def test_what_cannot_be_read_on_the_other_side_is_an_error_of_its_own(workers):
    for task in (workers.submit(repr, chores.FromElsewhere()), workers.submit(chores.FromElsewhere)):
        with pytest.raises(ModuleNotFoundError, match="no_such_module"):
            task.result(PATIENCE)
    assert workers.submit(chores.square, 3).result(PATIENCE) == 9
