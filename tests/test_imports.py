"""Imports run one way.

tolerances <- errors <- numerics <- laws <- model <- kinematics <- singularity | simulation | proofs <-
dynamics <- planning <- fidelity | atlas | identification | control | files <- show, cli <- robots <- tests
"""

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# From the ground up; a part imports from itself and from the floors below it.
FLOORS = (
    ("tolerances", "moved_modules"),
    ("errors",),
    ("argument_errors",),
    ("lazy_names",),
    ("numerics",),  # knows no robot
    ("laws",),
    ("model",),
    ("kinematics",),
    ("singularity", "simulation", "proofs", "catalogue"),  # none knows another: no plan stands on a proof
    ("dynamics",),
    ("planning",),
    (
        "fidelity",
        "atlas",
        "identification",
        "control",
        "files",
    ),  # applications, of which none imports another
    ("show", "dropped_functions"),
    ("__init__", "cli"),
    ("__main__",),
)
FLOOR = {part: floor for floor, parts in enumerate(FLOORS) for part in parts}
FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path
    for package in ("framework", "robots")
    for path in sorted((ROOT / package).rglob("*.py"))
}
FRAMEWORK = [name for name in FILES if name.startswith("framework.")]


# What people look at and type with. They ask questions of the parts below; they compute no answers.
FACES = [name for name in FRAMEWORK if name.split(".")[1] in ("show", "cli")]
# From the parts that compute, only what answers a question whole may come in: these modules, or these of
# their names. No equations, no solvers, no measures to evaluate.
QUESTIONS = {
    "framework.proofs.assembly_modes": {"assembly_modes"},
    "framework.proofs.working_modes": {"working_modes"},
    "framework.proofs.converted_reference": None,
    "framework.kinematics.diagnostics.diagnosis": None,
    "framework.kinematics.diagnostics.mistaken_units": None,
    "framework.kinematics.diagnostics.proposal": None,
    "framework.kinematics.continuation.forward_kinematics": None,
    "framework.kinematics.motion_rates": {"Motion"},
    "framework.kinematics.external_wrenches": {"AppliedWrench", "wrench_on_platform"},
    "framework.kinematics.mechanism": {"Mechanism"},
    "framework.kinematics.diagnostics.mobility": None,
    "framework.kinematics.parallel_robot": {"ParallelRobot"},
    "framework.kinematics.assembly": {"configuration", "remark_on_turns"},
    "framework.kinematics.assembly_search": {"can_close", "find_closed_pose"},
    "framework.kinematics.placements": None,
    "framework.kinematics.platform": {"FramePlatform"},
    "framework.kinematics.continuation.tracking": {"assemble", "reach_of_links", "remark_on_reach"},
    "framework.kinematics.velocity_matrices": None,
    "framework.dynamics.result": None,
    "framework.singularity.type2": {"moves_point"},
    "framework.atlas.nonsingular_mode_change": {"AssemblyModeChange"},
    "framework.singularity.pose_classes": None,
    "framework.singularity.jogging": None,
    "framework.singularity.drawn_locus": {"LocusCurves", "locus_curves", "locus_patch"},
    "framework.singularity.points_on_path": {
        "SearchedPath",
        "SingularPoint",
        "locate_singularities",
        "search_path",
        "spring_shift",
    },
    "framework.singularity.traced_locus": None,
    "framework.dynamics.finite_differences": None,
    "framework.dynamics.loading": {"LOAD_WORDS", "LoadReason"},
    "framework.dynamics.motor_limits": {"motor_limits"},
    "framework.dynamics.platform_wrench": None,
    "framework.dynamics.instant": {"Instant"},
    "framework.dynamics.pointwise_dynamics": None,
    "framework.dynamics.stiffness": {"PlatformStiffness", "platform_stiffness"},
    "framework.dynamics.vibrations": {"Vibrations", "platform_vibrations"},
    "framework.simulation": {"Simulation", "simulate"},
    "framework.simulation.methods": {"METHODS"},
}
COMPUTE = ("kinematics", "proofs", "singularity", "simulation", "dynamics")
# of `numerics`, which also writes files
LINEAR_ALGEBRA = {
    "framework.numerics.banded_lu",
    "framework.numerics.ordered_sums",
    "framework.numerics.polytope",
    "framework.numerics.rotations",
}


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """All statements below a node; expressions, nine tenths of a tree, are not looked at."""
    for child in [*getattr(node, "body", ()), *getattr(node, "orelse", ()), *getattr(node, "finalbody", ())]:
        yield child
        yield from statements(child)
    for child in [*getattr(node, "handlers", ()), *getattr(node, "cases", ())]:
        yield from statements(child)


