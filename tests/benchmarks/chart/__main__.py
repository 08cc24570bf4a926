"""Measure the methods of the chart, and write its figures and tables: `python -m tests.benchmarks.chart`.

Every method in one run, against references that share no code with it: for each stage a figure (.png, .pdf)
and a table (.md, .json). Peers that are not installed are left out and named.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from framework import FrameworkError
from framework.numerics.output import written_together
from tests.benchmarks.chart import stages, table
from tests.benchmarks.chart.figures import save_chart
from tests.benchmarks.chart.measure import FULL, QUICK, Effort, Stage, rows_of

FOLDER = "chart"


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the chart, or one row of it again."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.chart", description=__doc__)
    parser.add_argument("--stage", nargs="+", metavar="S", help="some stages only (default: all)")
    parser.add_argument(
        "--row", metavar="ROW", help="one row made again, as the table names it; writes nothing"
    )
    parser.add_argument("--quick", action="store_true", help="one setting of a series, run once")
    parser.add_argument("--out", type=Path, default=Path(FOLDER), metavar="DIR", help="default: %(default)s")
    options = parser.parse_args(arguments)
    try:
        if options.row is None:
            chosen = [stages.stage(name) for name in dict.fromkeys(options.stage or stages.NAMES)]
            print(write_chart(chosen, options.out, QUICK if options.quick else FULL))
        else:
            print(table.line(*stages.made_again(options.row)))
    except FrameworkError as error:
        parser.error(" ".join(str(error).split()))


def write_chart(chosen: Sequence[Stage], folder: Path, effort: Effort = FULL) -> str:
    """Measure the stages and write their figures and tables, all or nothing; returns a summary."""
    summary = list[str]()
    with written_together(folder, document=f"{chosen[0].name}.json") as temporary:
        for stage in chosen:
            began = time.process_time()
            rows = rows_of(stage, effort)
            spent = time.process_time() - began
            print(f"{stage.name}: {len(rows)} rows, {spent:.0f} s of processor time", file=sys.stderr)
            document = table.document(stage, rows)
            (temporary / f"{stage.name}.md").write_text(table.markdown(stage, rows), encoding="utf-8")
            (temporary / f"{stage.name}.json").write_text(json.dumps(document), encoding="utf-8")
            save_chart(stage, rows, temporary / stage.name)
            summary += table.summary(document)
    return "\n".join([*summary, f"written to {folder}/"])


if __name__ == "__main__":
    main()
