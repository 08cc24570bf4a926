"""Finished chunks on disk, from which a stopped computation continues.

The chunks are in a folder beside the results. The folder's name is a hash of everything on which the results
depend. Each chunk is one file, which is complete or absent.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from framework.numerics.output import written_together
from framework.numerics.tasks import iterate_results

PREFIX = ".crossing-kept-"  # of names of stores
WHY = "why"  # name of the column with the reasons for rows without numbers
Arrays = Mapping[str, NDArray[Any]]
K = TypeVar("K")


class ArrayField(NamedTuple):
    """An array of a chunk: the kind of its values (b, i, u, f, U, as numpy) and its shape."""

    kind: str
    shape: tuple[int, ...]


def fits(arrays: Arrays | None, table: Mapping[str, ArrayField]) -> bool:
    """Return whether arrays have the names, kinds and shapes of a table; false for None."""
    if arrays is None:
        return False
    return table == {name: ArrayField(array.dtype.kind, array.shape) for name, array in arrays.items()}


@dataclass(frozen=True)
class KeptChunks:
    """A folder of finished chunks: arrays by the name of their chunk."""

    folder: Path

    @staticmethod
    def of(out: Path, document: Mapping[str, Any], *parts: str) -> KeptChunks:
        """Return the store of the computation that a document describes.

        Args:
            out: folder of the results, which contains the store.
            document: everything on which the results depend.
            parts: names of subfolders of the store, outermost first.
        """
        text = json.dumps(document, sort_keys=True)
        name = f"{PREFIX}{hashlib.sha256(text.encode()).hexdigest()[:16]}"
        return KeptChunks(out.joinpath(name, *parts))

    def read(self) -> dict[str, Arrays]:
        """Return the finished chunks, by name."""
        chunks: dict[str, Arrays] = {}
        for file in sorted(self.folder.glob("*.npz")):
            try:
                with open(file, "rb") as stream, np.load(stream) as archive:
                    chunks[file.stem] = {name: archive[name] for name in archive.files}
            except Exception:  # noqa: BLE001 - damaged bytes raise nearly any; the chunk is computed anew
                continue
        return chunks

    def keep(self, name: str, arrays: Arrays) -> None:
        """Store the arrays of a finished chunk.

        Raises:
            OutputError: the chunk cannot be written.
        """
        with written_together(self.folder) as temporary:
            np.savez(temporary / name, allow_pickle=False, **arrays)


def complete_chunks(
    compute: Callable[[K], Arrays],
    tasks: Mapping[str, K],
    fields: Callable[[K], Mapping[str, ArrayField]],
    *,
    executor: Executor | None,
    keeper: KeptChunks | None,
    progress: Callable[[Collection[str]], None],
) -> dict[str, NDArray[Any]]:
    """Return the arrays of all tasks by name, joined in order; compute chunks that are not stored.

    Args:
        compute: computes the arrays of a task; must be picklable for an executor of processes.
        tasks: the task of each chunk, by the name of the chunk.
        fields: returns the kinds and shapes of the arrays of a task.
        executor: computes the chunks; None computes them in this process.
        keeper: stores finished chunks; stored chunks are not computed again.
        progress: called with the names of all finished chunks.
    """
    stored = {} if keeper is None else keeper.read()
    chunks = {name: stored[name] for name, task in tasks.items() if fits(stored.get(name), fields(task))}
    progress(chunks)
    missing = {name: task for name, task in tasks.items() if name not in chunks}
    for name, chunk in iterate_results(compute, missing, executor):
        chunks[name] = chunk
        if keeper is not None:
            keeper.keep(name, chunk)
        progress(chunks)

    in_order = [chunks[name] for name in tasks]
    return {key: np.concatenate([chunk[key] for chunk in in_order]) for key in in_order[0]}


def compute_rows(
    compute: Callable[[K], Mapping[str, float]],
    columns: Iterable[str],
    refusals: tuple[type[Exception], ...],
    tasks: Iterable[K],
) -> dict[str, NDArray[Any]]:
    """Compute a chunk of tasks: arrays by column, with a row for each task.

    The row of a refused task has NaN as numbers and the reason in the column `why`.

    Args:
        compute: returns the numbers of a task by column.
        columns: names of all columns of numbers.
        refusals: exceptions by which `compute` refuses a task.
        tasks: the tasks of the chunk, in the order of the rows.
    """
    rows = []
    for task in tasks:
        row: dict[str, Any] = {**dict.fromkeys(columns, np.nan), WHY: ""}
        try:
            row |= compute(task)
        except refusals as refusal:
            row[WHY] = str(refusal)
        rows.append(row)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def remove_stores(out: Path) -> None:
    """Remove the stores of stopped computations from a folder."""
    for store in out.glob(f"{PREFIX}*"):
        shutil.rmtree(store, ignore_errors=True)
