"""How often intervals of 95 % of `identify` hold the true parameters: `python -m tests.benchmarks.intervals`.

Recordings of robots whose masses, rotors and friction differ from their files', by closed inverse dynamics:
one stroke, strokes to and fro on a line, and sums of sines. Encoders have 16 bits and half a step of noise,
torques 1 % of noise, steps of 0.2 % and a scale that is off by 0.5 %. A parameter counts as `identify` says,
if its deviation is below its true value or a twentieth of its typical size. Kinds are friction and damping,
sums with a rotor, and other sums of bodies.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np

import robots
from framework import ParallelRobot
from framework.identification import (
    Recording,
    base_parameters,
    collect_link_parameters,
    torque_parameters,
    with_masses_and_motors,
)
from framework.identification.least_squares import estimate
from framework.identification.measured_motion import measured_motion
from framework.identification.torque_rows import torque_rows
from framework.identification.unknowns import choose_unknowns, is_narrowed, rests_on_data
from tests.identification.recorded_motions import exact_motors, motor_columns, platform_sines

ROBOTS = ("five_bar_heavy", "slider_crank", "three_rrr", "four_bar", "delta", "orthoglide")
MOTIONS = {"stroke": (1.0, 250.0), "to and fro": (4.0, 125.0), "sines": (4.0, 125.0)}  # [s], [Hz]
KINDS = ("friction", "rotor", "body")
STEP = 2.0 * np.pi / 2**16  # [rad] of encoders; of slides without a gear 1e-6 m
HARMONICS = (1, 2, 3, 5, 7, 9, 11)


class Coverage(NamedTuple):
    """Deviations of estimates from the truth over their standard deviations, of R runs and r parameters."""

    ratios: np.ndarray  # (R, r)
    determined: np.ndarray  # (R, r)
    kinds: np.ndarray  # (r,) of KINDS

    def share(self, kind: str = "") -> float:
        """Share of the intervals of 95 % of determined parameters that contain the truth."""
        counted = self.determined & ((self.kinds == kind) | (not kind))
        return float(np.mean(np.abs(self.ratios[counted]) < 1.96)) if counted.any() else np.nan


def platform_motion(robot: ParallelRobot, motion: str, size: float):
    """Times (T,) and x, dx, ddx (T, n) of the platform, `size` in lengths of the robot."""
    duration, rate = MOTIONS[motion]
    if motion == "sines":
        return platform_sines(robot, duration=duration, rate=rate, size=size, seed=0, harmonics=HARMONICS)
    random = np.random.default_rng(0)
    t = np.arange(int(duration * rate) + 1) / rate
    line = random.standard_normal(robot.n)
    line *= 2.0 * size * robot.platform_scale / np.linalg.norm(line)
    period = duration / (1 if motion == "stroke" else 6)
    stroke = np.minimum((t / period).astype(int), round(duration / period) - 1)
    u = t / period - stroke
    back = stroke % 2 == 1
    s = 6 * u**5 - 15 * u**4 + 10 * u**3
    ds, dds = (30 * u**4 - 60 * u**3 + 30 * u**2) / period, (120 * u**3 - 180 * u**2 + 60 * u) / period**2
    sign = np.where(back, -1.0, 1.0)
    x = robot.reference.x + np.outer(np.where(back, 1.0 - s, s) - 0.5, line)
    return t, x, np.outer(sign * ds, line), np.outer(sign * dds, line)


def exact_motion(robot: ParallelRobot, motion: str, *, size: float = 0.05):
    """Times, angles and torques of the motors, dry friction included."""
    t, *platform = platform_motion(robot, motion, size)
    return t, *exact_motors(robot, *platform)


def record(robot: ParallelRobot, exact, seed: int) -> Recording:
    """The motion as sensors show it."""
    random = np.random.default_rng(seed)
    t, angles, torques = exact
    step = np.where(np.array(robot.torque_units) == "N", 1e-6, STEP)
    zero = random.uniform(0.0, 1.0, angles.shape[1]) * step
    noisy = angles + zero + 0.5 * step * random.standard_normal(angles.shape)
    angles = np.round(noisy / step) * step - zero
    largest = np.abs(torques).max(axis=0)
    torques = torques * (1.0 + 0.005 * random.standard_normal(torques.shape[1]))
    torques = torques + 0.01 * largest * random.standard_normal(torques.shape)
    torques = np.round(torques / (0.002 * largest)) * (0.002 * largest)
    return Recording("simulated", motor_columns(robot), np.column_stack([t, angles, torques]))


def true_robot(nominal: ParallelRobot) -> tuple[ParallelRobot, np.ndarray]:
    """A robot with other masses, rotors and friction, and its parameters (p,)."""
    described = torque_parameters(nominal)
    links = collect_link_parameters(nominal, described)
    values = links.values.copy()
    bodies = values[: links.motor_slice.start].reshape(-1, 10)
    motors = values[links.motor_slice].reshape(-1, 3)
    bodies *= np.random.default_rng(5).uniform(0.8, 1.2, (len(bodies), 1))
    motors[:, 0] *= 1.1
    motors[:, 1:] = [0.02, 0.05] * described.sizes[-3 * nominal.n_a :].reshape(-1, 3)[:, 1:]
    theta = described.values + links.to_parameters @ (values - links.values)
    return ParallelRobot.from_description(with_masses_and_motors(nominal, links, values)), theta


def measure_coverage(name: str, motion: str, runs: int) -> Coverage:
    """Estimate the base parameters from `runs` recordings, each with its own noise."""
    nominal = robots.load(name)
    true, theta = true_robot(nominal)
    base = base_parameters(nominal)
    truth = base.combinations.coefficients @ theta
    sizes = base.described.sizes[base.combinations.leading]
    unknowns = choose_unknowns(base, collect_link_parameters(nominal, base.described))
    by_prior = np.linalg.norm(unknowns.design, axis=1)
    with_rotor = [
        bool(base.combinations.coefficients[k, -3 * nominal.n_a :: 3].any()) for k in range(base.rank)
    ]
    of_friction = base.combinations.leading >= len(theta) - 3 * nominal.n_a
    kinds = np.where(with_rotor, "rotor", np.where(of_friction, "friction", "body"))
    exact = exact_motion(true, motion)
    ratios, determined = [], []
    for seed in range(runs):
        measured = measured_motion(nominal, record(true, exact, seed))
        found = estimate(torque_rows(nominal, measured, base), unknowns.design, base.values)
        spread = unknowns.design @ found.spread
        deviations = np.linalg.norm(spread, axis=1)
        by_file = np.linalg.norm(spread @ found.spread.T, axis=1)
        ratios.append((base.values + unknowns.design @ found.values - truth) / deviations)
        small = deviations < np.maximum(np.abs(truth), 0.05 * sizes)
        determined.append(is_narrowed(deviations, by_prior) & rests_on_data(deviations, by_file) & small)
    return Coverage(np.array(ratios), np.array(determined), kinds)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--robots", nargs="+", default=ROBOTS)
    options = parser.parse_args()
    print("robot            motion     determined   intervals of 95 % that hold", *KINDS)
    for name in options.robots:
        for motion in MOTIONS:
            found = measure_coverage(name, motion, options.runs)
            shares = [f"{100 * found.share(kind):6.1f} %" for kind in ("", *KINDS)]
            print(f"{name:16} {motion:10} {100 * found.determined.mean():8.0f} %", *shares, flush=True)


if __name__ == "__main__":
    main()
