"""What an audit has done, kept in a file, so that one that was interrupted goes on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

from tests.benchmarks.tolerance_audit import runs
from tests.benchmarks.tolerance_audit.constants import ROOT, Change
from tests.benchmarks.tolerance_audit.runs import Outcome, Run, Scene


class Kept:
    """The runs that have been done, by their change, as long as no source changes."""

    def __init__(self, file: Path | None) -> None:
        self.file = file
        self.sources = sources()
        self.done: dict[str, dict] = {}
        if file is not None and file.exists():
            content = json.loads(file.read_text(encoding="utf-8"))
            if content["sources"] == self.sources:
                self.done = content["done"]

    def run(self, change: Change, scenes: Sequence[Scene]) -> Run:
        """Plan scenes with a change, or return what came of them before."""
        constant, names = change.constant, [scene.name for scene in scenes]
        key = f"{constant.module}.{constant.name} {change.factor:g}"
        found = self.done.get(key)
        if found is None or list(found["outcomes"]) != names:
            run = runs.in_a_process(runs.planned, scenes, change)
            found = self.done[key] = {"seconds": run.seconds, "outcomes": run.outcomes}
            self._write()
        outcomes = {name: Outcome(*outcome) for name, outcome in found["outcomes"].items()}
        return Run(outcomes, found["seconds"])

    def _write(self) -> None:
        if self.file is not None:
            content = {"sources": self.sources, "done": self.done}
            self.file.write_text(json.dumps(content), encoding="utf-8")


def sources() -> str:
    """Return a digest of the framework, of the robots and of the audit."""
    digest = hashlib.sha256()
    for folder in ("framework", "robots", "urdf", "tests/benchmarks/tolerance_audit"):
        for file in sorted((ROOT / folder).rglob("*")):
            if file.suffix in {".py", ".yaml", ".urdf", ".xml"}:
                digest.update(file.read_bytes())
    return digest.hexdigest()
