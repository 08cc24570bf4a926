"""Count how much code the framework has; `--store` writes the table census.md.

Lines are all lines of the files, nodes those of the syntax tree without docstrings, and records the classes
that are dataclasses or NamedTuples. Only the number of nodes in all is held, by test_census.py; what a plan
calls is held by tests/planning/test_calls.py.
"""

import ast
import sys
from collections import Counter, defaultdict
from pathlib import Path

from tests.test_imports import FILES, FRAMEWORK, imports

TABLE = Path(__file__).with_name("census.md")
PLANNING = "framework.planning.plan"
COUNTS = ("files", "lines", "nodes", "records")
Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def is_record(node: ast.AST) -> bool:
    """Return whether a node defines a dataclass or a NamedTuple."""
    if not isinstance(node, ast.ClassDef):
        return False
    decorators = [d.func if isinstance(d, ast.Call) else d for d in node.decorator_list]
    names = {ast.unparse(expression).rpartition(".")[2] for expression in [*decorators, *node.bases]}
    return bool(names & {"dataclass", "NamedTuple"})


def count(text: str) -> Counter[str]:
    """Count one module."""
    tree = ast.parse(text)
    for owner in ast.walk(tree):
        if isinstance(owner, Documented) and ast.get_docstring(owner, clean=False) is not None:
            owner.body = owner.body[1:] or [ast.Pass()]
    nodes = list(ast.walk(tree))
    return Counter(files=1, lines=text.count("\n"), nodes=len(nodes), records=sum(map(is_record, nodes)))


def reach(module: str) -> set[str]:
    """Return all modules that a module imports, directly or by way of others, with itself."""
    reached, waiting = set[str](), [module]
    while waiting:
        reached.add(waiting[-1])
        waiting += (imports(waiting.pop()) & set(FILES)) - reached
    return reached


def take_census() -> dict[str, Counter[str]]:
    """Count the framework by package, in all, and what planning reaches."""
    packages = defaultdict[str, Counter[str]](Counter)
    planning = reach(PLANNING)
    for module in FRAMEWORK:
        package = ".".join(module.split(".")[:2])
        package = package if FILES[module].parent.name != "framework" else "framework"
        counts = count(FILES[module].read_text(encoding="utf-8"))
        packages[package] += counts
        packages["total"] += counts
        if module in planning:
            packages[f"reached by {PLANNING}"] += counts
    return packages


def format_table(packages: dict[str, Counter[str]]) -> str:
    """Return the census as a table, a package a line."""
    rows = [("package", *COUNTS), ("---", *["---:"] * len(COUNTS))]
    rows += [(package, *(str(counts[name]) for name in COUNTS)) for package, counts in packages.items()]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def read_table(text: str) -> dict[str, Counter[str]]:
    """Return the counts of a stored table, by package."""
    rows = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in text.splitlines()]
    return {row[0]: Counter(dict(zip(COUNTS, map(int, row[1:]), strict=True))) for row in rows[2:]}


if __name__ == "__main__":
    table = format_table(dict(sorted(take_census().items())))
    if "--store" in sys.argv:
        TABLE.write_text(table, encoding="utf-8")
    print(table, end="")
