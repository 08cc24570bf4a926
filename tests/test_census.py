"""The framework does not grow unawares."""

import pytest

from tests.census import COUNTS, PLANNING, TABLE, count, is_unclear, read_table, take_census

SAMPLE = '''"""A module."""
LIMIT = -2.5
NAME = "a"


def moved(a):
    """Return what it is."""
    return a
'''


def test_counts_of_a_sample():
    """By hand: Module; LIMIT = -2.5 is 6 nodes, NAME = "a" 4; def, its arguments and one, return, a are 6."""
    counts = count(SAMPLE)
    assert {name: counts[name] for name in COUNTS} == {
        "files": 1,
        "lines": 8,
        "nodes": 1 + 6 + 4 + 6,
        "many locals": 0,
        "numbers": 1,
        "unclear names": 1,
        "first lines": 1,
    }
    assert counts["code lines"] == 4


@pytest.mark.parametrize("name", ["at", "_between_the_arms", "moved", "_held", "kept_between"])
def test_a_preposition_or_a_bare_participle_is_no_name(name):
    assert is_unclear(name) == (name != "kept_between")
    assert not is_unclear(f"find_{name.strip('_')}")


def test_no_count_of_the_framework_grows():
    census, stored = take_census(), read_table(TABLE.read_text(encoding="utf-8"))
    grown = [
        f"{row}, {name}: {stored[row][name]} -> {census[row][name]}"
        for row in ("total", f"reached by {PLANNING}")
        for name in COUNTS
        if census[row][name] > stored[row][name]
    ]
    assert not grown, (
        f"{'; '.join(grown)}. Say less, or store the growth with `python -m tests.census --store` and its "
        f"reason in the message of the commit."
    )
