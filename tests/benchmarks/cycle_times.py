"""How long a control cycle takes: pose, rates and torques of a robot that swings, each millisecond.

    python -m tests.benchmarks.cycle_times [ROBOT ...] [--cycles 100000] [--figure FILE]

Times are those of the thread on the processor: what else the machine does is left out, but for the caches.
The figure has a histogram for each robot.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import robots
from framework.control import ControlCycle

ROBOTS = ("five_bar", "delta", "gough_stewart")
SWING = 4e-3  # [rad, robot lengths] of the motors: the delta's reference is 0.01 from a singularity
PERIOD = 1e-3  # [s]
QUANTILES = (0.5, 0.99, 0.999, 1.0)


def cycle_times(name: str, cycles: int) -> tuple[np.ndarray, float]:
    """Times (cycles,) [ms] of the processor for `update` and `torque`, and the largest residual [m, rad]."""
    robot = robots.load(name)
    cycle, columns = ControlCycle(robot), robot.actuated
    start = robot.actuated_coordinates(robot.reference.q[None])[0]
    w = 2 * np.pi * (1.0 + 0.3 * np.arange(robot.n_a))
    size = SWING * robot.column_scale[columns]
    times, largest = np.empty(cycles), 0.0
    for k in range(cycles):
        phase = w * PERIOD * k
        q_a, dq_a = start + size * np.sin(phase), size * w * np.cos(phase)
        ddq_a = -size * w**2 * np.sin(phase)
        begun = time.thread_time_ns()
        cycle.update(q_a, dq_a)
        cycle.torque(ddq_a)
        times[k] = 1e-6 * (time.thread_time_ns() - begun)
        largest = max(largest, cycle.residual)
    return times, largest


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("robots", nargs="*", default=ROBOTS, metavar="ROBOT")
    parser.add_argument("--cycles", type=int, default=100_000)
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args(argv)
    print(f"{'ms':20}" + "".join(f"{100 * share:>8g}%" for share in QUANTILES) + "   residual")
    results = {}
    for name in options.robots:
        results[name], residual = cycle_times(name, options.cycles)
        values = "".join(f"{value:9.3f}" for value in np.quantile(results[name], QUANTILES))
        print(f"{name:20}{values}   {residual:.1e}", flush=True)
    if options.figure:
        draw(results, options.figure)


def draw(results: dict[str, np.ndarray], file: Path) -> None:
    """Draw a histogram for each robot, logarithmic in time and in the number of cycles."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    edges = np.geomspace(0.05, 5.0, 120)
    for name, times in results.items():
        axes.hist(np.clip(times, edges[0], edges[-1]), edges, histtype="step", label=name)
    axes.set(xscale="log", yscale="log", xlabel="processor time of a cycle [ms]", ylabel="cycles")
    axes.legend()
    figure.savefig(file)


if __name__ == "__main__":
    main()
