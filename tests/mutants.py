"""Mutants of the framework, and the tests that notice them: `python -m tests.mutants --seed 7 --count 40`.

A mutant changes one operator, comparison, number or term of one function. Packages are drawn alike, in them
functions. The tests that touch the module run on a copy of the checkout: those of its package and those that
import it, then those that import a module that does. A mutant survives if all pass; somebody must then judge
whether it is equivalent, and which law is missing. Tests that change source themselves ("idle") are left out.
"""

from __future__ import annotations

import argparse
import ast
import copy
import difflib
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

SOURCES = ("framework", "robots", "urdf", "tests", "notebooks")  # folders that are copied
SWAPPED: dict[type, type] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Lt: ast.Gt,
    ast.Gt: ast.Lt,
    ast.LtE: ast.GtE,
    ast.GtE: ast.LtE,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum", "maximum": "minimum"}


class Mutant(NamedTuple):
    """A module with one change."""

    path: Path  # relative to the checkout
    function: str
    text: str  # of the mutated module


def mutations(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the changes of one expression or statement."""
    if isinstance(node, ast.BinOp) and type(node.op) in SWAPPED:
        yield ast.BinOp(node.left, SWAPPED[type(node.op)](), node.right)
        if isinstance(node.op, ast.Add | ast.Sub | ast.Mult):
            yield node.left
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPPED:
        yield ast.Compare(node.left, [SWAPPED[type(node.ops[0])](), *node.ops[1:]], node.comparators)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(SWAPPED[type(node.op)](), node.values)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not | ast.Invert):
        yield node.operand
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield ast.Constant(
            1.5 * node.value if isinstance(node.value, float) and node.value else node.value + 1
        )
    elif isinstance(node, ast.Attribute | ast.Name):
        name = node.attr if isinstance(node, ast.Attribute) else node.id
        if name in NAMES:
            changed = copy.copy(node)
            setattr(changed, "attr" if isinstance(node, ast.Attribute) else "id", NAMES[name])
            yield changed
    elif isinstance(node, ast.AugAssign):
        yield ast.Pass()


def mutants_of(checkout: Path, path: Path) -> list[Mutant]:
    """Return all mutants of the functions of a module; messages, annotations and defaults stay."""
    text = (checkout / path).read_text()
    starts = [0]  # in bytes, of the lines
    for line in text.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = list[Mutant]()

    def visit(node: ast.AST, function: str) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Raise | ast.JoinedStr | ast.arguments | ast.AnnAssign):
                continue
            if isinstance(child, ast.FunctionDef):
                for statement in child.body:
                    visit(ast.Module([statement], []), child.name)
                continue
            if function and hasattr(child, "col_offset"):
                first = starts[child.lineno - 1] + child.col_offset
                last = starts[child.end_lineno - 1] + child.end_col_offset
                for change in mutations(child):
                    new = ast.unparse(ast.fix_missing_locations(change))
                    new = (
                        f"({new})" if isinstance(child, ast.expr) and not isinstance(child, ast.Name) else new
                    )
                    changed = text.encode()[:first] + new.encode() + text.encode()[last:]
                    found.append(Mutant(path, function, changed.decode()))
            visit(child, function)

    visit(ast.parse(text), "")
    return found


@cache
def imported(path: Path) -> set[str]:
    """Return the modules of the framework that a file imports; of `from framework import x` that of x."""
    import framework

    names = set[str]()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("framework"):
            names.add(node.module)
            for alias in node.names:
                module = f"{node.module}.{alias.name}"
                if node.module == "framework":
                    names.add(getattr(getattr(framework, alias.name, None), "__module__", module))
                names.add(module)
    return names


def tests_of(checkout: Path, path: Path) -> list[list[str]]:
    """Return the test files that touch a module: its package's and those that import it; then one step on."""
    module = ".".join(path.with_suffix("").parts)
    users = {
        ".".join(file.relative_to(checkout).with_suffix("").parts)
        for file in (checkout / "framework").rglob("*.py")
        if module in imported(file)
    } - {"framework"}
    near, far = list[str](), list[str]()
    for file in sorted((checkout / "tests").rglob("test_*.py")):
        if {"witness", "browser", "benchmarks", "fuzz"} & set(file.parts):
            continue
        names = imported(file)
        in_package = file.is_relative_to(checkout / "tests" / path.parts[1])
        if module in names or in_package:
            near.append(str(file.relative_to(checkout)))
        elif users & names:
            far.append(str(file.relative_to(checkout)))
    # those that import the module themselves first
    near.sort(key=lambda name: module not in imported(checkout / name))
    return [stage for stage in (near, far) if stage]


def judge(mutant: Mutant, checkout: Path, seconds: float) -> str:
    """Run the tests that touch a mutant in a copy of the checkout; return what became of it.

    The mutant hangs if the first stage of tests takes longer than `seconds`; the second one is then cut off.
    """
    target = checkout / mutant.path
    original = target.read_text()
    stages = tests_of(checkout, mutant.path)
    target.write_text(mutant.text)
    environment = os.environ | {"PYTHONPATH": str(checkout), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-k", "not idle"]
    try:
        for number, stage in enumerate(stages):
            try:
                done = subprocess.run(
                    [*command, *stage],
                    cwd=checkout,
                    env=environment,
                    capture_output=True,
                    timeout=seconds,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                return "hangs" if number == 0 else "SURVIVES what time allowed"
            if done.returncode == 4:  # a mistake of this program, not of the mutant
                raise RuntimeError(done.stderr.decode())
            if done.returncode not in (0, 5):  # 5: no tests
                return "dies"
        return "SURVIVES"
    finally:
        target.write_text(original)


def show(checkout: Path, mutant: Mutant) -> str:
    """Return the changed lines of a mutant."""
    lines = difflib.unified_diff(
        (checkout / mutant.path).read_text().splitlines(), mutant.text.splitlines(), n=0, lineterm=""
    )
    changed = "\n".join(f"    {line}" for line in list(lines)[3:])
    return f"{mutant.path} {mutant.function}\n{changed}"


def main() -> None:
    """Draw mutants and print those that survive."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--packages", nargs="+", help="of the framework; by default all but cli and show")
    parser.add_argument("--seconds", type=float, default=300.0, help="of one stage of tests")
    options = parser.parse_args()

    rng = random.Random(options.seed)
    root = Path(__file__).parent.parent
    packages = options.packages or sorted(
        {path.parent.name for path in (root / "framework").glob("*/__init__.py")} - {"cli", "show"}
    )
    survivors = 0
    with tempfile.TemporaryDirectory() as folder:
        checkout = Path(folder)
        for name in SOURCES:
            shutil.copytree(root / name, checkout / name, ignore=shutil.ignore_patterns("__pycache__"))
        for file in (path for path in root.iterdir() if path.is_file()):
            shutil.copy(file, checkout)
        for number in range(options.count):
            package = rng.choice(packages)
            by_function: dict[tuple[Path, str], list[Mutant]] = {}
            for path in sorted((checkout / "framework" / package).rglob("*.py")):
                for mutant in mutants_of(checkout, path.relative_to(checkout)):
                    by_function.setdefault((mutant.path, mutant.function), []).append(mutant)
            mutant = rng.choice(by_function[rng.choice(sorted(by_function))])
            verdict = judge(mutant, checkout, options.seconds)
            survivors += verdict.startswith("SURVIVES")
            print(f"{number + 1}: {verdict}  {show(checkout, mutant)}", flush=True)
    print(f"{survivors} of {options.count} survive")


if __name__ == "__main__":
    main()
