"""Write a description as our own robot file and URDF, both or neither."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring, indent, tostring

import yaml

from framework.errors import OutputError, RobotFileError
from framework.model.description import Closure, RobotDescription, Scene, kinds_with_length, locked_axes
from framework.model.robot_file import read_robot_file
from framework.model.robot_keys import VERSION
from framework.model.urdf_elements import read_tree
from framework.numerics.output import Document, written_together


def write_robot_file(
    description: RobotDescription, folder: str | Path, *, comments: Iterable[str] = ()
) -> Path:
    """Write NAME.yaml and NAME.urdf into a folder; return the path of the YAML.

    Both are read back first. `comments` stand on top of the YAML, a line each.

    Raises:
        OutputError: the folder cannot be written, or these would overwrite the file that was read.
        RobotFileError: what was written cannot be read; nothing is left in the folder then.
    """
    out, name = Path(folder), description.name
    for suffix in (".yaml", ".urdf"):
        target = out / f"{name}{suffix}"
        if target.exists() and target.resolve() in (
            description.file.resolve(),
            description.file.with_suffix(suffix).resolve(),
        ):
            raise OutputError(f"--out: would overwrite {target}, which is read; give another folder")
    with written_together(out) as temporary:
        (temporary / f"{name}.urdf").write_text(
            _moved_urdf_text(description.urdf_text, description.file.parent, out), encoding="utf-8"
        )
        written = temporary / f"{name}.yaml"
        written.write_text(_yaml_text(description, comments), encoding="utf-8")
        try:
            read_robot_file(written)
        except RobotFileError as error:
            message = str(error).removeprefix(f"{written}: ").replace(str(temporary), str(out))
            raise RobotFileError(f"{description.file}: cannot become a robot file: {message}") from None
    return out / f"{name}.yaml"


def record_entry(record: Any) -> Document:
    """Return a record as an entry of a robot file, without empty and zero fields."""
    return {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in asdict(record).items()
        if value
    }


def robot_document(description: RobotDescription) -> Document:
    """Return the content of the description's robot file; its URDF is NAME.urdf."""
    document: Document = {
        "version": VERSION,
        "urdf": f"{description.name}.urdf",
        "gravity": list(description.gravity),
        "platform": record_entry(description.platform),
        "actuators": [record_entry(actuator) for actuator in description.actuators],
        "closures": [_closure_entry(closure) for closure in description.closures],
    }
    optional = {
        "springs": [record_entry(spring) for spring in description.springs],
        "couplings": [asdict(coupling) for coupling in description.couplings],
        "joints": _joint_entries(description),
        "reference": dict(description.reference),
        "scenes": {name: _scene_entry(scene) for name, scene in description.scenes.items()},
        "left_out": list(description.left_out),
    }
    return document | {key: value for key, value in optional.items() if value}


def _joint_entries(description: RobotDescription) -> dict[str, dict[str, float]]:
    """Return the entry `joints`, a ball as one joint if its axes are alike."""
    written = dict(description.joints)
    for name, joint in read_tree(fromstring(description.urdf_text)).joints.items():
        values = [written.get(coordinate) for coordinate in joint.coordinates]
        if len(values) > 1 and values[0] is not None and all(value == values[0] for value in values):
            written = {key: value for key, value in written.items() if key not in joint.coordinates}
            written[name] = values[0]
    overriding = ("damping", "friction")  # zeros of these override the URDF
    return {
        name: {key: value for key, value in asdict(joint).items() if value or key in overriding}
        for name, joint in written.items()
    }


def _closure_entry(closure: Closure) -> Document:
    """Return the entry of a closure, by kind where its locked axes have one."""
    entry = record_entry(closure)
    kinds = {
        locked_axes(kind): kind for kind in ("fixed", "spherical", *kinds_with_length())
    }  # without an axis
    if closure.axes in kinds:
        del entry["axes"]
        entry["kind"] = kinds[closure.axes]
    return entry


def _scene_entry(scene: Scene) -> Document:
    """Return the entry of a scene: its path and stated options."""
    stated = {key: value for key, value in vars(scene).items() if value is not None}
    del stated["name"]
    path = {stated.pop("kind"): [list(point) for point in stated.pop("points")]}
    for key, value in stated.items():
        if isinstance(value, tuple):
            stated[key] = list(value)
    if scene.wrenches is not None:
        stated["wrenches"] = dict(scene.wrenches)
    if scene.fidelity is not None:
        stated["fidelity"] = asdict(scene.fidelity)
    return path | stated


def _yaml_text(description: RobotDescription, comments: Iterable[str] = ()) -> str:
    """Return a robot file's text, with source, units and comments ahead."""
    head = f"# Converted from {description.file.name}. SI units: m, kg, s, rad, N, N m.\n"
    head += "".join(f"# {' '.join(line.split())}\n" for line in comments)
    return head + yaml.safe_dump(
        robot_document(description), sort_keys=False, default_flow_style=None, allow_unicode=True, width=110
    )


def _moved_urdf_text(text: str, old: Path, new: Path) -> str:
    """Return the URDF's text, relative mesh files seen from the new folder."""
    root = fromstring(text)
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        if name and "://" not in name and not os.path.isabs(name):
            mesh.set("filename", Path(os.path.relpath(old / name, new)).as_posix())
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"
