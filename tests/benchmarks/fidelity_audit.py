"""How often the indicators of fidelity choose the level that the simulation would.

`python -m tests.benchmarks.fidelity_audit [ROBOT ...]` studies every scene of the catalogue that can be
planned, in several durations, and prints for each the level that is enough for 1 %, 0.1 %, 0.01 %, and the
one that the indicators choose; then the score. `--factors F ...` are the durations, over that of the scene.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import robots
from framework import NoAnswer, fidelity_study
from framework.fidelity.fidelity_study import FidelityStudy
from framework.model.fidelity_levels import LEVELS_BY_NAME

FACTORS = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
FEW = (0.7, 1.0, 1.4)  # of robots whose simulation takes ten times as long as that of a five-bar
LARGE = ("delta", "gough_stewart", "orthoglide", "par4", "standing_quadruped", "two_arms")
TOLERANCES = (1e-2, 1e-3, 1e-4)
LEVEL = {name: level for level, name in enumerate(LEVELS_BY_NAME)}


class Choice(NamedTuple):
    """What a study found enough for one tolerance and what the indicators choose; None: no level."""

    tolerance: float
    found: str | None
    indicated: str

    @property
    def verdict(self) -> str:
        if self.found is None:
            return "nothing enough"
        above = LEVEL[self.indicated] - LEVEL[self.found]
        return "right" if above == 0 else "too low" if above < 0 else "too high"


def choices(study: FidelityStudy) -> list[Choice]:
    """One for each tolerance: the errors of a study do not depend on it."""
    found = []
    for tolerance in TOLERANCES:
        compared = replace(study, tolerance=tolerance)
        enough = None if compared.enough is None else compared.enough.level.name
        found.append(Choice(tolerance, enough, compared.indicated.level.name))
    return found


def studies(
    names: Sequence[str], factors: Sequence[float]
) -> Iterator[tuple[str, str, float, FidelityStudy | None]]:
    """(robot, scene, duration, study) of all scenes; no study where the highest level has no plan."""
    for name in names:
        robot = robots.load(name)
        for scene in robot.description.scenes.values():
            if scene.times == () or scene.at is not None:  # asks for a plan that cannot be
                continue
            for factor in factors or (FEW if name in LARGE else FACTORS):
                options = (
                    {}
                    if factor == 1.0
                    else {"duration": factor * scene.duration, "times": None, "speeds": None}
                )
                try:
                    study = fidelity_study(robot, scene.name, tolerance=TOLERANCES[-1], **options)
                except NoAnswer:
                    study = None
                yield name, scene.name, factor * scene.duration, study


def main(arguments: Sequence[str] | None = None) -> Counter[tuple[float, str]]:
    """Print the table and the score, and return it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=list(robots.CATALOGUE))
    parser.add_argument("--factors", nargs="+", type=float, default=())
    options = parser.parse_args(arguments)
    score: Counter[tuple[float, str]] = Counter()
    scenes = 0
    for name, scene, duration, study in studies(options.robots, options.factors):
        place = f"{name:20s} {scene:12s} {duration:6.3g} s "
        if study is None:
            print(f"{place} no plan of the highest level", flush=True)
            continue
        scenes += 1
        told = []
        for choice in choices(study):
            score[choice.tolerance, choice.verdict] += 1
            wrong = "" if choice.verdict == "right" else f" ({choice.verdict}: {choice.indicated})"
            told.append(f"{100 * choice.tolerance:g} %: {choice.found}{wrong}")
        print(f"{place} {'; '.join(told)}; {study.seconds:.1f} s", flush=True)
    print(f"\n{scenes} scenes; the indicators alone choose")
    for tolerance in TOLERANCES:
        counts = {verdict: count for (at, verdict), count in score.items() if at == tolerance}
        listed = ", ".join(
            f"{verdict} {count}" for verdict, count in sorted(counts.items(), key=lambda item: -item[1])
        )
        print(f"  for {100 * tolerance:5g} %: {listed}")
    return score


if __name__ == "__main__":
    main()
