"""The bounds of a paving of displacements, and that it misses none."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from framework.proofs.branch_and_bound import Boxes
from framework.proofs.completeness import KnownSolutions, has_no_others, unique_radius
from framework.proofs.real_displacements import DualQuaternionChart, bound_translation, find_real_solutions
from framework.proofs.study_quadric import spatial_displacements
from framework.tolerances import LEG_COEFFICIENT_ROUNDING
from tests.proofs.rods import rod
from tests.proofs.test_real_displacements import COUNTS, conditions, lengths_at


def test_no_condition_bends_more_than_its_bound():
    rng = np.random.default_rng(2)
    rows, slack = spatial_displacements().eliminate_square(rng.standard_normal((6, 17)))
    for one in range(4):
        chart = DualQuaternionChart(spatial_displacements(), rows, LEG_COEFFICIENT_ROUNDING * slack, one)
        r = 10.0 ** rng.uniform(-6, 0.5, (200, 7))
        c, d = rng.uniform(-2, 2, r.shape), r * np.clip(rng.uniform(-1.5, 1.5, r.shape), -1, 1)
        lines, there = chart(c, r), chart(c + d, r).values
        rest = np.abs(there - lines.values - (lines.slopes @ d[:, :, None])[:, :, 0])
        assert np.all(rest <= lines.errors)


def test_no_pose_of_a_rod_is_farther_away_than_its_bound():
    rng = np.random.default_rng(3)
    for _ in range(50):
        a, b = rng.standard_normal((2, 3))
        length, way = rng.uniform(0.1, 3), rng.standard_normal(3)
        R = Rotation.from_rotvec(rng.standard_normal(3)).as_matrix()
        p = a - R @ b + length * way / np.linalg.norm(way)
        rows, slack = spatial_displacements().eliminate_square(np.array([rod(a, b, length)] * 6))
        assert np.linalg.norm(p) <= bound_translation(
            spatial_displacements(), rows, LEG_COEFFICIENT_ROUNDING * slack
        )


def test_a_pose_that_is_not_known_leaves_the_boxes_about_it_open():
    base, platform, _ = COUNTS["octahedron"]
    R, p = Rotation.from_rotvec([0.2, -0.1, 0.4]).as_matrix(), np.array([0.1, -0.2, 0.9])
    rows = conditions(base, platform, lengths_at(R, p, base, platform))
    found = find_real_solutions(spatial_displacements(), rows)
    rows, slack = spatial_displacements().eliminate_square(rows)
    chart = DualQuaternionChart(spatial_displacements(), rows, LEG_COEFFICIENT_ROUNDING * slack, 0)
    for z in found.z[np.abs(found.z[:, 0]) > 0.1]:
        point = (z / z[0])[1:]
        box = Boxes(point[None] + 0.003, np.full((1, 7), 0.01))
        known = KnownSolutions(point[None], np.array([unique_radius(chart, point)]), np.full(7, np.inf))
        none = KnownSolutions(np.zeros((0, 7)), np.zeros(0), known.period)
        assert has_no_others(chart, box, known)
        assert not has_no_others(chart, box, none)
