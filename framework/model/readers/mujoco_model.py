"""MuJoCo's own model of an MJCF file, without missing parts that no motion needs.

MuJoCo compiles it: defaults, classes, includes, frames, units and inertia of geoms come with that. Left out
beforehand are plugins, textures, sensors and meshes that weigh nothing. Bodies without mass pass, and have
none afterwards.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from framework.errors import MissingPackage, RobotFileError
from framework.model.readers.urdf_tree import UnreadElement
from framework.model.urdf_elements import check_inertia, symmetric_matrix
from framework.numerics.input import read_text

# [kg], [kg m^2] of bodies without mass, for MuJoCo, which refuses less than 1e-15
STAND_IN_MASS, STAND_IN_INERTIA = 1e-12, 1e-14
# disabled arrays, by flag of <option>
_DISABLED = {
    "SPRING": ("jnt_stiffness", "jnt_stiffnesspoly", "tendon_stiffness"),
    "DAMPER": ("dof_damping", "dof_dampingpoly", "tendon_damping", "actuator_damping"),
    "FRICTIONLOSS": ("dof_frictionloss", "tendon_frictionloss"),
    "LIMIT": ("jnt_limited", "tendon_limited"),
    "GRAVITY": ("body_gravcomp",),
}
_UNUSED = ("sensors", "pairs", "excludes", "tuples", "skins", "lights", "textures", "materials", "hfields")
_PLUGIN = re.compile(r"<extension\b.*?</extension\s*>|<plugin\b[^>]*/>|<plugin\b.*?</plugin\s*>", re.DOTALL)


def compile_mjcf(file: Path) -> tuple[Any, list[UnreadElement], Counter[str]]:
    """Return the compiled model, unread elements, and counts of unused ones by kind.

    Bodies without mass stay massless. MuJoCo's own refusal becomes a RobotFileError.
    """
    try:
        import mujoco
    except ImportError:
        raise MissingPackage(
            "MJCF is read by MuJoCo itself, which is not installed: pip install "
            "'parallel-singularity-crossing[mjcf]'",
            package="mujoco",
        ) from None
    try:
        with ExitStack() as silence, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it computes with bodies that have next to no mass
            silence.callback(mujoco.set_mju_user_warning, mujoco.get_mju_user_warning())
            mujoco.set_mju_user_warning(lambda _: None)  # its own writes a file where the program runs
            return _compile_usable_parts(mujoco, _load_spec(mujoco, file))
    except RobotFileError:
        raise
    except (ValueError, RuntimeError) as error:  # of MuJoCo, for all that it refuses
        raise RobotFileError(_reorder_error(str(error))) from None


def _compile_usable_parts(mujoco: Any, spec: Any) -> tuple[Any, list[UnreadElement], Counter[str]]:
    """Compile a specification without parts that MuJoCo refuses or no motion needs."""
    unused = Counter({kind: len(getattr(spec, kind)) for kind in (*_UNUSED, "cameras")})
    left_out = [*_delete_unused(mujoco, spec), *_repair_inertias(mujoco, spec)]
    left_out += _delete_needless_meshes(mujoco, spec)
    count = len(spec.keys[0].qpos) if spec.keys else 0
    compiled, refused = _compile(spec)
    if count not in (0, compiled.nq):
        raise RobotFileError(
            f"<key> {spec.keys[0].name!r} qpos: needs {compiled.nq} numbers, one a coordinate, got {count}"
        )
    _apply_flags(mujoco, compiled)
    return compiled, left_out + refused, unused


def _apply_flags(mujoco: Any, compiled: Any) -> None:
    """Set effects disabled by flags of the file to zero; refuse disabled loops."""
    off = {
        name.removeprefix("mjDSBL_")
        for name, flag in mujoco.mjtDisableBit.__members__.items()
        if compiled.opt.disableflags & flag
    }
    for name in ("EQUALITY", "CONSTRAINT"):
        if name in off and compiled.eq_active0.any():
            raise RobotFileError(f"<flag> {name.lower()}: disabled, so there would be no loop")
    for name in off & _DISABLED.keys():
        for values in _DISABLED[name]:
            getattr(compiled, values)[:] = 0
    if "GRAVITY" in off:
        compiled.opt.gravity[:] = 0.0


def _reorder_error(error: str) -> str:
    """Return MuJoCo's error in one line that begins with line and element."""
    text = " ".join(re.sub(r"^((XML )?Error: )+", "", error).split())
    match = re.search(r" Element (name )?'(?P<name>[^']*)'(, id \d+)?, line (?P<line>\d+)$", text)
    if match is None:
        return f"MuJoCo: {text}"
    name = f"{match['name']!r}: " if match["name"] else ""
    return f"line {match['line']}: {name}MuJoCo: {text[: match.start()]}"


