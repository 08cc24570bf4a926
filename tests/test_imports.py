"""Imports run one way.

errors <- input <- output, linalg, motion <- model <- kinematics <- singularity | simulation <- dynamics <-
crossing <- control <- show, cli <- robots <- tests
"""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# From the ground up; a part imports from itself and from the floors below it.
FLOORS = (
    ("arrays",),
    ("errors", "interruption"),
    ("input",),
    ("output", "linalg", "motion"),
    ("model",),
    ("kinematics", "catalogue"),
    ("singularity", "simulation"),  # neither knows the other: simulation is the witness
    ("dynamics",),
    ("crossing",),
    ("control",),
    ("show", "__init__"),  # __init__ is the public face: `import framework` draws nothing
    ("cli",),
    ("__main__",),
)
FLOOR = {part: floor for floor, parts in enumerate(FLOORS) for part in parts}
FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path
    for package in ("framework", "robots")
    for path in sorted((ROOT / package).rglob("*.py"))
}
FRAMEWORK = [name for name in FILES if name.startswith("framework.")]


def imports(module: str) -> set[str]:
    """Modules that a module imports, wherever in its text."""
    found = set()
    for node in ast.walk(ast.parse(FILES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            base = node.module or ""
            found |= {f"{base}.{a.name}" if f"{base}.{a.name}" in FILES else base for a in node.names}
    return {f"{name}.__init__" if f"{name}.__init__" in FILES else name for name in found}


@pytest.mark.parametrize("module", FRAMEWORK)
def test_a_part_of_the_framework_imports_only_from_the_floors_below(module):
    part = module.split(".")[1]
    for name in imports(module):
        assert name.split(".")[0] not in ("robots", "tests"), f"{module} imports {name}"
        if name.startswith("framework."):
            other = name.split(".")[1]
            assert other == part or FLOOR[other] < FLOOR[part], f"{module} imports {name}"


def test_what_the_readers_of_dialects_are_made_of_stands_below_them():
    for module in FRAMEWORK:
        if module.startswith("framework.model.") and not module.startswith("framework.model.readers."):
            found = {name for name in imports(module) if name.startswith("framework.model.readers")}
            assert not found, f"{module} imports {found}"


@pytest.mark.parametrize("module", FILES)
def test_drawing_is_for_show_alone(module):
    drawing = {name for name in imports(module) if name.split(".")[0] in ("matplotlib", "meshcat")}
    assert not drawing or module.startswith("framework.show."), f"{module} imports {drawing}"


def test_no_module_imports_itself_by_way_of_others():
    graph = {module: {name for name in imports(module) if name in FILES} for module in FILES}
    assert len(list(TopologicalSorter(graph).static_order())) == len(FILES)  # raises CycleError
