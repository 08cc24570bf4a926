"""Writes the URDFs of all generators beside their robot files: python -m robots.generators"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from framework.catalogue import URDF

if __name__ == "__main__":
    for found in iter_modules([str(Path(__file__).parent)]):
        if found.name not in ("__main__", "elements"):
            for name, text in import_module(f"robots.generators.{found.name}").files().items():
                (URDF / name).write_text(text, encoding="utf-8")
