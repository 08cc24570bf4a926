"""Radau IIA tables against their defining properties and the two-stage table in print."""

import numpy as np
import pytest

from framework.simulation.collocation import radau_table


def test_two_stages_are_those_of_the_literature():
    table = radau_table(2)  # Hairer and Wanner 1996, table IV.5.5
    np.testing.assert_allclose(table.nodes, [1 / 3, 1], atol=1e-15)
    np.testing.assert_allclose(table.integration, [[5 / 12, -1 / 12], [3 / 4, 1 / 4]], atol=1e-15)


@pytest.mark.parametrize("stages", [1, 3, 5, 16, 30])
def test_a_step_of_s_stages_integrates_polynomials_of_degree_2s_minus_2(stages):
    table = radau_table(stages)
    assert table.nodes[-1] == 1.0
    for power in range(2 * stages - 1):
        assert table.integration[-1] @ table.nodes**power == pytest.approx(1 / (power + 1), abs=1e-14)


@pytest.mark.parametrize("stages", [1, 3, 5, 16, 30])
def test_unresolved_vibrations_decay(stages):
    """The stability function 1 + z b' (1 - z A)^-1 1 vanishes at infinity (L-stability)."""
    table, z = radau_table(stages), -1e9
    solved = np.linalg.solve(np.eye(stages) - z * table.integration, np.ones(stages))
    assert abs(1 + z * table.integration[-1] @ solved) < 1e-6


@pytest.mark.parametrize("stages", [3, 16])
def test_series_reproduce_polynomials_and_their_integrals(stages):
    table, at = radau_table(stages), np.linspace(0, 1, 11)
    monomials = table.nodes[:, None] ** np.arange(stages)
    found = table.basis(at, stages - 1) @ table.to_series @ monomials
    np.testing.assert_allclose(found, at[:, None] ** np.arange(stages), atol=1e-13)
    with_start = np.append(0.0, table.nodes)[:, None] ** np.arange(stages + 1)
    found = table.basis(at) @ table.to_series_with_start @ with_start
    np.testing.assert_allclose(found, at[:, None] ** np.arange(stages + 1), atol=1e-13)
    powers = np.arange(1, stages + 1)
    integral = table.basis(at) @ table.to_integral_series @ monomials
    np.testing.assert_allclose(integral, at[:, None] ** powers / powers, atol=1e-13)
