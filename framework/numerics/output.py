"""Write complete files: all files of a result, or none."""

from __future__ import annotations

import fcntl
import json
import math
import os
import shutil
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from framework.errors import InvalidInput, OutputError
from framework.numerics.input import read_text
from framework.numerics.interruption import check_interruption, defer_signals

# those on which the last bit of results depends
PROGRAM = "parallel-singularity-crossing"  # in pages, pictures and models, as their generator
PACKAGES = (PROGRAM, "pin", "numpy", "scipy")

Document = dict[str, Any]  # a JSON object, or what becomes one
UNFINISHED = ".crossing-unfinished-"  # prefix of names of temporary folders, which this program may remove


@contextmanager
def written_together(
    folder: Path,
    *,
    document: str | None = None,
    files: Collection[str] = (),
    option: str = "--out",
    file: Path | None = None,
    outdated: Collection[str] = (),
) -> Iterator[Path]:
    """Yield a temporary folder whose files move into `folder` if the block ends without an error.

    Missing folders are made first, and removed again if nothing is written. Before the block runs, it is
    checked that `folder` can be written and contains no foreign `document` and `files`.

    Args:
        folder: where the files are to be.
        document: name of the JSON file about a robot that is written with the others and marks them as files
            of this program. If `folder` has no such file, existing files of the same names are foreign and
            are not overwritten.
        files: names of further files that the block writes, as far as they are known before.
        outdated: names of files that belong to an earlier `document`, and are removed if the block does not
            write them again.
        option: command-line option that is named in complaints.
        file: file that is named in complaints instead of the folder.

    Raises:
        OutputError: `folder` cannot be made or written, or holds foreign files of the same names.
    """
    complaint = f"{option}: cannot write {f'into {folder}' if file is None else file}"
    new_folders = [path for path in (folder, *folder.parents) if not os.path.lexists(path)]
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except ValueError as error:  # not the name of a folder
            raise OutputError(f"{complaint}: {error}") from None
        with _temporary_folder(folder) as temporary:
            if document is not None:
                _check_overwritten(folder, [document, *files], document, complaint)
            yield temporary

            check_interruption()  # which the block may have lost
            # the block has ended without an error: its files replace older ones
            new_files = sorted(temporary.iterdir())
            names = [written.name for written in new_files]
            _check_overwritten(folder, names, document, complaint)
            replaces = document is not None and os.path.lexists(folder / document)
            with defer_signals():
                for written in new_files:
                    os.replace(written, folder / written.name)
                for name in set(outdated) - set(names) if replaces else ():
                    (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{complaint}: {error.strerror or error}") from None
    finally:
        with defer_signals():
            for created in new_folders:  # the deepest first
                if os.path.isdir(created) and not any(created.iterdir()):
                    created.rmdir()


def _check_overwritten(folder: Path, names: Sequence[str], document: str | None, complaint: str) -> None:
    """Refuse to overwrite folders, and files that do not belong to this program.

    Args:
        document: name of the JSON file that marks the others as files of this program; None overwrites any.
        complaint: beginning of the message.
    """
    present = [name for name in names if os.path.lexists(folder / name)]
    for name in present:
        if (folder / name).is_dir():
            raise OutputError(f"{complaint}: {name} is a folder there")
    if document is not None and present and not _is_ours(folder / document):
        foreign = document if document in present else present[0]
        raise OutputError(
            f"{complaint}: {foreign} is there already, and not of this program; give another folder, or "
            f"move it"
        )


@contextmanager
def _temporary_folder(folder: Path) -> Iterator[Path]:
    """Yield a locked temporary folder in `folder`, which is removed at the end.

    A lock ends with its process. So unlocked temporary folders, which processes left that were killed while
    writing, can be removed here.
    """
    with ExitStack() as cleanup:
        with defer_signals(), _lock(folder):  # no other process removes the new folder before it is locked
            for abandoned in folder.glob(f"{UNFINISHED}*"):
                with suppress(OSError), _lock(abandoned, is_patient=False):  # fails if the folder is in use
                    shutil.rmtree(abandoned, ignore_errors=True)
            temporary = Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=folder))
            cleanup.enter_context(_lock(temporary))
            cleanup.callback(_remove_folder, temporary)
        yield temporary


