"""The URDF of a robot file: its place and its tree."""

from __future__ import annotations

import sysconfig
import xml.etree.ElementTree as ElementTree
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

from framework.errors import MissingPackage, RobotFileError
from framework.model.documents import naming
from framework.model.urdf_elements import Tree, read_tree

PACKAGE = "package://"


def locate_urdf(folder: Path, reference: str) -> Path:
    """Return the file of `urdf: reference` in a robot file in `folder`.

    A path is taken from the folder. package://NAME/REST is share/NAME/REST as the Python distribution NAME
    has installed it or, failing that, under the prefix of this interpreter (where conda puts it).

    Raises:
        MissingPackage: NAME is not installed.
        RobotFileError: it is installed and has no such file, or the reference names no file.
    """
    if not reference.startswith(PACKAGE):
        return folder / reference
    package, _, rest = reference.removeprefix(PACKAGE).partition("/")
    if not package or not rest:
        raise RobotFileError(f"urdf: needs {PACKAGE}NAME/FILE, got {reference!r}")
    shared = f"share/{package}/{rest}"
    beside = Path(sysconfig.get_path("data")) / shared
    try:
        installed = files(package) or []
    except PackageNotFoundError:
        installed = None
    for file in installed or ():
        if file.as_posix() == shared or file.as_posix().endswith(f"/{shared}"):
            return Path(str(file.locate()))
    if beside.is_file():
        return beside
    if installed is None and not (beside.parents[rest.count("/")]).is_dir():
        raise MissingPackage(
            f"urdf: {reference} is in the package {package}, which is not installed: pip install {package}",
            package=package,
        )
    raise RobotFileError(f"urdf: the package {package} has no file {shared}")


def check_urdf(path: Path, root: ElementTree.Element) -> Tree:
    """Check a URDF and return its tree; `path` is for messages.

    Raises:
        RobotFileError: not a tree of known joint types, or a number that is none.
    """
    with naming(f"urdf: {path}"):
        return read_tree(root)