@cache
def imports(module: str) -> frozenset[str]:
    """Modules that a module imports, wherever in its text."""
    found = set()
    for node in statements(ast.parse(FILES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            base = node.module or ""
            found |= {f"{base}.{a.name}" if f"{base}.{a.name}" in FILES else base for a in node.names}
    return frozenset(f"{name}.__init__" if f"{name}.__init__" in FILES else name for name in found)


def test_a_part_of_the_framework_imports_only_from_the_floors_below():
    for module in FRAMEWORK:
        part = module.split(".")[1]
        for name in imports(module):
            assert name.split(".")[0] not in ("robots", "tests"), f"{module} imports {name}"
            if name.startswith("framework."):
                other = name.split(".")[1]
                assert other == part or FLOOR[other] < FLOOR[part], f"{module} imports {name}"


def test_what_the_readers_of_dialects_are_made_of_stands_below_them():
    readers = {name for name in FRAMEWORK if name.startswith("framework.model.readers.")}
    below, waiting = set[str](), sorted(readers)
    while waiting:
        new = imports(waiting.pop()) & set(FRAMEWORK) - readers - below
        below |= new
        waiting += new
    assert "framework.model.robot_file" in below
    for module in below:
        assert not imports(module) & readers, f"{module} imports {imports(module) & readers}"


def test_drawing_is_for_show_alone():
    for module in FILES:
        drawing = {name for name in imports(module) if name.split(".")[0] in ("matplotlib", "meshcat")}
        assert not drawing or module.startswith("framework.show."), f"{module} imports {drawing}"


@pytest.mark.parametrize("module", FACES)
def test_what_is_looked_at_and_typed_computes_nothing(module):
    """show draws and cli parses: no equations, no solver, no linear algebra but lengths of vectors."""
    for node in ast.walk(ast.parse(FILES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            taken = {node.module: {alias.name for alias in node.names}}
        elif isinstance(node, ast.Import):
            taken = {alias.name: {"*"} for alias in node.names}
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value).endswith(".linalg"):
            assert node.attr == "norm", f"{module} uses {ast.unparse(node)}"
            continue
        else:
            continue
        for source, names in taken.items():
            package, _, rest = source.partition(".")
            assert package not in ("scipy", "pinocchio", "coal"), f"{module} imports {source}"
            assert package != "numpy" or rest in ("", "typing"), f"{module} imports {source}"
            if package == "framework" and (rest.split(".")[0] in COMPUTE or source in LINEAR_ALGEBRA):
                assert source in QUESTIONS, f"{module} imports {source}"
                others = names - (names if QUESTIONS[source] is None else QUESTIONS[source])
                assert not others, f"{module} imports {others} of {source}"


def test_no_module_imports_itself_by_way_of_others():
    graph = {module: {name for name in imports(module) if name in FILES} for module in FILES}
    assert len(list(TopologicalSorter(graph).static_order())) == len(FILES)  # raises CycleError


def test_no_plan_stands_on_a_proof():
    """All that planning a crossing imports, directly or by way of others, lies outside of `proofs`."""
    waiting, reached = ["framework.planning.plan"], set[str]()
    while waiting:
        module = waiting.pop()
        reached.add(module)
        waiting += sorted(name for name in imports(module) if name in FILES and name not in reached)
    assert "framework.planning.condition" in reached
    assert not {name for name in reached if name.startswith("framework.proofs.")}


GIVEN = {"ParallelRobot", "Line", "CrossingPlan"}


@pytest.mark.parametrize(
    "file", sorted((ROOT / "tests" / "oracles").glob("[!t]*.py")), ids=lambda file: file.stem
)
def test_an_oracle_takes_from_the_framework_what_is_given_and_nothing_that_is_computed(file):
    """The robot as described, the path asked for, the plan to be judged; no equation of what judges it."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "framework":
            names = {alias.name for alias in node.names}
            given = node.module.startswith("framework.model") or names <= GIVEN
            assert given, f"{file.name} imports {names} of {node.module}"
