"""Public names: where they stand, what they return, who uses them, and those of the version before."""

import ast
import importlib
import inspect
import json
import pkgutil
import re
import sys
import typing
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import framework
from framework.moved_modules import MOVED

ROOT = Path(__file__).parents[1]
PACKAGES = ["framework"] + [
    f"framework.{package.name}"
    for package in pkgutil.iter_modules(framework.__path__)
    if package.ispkg and package.name != "cli"
]
PUBLIC = {name: importlib.import_module(name).__all__ for name in PACKAGES}
MODULES = {*PACKAGES, "framework.catalogue", "framework.errors", "framework.cli"}  # of the last, `main`


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_has_the_names_of_its_stub_whatever_was_imported_before(package: str) -> None:
    module = importlib.import_module(package)
    stub = ast.parse(Path(module.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    (stated,) = [ast.literal_eval(node.value) for node in stub.body if isinstance(node, ast.Assign)]
    assert module.__all__ == sorted(stated)
    for name in module.__all__:
        home = getattr(module, name)
        if hasattr(home, "__module__"):  # constants have none
            importlib.import_module(home.__module__)
        assert not inspect.ismodule(getattr(module, name)), name
    with pytest.raises(AttributeError, match=f"'{package}' has no attribute 'nothing'"):
        _ = module.nothing


# ------------------------------------------------------------------ who uses them


def code_of_notebooks() -> Iterator[tuple[str, str]]:
    for file in sorted((ROOT / "notebooks").glob("*.ipynb")):
        cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        python = "\n".join(text for text in code if not text.startswith("%%"))
        yield file.stem, re.sub(r"^(\s*)[%!].*", r"\1pass", python, flags=re.MULTILINE)


def code_of_guides() -> Iterator[tuple[str, str]]:
    for file in [ROOT / "README.md", *sorted(ROOT.glob("*/README.md")), *sorted(ROOT.glob("docs/**/*.md"))]:
        blocks = file.read_text(encoding="utf-8").split("```python\n")[1:]
        yield file.relative_to(ROOT).as_posix(), "\n".join(block.split("```")[0] for block in blocks)


# What measures our own steps in the chart, and data files of this project.
INNER = {
    "framework.dynamics.elasticity",
    "framework.dynamics.forces",
    "framework.fidelity.predicted_level",
    "framework.identification.least_squares",
    "framework.identification.measured_motion",
    "framework.identification.torque_rows",
    "framework.identification.unknowns",
    "framework.kinematics.frames",
    "framework.kinematics.linearised_loops",
    "framework.numerics.output",
    "framework.show.style",
}


def code_of_benchmarks() -> Iterator[tuple[str, str]]:
    for file in sorted((ROOT / "tests" / "benchmarks").rglob("*.py")):
        yield file.relative_to(ROOT).as_posix(), file.read_text(encoding="utf-8")


def imported_from(code: str) -> Iterator[tuple[str, str]]:
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "framework":
            yield from ((str(node.module), alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names if alias.name.startswith("framework"))


@pytest.mark.parametrize(
    ("name", "code"),
    [*code_of_notebooks(), *code_of_guides(), *code_of_benchmarks()],
    ids=lambda value: value[:40],
)
def test_what_users_read_imports_public_names_alone(name: str, code: str) -> None:
    inner = INNER if name.startswith("tests/") else set()
    for module, imported in imported_from(code):
        assert module in MODULES | inner, f"{name} imports {module}"
        if module in PUBLIC and imported:
            assert imported in PUBLIC[module], f"{name} imports {imported} of {module}"


# ------------------------------------------------------------------ what they return


def classes_in(hint: Any) -> Iterator[type]:
    """The classes of this project in a type."""
    if isinstance(hint, type) and hint.__module__.split(".")[0] == "framework":
        yield hint
    for part in typing.get_args(hint):
        yield from classes_in(part)


def functions_of(value: Any) -> Iterator[Any]:
    """A function, or the public methods and properties of a class, and the class for its fields."""
    yield value
    for name, member in vars(value).items() if isinstance(value, type) else ():
        function = (
            getattr(member, "fget", None)
            or getattr(member, "func", None)
            or getattr(member, "__func__", member)
        )
        if name[0] != "_" and inspect.isfunction(function):
            yield function


# Records of the computation, which public ones hold or hand on, and from which their readers need nothing.
OF_THE_COMPUTATION = {
    "Attitude", "Band", "BandFactors", "BranchPoses", "Collocation", "CollocationStep",
    "CompliantMotions", "EquationsOfMotion", "KeptChunks", "Smoothstep", "SpeedBasis", "Stretch", "Terms",
    "WorldForces",
    "Continuation", "Cubics", "DenseFactors", "Equations", "FrameMotions", "FrameStack", "LinearModels",
    "LinearisedLoops", "LineSprings",
    "LockedDirections", "LoopRows", "LoopStructure", "LoopWrenches", "MotorCurves", "Polynomials",
    "Projection", "Shape",
    "Specification",
}  # fmt: skip


def test_a_record_that_a_public_function_takes_or_returns_is_public() -> None:
    exported = {name for names in PUBLIC.values() for name in names}
    classes = {
        name: value
        for package in pkgutil.walk_packages(framework.__path__, "framework.")
        if not package.name.startswith(("framework.cli", "framework.__main__"))
        for name, value in vars(importlib.import_module(package.name)).items()
        if isinstance(value, type) and value.__module__ == package.name
    }
    hidden = {}
    for package, names in PUBLIC.items():
        for name in names:
            value = getattr(importlib.import_module(package), name)
            for function in (
                functions_of(value) if inspect.isroutine(value) or isinstance(value, type) else ()
            ):
                known = {**classes, **vars(sys.modules[function.__module__])}
                try:
                    hints = typing.get_type_hints(function, globalns=known)
                except NameError:  # of a package that is imported when it is needed
                    continue
                for part, hint in hints.items():
                    for found in classes_in(hint) if part[0] != "_" else ():
                        if found.__name__ not in exported | OF_THE_COMPUTATION and found.__name__[0] != "_":
                            hidden[found.__name__] = f"{name}: {part}"
    assert hidden == {}


# ------------------------------------------------------------------ those of the versions before

OPTIONS = [line.split() for line in (ROOT / "tests/data/public_options_of_0.8.txt").read_text().splitlines()]


@pytest.mark.parametrize("package", sorted({package for package, *_ in OPTIONS}))
def test_functions_take_the_options_that_they_took_in_0_8(package: str) -> None:
    for place, path, *options in OPTIONS:
        if place == package:
            function: Any = importlib.import_module(package)
            for name in path.split("."):
                function = getattr(function, name)
            assert set(options) <= inspect.signature(function).parameters.keys(), path


OLD = [tuple(line.split()) for line in (ROOT / "tests/data/public_names_of_0.7.txt").read_text().splitlines()]


@pytest.mark.parametrize("module", sorted({module for module, _ in OLD}))
def test_names_of_0_7_are_found_with_a_warning_where_they_have_moved(module: str) -> None:
    for name in [name for place, name in OLD if place == module]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            value = getattr(importlib.import_module(module), name)
        assert getattr(value, "__name__", name) == name or caught
        if module in MOVED:
            (warning,) = caught
            assert warning.category is DeprecationWarning
            assert warning.filename == __file__
            place = str(warning.message).partition(" is ")[2].partition(" now")[0]
            if place:  # the successor that the warning names
                home, _, today = place.rpartition(".")
                assert getattr(importlib.import_module(home), today) is value


def test_a_name_that_never_was_is_not_found_in_a_module_that_has_moved() -> None:
    with pytest.raises(ImportError, match="nothing"):
        from framework.motion.law import nothing  # type: ignore[import-not-found] # noqa: F401
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("framework.motion.nothing")
