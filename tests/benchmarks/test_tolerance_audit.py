"""The audit of tolerances in small: a few numbers, few scenes; and the change of a constant."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from tests.benchmarks.tolerance_audit.constants import ROOT, TABLE, all_others, table
from tests.benchmarks.tolerance_audit.watched import Watched, felt

# What the audit does in a process of its own, for each change.
CHANGED = """
from tests.benchmarks.tolerance_audit.constants import Change, change_on_import, table
(number,) = [one for one in table() if one.name == {name!r}]
change_on_import(Change(number, 10.0))
from framework import tolerances
from framework.motion import path
print(tolerances.{name} / number.value, path.{name} / number.value)
"""

# A scene of a robot, with each number changed that it does not feel; how many these are.
UNFELT = """
from tests.benchmarks.tolerance_audit import runs
from tests.benchmarks.tolerance_audit.constants import Change, table
runs.preload()
scene = runs.Scene("C", "five_bar", "rigid", "C", "", (), {})
plain = runs.in_a_process(runs.planned, [scene]).outcomes["C"]
numbers = [one for one in table() if one.name != "TORQUE_TAIL"]
watching = runs.in_a_process(runs.watched, [scene], numbers)["C"]
assert watching.outcome.like(plain), (watching, plain)
count = 0
for one in numbers[::8]:
    for factor in (10.0, 0.1):
        if (one.full_name, factor) not in watching.felt:
            changed = runs.in_a_process(runs.planned, [scene], Change(one, factor)).outcomes["C"]
            assert changed.like(plain), (one, factor, changed, plain)
            count += 1
print(count)
"""


def run(*arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)


def test_a_constant_changes_where_it_is_assigned_and_where_it_is_imported():
    done = run("-c", CHANGED.format(name="DEGENERATE_PATH"))
    assert done.stderr == ""
    assert [float(ratio) for ratio in done.stdout.split()] == pytest.approx([10.0, 10.0])


def test_the_table_has_nothing_but_numbers_and_the_rest_has_many():
    import framework.tolerances

    numbers = {one.name: one.value for one in table()}
    values = {name: value for name, value in vars(framework.tolerances).items() if name.isupper()}
    assert numbers == {name: value for name, value in values.items() if isinstance(value, float)}
    others = all_others()
    assert len(others) > 100
    assert all(one.module != TABLE and one.value > 0 for one in others)


def test_a_comparison_that_comes_out_otherwise_is_felt():
    number = Watched.constant("a", 1e-3)
    felt.clear()
    assert not np.any(np.array([1.0, 2.0]) < 2.0 * number)
    assert max(number, 1e-5) > 0.0
    assert not felt
    assert list(np.array([1e-9, 5e-3, 1.0]) < number) == [True, False, False]
    assert felt == {("a", 10.0)}
    assert np.linalg.matrix_rank(np.eye(2), tol=number) == 2  # which cannot be followed
    assert felt == {("a", 10.0), ("a", 0.1)}


def test_what_a_run_does_not_feel_leaves_it_the_same_to_the_last_bit():
    done = run("-c", UNFELT)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 8


@pytest.mark.slow
def test_no_number_ten_times_as_large_or_small_makes_an_answer_wrong():
    names = [one.name for one in table()][2:22:7]
    options = ["--numbers", *names, "--others", "3", "--every", "9"]
    done = run("-m", "tests.benchmarks.tolerance_audit", *options)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 numbers of the table, 6 changes: 0 wrong answers" in done.stdout
