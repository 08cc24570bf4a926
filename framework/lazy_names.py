"""Names of a package, imported when they are first used; its `__init__.pyi` says where each stands."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any


def lazy_names(
    package: str, file: str, modules: tuple[str, ...] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package, whose `__init__.py` is `file`.

    Args:
        modules: those of the package that share their names with public functions. Python sets a module as
            an attribute of its package when it is imported; these are not set, so that the functions stay.
    """

    @cache
    def homes() -> dict[str, str]:
        import ast  # takes longer to import than a package without it

        tree = ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8"))
        imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
        return {alias.name: str(node.module) for node in imports for alias in node.names}

    def get_name(name: str) -> Any:
        if name == "__all__":
            return sorted(homes())
        if name.startswith("_") or name not in homes():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(homes()[name]), name)
        if isinstance(value, FunctionType):
            value = _explain_errors(value)
            value.__module__ = package  # by which it is pickled
        return value

    class Package(ModuleType):
        def __setattr__(self, name: str, value: object) -> None:
            if name not in modules or not isinstance(value, ModuleType):
                super().__setattr__(name, value)

    if modules:
        sys.modules[package].__class__ = Package
    return get_name, lambda: sorted(homes())


@cache
def _explain_errors(function: FunctionType) -> Callable[..., Any]:
    """Return a public function with errors that name the wrong argument; one object for all packages."""
    from framework.argument_errors import explain_errors  # imports numpy

    return explain_errors(function)


def notebook_picture(function: str) -> Callable[..., tuple[dict[str, Any], dict[str, Any]]]:
    """Return the method `_repr_mimebundle_` of a class whose objects `framework.show` draws by a function.

    The packages that define robots, plans and maps import no drawing; a notebook asks for it.
    """

    def bundle(
        self: Any, include: object = None, exclude: object = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        picture, metadata = getattr(import_module("framework.show"), function)(self)
        return {"text/plain": repr(self), "image/png": picture}, {"image/png": metadata}

    return bundle
