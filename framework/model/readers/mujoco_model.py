"""Compile an MJCF file with MuJoCo, without the parts that no motion needs.

MuJoCo resolves defaults, classes, includes, frames, units and the inertia of geoms. Before that, plugins,
textures, sensors and meshes without mass are removed, so that they may be missing. MuJoCo refuses bodies
without mass; they are given a small mass for the compilation and are massless afterwards.

In the functions `mujoco` is the imported package, and `spec` is an MjSpec: MuJoCo's specification of a model,
whose elements can be changed and deleted before it is compiled.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from math import prod
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from framework.errors import MissingPackage, RobotFileError
from framework.model.documents import erase_matches, parse_xml
from framework.model.placement import to_quaternion
from framework.model.readers.urdf_tree import UnreadElement
from framework.model.urdf_elements import check_inertia, symmetric_matrix
from framework.numerics.input import read_text

# the arrays that each flag of <option> disables
_ARRAYS_OF_FLAG = {
    "SPRING": ("jnt_stiffness", "jnt_stiffnesspoly", "tendon_stiffness"),
    "DAMPER": ("dof_damping", "dof_dampingpoly", "tendon_damping", "actuator_damping"),
    "FRICTIONLOSS": ("dof_frictionloss", "tendon_frictionloss"),
    "LIMIT": ("jnt_limited", "tendon_limited"),
    "GRAVITY": ("body_gravcomp",),
}
_UNUSED = ("sensors", "pairs", "excludes", "tuples", "skins", "lights", "textures", "materials", "hfields")
# Elements of which a few characters make many parts: attributes with numbers, and the most that is read of
# their product. MuJoCo takes a second for each thousand of copies, and a field of numbers for each body.
_USER_DATA = ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor")
_LARGEST_PRODUCT: dict[str, tuple[tuple[str, ...], int]] = {
    "replicate": (("count",), 1000),
    "flexcomp": (("count",), 1000),
    "composite": (("count",), 1000),
    "hfield": (("nrow", "ncol"), 4_000_000),
    "size": (("nkey", *(f"nuser_{kind}" for kind in _USER_DATA)), 10_000),
}
MAX_COPIES = 5000  # of elements in <replicate>
_PLUGIN = re.compile(  # one without an end is sought once
    r"<extension\b.*?(?:</extension\s*>|\Z)|<plugin\b[^<>]*/>|<plugin\b.*?(?:</plugin\s*>|\Z)", re.DOTALL
)


def compile_mjcf(file: Path) -> tuple[Any, list[UnreadElement], Counter[str]]:
    """Return the compiled model, unread elements, and counts of unused elements by kind.

    Raises:
        MissingPackage: MuJoCo is not installed.
        RobotFileError: MuJoCo refuses the file.
    """
    try:
        import mujoco
    except ImportError:
        raise MissingPackage(
            "MJCF is read by MuJoCo itself, which is not installed: pip install 'mujoco>=4.0'",
            package="mujoco",
        ) from None
    try:
        with ExitStack() as silence, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # MuJoCo warns of stand-in masses
            silence.callback(mujoco.set_mju_user_warning, mujoco.get_mju_user_warning())
            mujoco.set_mju_user_warning(lambda _: None)  # the default writes into the working directory
            return _compile_usable_parts(mujoco, _load_spec(mujoco, file))
    except RobotFileError:
        raise
    except (ValueError, RuntimeError) as error:  # how MuJoCo refuses a file
        raise RobotFileError(_reorder_error(str(error))) from None


def check_expansion(root: Element, folder: Path) -> None:
    """Refuse a file that MuJoCo would expand to more than a robot needs.

    Args:
        root: of the MJCF.
        folder: of the file, from which paths of included files start.

    Raises:
        RobotFileError: an element of the file or of an included one has too many parts, or all `<replicate>`
            make too many copies.
    """
    included: set[Path] = set()
    copies_of_all = 0.0
    remaining = [(root, 1.0)]  # elements, with the number of copies of each
    while remaining:
        element, copies = remaining.pop()
        copies_of_all += copies if copies > 1.0 else 0.0
        names, largest = _LARGEST_PRODUCT.get(element.tag, ((), 1))
        numbers = " ".join(element.get(name, "1") for name in names).split()
        product = prod(max(float(number), 1.0) for number in numbers if number.isdecimal())
        if product > largest:
            stated = " ".join(filter(element.get, names))
            raise RobotFileError(f"<{element.tag}> {stated}: {product:g} parts; at most {largest} are read")
        if copies_of_all > MAX_COPIES:
            raise RobotFileError(f"<replicate>: more than {MAX_COPIES} copies of elements")
        if element.tag == "replicate":
            copies *= product
        remaining += [(child, copies) for child in element]
        file = folder / element.get("file", "")
        if element.tag == "include" and file not in included and file.is_file():
            included.add(file)
            content = parse_xml(read_text(file, f"{file}: cannot read it", error=RobotFileError))
            remaining.append((content, copies))


def member_name(enumeration: str, number: int) -> str:
    """Return the name of a member of one of MuJoCo's enumerations, such as mjJNT_BALL of mjtJoint."""
    import mujoco

    return str(getattr(mujoco, enumeration)(number).name)


