"""Write a description as our own robot file and URDF: both files or none."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring, indent, tostring

import yaml

from framework.errors import InvalidInput, OutputError, RobotFileError
from framework.model.description import (
    Closure,
    Coupling,
    RobotDescription,
    Scene,
    kinds_with_length,
    locked_axes,
)
from framework.model.robot_file import read_robot_file
from framework.model.robot_keys import VERSION
from framework.model.urdf_elements import read_tree
from framework.numerics.input import read_text
from framework.numerics.output import Document, written_together


def write_robot_file(
    description: RobotDescription,
    folder: str | Path,
    *,
    comments: Iterable[str] = (),
    overwrite: bool = False,
) -> Path:
    """Write NAME.yaml and NAME.urdf into a folder; return the path of the YAML.

    The two files move into the folder only if they can be read back. Each of the `comments` becomes a line at
    the top of the YAML. So does a hash of both files, by which edited ones are recognised.

    Raises:
        OutputError: the folder cannot be written; a file would overwrite the one that was read or, without
            `overwrite`, one that is edited or of another origin.
        RobotFileError: the files cannot be read back; the folder is unchanged.
    """
    out = Path(folder)
    name = description.name
    source = description.file
    check_overwritten_robot(description, folder, overwrite=overwrite)
    with written_together(out) as temporary:
        urdf_text = _relocate_meshes(description.urdf_text, source.parent, out)
        (temporary / f"{name}.urdf").write_text(urdf_text, encoding="utf-8")
        written = temporary / f"{name}.yaml"
        head = [f"Converted from {source.name}. SI units: m, kg, s, rad, N, N m.", *comments]
        text = "".join(f"# {' '.join(line.split())}\n" for line in head) + yaml.safe_dump(
            robot_document(description),
            sort_keys=False,
            default_flow_style=None,
            allow_unicode=True,
            width=110,
        )
        written.write_text(f"{_seal(text, urdf_text)}\n{text}", encoding="utf-8")
        try:
            read_robot_file(written)
        except RobotFileError as error:
            message = error.sentence.replace(str(temporary), str(out))  # where the files would be
            raise RobotFileError(f"{source}: cannot become a robot file: {message}") from None
    return out / f"{name}.yaml"


def check_overwritten_robot(
    description: RobotDescription, folder: str | Path, *, overwrite: bool = False
) -> None:
    """Refuse a folder into which `write_robot_file` cannot write the description.

    Raises:
        OutputError: as `write_robot_file`.
    """
    source = description.file
    file = Path(folder) / f"{description.name}.yaml"
    for suffix in (".yaml", ".urdf"):
        target = file.with_name(f"{description.name}{suffix}")
        if target.exists() and target.resolve() in (source.resolve(), source.with_suffix(suffix).resolve()):
            raise OutputError(f"--out: would overwrite {target}, which is read; give another folder")
    if not overwrite:
        _check_unedited(file)
    with written_together(Path(folder)):
        pass


def _seal(text: str, urdf_text: str) -> str:
    """Return the comment with the hash of a robot file's other lines and its URDF."""
    return f"# Generated; hash {hashlib.sha256(f'{text}{urdf_text}'.encode()).hexdigest()[:16]}."


def _check_unedited(file: Path) -> None:
    """Refuse to overwrite a robot file or its URDF unless both are as generated."""
    urdf = file.with_suffix(".urdf")
    present = [path for path in (file, urdf) if os.path.lexists(path)]
    if not present:
        return
    try:
        seal, _, text = read_text(file, "").partition("\n")
        is_unedited = seal == _seal(text, read_text(urdf, ""))
    except InvalidInput:
        is_unedited = False
    if not is_unedited:
        raise OutputError(
            f"--out: {present[0]} is edited, or not of this program; give another folder, or --overwrite"
        )


def record_entry(record: Any) -> Document:
    """Return a `record`, a dataclass, as an entry of a robot file, without empty and zero fields."""
    return {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in asdict(record).items()
        if value
    }


def robot_document(description: RobotDescription) -> Document:
    """Return the content of the robot file whose URDF is NAME.urdf."""
    document: Document = {
        "version": VERSION,
        "urdf": f"{description.name}.urdf",
        "gravity": description.gravity,
        "platform": record_entry(description.platform),
        "actuators": [record_entry(actuator) for actuator in description.actuators],
        "closures": [_closure_entry(closure) for closure in description.closures],
    }
    optional = {
        "springs": [
            *map(record_entry, description.springs),
            # a free length of zero is stated, too
            *(record_entry(s) | ({"rest": s.rest} if s.stiffness else {}) for s in description.line_springs),
        ],
        "couplings": [_coupling_entry(coupling) for coupling in description.couplings],
        "joints": _joint_entries(description),
        "reference": dict(description.reference),
        "scenes": {name: _scene_entry(scene) for name, scene in description.scenes.items()},
        "left_out": description.left_out,
    }
    return document | {key: value for key, value in optional.items() if value}


def _joint_entries(description: RobotDescription) -> Document:
    """Return the entries of `joints`, one for each coordinate of a joint with its own dynamics.

    A ball with equal dynamics about all of its axes has one entry by the name of the joint.
    """
    dynamics = dict(description.joints)  # by coordinate
    for name, joint in read_tree(fromstring(description.urdf_text)).joints.items():
        about_axes = [dynamics.get(coordinate) for coordinate in joint.coordinates]
        if len(about_axes) > 1 and about_axes[0] and len(set(about_axes)) == 1:
            dynamics[name] = about_axes[0]
            for coordinate in joint.coordinates:
                del dynamics[coordinate]
    overriding = ("damping", "friction")  # those of the URDF, also where they are zero
    return {
        name: {key: value for key, value in asdict(values).items() if value or key in overriding}
        for name, values in dynamics.items()
    }


def _coupling_entry(coupling: Coupling) -> Document:
    """Return the entry of a coupling, with products of joints such as knee*knee by name."""
    entry = asdict(coupling)
    if coupling.terms:
        return entry | {"terms": {"*".join(product): value for product, value in coupling.terms}}
    del entry["terms"]
    return entry


def _closure_entry(closure: Closure) -> Document:
    """Return the entry of a closure, with a kind in place of axes if possible; an axis is always written."""
    entry = record_entry(replace(closure, omits_axis=False))
    for kind in ("fixed", "spherical", *kinds_with_length()):  # the kinds without an axis
        if closure.axes == locked_axes(kind):
            del entry["axes"]
            entry["kind"] = kind
    return entry


def _scene_entry(scene: Scene) -> Document:
    """Return the entry of a scene: the path, then the stated options."""
    stated = {key: value for key, value in asdict(scene).items() if value is not None}
    del stated["name"]
    return {stated.pop("kind"): stated.pop("points")} | stated


def _relocate_meshes(text: str, old: Path, new: Path) -> str:
    """Return a URDF's text with mesh paths relative to the folder `new` instead of `old`."""
    root = fromstring(text)
    for mesh in root.iter("mesh"):
        reference = mesh.get("filename", "")
        if reference and "://" not in reference and not os.path.isabs(reference):
            mesh.set("filename", Path(os.path.relpath(old / reference, new)).as_posix())
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"
