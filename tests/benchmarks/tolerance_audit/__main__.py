"""Hold each number of `framework.tolerances` ten times as large and as small against equations of motion.

60 scenes of rigid robots and 15 of elastic ones are planned with each number times 10 and divided by 10; the
plans are held against equations of motion written here. No change may turn a refusal, or a right answer, into
a wrong answer; what turns an answer into a refusal is listed. Then 100 float constants of the rest, drawn at
random, times 10 each: no verdict changes. A scene runs again only where it calls a function that looks the
number up. With --state an audit that was interrupted goes on, if no source has changed since.
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
from tests.benchmarks.tolerance_audit.constants import Change, Constant, all_others, readers, table
from tests.benchmarks.tolerance_audit.report import HEADER, Audited, audited, row, summary
from tests.benchmarks.tolerance_audit.runs import Calls, Outcome, Run, Scene
from tests.benchmarks.tolerance_audit.state import Kept

FACTORS = (10.0, 0.1)
OTHERS, SEED = 100, 19
NOTHING = Run({}, frozenset(), 0.0)


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
        audit = Audit(Path(folder), options.every, Kept(options.state))
        write(audit.introduction())
        changes = [Change(number, factor) for number in numbers for factor in FACTORS]
        of_table = _tabulated(audit.changed(changes), write)
        changes = [Change(number, 10.0) for number in drawn(options.others)]
        of_others = _tabulated(audit.changed(changes), write)
        write(summary(of_table, of_others))
        write(f"{audit.seconds / 60:.1f} minutes of processor time.")
    return int(any(one.wrong for one in of_table))


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
    """The scenes, what comes of them with nothing changed, and which functions each calls."""

    def __init__(self, folder: Path, every: int, kept: Kept) -> None:
        self.kept = kept
        runs.preload()
        rigid, elastic = runs.in_a_process(runs.all_scenes, folder)
        self.rigid, self.elastic = rigid[::every], elastic[::every]
        self.unchanged: dict[str, Outcome] = {}
        self.calls: dict[str, Calls] = {}
        self.seconds = 0.0
        for scene in tqdm(self.scenes, desc="unchanged", unit="scene", leave=False):
            run = runs.in_a_process(runs.planned, [scene], None, True)
            self.unchanged |= run.outcomes
            self.calls[scene.name] = run.calls
            self.seconds += run.seconds

    @property
    def scenes(self) -> list[Scene]:
        return [*self.rigid, *self.elastic]

    def changed(self, changes: Sequence[Change]) -> Iterator[Audited]:
        """Yield what comes of the scenes with each change alone."""
        for change in tqdm(changes, desc="changed", unit="change", leave=False):
            modules = readers(change.constant)
            scenes = [one for one in self.scenes if self._reads(one.name, change.constant, modules)]
            run = self.kept.run(change, scenes) if scenes else NOTHING
            self.seconds += run.seconds
            yield audited(change, self.unchanged, run.outcomes)

    def _reads(self, scene: str, constant: Constant, modules: frozenset[str] | None) -> bool:
        """Whether a function that the scene calls may look the constant up."""
        if modules is None:
            return True
        return any(module in modules and constant.name in names for module, names in self.calls[scene])

    def introduction(self) -> str:
        """Return what was planned, and what came of it unchanged."""
        answers = [outcome.defect for outcome in self.unchanged.values() if not outcome.refusal]
        return (
            f"{len(self.rigid)} rigid and {len(self.elastic)} elastic scenes: {len(answers)} answers, of "
            f"which the worst leaves {max(answers):.1e} of the equations of motion, and "
            f"{len(self.unchanged) - len(answers)} refusals."
        )


if __name__ == "__main__":
    sys.exit(main())
