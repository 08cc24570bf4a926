"""`crossing chart`: speed against accuracy of the methods, as figures and tables."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from framework.cli.parser import Report, command, progress_bar
from framework.output import written_together

FOLDER = "chart"


def add(commands: Any) -> None:
    """Add the command to the parser."""
    more = (
        "Every method in one run, against references that share no code with it: for each stage a figure "
        "(.png, .pdf) and a table (.csv, .md, .json). Peers that are not installed are left out and named."
    )
    parser = command(commands, "chart", run, "speed against accuracy of the methods", more)
    parser.add_argument("--stage", nargs="+", metavar="S", help="some stages only (default: all)")
    parser.add_argument(
        "--row", metavar="ROW", help="one row made again, as the table names it; writes nothing"
    )
    parser.add_argument("--out", metavar="DIR", help=f"where to write (default: ./{FOLDER})")


def run(options: argparse.Namespace) -> Report:
    """Measure, draw, and write all or nothing."""
    from framework.chart import stages, table

    if options.row is not None:
        one, row = stages.made_again(options.row)
        return table.row_document(row), table.line(one, row)
    from framework.show.chart import save_chart

    asked = [stages.stage(name) for name in dict.fromkeys(options.stage or stages.NAMES)]
    folder = Path(options.out or FOLDER)
    documents = []
    with (
        written_together(folder, document=f"{asked[0].name}.json") as temporary,
        progress_bar(stages.count(asked), "row", silent=options.json) as advance,
    ):
        done = 0

        def next_row() -> None:
            nonlocal done
            done += 1
            advance(done)

        for one in asked:
            rows = stages.made(one, next_row)
            documents.append(table.document(one, rows))
            (temporary / f"{one.name}.csv").write_text(table.csv_text(one, rows), encoding="utf-8")
            (temporary / f"{one.name}.md").write_text(table.markdown(one, rows), encoding="utf-8")
            (temporary / f"{one.name}.json").write_text(json.dumps(documents[-1]), encoding="utf-8")
            save_chart(one, rows, temporary / one.name)
    lines = [line for found in documents for line in table.summary(found)]
    return {"folder": str(folder), "stages": documents}, "\n".join([*lines, f"written to {folder}/"])
