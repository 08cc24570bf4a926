"""Modules of version 0.7 under their old names, with a DeprecationWarning that names the new place.

`install` appends a finder to Python's: it is asked for what all others did not find. Goes in 0.9, with
`dropped_functions`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any
from warnings import warn

# The module of 0.7, and the modules where its names stand today. Packages are those of other keys.
MOVED = {
    "framework.arrays": ("framework.numerics.arrays",),
    "framework.atlas.ranges": ("framework.atlas.workspace_map",),
    "framework.atlas.window": ("framework.atlas.survey", "framework.atlas.workspace_map"),
    "framework.crossing.capacity": ("framework.fidelity.capacity",),
    "framework.crossing.condition": ("framework.planning.condition",),
    "framework.crossing.feasibility": ("framework.planning.feasibility",),
    "framework.crossing.motion_table": ("framework.planning.motion_table",),
    "framework.crossing.neglected_effects": ("framework.planning.neglected_effects",),
    "framework.crossing.options": ("framework.planning.options",),
    "framework.crossing.plan": ("framework.planning.plan",),
    "framework.crossing.request": ("framework.planning.request",),
    "framework.crossing.result": ("framework.planning.result",),
    "framework.crossing.saved": ("framework.planning.saved",),
    "framework.crossing.scenes": ("framework.planning.scenes",),
    "framework.dynamics.forward_derivatives": ("framework.dynamics.forward_dynamics",),
    "framework.export.joint_trajectory": ("framework.files.trajectory_file",),
    "framework.export.mjcf": ("framework.files.mjcf",),
    "framework.export.trajectory_file": ("framework.dropped_functions",),
    "framework.kinematics.continuation.pose_stack": ("framework.kinematics.continuation.forward_kinematics",),
    "framework.kinematics.kinematic_derivatives": ("framework.kinematics.velocity_matrices",),
    "framework.locus.drawn_locus": ("framework.singularity.drawn_locus",),
    "framework.locus.nonsingular_mode_change": ("framework.atlas.nonsingular_mode_change",),
    "framework.locus.traced_locus": ("framework.singularity.traced_locus",),
    "framework.motion.chebyshev": ("framework.numerics.chebyshev",),
    "framework.motion.law": ("framework.laws.law",),
    "framework.motion.optimal_law": ("framework.laws.optimal_law",),
    "framework.motion.path": ("framework.laws.path", "framework.laws.curves"),
    "framework.public": ("framework",),
    "framework.show.locus_figures": ("framework.show.map",),
    "framework.statics.loading": ("framework.dynamics.loading",),
    "framework.statics.stiffness": ("framework.dynamics.stiffness", "framework.dropped_functions"),
    "framework.statics.vibrations": ("framework.dropped_functions",),
}
RENAMED = {
    "advance_through": "speed_ratios_and_peaks",
    "along": "time_derivatives",
    "assembly_mode_change": "find_mode_change",
    "orders_of": "law_derivatives",
}
_PACKAGES = {f"framework.{package}" for package in ("crossing", "export", "locus", "motion", "statics")}


def find_successor(name: str, modules: Sequence[str]) -> tuple[str, Any]:
    """Return the place of a name today, its package if it is public there, and its value.

    Raises:
        AttributeError: no module has it.
    """
    for module in modules:
        package = import_module(".".join(module.split(".")[:2]))
        place = package if name in getattr(package, "__all__", ()) else import_module(module)
        if name in vars(place) or name in getattr(place, "__all__", ()):
            return f"{place.__name__}.{name}", getattr(place, name)
    raise AttributeError(f"{name}: not in {' or '.join(modules)}")


class _MovedModule(ModuleType):
    """A module of 0.7, whose names are looked up in today's."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or self.__name__ not in MOVED:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        place, value = find_successor(RENAMED.get(name, name), MOVED[self.__name__])
        has_moved = not place.startswith("framework.dropped_functions")
        remedy = f"is {place} now; the old place goes in 0.9" if has_moved else "goes in 0.9"
        warn(f"{self.__name__}.{name} {remedy}", DeprecationWarning, stacklevel=2)
        return value


class _MovedModules:
    """Find and make modules that have moved."""

    def find_spec(self, fullname: str, path: object, target: object = None) -> ModuleSpec | None:
        if fullname in MOVED or fullname in _PACKAGES:
            return ModuleSpec(fullname, self, is_package=fullname in _PACKAGES)  # type: ignore[arg-type]
        return None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _MovedModule(spec.name, "A module of version 0.7, which has moved.")

    def exec_module(self, module: ModuleType) -> None:
        """Leave the module empty: its names are looked up when they are asked for."""


def install() -> None:
    """Let Python find modules of 0.7, after all others."""
    if not any(isinstance(finder, _MovedModules) for finder in sys.meta_path):
        sys.meta_path.append(_MovedModules())


def renamed_names(module: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """Return `__getattr__` of a module of which functions have other names than in 0.7."""

    def get_name(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        warn(
            f"{module}.{name} is {names[name]} now; the old name goes in 0.9",
            DeprecationWarning,
            stacklevel=2,
        )
        return getattr(sys.modules[module], names[name])

    return get_name
