"""Tasks for worker processes, in a module of their own so that these can import them."""

import os
import signal
import time
from importlib import import_module
from pathlib import Path

import numpy as np

from framework import NotAssembled


class Stubborn(Exception):
    """Cannot be told to another process."""

    def __init__(self, *, what: str) -> None:
        super().__init__()
        self.what = what

    def __reduce__(self):
        return Stubborn, ()


class FromElsewhere:
    """Unpickled by importing a module that is not there."""

    def __reduce__(self):
        return import_module, ("no_such_module",)


def square(number: int) -> int:
    return number**2


def process() -> int:
    return os.getpid()


def die(tombstones: str, deaths: int) -> int:
    """Be killed as often as `deaths` says, then tell how often that was."""
    died = len(list(Path(tombstones).iterdir()))
    if died < deaths:
        (Path(tombstones) / str(died)).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return died


def fail(kind: str) -> None:
    if kind == "not assembled":
        raise NotAssembled("open by a metre", q=np.ones(3), residual=1.0)
    if kind == "stubborn":
        raise Stubborn(what="no")
    raise ZeroDivisionError("by zero")


def sleep(note: str) -> None:
    """Leave a note with the number of this process, and never come back."""
    Path(note).write_text(str(os.getpid()))
    while True:
        time.sleep(0.1)
