"""Finished runs of a study as chunks on disk (`framework.parallel.kept`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from framework.control.run_monitor import Run
from framework.parallel.kept import ArrayField, Arrays, KeptChunks, fits


def _kept_arrays(runs: int, motors: int) -> dict[str, ArrayField]:
    """Return the arrays of a chunk of runs, fields of `Run`."""
    numbers = ArrayField("f", (runs,))
    return {
        "passed": ArrayField("b", (runs,)),
        "why": ArrayField("U", (runs,)),
        "tracking_error": numbers,
        "end_error": numbers,
        "peak_torque": ArrayField("f", (runs, motors)),
        "payload": numbers,
    }


@dataclass(frozen=True)
class KeptRuns:
    """Chunks of one controller's runs in a folder."""

    chunks: KeptChunks
    motors: int  # of the robot

    @staticmethod
    def of(out: Path, setup: Mapping[str, Any], controller: str) -> KeptRuns:
        """Return the place in the folder `out` for runs of that setup, a document of JSON."""
        plan = {key: value for key, value in setup["plan"].items() if key != "seconds"}
        return KeptRuns(KeptChunks.of(out, {**setup, "plan": plan}, controller), len(setup["limit"]))

    def read(self) -> list[tuple[range, Run]]:
        """Return the finished runs, by their numbers."""
        runs = []
        for name, arrays in self.chunks.read().items():
            try:
                first, stop = map(int, name.split("-"))
            except ValueError:
                continue  # not one of ours: computed anew
            if fits(arrays, _kept_arrays(stop - first, self.motors)):
                runs.append((range(first, stop), _run(arrays)))
        return runs

    def keep(self, chunk: range, run: Run) -> None:
        """Store a finished chunk.

        Raises:
            OutputError: the chunk cannot be written.
        """
        arrays = {name: np.asarray(getattr(run, name)) for name in _kept_arrays(0, 0)}
        self.chunks.keep(f"{chunk.start}-{chunk.stop}", arrays)


def _run(kept: Arrays) -> Run:
    """Return the runs of a stored chunk."""
    return Run(
        passed=kept["passed"],
        why=tuple(kept["why"].tolist()),
        tracking_error=kept["tracking_error"],
        end_error=kept["end_error"],
        peak_torque=kept["peak_torque"],
        payload=kept["payload"],
        x=np.empty((0, 0, 0)),  # not kept
    )
