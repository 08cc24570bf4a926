"""The catalogue: one short file for each mechanism, found here by name.

A file of this package with an `ENTRY` is in the catalogue; nothing else needs to know it.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import Never

from framework.catalogue import CatalogueEntry
from framework.errors import InvalidInput, choose_from, short
from framework.kinematics.parallel_robot import ParallelRobot


def _entries() -> dict[str, CatalogueEntry]:
    modules = [import_module(f"{__name__}.{found.name}") for found in iter_modules(__path__)]
    entries = [module.ENTRY for module in modules if hasattr(module, "ENTRY")]
    return {entry.name: entry for entry in entries}


CATALOGUE: dict[str, CatalogueEntry] = _entries()


def load(name: str, *misplaced: Never, flexibility: str = "rigid") -> ParallelRobot:
    """A robot of the catalogue: rigid, flexible_joints or flexible_links.

    Raises:
        InvalidInput: unknown name or flexibility; lists the valid ones.
    """
    if misplaced:
        given = short(misplaced[0])
        raise InvalidInput(f"flexibility: has to be given by name, flexibility={given}, got {given} alone")
    if name not in tuple(CATALOGUE):  # whatever it is, hashable or not
        raise InvalidInput(choose_from("robot", name, CATALOGUE))
    return CATALOGUE[name].load(flexibility=flexibility)
