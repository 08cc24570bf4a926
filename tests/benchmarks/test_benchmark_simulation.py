"""Work against precision on the 5R, scene C: our integrators, pinocchio with RK4, MuJoCo and Exudyn.

Prints, for errors from 1e-4 to 1e-11 m, the least wall time at which each method gets there: `make bench`.
Times are minima of several runs in one process; read them as ratios. What a step costs is printed, too.
With CROSSING_FIGURES=DIR in the environment the curves are drawn into that folder.
"""

from __future__ import annotations

import os
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import robots
from framework.show.plots import save
from framework.simulation import Stepper
from tests.benchmarks.integration_methods import Method, methods
from tests.benchmarks.work_precision import plot_work_precision

pytestmark = pytest.mark.benchmark
REPEATS = 3
GOALS = 10.0 ** -np.arange(4, 12)  # [m]
# [s] the witnesses are of order 1, 2 or 4
WITNESS_STEPS = (2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5)


def witnesses(name: str, flexibility: str) -> dict[str, Method]:
    """Other simulators, as far as they are installed."""
    if not (find_spec("tests.benchmarks.witness_methods") and find_spec("mujoco")):
        return {}
    from tests.benchmarks.witness_methods import methods as found

    return {label: Method(run, WITNESS_STEPS) for label, run in found(name, flexibility).items()}


def curve(method: Method) -> list[tuple[float, float]]:
    """(seconds, error) at each setting, until a run takes more than half a second."""
    points = []
    for setting in method.settings:
        runs = [method.run(setting) for _ in range(REPEATS)]
        points.append((min(seconds for seconds, _ in runs), runs[0][1]))
        if points[-1][0] > 0.5:
            break
    return points


def least_times(points: list[tuple[float, float]]) -> np.ndarray:
    """Least time [s] with an error no larger than each goal; infinite where no setting gets there."""
    return np.array([min((s for s, error in points if error <= goal), default=np.inf) for goal in GOALS])


@pytest.mark.parametrize(
    ("name", "flexibility"),
    [("five_bar_heavy", "rigid"), ("five_bar", "rigid"), ("five_bar", "flexible_links")],
)
def test_work_against_precision(capsys, name, flexibility):
    ours, others = {}, {}
    every = methods(name, flexibility) | witnesses(name, flexibility)
    curves = {label: curve(method) for label, method in every.items()}
    for label, points in curves.items():
        (ours if label.startswith("ours") else others)[label] = least_times(points)
    if "CROSSING_FIGURES" in os.environ:
        stem = Path(os.environ["CROSSING_FIGURES"]) / f"work_precision_{name}_{flexibility}"
        save(lambda: plot_work_precision(curves), stem)
    best, rest = (np.min([*table.values(), np.full(len(GOALS), np.inf)], axis=0) for table in (ours, others))
    lines = [f"{'error [m]':34s}" + "".join(f"{goal:9.0e}" for goal in GOALS)]
    for label, times in (ours | others).items():
        lines.append(
            f"{label:34s}" + "".join(f"{1e3 * t:9.2f}" if t < np.inf else "        -" for t in times)
        )
    ratios = np.where(rest < np.inf, rest / best, np.inf)
    lines.append(f"{'best other over best of ours':34s}" + "".join(f"{ratio:9.2g}" for ratio in ratios))
    with capsys.disabled():
        print(f"\n  wall time [ms], {name}, {flexibility}, 1.5 s through the singularity")
        print("\n".join("  " + line for line in lines))
    assert np.all(np.isfinite(best))  # ours gets to every error


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_joints", "flexible_links"])
def test_cost_of_a_fixed_step(capsys, flexibility):
    robot = robots.load("five_bar", flexibility=flexibility)
    stepper = Stepper.of(robot)
    start = stepper.start(robot.q_near)
    spent = []
    for runs in (1, 10, 100, 1000):
        q, v = (np.repeat(part[None], runs, axis=0) for part in start)
        torque = np.zeros((runs, robot.n_a))
        times = []
        for _ in range(20):
            began = time.perf_counter()
            stepper.step(q, v, torque, 1e-3)
            times.append(time.perf_counter() - began)
        spent.append(f"{1e6 * min(times) / runs:.0f} us in a stack of {runs}")
    with capsys.disabled():
        print(f"\n  a step of one run, {stepper.scheme}, five_bar {flexibility}: {', '.join(spent)}")
    assert stepper.scheme == ("extrapolated" if flexibility == "flexible_links" else "midpoint")
