"""Write the files of commands into the folder of --out, which the report names at its end."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path

from framework.cli.parser import Report
from framework.numerics.kept import KeptChunks, remove_stores
from framework.numerics.output import Document, write_file, written_together
from framework.numerics.tasks import executor_of


def write_page(file: Path, page: str | bytes) -> Report:
    """Write one file and return the report on its name and size."""
    write_file(file, page)
    size = file.stat().st_size
    return {"file": str(file), "bytes": size}, [f"written to {file} ({size / 1e6:.2f} MB)"]


@contextmanager
def written_out(options: Namespace, document: str, beside: Collection[str] = ()) -> Iterator[Path | None]:
    """Yield a folder whose files `written_together` moves into --out; None without --out."""
    if options.out is None:
        yield None
        return
    with written_together(Path(options.out), document=document, beside=beside) as folder:
        yield folder
    options.written = options.out


@contextmanager
def mapped_stepwise(
    options: Namespace, document: str, setup: Document, unit: str
) -> Iterator[tuple[Path | None, KeptChunks | None, Executor | None]]:
    """Yield the folder of `written_stepwise`, the store of finished chunks, the executor."""
    store = None if options.out is None else KeptChunks.of(Path(options.out), setup)
    with (
        written_stepwise(options, document, lambda: len(store.read()) if store else 0, unit) as folder,
        executor_of(workers=options.workers, dask=options.dask) as executor,
    ):
        yield folder, store, executor


@contextmanager
def written_stepwise(
    options: Namespace, document: str, count: Callable[[], int], unit: str
) -> Iterator[Path | None]:
    """Yield the folder of `written_out`, for long work that may be interrupted.

    After an interruption finished parts stay in --out, and the message states their number, `count()`, and
    `unit`.
    """
    with written_out(options, document) as folder:
        try:
            yield folder
        except KeyboardInterrupt as stop:
            finished = count()
            sentence = f"{finished} {unit} are kept in {options.out}, and the same command goes on from them"
            raise type(stop)(*([sentence] if finished else [])) from None
    if options.out is not None:
        remove_stores(Path(options.out))
