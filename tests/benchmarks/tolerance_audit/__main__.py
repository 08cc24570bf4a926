"""Hold each number of `framework.tolerances` ten times as large and as small against equations of motion.

60 scenes of rigid robots and 15 of elastic ones are planned with each number times 10 and divided by 10; the
plans are held against equations of motion written here. No change may turn a refusal, or a right answer, into
a wrong answer; what turns an answer into a refusal is listed. Then 100 float constants of the rest, drawn at
random, times 10 each: no verdict changes. A scene runs again only where some comparison with the number would
come out otherwise, or where it goes to what cannot be followed (`watched`). With --state an audit that was
interrupted goes on, if no source has changed since.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tqdm import tqdm

from tests.benchmarks.tolerance_audit import runs
from tests.benchmarks.tolerance_audit.constants import Change, Constant, all_others, table
from tests.benchmarks.tolerance_audit.report import HEADER, Audited, audited, row, summary
from tests.benchmarks.tolerance_audit.runs import Outcome, Run, Scene
from tests.benchmarks.tolerance_audit.state import Kept
from tests.benchmarks.tolerance_audit.watched import FACTORS

OTHERS, SEED = 100, 19
NOTHING = Run({}, 0.0)
PASSED_ON = ("TORQUE_TAIL",)  # as an argument that has to be a float, so that it is not watched


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; return 1 if a number of the table makes an answer wrong, else 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--numbers", nargs="+", metavar="NAME", help="of the table, some only")
    parser.add_argument("--others", type=int, default=OTHERS, metavar="N", help="default: %(default)s")
    parser.add_argument("--every", type=int, default=1, metavar="K", help="every K-th scene only")
    parser.add_argument("--out", type=Path, metavar="FILE", help="where to write the tables, in Markdown")
    parser.add_argument("--state", type=Path, metavar="FILE", help="where to keep what is done")
    options = parser.parse_args(arguments)
    numbers = [one for one in table() if options.numbers is None or one.name in options.numbers]
    with TemporaryDirectory() as folder, _output(options.out) as write:
        of_table = [Change(number, factor) for number in numbers for factor in FACTORS]
        of_others = [Change(number, 10.0) for number in drawn(options.others)]
        audit = Audit(Path(folder), options.every, of_table + of_others, Kept(options.state))
        write(audit.introduction())
        for_table = _tabulated(audit.changed(of_table), write)
        for_others = _tabulated(audit.changed(of_others), write)
        write(summary(for_table, for_others))
        write(f"{audit.seconds / 60:.1f} minutes of processor time.")
    return int(any(one.wrong for one in for_table))


@contextmanager
def _output(file: Path | None) -> Iterator[Callable[[str], None]]:
    """Write lines at once, to a file if there is one, else to the standard output."""
    with open(file, "w", encoding="utf-8") if file else nullcontext(sys.stdout) as stream:
        yield lambda text: print(text, file=stream, flush=True)


def _tabulated(found: Iterable[Audited], write: Callable[[str], None]) -> list[Audited]:
    """Write a table of what changes, line by line as the audit goes on; return all that was found."""
    done = []
    write(f"\n{HEADER}")
    for one in found:
        done.append(one)
        if one.changed or one.renamed:
            write(row(one))
    return done


def drawn(count: int) -> list[Constant]:
    """Return constants that are not in the table, drawn at random."""
    others = all_others()
    chosen = np.random.default_rng(SEED).permutation(len(others))[:count]
    return [others[k] for k in sorted(chosen)]


class Audit:
    """The scenes, what comes of them with nothing changed, and which changes each may feel."""

    def __init__(self, folder: Path, every: int, changes: Sequence[Change], kept: Kept) -> None:
        runs.preload()
        rigid, elastic = runs.in_a_process(runs.all_scenes, folder)
        self.rigid, self.elastic = rigid[::every], elastic[::every]
        self.kept = kept
        plain = runs.in_a_process(runs.planned, self.scenes)
        self.unchanged: dict[str, Outcome] = plain.outcomes
        constants = list(dict.fromkeys(one.constant for one in changes if one.constant.name not in PASSED_ON))
        watched = runs.in_a_process(runs.watched, self.scenes, constants)
        self.felt = {name: one.felt for name, one in watched.items()}
        self.unlike = {name for name, one in watched.items() if not one.outcome.like(plain.outcomes[name])}
        self.seconds = plain.seconds + sum(one.outcome.seconds for one in watched.values())

    @property
    def scenes(self) -> list[Scene]:
        return [*self.rigid, *self.elastic]

    def changed(self, changes: Sequence[Change]) -> Iterator[Audited]:
        """Yield what comes of the scenes with each change alone."""
        for change in tqdm(changes, desc="changed", unit="change", leave=False):
            scenes = [one for one in self.scenes if self._may_feel(one.name, change)]
            run = self.kept.run(change, scenes) if scenes else NOTHING
            self.seconds += run.seconds
            yield audited(change, self.unchanged, run.outcomes)

    def _may_feel(self, scene: str, change: Change) -> bool:
        """Whether a comparison comes out otherwise, or the constant was not followed."""
        key = change.constant.full_name, change.factor
        return change.constant.name in PASSED_ON or scene in self.unlike or key in self.felt[scene]

    def introduction(self) -> str:
        """Return what was planned, and what came of it unchanged."""
        answers = [outcome.defect for outcome in self.unchanged.values() if not outcome.refusal]
        return (
            f"{len(self.rigid)} rigid and {len(self.elastic)} elastic scenes: {len(answers)} answers, of "
            f"which the worst leaves {max(answers):.1e} of the equations of motion, and "
            f"{len(self.unchanged) - len(answers)} refusals. {len(self.unlike)} could not be watched."
        )


if __name__ == "__main__":
    sys.exit(main())
