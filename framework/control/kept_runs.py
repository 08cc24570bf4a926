"""Finished runs of a study as chunks on disk (`framework.parallel.kept`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from framework.control.run_monitor import Run
from framework.parallel.kept import Arrays, KeptChunks

KEPT_FIELDS = ("passed", "why", "tracking_error", "end_error", "peak_torque", "payload")


@dataclass(frozen=True)
class KeptRuns:
    """Chunks of one controller's runs in a folder."""

    chunks: KeptChunks

    @staticmethod
    def of(out: Path, setup: Mapping[str, Any], controller: str) -> KeptRuns:
        """Return the place in the folder `out` for runs of that setup, a document of JSON."""
        plan = {key: value for key, value in setup["plan"].items() if key != "seconds"}
        return KeptRuns(KeptChunks.of(out, {**setup, "plan": plan}, controller))

    def found(self) -> list[tuple[range, Run]]:
        """Return the finished runs, by their numbers."""
        runs = []
        for name, arrays in self.chunks.found().items():
            try:
                first, stop = map(int, name.split("-"))
                run = _run(arrays)
            except (ValueError, KeyError):
                continue  # not one of ours: computed anew
            if len(run.passed) == stop - first:
                runs.append((range(first, stop), run))
        return runs

    def keep(self, chunk: range, run: Run) -> None:
        """Put a finished chunk there.

        Raises:
            OutputError: it cannot be written.
        """
        arrays = {name: np.asarray(getattr(run, name)) for name in KEPT_FIELDS}
        self.chunks.keep(f"{chunk.start}-{chunk.stop}", arrays)


def _run(kept: Arrays) -> Run:
    return Run(
        passed=kept["passed"],
        why=tuple(kept["why"].tolist()),
        tracking_error=kept["tracking_error"],
        end_error=kept["end_error"],
        peak_torque=kept["peak_torque"],
        payload=kept["payload"],
        x=np.empty((0, 0, 0)),  # not kept
    )
