"""The other simulators, and dask, which not everybody has installed.

They come with the extras `witness` and `dask`. Without these the tests of this folder are skipped, and say
so. Where they must run, as in CI, the environment sets CROSSING_WITNESS=required: then a missing package is
a failure.
"""

import os
from importlib import import_module
from types import ModuleType

import pytest

REQUIRED = os.environ.get("CROSSING_WITNESS") == "required"


def witness(package: str, module: str, *, extra: str = "witness") -> ModuleType:
    """The module that uses the package; skips the calling test module without it."""
    if not REQUIRED:
        pytest.importorskip(package, reason=f"{package} is not installed: pip install '.[{extra}]'")
    return import_module(module)
