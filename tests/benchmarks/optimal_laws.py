"""Sixty random robots, twelve requests of optimal laws each: contradictions, gaps, turns and processor time.

    python -m tests.benchmarks.optimal_laws [--robots 0 7 12 | --seeds 0 60] [--longest 1 20 1000]

Robots, paths and durations D are those of `tests.planning.optimal.random_crossings`. Asked for are the least
peak and energy at D and within 1, 20 and 1000 D, and the least time at 1.25 times the least peak within D,
with the same bounds, and at 1.002 times without. Gaps are those to the estimates of `best_law_bounds` beside
them, on other unknowns and with torques of their own; contradictions those of `law_contradictions`. A line
has a law's value, duration and turns of s', or a refusal's reason, and processor seconds.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tests.planning.optimal.best_law_bounds import BestLaws, least_energy_lasting
from tests.planning.optimal.law_contradictions import Answer, Asked, answer, contradictions
from tests.planning.optimal.random_crossings import COUNT, RandomCrossing, random_crossing

LONGEST = (1, 20, 1000)  # durations
AMPLE, NARROW = 1.25, 1.002  # limits over the least peak
MAX_TURNS = 7


class Line(NamedTuple):
    """An answer with the gap of its value to the estimate, and to which group of figures it belongs."""

    robot: RandomCrossing
    group: str
    answer: Answer
    gap: float = np.nan  # share


def lines_of(one: RandomCrossing, *, ratios: Sequence[float] = LONGEST, bounds: bool = True) -> list[Line]:
    """Plan all requests of a robot."""
    duration = one.duration

    def plan(group: str, asked: Asked) -> Line:
        return Line(one, group, answer(*one.plan_arguments(), asked))

    lines = [
        plan("peak at D", Asked("peak_torque", duration=duration)),
        plan("energy at D", Asked("energy", duration=duration)),
    ]
    for ratio in ratios:
        longest = ratio * duration
        lines.append(plan(f"peak within {ratio:g} D", Asked("peak_torque", longest=longest)))
        lines.append(plan(f"energy within {ratio:g} D", Asked("energy", longest=longest)))
    least = next(line.answer.peak for line in lines if line.group == "peak within 1 D")
    if least > 0.0:
        for ratio in ratios:
            asked = Asked("time", longest=ratio * duration, torque_limit=AMPLE * least)
            lines.append(plan(f"time at {AMPLE} within {ratio:g} D", asked))
        lines.append(plan(f"time at {NARROW}", Asked("time", torque_limit=NARROW * least)))
    if not bounds:
        return lines
    estimates = estimates_of(BestLaws(one.robot, one.path), duration, least)
    return [line._replace(gap=line.answer.value / estimates.get(line.group, np.nan) - 1.0) for line in lines]


def estimates_of(laws: BestLaws, duration: float, least: float) -> dict[str, float]:
    """Return the least that any law may need, by group."""
    return {
        "peak within 1 D": laws.least_peak(duration),
        f"time at {AMPLE} within 1 D": laws.least_time(AMPLE * least) if least > 0.0 else np.nan,
        f"time at {NARROW}": laws.least_time(NARROW * least) if least > 0.0 else np.nan,
        "energy within 1 D": laws.least_energy(duration),
        "energy at D": least_energy_lasting(laws, duration),
    }


def text_of(line: Line) -> str:
    """Return a line of the table."""
    one = line.answer
    if one.plan is None:
        problem = one.refusal or one.failure
        return f"  {line.group:26s} {one.seconds:5.2f} s  {type(problem).__name__}: {problem}"
    gap = "" if np.isnan(line.gap) else f", gap {100 * line.gap:.2f} %"
    law = f"{one.value:.6g} over {one.duration:.5g} s, turns {one.turns}{gap}"
    return f"  {line.group:26s} {one.seconds:5.2f} s  {law}"


def shares(values: Sequence[float], *percent: float) -> str:
    """Return the median, percentiles and maximum as a text."""
    known = np.array(values)[np.isfinite(values)]
    if not len(known):
        return "none"
    parts = [f"median {np.median(known):.3g}"]
    parts += [f"{p:g} % within {np.percentile(known, p):.3g}" for p in percent]
    return ", ".join([*parts, f"max {known.max():.3g} ({len(known)})"])


def summary(lines: Sequence[Line], contradicted: Sequence[str]) -> list[str]:
    """Return the lines of the acceptance."""
    laws = [line for line in lines if line.answer.plan is not None]
    text = [f"{len(laws)} laws of {len(lines)} requests, {len(contradicted)} contradictions"]
    for group in dict.fromkeys(line.group for line in laws if np.isfinite(line.gap)):
        for crossings in (1, 2, 3):
            gaps = [100 * x.gap for x in laws if x.group == group and x.robot.crossings == crossings]
            text.append(f"gap [%], {group}, {crossings} crossings: {shares(gaps, 75, 90)}")
    few = np.mean([line.answer.turns <= MAX_TURNS for line in laws])
    text.append(f"turns: {100 * few:.0f} % at most {MAX_TURNS}, {shares([x.answer.turns for x in laws], 90)}")
    text += [
        f"  {line.answer.turns} turns: {line.robot.name}, {line.group}"
        for line in laws
        if line.answer.turns > MAX_TURNS
    ]
    at_duration = [x.answer.seconds for x in lines if x.group == "energy at D"]
    others = [x.answer.seconds for x in lines if x.group != "energy at D"]
    text.append(f"processor time [s], energy at D: {shares(at_duration, 90)}; others: {shares(others, 90)}")
    return text


def main() -> None:
    """Plan, judge and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--robots", type=int, nargs="*")
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, COUNT), metavar=("FIRST", "END"))
    parser.add_argument("--longest", type=float, nargs="+", default=LONGEST, help="durations, 1 the first")
    parser.add_argument("--no-bounds", action="store_true")
    arguments = parser.parse_args()
    lines: list[Line] = []
    contradicted: list[str] = []
    for k in range(*arguments.seeds) if arguments.robots is None else arguments.robots:
        one = random_crossing(k)
        print(f"{one.name}, D = {one.duration} s", flush=True)
        own = lines_of(one, ratios=arguments.longest, bounds=not arguments.no_bounds)
        for line in own:
            print(text_of(line), flush=True)
        found = contradictions(line.answer for line in own)
        for text in found:
            print(f"  CONTRADICTION {text}", flush=True)
        lines += own
        contradicted += found
    print("\n".join(summary(lines, contradicted)))


if __name__ == "__main__":
    main()