def _load_spec(mujoco: Any, file: Path) -> Any:
    """Load MuJoCo's specification of a file, without missing plugins."""
    try:
        return mujoco.MjSpec.from_file(str(file))
    except ValueError as error:
        if "plugin" not in str(error):
            raise
    text = _remove_plugins(read_text(file, "cannot read it", error=RobotFileError))
    spec = mujoco.MjSpec.from_string(text, include=dict(_included_files(file.parent, text)))
    spec.modelfiledir = str(file.parent)
    return spec


def _remove_plugins(text: str) -> str:
    """Remove plugins from the text of an MJCF file, keeping its line numbers."""
    return _PLUGIN.sub(lambda plugin: "\n" * plugin[0].count("\n"), text)


def _included_files(folder: Path, text: str) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each file that an MJCF text includes, recursively."""
    for name in re.findall(r"<include\s+file\s*=\s*[\"']([^\"']+)", text):
        other = _remove_plugins(
            read_text(folder / name, f"<include> {name!r}: cannot read it", error=RobotFileError)
        )
        yield name, other.encode()
        yield from _included_files(folder, other)


def _delete_unused(mujoco: Any, spec: Any) -> Iterator[UnreadElement]:
    """Delete elements that no motion needs; yield actuators of plugins."""
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_HFIELD:
            spec.delete(geom)
    for kind in _UNUSED:
        for element in list(getattr(spec, kind)):
            spec.delete(element)
    for element in (*spec.geoms, *spec.sites, *spec.tendons, *spec.flexes, *spec.meshes):
        element.material = ""
    for site in spec.sites:
        if site.meshname:
            site.type, site.meshname = mujoco.mjtGeom.mjGEOM_SPHERE, ""
    for actuator in list(spec.actuators):
        if actuator.plugin.active:
            yield UnreadElement(f"actuator {actuator.name!r}: driven by a plugin", (actuator.target,))
            spec.delete(actuator)
    spec.compiler.fusestatic = False  # each body keeps its name
    spec.compiler.LRopt.mode = mujoco.mjtLRMode.mjLRMODE_NONE  # simulates muscles, which are not read


def _repair_inertias(mujoco: Any, spec: Any) -> Iterator[UnreadElement]:
    """Give impossible bodies an inertia that MuJoCo compiles; yield each."""
    geoms_only = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    for body in spec.bodies:
        is_mended = body.compiler.balanceinertia or body.compiler.inertiafromgeom == geoms_only  # by MuJoCo
        if not body.explicitinertial or is_mended:
            continue
        if np.isfinite(body.fullinertia[0]):
            _make_principal(body)
        try:
            if body.mass < 0:
                raise RobotFileError(f"body {body.name!r}: has a mass of {body.mass:g} kg")
            check_inertia(f"body {body.name!r}: inertia", np.diag(body.inertia))
        except RobotFileError as error:
            yield UnreadElement(f"{body.info}: {error}", (body.name,), is_decisive=True)
            body.mass, body.inertia = max(body.mass, 0.0), np.ones(3)
        # a thin rod's moments, rounded: MuJoCo allows the largest not a digit more than the others' sum
        moments = np.maximum(body.inertia, 0.0)
        largest = int(np.argmax(moments))
        moments[largest] = min(moments[largest], moments.sum() - moments[largest])
        body.inertia = moments


def _make_principal(body: Any) -> None:
    """Replace the inertia matrix of a body by principal moments [kg m^2] and axes."""
    moments, axes = np.linalg.eigh(symmetric_matrix(*body.fullinertia))
    axes[:, 0] *= np.linalg.det(axes)  # right-handed
    turn = pin.Quaternion(axes)
    body.fullinertia = [np.nan, 0, 0, 0, 0, 0]
    body.inertia, body.iquat = moments, [turn.w, turn.x, turn.y, turn.z]


def _delete_needless_meshes(mujoco: Any, spec: Any) -> Iterator[UnreadElement]:
    """Delete meshes without mass and missing meshes; yield the latter as decisive."""
    needed = set()
    for geom in list(spec.geoms):
        if not geom.meshname:
            continue
        body, mesh = geom.parent, spec.mesh(geom.meshname)
        if _adds_mass(mujoco, geom, body):
            name = mesh.file if mesh is not None else geom.meshname
            folder = Path(spec.modelfiledir) / (mesh.compiler.meshdir if mesh is not None else "")
            file = folder / (Path(name).name if spec.strippath else name)
            if mesh is not None and (not name or file.is_file()):
                needed.add(geom.meshname)
                continue
            text = (
                f"{geom.info}: body {body.name!r}: its inertia is that of the mesh {name!r}, which is missing"
            )
            yield UnreadElement(text, (body.name,), is_decisive=True)
        spec.delete(geom)
    for mesh in list(spec.meshes):
        if mesh.name not in needed and Path(mesh.file).stem not in needed:
            spec.delete(mesh)


def _adds_mass(mujoco: Any, geom: Any, body: Any) -> bool:
    """Return whether a geom adds to the mass of its body."""
    rule, kinds = body.compiler.inertiafromgeom, mujoco.mjtInertiaFromGeom
    if rule == kinds.mjINERTIAFROMGEOM_FALSE or (
        rule == kinds.mjINERTIAFROMGEOM_AUTO and body.explicitinertial
    ):
        return False
    lowest, highest = body.compiler.inertiagrouprange
    return bool(lowest <= geom.group <= highest and geom.mass != 0.0 and geom.density != 0.0)


def _compile(spec: Any) -> tuple[Any, list[UnreadElement]]:
    """Compile a specification without refused meshes; return model and decisive omissions."""
    masses, inertias = spec.compiler.boundmass, spec.compiler.boundinertia
    spec.compiler.boundmass = max(masses, STAND_IN_MASS)
    spec.compiler.boundinertia = max(inertias, STAND_IN_INERTIA)
    left_out, model = list[UnreadElement](), None
    while model is None:
        try:
            model = spec.compile()
        except ValueError as error:
            left_out += _delete_refused_meshes(spec, _reorder_error(str(error)))
    if masses < STAND_IN_MASS:
        model.body_mass[model.body_mass <= STAND_IN_MASS] = 0.0
    if inertias < STAND_IN_INERTIA:
        model.body_inertia[model.body_inertia <= STAND_IN_INERTIA] = 0.0
    return model, left_out


def _delete_refused_meshes(spec: Any, error: str) -> list[UnreadElement]:
    """Delete the mesh that an error names, else all meshes, with their geoms."""
    left_out = []
    geoms = [geom for geom in spec.geoms if geom.meshname]
    if not geoms:
        raise RobotFileError(error)
    line = error.partition(": ")[0]
    named = {geom.meshname for geom in geoms if line in (geom.info, spec.mesh(geom.meshname).info)}
    for geom in geoms:
        if geom.meshname in named or not named:
            text = f"body {geom.parent.name!r}: its inertia is that of a mesh: {error}"
            left_out.append(UnreadElement(text, (geom.parent.name,), is_decisive=True))
            spec.delete(geom)
    for mesh in list(spec.meshes):
        if mesh.name in named or not named:
            spec.delete(mesh)
    return left_out
