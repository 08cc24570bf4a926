"""The legs of a robot, by scipy's graphs, and the matching on which they rest."""

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

import robots
from framework.kinematics.modes import _match_rows, legs


@pytest.mark.parametrize(
    "name", ["five_bar", "delta", "humanoid_ankle", "n_four_bar", "orthoglide", "three_rrr"]
)
def test_legs_are_the_strong_components_of_the_equations(name):
    robot = robots.load(name)
    pattern = csr_array(robot.equations.pattern[:, robot.moving].astype(float))
    matched = pattern[maximum_bipartite_matching(pattern, perm_type="row")]
    count, label = connected_components(matched, directed=True, connection="strong")
    found = legs(robot)
    assert sorted(leg.columns.tolist() for leg in found) == sorted(
        np.flatnonzero(label == k).tolist() for k in range(count)
    )
    rows = np.concatenate([leg.rows for leg in found])
    assert sorted(rows) == list(range(pattern.shape[0]))
    for leg in found:  # its equations contain its joints, and only those solved earlier besides
        contained = np.flatnonzero(pattern.toarray()[leg.rows].any(axis=0))
        assert set(contained) <= set(leg.columns) | set(leg.needed)


def test_each_column_has_a_row_of_its_own():
    random = np.random.default_rng(0)
    for size in range(1, 12):
        order = random.permutation(size)
        pattern = random.random((size, size)) < 0.2
        pattern[order, np.arange(size)] = True
        rows = _match_rows(pattern)
        assert sorted(rows) == list(range(size))
        assert pattern[rows, np.arange(size)].all()


def test_a_pattern_of_singular_matrices_has_no_matching():
    pattern = np.ones((4, 4), dtype=bool)
    pattern[:2, 1:] = False  # two rows with one column
    assert _match_rows(pattern) is None