def _remove_folder(folder: Path) -> None:
    """Remove a folder with its content, without interruption."""
    with defer_signals():
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _lock(folder: Path, *, is_patient: bool = True) -> Iterator[None]:
    """Lock a folder against other processes for the duration of the block.

    If another process has the lock, wait for it with `is_patient`, else raise BlockingIOError. On a file
    system without locks, do without the lock with `is_patient`, else raise OSError.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX if is_patient else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            if not is_patient:
                raise
        yield
    finally:
        os.close(descriptor)


def plain(value: Any) -> Any:
    """Convert a value for JSON: arrays become lists, numbers that are not finite become null.

    Mappings, lists and tuples are converted with all that they contain.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def select_fields(record: object, *names: str) -> Document:
    """Return some attributes of a record, by name."""
    return {name: getattr(record, name) for name in names}


def json_text(document: Mapping[str, Any]) -> str:
    """Return a `plain` document as the text of a file."""
    return json.dumps(plain(document), indent=2, allow_nan=False) + "\n"


def write_csv(file: Path, groups: Mapping[str, Iterable[str]], rows: np.ndarray) -> None:
    """Write rows (T, 1 + number of names) over time below a header of `time` and GROUP_NAME.

    Args:
        groups: names of columns by group, in the order of the columns behind the time [s].
    """
    names = ["time", *(f"{group}_{name}" for group, members in groups.items() for name in members)]
    np.savetxt(file, rows, fmt="%.17g", delimiter=",", header=",".join(names), comments="")


def write_files(
    contents: Mapping[Path, str | bytes], *, option: str = "--html", overwrite: bool = False
) -> None:
    """Write complete files, or none; if this fails, existing files stay unchanged.

    A file is this program's if it names PROGRAM or, of formats without a place for that, begins alike.

    Args:
        contents: by file: bytes, or a text that is written in UTF-8. Characters without UTF-8 encoding, as
            in paths that are not UTF-8, become question marks.
        option: command-line option that is named in complaints.
        overwrite: whether a file of another origin is replaced, too.

    Raises:
        OutputError: a file cannot be written, its name belongs to something else than a file, or the file
            has another origin and is not to be overwritten.
    """
    with ExitStack() as writing:  # what is written moves to its place at the end
        for file, content in contents.items():
            data = content if isinstance(content, bytes) else content.encode("utf-8", "replace")
            target = _overwritable_target(file, data, option, overwrite=overwrite)
            temporary = writing.enter_context(written_together(target.parent, option=option, file=file))
            (temporary / target.name).write_bytes(data)


def check_files(beginnings: Mapping[Path, str], *, option: str = "--html", overwrite: bool = False) -> None:
    """Refuse files that `write_files` would refuse, before long work.

    Args:
        beginnings: by file, how its text begins, PROGRAM if it names the program; empty if that is not known.
        option, overwrite: as of `write_files`.

    Raises:
        OutputError: as `write_files`.
    """
    for file, beginning in beginnings.items():
        is_known = beginning != ""
        target = _overwritable_target(file, beginning.encode(), option, overwrite=overwrite or not is_known)
        with written_together(target.parent, option=option, file=file):
            pass


def _overwritable_target(file: Path, data: bytes, option: str, *, overwrite: bool) -> Path:
    """Return the path to write `data` to; refuse a file of another origin unless `overwrite`."""
    try:
        target = Path(os.path.realpath(file))  # a link stays; the file to which it points is replaced
    except ValueError as error:
        raise OutputError(f"{option}: cannot write {file}: {error}") from None
    if os.path.lexists(target) and not os.path.isfile(target):
        raise OutputError(f"{option}: cannot write {file}: not a regular file")
    old = b"" if overwrite or not os.path.isfile(target) else target.read_bytes()
    mark = PROGRAM.encode()
    if old and (mark not in old if mark in data else not old.startswith(data[:24])):
        raise OutputError(
            f"{option}: {file} is there already, and not of this program; give another name, or --overwrite"
        )
    return target


def _is_ours(document: Path) -> bool:
    """Return whether a file is a JSON object with the key `robot`, as of this program."""
    try:
        content = json.loads(read_text(document, "", largest=1_000_000_000))
    except (InvalidInput, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and "robot" in content


def package_versions() -> dict[str, str]:
    """Return the versions of the packages on which the last bit of results depends."""
    from importlib.metadata import version  # takes time to import

    return {package: version(package) for package in PACKAGES}
