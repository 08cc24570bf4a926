"""The other simulators, which not everybody has installed.

They come with the extra `witness`. Without it the tests of this folder are skipped, and say so. Where they
must run, as in CI, the environment sets CROSSING_WITNESS=required: then a missing simulator is a failure.
"""

from __future__ import annotations

import os
from importlib import import_module
from types import ModuleType

import pytest

REQUIRED = os.environ.get("CROSSING_WITNESS") == "required"


def witness(simulator: str, module: str) -> ModuleType:
    """The module that uses the simulator; skips the calling test module without it."""
    if not REQUIRED:
        pytest.importorskip(simulator, reason=f"{simulator} is not installed: pip install '.[witness]'")
    return import_module(module)
