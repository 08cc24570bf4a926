"""The catalogue: one short file for each mechanism, found here by name."""

from __future__ import annotations

from framework import ParallelRobot
from framework.catalogue import CatalogueEntry
from framework.errors import InvalidInput, choose_from
from robots import five_bar, five_bar_heavy

CATALOGUE: dict[str, CatalogueEntry] = {entry.name: entry for entry in (five_bar.ENTRY, five_bar_heavy.ENTRY)}


def load(name: str, *, flexibility: str = "rigid") -> ParallelRobot:
    """A robot of the catalogue: rigid, flexible_joints or flexible_links.

    Raises:
        InvalidInput: unknown name or flexibility; lists the valid ones.
    """
    if name not in CATALOGUE:
        raise InvalidInput(choose_from("robot", name, CATALOGUE))
    return CATALOGUE[name].load(flexibility)
