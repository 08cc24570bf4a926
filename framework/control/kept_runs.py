"""Finished runs of a study on disk, so that a study that is stopped goes on from them.

A folder beside the results is named by all that its runs depend on; each chunk is a file that is there
whole or not at all.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from framework.control.closed_loop import Run
from framework.output import written_together

PREFIX = ".crossing-runs-"
KEPT = ("passed", "why", "tracking_error", "end_error", "peak_torque", "payload")


@dataclass(frozen=True)
class KeptRuns:
    """Chunks of one controller's runs in a folder."""

    folder: Path

    @staticmethod
    def of(out: Path, setup: Mapping[str, Any], controller: str) -> KeptRuns:
        """The place in the folder `out` for runs of that setup, a document of JSON."""
        plan = {key: value for key, value in setup["plan"].items() if key != "seconds"}
        text = json.dumps({**setup, "plan": plan}, sort_keys=True)
        return KeptRuns(out / f"{PREFIX}{hashlib.sha256(text.encode()).hexdigest()[:16]}" / controller)

    def found(self) -> list[tuple[range, Run]]:
        """What is there, by the numbers of the runs."""
        found = []
        for file in sorted(self.folder.glob("*.npz")):
            try:
                first, stop = map(int, file.stem.split("-"))
                run = _read(file)
            except (OSError, ValueError, KeyError, zipfile.BadZipFile):
                continue  # not one of ours: computed anew
            if len(run.passed) == stop - first:
                found.append((range(first, stop), run))
        return found

    def keep(self, chunk: range, run: Run) -> None:
        """Put a finished chunk there.

        Raises:
            OutputError: it cannot be written.
        """
        with written_together(self.folder) as temporary:
            np.savez(temporary / f"{chunk.start}-{chunk.stop}", **{name: getattr(run, name) for name in KEPT})


def _read(file: Path) -> Run:
    with open(file, "rb") as stream, np.load(stream) as kept:
        return Run(
            passed=kept["passed"],
            why=tuple(kept["why"].tolist()),
            tracking_error=kept["tracking_error"],
            end_error=kept["end_error"],
            peak_torque=kept["peak_torque"],
            payload=kept["payload"],
            x=np.empty((0, 0, 0)),  # not kept
        )


def forget(out: Path) -> None:
    """Remove what studies that were stopped have left in a folder."""
    for place in out.glob(f"{PREFIX}*"):
        shutil.rmtree(place, ignore_errors=True)
