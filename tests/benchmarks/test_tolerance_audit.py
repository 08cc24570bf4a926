"""The audit of tolerances in small: a few numbers, few scenes; and the change of a constant."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.benchmarks.tolerance_audit.constants import ROOT, TABLE, all_others, table

# What the audit does in a process of its own, for each change.
CHANGED = """
from tests.benchmarks.tolerance_audit.constants import Change, change_on_import, table
(number,) = [one for one in table() if one.name == {name!r}]
change_on_import(Change(number, 10.0))
from framework import tolerances
from framework.motion import path
print(tolerances.{name} / number.value, path.{name} / number.value)
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


@pytest.mark.slow
def test_no_number_ten_times_as_large_or_small_makes_an_answer_wrong():
    names = [one.name for one in table()][2:22:7]
    options = ["--numbers", *names, "--others", "3", "--every", "9"]
    done = run("-m", "tests.benchmarks.tolerance_audit", *options)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 numbers of the table, 6 changes: 0 wrong answers" in done.stdout