def _compile_usable_parts(mujoco: Any, spec: Any) -> tuple[Any, list[UnreadElement], Counter[str]]:
    """Compile a specification without the parts that MuJoCo refuses or that no motion needs.

    Returns:
        The compiled model, unread elements, and counts of unused elements by kind.
    """
    unused = Counter({kind: len(getattr(spec, kind)) for kind in (*_UNUSED, "cameras")})
    left_out = [*_delete_unused(mujoco, spec), *_repair_inertias(mujoco, spec)]
    left_out += _delete_needless_meshes(mujoco, spec)
    key_size = len(spec.keys[0].qpos) if spec.keys else 0  # of the file: the compiler changes the size

    # MuJoCo refuses bodies without mass, which get small stand-ins for the compilation, and some meshes
    stand_in_mass = 1e-12  # [kg]; MuJoCo refuses less than 1e-15
    stand_in_inertia = 1e-14  # [kg m^2]
    least_mass, least_inertia = spec.compiler.boundmass, spec.compiler.boundinertia  # as the file states
    spec.compiler.boundmass = max(least_mass, stand_in_mass)
    spec.compiler.boundinertia = max(least_inertia, stand_in_inertia)
    compiled = None
    while compiled is None:
        try:
            compiled = spec.compile()
        except ValueError as error:
            left_out += _delete_refused_meshes(spec, _reorder_error(str(error)))
    if least_mass < stand_in_mass:
        compiled.body_mass[compiled.body_mass <= stand_in_mass] = 0.0
    if least_inertia < stand_in_inertia:
        compiled.body_inertia[compiled.body_inertia <= stand_in_inertia] = 0.0
    if key_size not in (0, compiled.nq):
        raise RobotFileError(
            f"<key> {spec.keys[0].name!r} qpos: needs {compiled.nq} numbers, one a coordinate, got {key_size}"
        )
    _apply_flags(mujoco, compiled)
    return compiled, left_out, unused


def _apply_flags(mujoco: Any, compiled: Any) -> None:
    """Zero the effects in the compiled model that flags of the file disable; refuse disabled loops.

    `mujoco` is the package, here and below, which is imported only where it is needed.
    """
    disabled = [
        name.removeprefix("mjDSBL_")
        for name, flag in mujoco.mjtDisableBit.__members__.items()
        if compiled.opt.disableflags & flag
    ]
    for name in ("EQUALITY", "CONSTRAINT"):
        if name in disabled and compiled.eq_active0.any():
            raise RobotFileError(f"<flag> {name.lower()}: disabled, so there would be no loop")
    for name in disabled:
        for array_name in _ARRAYS_OF_FLAG.get(name, ()):
            getattr(compiled, array_name)[:] = 0  # in place
    if "GRAVITY" in disabled:
        compiled.opt.gravity[:] = 0.0


def _reorder_error(error: str) -> str:
    """Return MuJoCo's error as one line that begins with line number and element."""
    text = " ".join(re.sub(r"^((XML )?Error: )+", "", error).split())
    match = re.search(r" Element (name )?'(?P<name>[^']*)'(, id \d+)?, line (?P<line>\d+)$", text)
    if match is None:
        return f"MuJoCo: {text}"
    name = f"{match['name']!r}: " if match["name"] else ""
    line = f"line {match['line']}"
    return f"{_place(line)}{name}MuJoCo: {text[: match.start()]}"


def _place(info: str) -> str:
    """Return "line N: " from an element's `info`; empty for the 0 that MuJoCo has for included files."""
    return "" if info == "line 0" else f"{info}: "


def _load_spec(mujoco: Any, file: Path) -> Any:
    """Load MuJoCo's specification of a file, without plugins if MuJoCo lacks any."""
    try:
        return mujoco.MjSpec.from_file(str(file))
    except ValueError as error:
        if "plugin" not in str(error):
            raise
    text = erase_matches(_PLUGIN, read_text(file, "cannot read it", error=RobotFileError))
    spec = mujoco.MjSpec.from_string(text, include=dict(_included_files(file.parent, text)))
    spec.modelfiledir = str(file.parent)
    return spec


def _included_files(folder: Path, text: str) -> Iterator[tuple[str, bytes]]:
    """Yield name and content, without plugins, of each file that an MJCF text includes, recursively.

    `folder` is that of the file with the text.
    """
    for name in re.findall(r"<include\s+file\s*=\s*[\"']([^\"']+)", text):
        content = read_text(folder / name, f"<include> {name!r}: cannot read it", error=RobotFileError)
        usable_content = erase_matches(_PLUGIN, content)
        yield name, usable_content.encode()
        yield from _included_files(folder, usable_content)


