"""Finished chunks on disk, so that a computation that is stopped goes on from them.

A folder beside the results is named by all that they depend on; each chunk is a file that is there whole
or not at all.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.output import written_together

PREFIX = ".crossing-kept-"
Arrays = Mapping[str, NDArray[Any]]


class ArrayField(NamedTuple):
    """What an array of a chunk must be: its kind of values as numpy has them (b, i, u, f, U), its shape."""

    kind: str
    shape: tuple[int, ...]


def fits(arrays: Arrays | None, table: Mapping[str, ArrayField]) -> bool:
    """Whether these are the arrays of the table, and no others; None are not."""
    return arrays is not None and table == {
        name: ArrayField(array.dtype.kind, array.shape) for name, array in arrays.items()
    }


@dataclass(frozen=True)
class KeptChunks:
    """Arrays by the name of their chunk, in a folder."""

    folder: Path

    @staticmethod
    def of(out: Path, document: Mapping[str, Any], *parts: str) -> KeptChunks:
        """Return the place in the folder `out` for chunks of what a document of JSON describes completely."""
        text = json.dumps(document, sort_keys=True)
        name = f"{PREFIX}{hashlib.sha256(text.encode()).hexdigest()[:16]}"
        return KeptChunks(out.joinpath(name, *parts))

    def found(self) -> dict[str, Arrays]:
        """Return the finished chunks, by name."""
        chunks: dict[str, Arrays] = {}
        for file in sorted(self.folder.glob("*.npz")):
            try:
                with open(file, "rb") as stream, np.load(stream) as archive:
                    chunks[file.stem] = {name: archive[name] for name in archive.files}
            except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile, zlib.error):
                continue  # not one of ours: computed anew
        return chunks

    def keep(self, name: str, arrays: Arrays) -> None:
        """Put a finished chunk there.

        Raises:
            OutputError: it cannot be written.
        """
        with written_together(self.folder) as temporary:
            np.savez(temporary / name, allow_pickle=False, **arrays)


def forget(out: Path) -> None:
    """Remove what computations that were stopped have left in a folder."""
    for place in out.glob(f"{PREFIX}*"):
        shutil.rmtree(place, ignore_errors=True)
