"""The robots of this project, one short file each; `load` is `framework.load_robot`."""

from __future__ import annotations

from framework.catalogue import load_robot as load
from framework.catalogue import own_robots

__all__ = ["CATALOGUE", "load"]

CATALOGUE = own_robots()
