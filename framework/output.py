"""Write files together or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from framework.errors import OutputError


@contextmanager
def written_together(folder: Path) -> Iterator[Path]:
    """A temporary folder whose files move into `folder` once the block has ended without an error.

    That `folder` can be written is found out before the block runs.

    Raises:
        OutputError: `folder` cannot be made or written.
    """
    new = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=folder))
    except OSError as error:
        _remove_empty(new)
        raise OutputError(f"--out: cannot write into {folder}: {error.strerror or error}") from None
    try:
        yield temporary
        files = sorted(temporary.iterdir())
        for file in files:
            if (folder / file.name).is_dir():
                raise OutputError(f"--out: cannot write into {folder}: {file.name} is a folder there")
        for file in files:
            os.replace(file, folder / file.name)
    except OSError as error:
        raise OutputError(f"--out: cannot write into {folder}: {error.strerror or error}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        _remove_empty(new)


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders made for nothing, the deepest first."""
    for folder in folders:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
