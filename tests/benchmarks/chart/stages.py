"""The stages of the chart by name, each imported when it is asked for."""

from importlib import import_module

import numpy as np

from framework import InvalidInput
from framework.errors import choose_from
from tests.benchmarks.chart.measure import Row, Stage, measured, read_setting

NAMES = ("torque", "failure", "levels")


def stage(name: str) -> Stage:
    """The stage of that name.

    Raises:
        InvalidInput: there is none; lists those that there are.
    """
    if name not in NAMES:
        raise InvalidInput(choose_from("stage", name, NAMES))
    return import_module(f"tests.benchmarks.chart.{name}").STAGE


def made_again(key: str) -> tuple[Stage, Row]:
    """The row of that key, STAGE:METHOD:SETTING, made anew.

    Raises:
        InvalidInput: no such stage, method or setting, or its peer is not installed.
    """
    parts = key.split(":")
    if len(parts) != 3:
        raise InvalidInput(f"--row: needs STAGE:METHOD:SETTING as in the table's last column, got {key!r}")
    one = stage(parts[0])
    method, setting = one.method(parts[1]), read_setting(parts[2])
    alike = [known for known in method.settings if len(known) == len(setting)]
    if not any(np.allclose(setting, known, rtol=1e-9, atol=0.0) for known in alike):
        valid = " ".join(",".join(f"{number:.12g}" for number in known) for known in method.settings)
        raise InvalidInput(f"--row: {method.name} has the settings {valid} ({method.unit}), got {parts[2]!r}")
    if not method.installed:
        raise InvalidInput(f"--row: {method.package} is not installed")
    return one, measured(one, method, setting)
