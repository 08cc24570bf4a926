"""What it takes to prove where a robot is singular, and where it is not. Prints, asserts nothing about time:
`make bench`.
"""

from __future__ import annotations

import time

import pytest

import robots
from framework import pave_singularities
from framework.atlas.nearest import nearest_singular_pose
from framework.proofs.real_displacements import find_real_solutions
from framework.proofs.study_quadric import spatial_displacements
from tests.proofs.test_real_displacements import BASE, LENGTHS, PLATFORM, conditions

pytestmark = pytest.mark.benchmark


@pytest.mark.parametrize("name", ["five_bar", "biglide"])
def test_all_singular_poses_in_boxes_of_a_millimetre(name, capsys):
    start = time.process_time()
    paved = pave_singularities(robots.load(name))
    spent = time.process_time() - start
    with capsys.disabled():
        print(f"\n  {name}: {paved.sentence}; {spent:.1f} s of the processor (goal 30 s for the 5R)")


@pytest.mark.parametrize(
    "name", ["five_bar", "three_rpr", "three_rrr", "orthoglide", "delta", "gough_stewart"]
)
def test_the_two_bounds_of_a_margin(name, capsys):
    robot = robots.load(name)
    start = time.process_time()
    found = nearest_singular_pose(robot, robot.reference)
    spent = time.process_time() - start
    with capsys.disabled():
        print(f"\n  {name}: {found.status}; {spent:.1f} s of the processor")


def test_the_forty_real_poses_of_dietmaiers_platform(capsys):
    rods = conditions(BASE, PLATFORM, LENGTHS)
    start = time.process_time()
    found = find_real_solutions(spatial_displacements(), rods)
    spent = time.process_time() - start
    with capsys.disabled():
        print(f"\n  {len(found.R)} poses, {found.status}; {spent:.2f} s of the processor")
