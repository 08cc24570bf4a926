"""Mutants of the framework, and the tests that notice them: `python -m tests.mutants --seed 7 --count 40`.

A mutant changes one operator, comparison, number or term of one function. Packages are drawn alike, in them
functions. All plain tests run once and note which of the drawn statements they reach. A mutant then meets the
tests that reach its statement, the cheapest first, and the others of their files (which may share what was
computed), until one fails or the time is up. It survives if all pass; somebody must then judge whether it is
equivalent, and which law is missing. Each run is a fork of one process that has imported the libraries, and
reads the mutant instead of the file; processes that a test starts do not. Tests that change source themselves
("idle") are left out.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import copy
import difflib
import importlib
import json
import multiprocessing
import os
import random
import resource
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import NamedTuple, TypeVar

import pytest

T = TypeVar("T")
ROOT = Path(__file__).parent.parent
LIBRARIES = ("scipy.linalg", "scipy.optimize", "scipy.sparse.linalg", "pinocchio", "clarabel")
LEFT_OUT = {"browser", "benchmarks", "fuzz"}  # folders of tests
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
    """A change of one place of a file."""

    path: Path
    function: str
    statement: tuple[int, int]  # line and column of the innermost one
    first: int  # of the bytes replaced
    last: int
    new: str

    def text(self) -> str:
        """Return the mutated module."""
        old = self.path.read_bytes()
        return (old[: self.first] + self.new.encode() + old[self.last :]).decode()


class Test(NamedTuple):
    """A test that passed, and the numbers of the mutants whose statements it reached."""

    name: str
    seconds: float
    reached: list[int]


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


def mutants_of(path: Path) -> list[Mutant]:
    """Return all mutants of the functions of a module; messages, annotations and defaults stay."""
    text = path.read_text()
    starts = [0]  # in bytes, of the lines
    for line in text.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = list[Mutant]()

    def visit(node: ast.AST, function: str, statement: tuple[int, int]) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Raise | ast.JoinedStr | ast.arguments | ast.AnnAssign):
                continue
            if isinstance(child, ast.FunctionDef):
                for inner in child.body:
                    visit(ast.Module([inner], []), child.name, (0, 0))
                continue
            innermost = (child.lineno, child.col_offset) if isinstance(child, ast.stmt) else statement
            if function and hasattr(child, "col_offset"):
                first = starts[child.lineno - 1] + child.col_offset
                last = starts[child.end_lineno - 1] + child.end_col_offset
                for change in mutations(child):
                    new = ast.unparse(ast.fix_missing_locations(change))
                    if isinstance(child, ast.expr) and not isinstance(child, ast.Name):
                        new = f"({new})"
                    found.append(Mutant(path, function, innermost, first, last, new))
            visit(child, function, innermost)

    visit(ast.parse(text), "", (0, 0))
    return found


def draw(seed: int, count: int, packages: list[str]) -> list[Mutant]:
    """Draw mutants: a package, one of its functions, one of its changes."""
    rng = random.Random(seed)
    by_package: dict[str, dict[tuple[Path, str], list[Mutant]]] = {}
    drawn = list[Mutant]()
    for _ in range(count):
        package = rng.choice(packages)
        if package not in by_package:
            by_package[package] = by_function = {}
            for path in sorted((ROOT / "framework" / package).rglob("*.py")):
                for mutant in mutants_of(path):
                    by_function.setdefault((path, mutant.function), []).append(mutant)
        by_function = by_package[package]
        drawn.append(rng.choice(by_function[rng.choice(sorted(by_function))]))
    return drawn


def replace_sources(texts: dict[str, str | ast.Module]) -> None:
    """Let this process import modules as these sources instead of their files."""
    read = SourceFileLoader.get_code

    def get_code(loader: SourceFileLoader, name: str) -> CodeType | None:
        path = loader.get_filename(name)
        return compile(texts[path], path, "exec", dont_inherit=True) if path in texts else read(loader, name)

    SourceFileLoader.get_code = get_code


def marked(path: Path, numbers: dict[tuple[int, int], list[int]]) -> ast.Module:
    """Return a module that calls `_reach` with the numbers of a statement before it."""
    tree = ast.parse(path.read_text())
    for node in list(ast.walk(tree)):
        for field in ("body", "orelse", "finalbody"):
            statements = getattr(node, field, None)
            if isinstance(statements, list):
                for statement in reversed(list(statements)):
                    for number in numbers.get((statement.lineno, statement.col_offset), []):
                        call = ast.parse(f"_reach({number})").body[0]
                        statements.insert(statements.index(statement), call)
    return ast.fix_missing_locations(tree)


def in_fork(function: Callable[[], T], seconds: float) -> T | None:
    """Return what a function returns in a fork of this process; None if it dies or takes longer [s]."""
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)

    def run() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1,) * 2)
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
        there.send(function())

    process = context.Process(target=run)
    process.start()
    there.close()
    try:
        return here.recv() if here.poll(10.0 * seconds) else None
    except EOFError:
        return None
    finally:
        process.kill()
        process.join()


def run_pytest(plugin: object, *arguments: str) -> int:
    return int(pytest.main(["-q", "-p", "no:cacheprovider", "-k", "not idle", *arguments], plugins=[plugin]))


class Recorder:
    """Notes of each test that passes its time and what it reaches."""

    def __init__(self) -> None:
        self.tests = list[Test]()
        self.reached = set[int]()
        builtins._reach = self.reached.add
        self.seconds = 0.0

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds += report.duration
        if report.when == "call" and report.passed:
            self.tests.append(Test(report.nodeid, self.seconds, sorted(self.reached)))
        if report.when == "teardown":
            self.seconds = 0.0
            self.reached.clear()


class Chooser:
    """Runs these tests in this order until one fails or the processor time [s] is up."""

    def __init__(self, names: list[str], seconds: float) -> None:
        self.rank = {name: rank for rank, name in enumerate(names)}
        self.end = time.process_time() + seconds
        self.killer = ""

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = sorted(
            (item for item in items if item.nodeid in self.rank), key=lambda item: self.rank[item.nodeid]
        )

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self.killer = self.killer or report.nodeid * report.failed

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.killer = self.killer or report.nodeid * report.failed

    def pytest_runtest_teardown(self, item: pytest.Item) -> None:
        if self.killer or time.process_time() > self.end:
            item.session.shouldstop = "killed, or the time is up"


def record(sources: dict[str, str | ast.Module], file: str) -> list[Test]:
    """Run one file of tests; return the tests that pass."""
    replace_sources(sources)
    recorder = Recorder()
    run_pytest(recorder, file)
    return recorder.tests


def run_chosen(mutant: Mutant, names: list[str], seconds: float) -> str:
    """Run tests in this order; return the one that fails, or nothing."""
    replace_sources({str(mutant.path): mutant.text()})
    chooser = Chooser(names, seconds)
    run_pytest(chooser, *dict.fromkeys(name.split("::")[0] for name in names))
    return chooser.killer


def judge(number: int, mutant: Mutant, tests: list[Test], seconds: float) -> str:
    """Return what became of a mutant before the tests that reach it, and the others of their files."""
    files = {test.name.split("::")[0] for test in tests if number in test.reached}
    near = [test for test in tests if test.name.split("::")[0] in files]
    near.sort(key=lambda test: (number not in test.reached, test.seconds))
    names = [test.name for test in near]
    for part in (names[:30], names[30:200], names[200:]):  # files that are not needed are not read
        killer = in_fork(partial(run_chosen, mutant, part, seconds), 2.0 * seconds) if part else ""
        if killer is None:
            return "dies: it hangs"
        if killer:
            return f"dies by {killer}"
    reached = sum(number in test.reached for test in near)
    needed = sum(test.seconds for test in near)
    return f"SURVIVES {len(near)} tests of {needed:.0f} s; {reached} of them reach it"


def show(mutant: Mutant) -> str:
    """Return the changed lines of a mutant."""
    lines = difflib.unified_diff(
        mutant.path.read_text().splitlines(), mutant.text().splitlines(), n=0, lineterm=""
    )
    changed = "\n".join(f"    {line}" for line in list(lines)[3:])
    return f"{mutant.path.relative_to(ROOT)} {mutant.function}\n{changed}"


def main() -> None:
    """Draw mutants and print those that survive."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--skip", type=int, default=0, help="judge those after the first SKIP only")
    parser.add_argument("--packages", nargs="+", help="of the framework; by default all but cli and show")
    parser.add_argument("--seconds", type=float, default=60.0, help="of tests for each mutant")
    parser.add_argument("--record", type=Path, help="file of what tests reach, for the next run")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    options = parser.parse_args()

    packages = options.packages or sorted(
        {path.parent.name for path in (ROOT / "framework").glob("*/__init__.py")} - {"cli", "show"}
    )
    drawn = draw(options.seed, options.count, packages)
    for library in LIBRARIES:
        importlib.import_module(library)
    with ThreadPoolExecutor(options.processes) as pool:
        if options.record and options.record.exists():
            tests = [Test(*test) for test in json.loads(options.record.read_text())]
        else:
            numbers = defaultdict[Path, dict[tuple[int, int], list[int]]](lambda: defaultdict(list))
            for number, mutant in enumerate(drawn):
                numbers[mutant.path][mutant.statement].append(number)
            sources = {str(path): marked(path, numbers[path]) for path in numbers}
            files = [
                str(file.relative_to(ROOT))
                for file in sorted((ROOT / "tests").rglob("test_*.py"))
                if not LEFT_OUT & set(file.parts)
            ]
            runs = pool.map(lambda file: in_fork(partial(record, sources, file), 1000.0), files)
            tests = [test for file, run in zip(files, runs, strict=True) for test in run or print(file) or []]
            if options.record:
                options.record.write_text(json.dumps(tests))
        todo = list(enumerate(drawn))[options.skip :]
        verdicts = pool.map(lambda pair: judge(*pair, tests, options.seconds), todo)
        survivors = 0
        for (number, mutant), verdict in zip(todo, verdicts, strict=True):
            survivors += verdict.startswith("SURVIVES")
            print(f"{number + 1}: {verdict}\n  {show(mutant)}", flush=True)
    print(f"{survivors} of {len(todo)} survive")


if __name__ == "__main__":
    main()
