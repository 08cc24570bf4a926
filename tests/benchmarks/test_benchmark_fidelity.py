"""The audit of the fidelity ladder over the catalogue, some minutes: prints table and score, `make bench`."""

from __future__ import annotations

import pytest

from tests.benchmarks.fidelity_audit import TOLERANCES, main

pytestmark = pytest.mark.benchmark


def test_how_often_the_indicators_alone_choose_the_level(capsys):
    with capsys.disabled():
        print()
        score = main([])
    for tolerance in TOLERANCES:
        assert sum(count for (at, _), count in score.items() if at == tolerance) >= 200