def _delete_unused(mujoco: Any, spec: Any) -> Iterator[UnreadElement]:
    """Delete elements of the specification that no motion needs; yield actuators that a plugin drives."""
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
    spec.compiler.fusestatic = False  # so that each body keeps its name
    # no simulation for the length ranges of muscles, which are not read
    spec.compiler.LRopt.mode = mujoco.mjtLRMode.mjLRMODE_NONE


def _repair_inertias(mujoco: Any, spec: Any) -> Iterator[UnreadElement]:
    """Give bodies with an impossible inertia one that MuJoCo compiles; yield each such body."""
    geoms_only = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    for body in spec.bodies:
        # MuJoCo itself repairs or replaces such inertias
        is_replaced = body.compiler.balanceinertia or body.compiler.inertiafromgeom == geoms_only
        if not body.explicitinertial or is_replaced:
            continue
        if np.isfinite(body.fullinertia[0]):  # the file states a matrix: principal moments and axes instead
            body.inertia, axes = np.linalg.eigh(symmetric_matrix(*body.fullinertia))
            axes[:, 0] *= np.linalg.det(axes)  # makes the axes right-handed
            body.iquat = to_quaternion(axes)
            body.fullinertia = [np.nan, 0, 0, 0, 0, 0]  # MuJoCo's mark for no inertia matrix
        try:
            if body.mass < 0:
                raise RobotFileError(f"body {body.name!r}: has a mass of {body.mass:g} kg")
            check_inertia(f"body {body.name!r}: inertia", np.diag(body.inertia))
        except RobotFileError as error:
            yield UnreadElement(f"{_place(body.info)}{error}", (body.name,), is_decisive=True)
            body.mass = max(body.mass, 0.0)
            body.inertia = np.ones(3)  # any that is possible: the file is refused if the body moves
        # The largest moment of a thin rod is the sum of the others. MuJoCo allows no rounding above it.
        moments = np.maximum(body.inertia, 0.0)
        largest = moments.argmax()
        moments[largest] = min(moments[largest], moments.sum() - moments[largest])
        body.inertia = moments


def _delete_needless_meshes(mujoco: Any, spec: Any) -> Iterator[UnreadElement]:
    """Delete meshes without mass and missing meshes with mass; yield the latter as decisive."""
    needed = set()
    for geom in list(spec.geoms):
        if not geom.meshname:
            continue
        if _adds_mass(mujoco, geom):
            if _has_mesh(spec, geom):
                needed.add(geom.meshname)
                continue
            mesh = spec.mesh(geom.meshname)
            name = geom.meshname if mesh is None else mesh.file
            body = geom.parent.name
            what = f"its inertia is that of the mesh {name!r}, which is missing"
            text = f"{_place(geom.info)}body {body!r}: {what}"
            yield UnreadElement(text, (body,), is_decisive=True)
        spec.delete(geom)
    for mesh in list(spec.meshes):
        if mesh.name not in needed and Path(mesh.file).stem not in needed:
            spec.delete(mesh)


def _has_mesh(spec: Any, geom: Any) -> bool:
    """Return whether a geom's mesh is in the specification or in a file."""
    mesh = spec.mesh(geom.meshname)
    if mesh is None:
        return False
    file = Path(mesh.file).name if spec.strippath else mesh.file  # empty if vertices are stated
    return not mesh.file or (Path(spec.modelfiledir) / mesh.compiler.meshdir / file).is_file()


def _adds_mass(mujoco: Any, geom: Any) -> bool:
    """Return whether a geom adds to the mass of its body."""
    body = geom.parent
    rules = mujoco.mjtInertiaFromGeom
    rule = body.compiler.inertiafromgeom
    if rule == rules.mjINERTIAFROMGEOM_FALSE:
        return False
    if rule == rules.mjINERTIAFROMGEOM_AUTO and body.explicitinertial:
        return False
    lowest, highest = body.compiler.inertiagrouprange
    return bool(lowest <= geom.group <= highest and geom.mass != 0.0 and geom.density != 0.0)


def _delete_refused_meshes(spec: Any, error: str) -> Iterator[UnreadElement]:
    """Delete the geoms with the mesh that an error names, else with any mesh; yield each geom.

    `error` is MuJoCo's, as `_reorder_error` returns it.
    """
    geoms = [geom for geom in spec.geoms if geom.meshname]
    if not geoms:
        raise RobotFileError(error)
    line = error.partition(": ")[0]  # the place in the file, which is the `info` of an element
    named = {geom.meshname for geom in geoms if line in (geom.info, spec.mesh(geom.meshname).info)}
    for geom in geoms:
        if geom.meshname in named or not named:
            body = geom.parent.name
            text = f"body {body!r}: its inertia is that of a mesh: {error}"
            yield UnreadElement(text, (body,), is_decisive=True)
            spec.delete(geom)
    for mesh in list(spec.meshes):
        if mesh.name in named or not named:
            spec.delete(mesh)
