"""Measure the methods of the chart, and write its figures and tables: `python -m tests.benchmarks.chart`.

Every method in one run, against references that share no code with it: for each stage a figure (.png, .pdf)
and a table (.csv, .md, .json). Peers that are not installed are left out and named.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from framework import FrameworkError
from framework.cli.console import Progress
from framework.numerics.output import written_together
from tests.benchmarks.chart import stages, table
from tests.benchmarks.chart.figures import save_chart
from tests.benchmarks.chart.measure import FULL, QUICK, Effort, Stage, rows_of
from tests.benchmarks.chart.reading import losses

FOLDER = "chart"


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the chart, or one row of it again."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.chart", description=__doc__)
    parser.add_argument("--stage", nargs="+", metavar="S", help="some stages only (default: all)")
    parser.add_argument(
        "--row", metavar="ROW", help="one row made again, as the table names it; writes nothing"
    )
    parser.add_argument("--quick", action="store_true", help="one setting of a series, run once")
    parser.add_argument(
        "--redraw", action="store_true", help="figures and text anew, from the tables of --out"
    )
    parser.add_argument("--out", type=Path, default=Path(FOLDER), metavar="DIR", help="default: %(default)s")
    options = parser.parse_args(arguments)
    try:
        if options.row is None:
            chosen = [stages.stage(name) for name in dict.fromkeys(options.stage or stages.NAMES)]
            print(write_chart(chosen, options.out, QUICK if options.quick else FULL, redraw=options.redraw))
        else:
            print(table.line(*stages.made_again(options.row)))
    except FrameworkError as error:
        parser.error(" ".join(str(error).split()))


def write_chart(chosen: Sequence[Stage], folder: Path, effort: Effort = FULL, *, redraw: bool = False) -> str:
    """Measure the stages and write their figures and tables, all or nothing; returns a summary."""
    summary, sentences, lost = list[str](), list[str](), list[str]()
    known = {
        stage.name: table.read_rows(json.loads((folder / f"{stage.name}.json").read_text(encoding="utf-8")))
        for stage in (chosen if redraw else ())
    }
    with (
        written_together(folder, document=f"{chosen[0].name}.json") as temporary,
        Progress("measuring") as progress,
    ):
        advance = _counted(progress.start("measuring", stages.count(chosen, effort.settings), "rows"))
        for stage in chosen:
            began = time.process_time()
            rows = known[stage.name] if redraw else rows_of(stage, effort, advance)
            spent = time.process_time() - began
            print(
                f"{stage.name}: {len(rows)} rows, {spent:.0f} s of processor time",
                file=sys.stderr,
                flush=True,
            )
            document = table.document(stage, rows)
            (temporary / f"{stage.name}.csv").write_text(table.csv_text(stage, rows), encoding="utf-8")
            (temporary / f"{stage.name}.md").write_text(table.markdown(stage, rows), encoding="utf-8")
            (temporary / f"{stage.name}.json").write_text(json.dumps(document), encoding="utf-8")
            save_chart(stage, rows, temporary / stage.name)
            summary += table.summary(document)
            sentences.append(f"- {stage.title} (`{stage.name}.md`). {document['sentence']}")
            lost += [f"- {line}" for line in losses(stage, rows)]
        if len(chosen) == len(stages.NAMES):
            lines = [
                "# Where others are quicker",
                "",
                *(lost or ["- Nowhere."]),
                "",
                "# All",
                "",
                *sentences,
                "",
            ]
            (temporary / "summary.md").write_text("\n".join(lines), encoding="utf-8")
    return "\n".join([*summary, f"written to {folder}/"])


def _counted(show_progress: Callable[[float], None]) -> Callable[[], None]:
    """Return a function that reports one more row as done at each call."""
    done = 0

    def advance() -> None:
        nonlocal done
        done += 1
        show_progress(done)

    return advance


if __name__ == "__main__":
    main()
