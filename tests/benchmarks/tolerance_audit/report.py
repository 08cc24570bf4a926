"""What a change of a constant does to the verdicts, as tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from tests.benchmarks.tolerance_audit.constants import TABLE, Change
from tests.benchmarks.tolerance_audit.runs import Outcome

RIGHT = 1e-6
"""The largest defect of an answer that is right; those of the scenes unchanged leave 4e-12."""


class Audited(NamedTuple):
    """A change, and the scenes by what it makes of them; each text says which scene and what of it."""

    change: Change
    count: int  # of scenes that ran again, as they may feel the change
    worst: float  # the largest defect of their answers
    wrong: tuple[str, ...]  # answers that leave more than RIGHT of the equations of motion
    lost: tuple[str, ...]  # answers that became refusals
    gained: tuple[str, ...]  # refusals that became right answers
    renamed: tuple[str, ...]  # refusals for another reason

    @property
    def changed(self) -> tuple[str, ...]:
        """Scenes with another verdict."""
        return self.wrong + self.lost + self.gained


def audited(change: Change, unchanged: Mapping[str, Outcome], outcomes: Mapping[str, Outcome]) -> Audited:
    """Compare the outcomes under a change with those without it."""
    wrong, lost, gained, renamed = [], [], [], []
    for name, new in outcomes.items():
        old = unchanged[name]
        if not new.refusal and new.defect > RIGHT:
            wrong.append(f"{name}: leaves {new.defect:.1e} (before: {old.verdict})")
        elif new.refusal and not old.refusal:
            lost.append(f"{name}: {new.refusal}")
        elif old.refusal and not new.refusal:
            gained.append(f"{name}: leaves {new.defect:.1e} (before: {old.refusal})")
        elif old.refusal != new.refusal:
            renamed.append(f"{name}: {new.refusal} (before: {old.refusal})")
    answers = [outcome.defect for outcome in outcomes.values() if not outcome.refusal]
    worst = max(answers, default=0.0)
    return Audited(change, len(outcomes), worst, *map(tuple, (wrong, lost, gained, renamed)))


HEAD = (
    "number",
    "value",
    "times",
    "scenes",
    "wrong",
    "worst defect",
    "answers lost",
    "refusals lost",
    "reasons",
)
HEADER = f"| {' | '.join(HEAD)} |\n|---|{'--:|' * 5}---|---|---|"


def row(one: Audited) -> str:
    """Return the line of a change in a table of Markdown."""
    constant = one.change.constant
    name = constant.name if constant.module == TABLE else f"{constant.module}.{constant.name}"
    cells = [name, f"{constant.value:g}", f"{one.change.factor:g}", str(one.count)]
    cells += ["; ".join(one.wrong) or "0", f"{one.worst:.1e}"]
    cells += ["; ".join(part).replace("|", "/") for part in (one.lost, one.gained, one.renamed)]
    return f"| {' | '.join(cells)} |"


def summary(of_table: Sequence[Audited], of_others: Sequence[Audited]) -> str:
    """Return the verdict of the audit in a few lines."""
    wrong = sum(len(one.wrong) for one in of_table)
    unread = _names(of_table) - _names(one for one in of_table if one.count)
    touching = _names(one for one in of_table if one.changed or one.renamed)
    still = _names(one for one in of_table if one.count) - touching
    numbers = len(_names(of_table))
    changed = [one for one in of_others if one.changed]
    read = sum(bool(one.count) for one in of_others)
    lines = [
        f"\n{numbers} numbers of the table, {len(of_table)} changes: {wrong} wrong answers, "
        f"{sum(len(one.lost) for one in of_table)} answers lost, "
        f"{sum(len(one.gained) for one in of_table)} refusals that became right answers.",
        f"{len(of_others)} other constants times 10, {read} of them felt: {len(changed)} change a verdict, "
        f"{sum(len(one.wrong) for one in of_others)} to a wrong answer.",
    ]
    if still:
        lines.append(f"Nothing changes with {', '.join(sorted(still))}.")
    if unread:
        lines.append(f"Felt by no comparison in these scenes: {', '.join(sorted(unread))}.")
    return "\n\n".join(lines)


def _names(audits: Iterable[Audited]) -> set[str]:
    return {one.change.constant.name for one in audits}
