"""Mutants of the framework, and the tests that notice them: `python -m tests.mutants --seed 7 --count 40`.

A mutant changes one operator, comparison, number or term of one function. Packages are drawn alike, in them
functions. A first run notes which blocks of statements each plain test reaches; the record stays in a scratch
file until the framework or a test changes. One process then collects all tests and forks once for each
mutant: the fork swaps the code of the functions that are there and runs the tests that reach its block, the
quickest first, then the others of their files (which may share what was computed), then, if asked, their slow
ones, until one fails or the time is up. One that lives, and whose block is reached while tests are collected
(which leaves results behind), is then read instead of its file by a process that has imported libraries only.
A mutant survives if all pass; somebody must then judge whether it is equivalent, and which law is missing.
Processes that a test starts meet no mutant, and tests that change source themselves ("idle") are left out.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import copy
import difflib
import gc
import hashlib
import importlib
import json
import multiprocessing
import os
import random
import resource
import tempfile
import time
from bisect import bisect
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial, reduce
from importlib.machinery import SourceFileLoader
from itertools import accumulate, groupby, pairwise
from operator import or_
from pathlib import Path
from types import CodeType, FunctionType
from typing import NamedTuple, TypeVar

import numpy as np
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
SURVIVES = "SURVIVES"
NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum", "maximum": "minimum"}


class Mutant(NamedTuple):
    """A change of one place of a file."""

    path: Path
    function: str
    block: str  # `key` of the first statement of the innermost block
    first: int  # of the bytes replaced
    last: int
    new: str

    def text(self) -> str:
        """Return the mutated module, its lines where they were."""
        old = self.path.read_bytes()
        lines = b"\n" * old[self.first : self.last].count(b"\n")
        new = self.new.encode()
        new = new[:-1] + lines + new[-1:] if new.endswith(b")") else new + lines
        return (old[: self.first] + new + old[self.last :]).decode()


class Test(NamedTuple):
    """A test that passed, or a file that was collected; its processor time; what it reached."""

    name: str
    seconds: float
    reached: int  # bits, by the numbers of blocks


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


def blocks_of(tree: ast.AST) -> Iterator[list[ast.stmt]]:
    """Yield the lists of statements that run one after the other."""
    for node in ast.walk(tree):
        for field in ("body", "orelse", "finalbody"):
            block = getattr(node, field, None)
            if isinstance(block, list) and block:
                yield block


def key(path: Path, statement: ast.stmt) -> str:
    return f"{path.relative_to(ROOT)}:{statement.lineno}:{statement.col_offset}"


def mutants_of(path: Path) -> list[Mutant]:
    """Return all mutants of the functions of a module; messages, annotations and defaults stay."""
    text = path.read_text()
    tree = ast.parse(text)
    block_of = {id(statement): key(path, block[0]) for block in blocks_of(tree) for statement in block}
    starts = [0]  # in bytes, of the lines
    for line in text.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = list[Mutant]()

    def visit(node: ast.AST, function: str, block: str) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Raise | ast.JoinedStr | ast.arguments | ast.AnnAssign):
                continue
            if isinstance(child, ast.FunctionDef):
                for inner in child.body:
                    visit(ast.Module([inner], []), child.name, "")
                continue
            innermost = block_of.get(id(child), block)
            if function and hasattr(child, "col_offset"):
                first = starts[child.lineno - 1] + child.col_offset
                last = starts[child.end_lineno - 1] + child.end_col_offset
                for change in mutations(child):
                    new = ast.unparse(ast.fix_missing_locations(change))
                    if isinstance(child, ast.expr) and not isinstance(child, ast.Name):
                        new = f"({new})"
                    found.append(Mutant(path, function, innermost, first, last, new))
            visit(child, function, innermost)

    visit(tree, "", "")
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


def codes(text: str, path: Path) -> dict[tuple[str, int], CodeType]:
    """Return the code of all functions of a module, by name and line."""
    found, waiting = dict[tuple[str, int], CodeType](), [compile(text, path, "exec", dont_inherit=True)]
    while waiting:
        code = waiting.pop()
        found[code.co_qualname, code.co_firstlineno] = code
        waiting += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return found


def can_swap(mutant: Mutant) -> bool:
    """Return whether no function gains or loses a variable of an outer one."""
    old, new = codes(mutant.path.read_text(), mutant.path), codes(mutant.text(), mutant.path)
    return {at: code.co_freevars for at, code in old.items()} == {
        at: code.co_freevars for at, code in new.items()
    }


def in_fork(function: Callable[[], T], seconds: float) -> T | None:
    """Return what a function returns in a fork of this process; None if it dies or takes longer [s]."""
    context = multiprocessing.get_context("fork")
    source, sink = context.Pipe(duplex=False)

    def run() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1,) * 2)
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
        sink.send(function())
        os._exit(0)

    process = context.Process(target=run)
    process.start()
    sink.close()
    try:
        return source.recv() if source.poll(100.0 * seconds) else None
    except EOFError:
        return None
    finally:
        process.kill()
        process.join()


class Session:
    """A run of pytest that collects tests, and leaves it to a function what to do with them."""

    def __init__(self, loop: Callable[[Session, list[pytest.Item]], None]) -> None:
        self.loop = loop
        self.failure = ""

    def run(self, files: Iterable[str]) -> None:
        kinds = ["-m", "not benchmark and not browser", "-k", "not is_idle and not is_not_idle"]
        pytest.main(["-q", "-s", "-p", "no:cacheprovider", *kinds, *files], plugins=[self])

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        self.loop(self, session.items)
        return True

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self.failure = self.failure or report.nodeid * report.failed

    pytest_runtest_logreport = pytest_collectreport


def file_of(item: pytest.Item) -> str:
    return item.nodeid.split("::")[0]


def run_items(items: list[pytest.Item]) -> Iterator[tuple[pytest.Item, float]]:
    """Run tests; yield each with the processor time [s] that it took."""
    for item, following in pairwise([*items, None]):
        start = time.process_time()
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        yield item, time.process_time() - start


def marked(path: Path, numbers: dict[str, int]) -> ast.Module:
    """Return a module that calls `_reach` with the number of a block when it is entered."""
    tree = ast.parse(path.read_text())
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    inside = {id(block): block for function in functions for block in blocks_of(function)}
    for block in inside.values():
        call = ast.parse(f"_reach({numbers[key(path, block[0])]}, 1)").body[0]
        is_docstring = isinstance(block[0], ast.Expr) and isinstance(block[0].value, ast.Constant)
        block.insert(int(is_docstring), call)
    return ast.fix_missing_locations(tree)


def record(paths: list[Path], numbers: dict[str, int], files: list[str], scratch: Path) -> None:
    """Store the plain tests that pass and, of each file, what is reached while it is collected."""
    replace_sources({str(path): marked(path, numbers) for path in paths})
    reached = bytearray(len(numbers))
    builtins._reach = reached.__setitem__
    tests = list[Test]()

    def note(name: str, seconds: float = 0.0) -> Test:
        bits = np.packbits(np.frombuffer(bytes(reached), np.uint8), bitorder="little")
        reached[:] = bytes(len(reached))
        return Test(name, seconds, int.from_bytes(bits.tobytes(), "little"))

    def run_file(session: Session, items: list[pytest.Item]) -> list[Test]:
        passed = list[Test]()
        for item, seconds in run_items(items):
            test = note(item.nodeid, seconds)
            passed += [] if session.failure else [test]
            session.failure = ""
        return passed

    def run_files(session: Session, items: list[pytest.Item]) -> None:
        plain = [item for item in items if not item.get_closest_marker("slow")]
        runs = [partial(run_file, session, list(group)) for _, group in groupby(plain, key=file_of)]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for passed in pool.map(lambda run: in_fork(run, 1000.0), runs):
                tests.extend(passed or [])

    session = Session(run_files)
    session.pytest_collectreport = lambda report: tests.append(note(report.nodeid))
    session.run(files)
    scratch.write_text(json.dumps(tests))


class Candidate(NamedTuple):
    """A mutant, the plain tests that try it in this order, and the files of these and of slower ones."""

    mutant: Mutant
    names: list[str]
    files: set[str]
    left: int  # tests that reach it and are not tried
    slow: float  # processor time [s] of slow tests after them


def choose_tests(mutant: Mutant, tests: list[Test], bit: int, seconds: float, slow: float) -> Candidate:
    """Return the tests within the time [s], those that reach the mutant first, the quickest first."""
    files = {test.name.split("::")[0] for test in tests if test.reached & bit}
    near = [test for test in tests if "::" in test.name and test.name.split("::")[0] in files]
    near.sort(key=lambda test: (not test.reached & bit, test.seconds))
    names = [test.name for test in near]
    tried = bisect(list(accumulate(test.seconds for test in near)), seconds)
    left = sum(1 for test in near[tried:] if test.reached & bit)
    return Candidate(mutant, names[:tried], files, left, slow)


def judge(session: Session, items: list[pytest.Item], candidate: Candidate) -> str:
    """Return what becomes of the mutant that this process is."""
    by_name = {item.nodeid: item for item in items}
    chosen = [by_name[name] for name in candidate.names if name in by_name]
    slow = [item for item in items if item.get_closest_marker("slow") and file_of(item) in candidate.files]
    for item, _ in run_items(chosen):
        if session.failure:
            return f"dies by {item.nodeid}"
    end = time.process_time() + candidate.slow
    for item, _ in run_items(slow if candidate.slow else []):
        if session.failure:
            return f"dies by {item.nodeid}, which is slow"
        if time.process_time() > end:
            break
    last = f", the slowest {candidate.names[-1]}" if candidate.names else ""
    return f"{SURVIVES} {len(chosen)} plain tests{last}; {candidate.left} that reach it are not tried"


def judge_anew(candidate: Candidate) -> str:
    """Return what becomes of a mutant that is read instead of its file."""
    replace_sources({str(candidate.mutant.path): candidate.mutant.text()})
    verdicts = list[str]()
    session = Session(lambda session, items: verdicts.append(judge(session, items, candidate)))
    session.run({name.split("::")[0]: None for name in candidate.names})
    return verdicts[0] if verdicts else f"dies as {session.failure} is collected"


def judge_by_swapping(
    functions: list[FunctionType], session: Session, items: list[pytest.Item], candidate: Candidate
) -> str:
    """Return what becomes of a mutant whose code is given to the functions that are there, or read later."""
    replace_sources({str(candidate.mutant.path): candidate.mutant.text()})
    new = codes(candidate.mutant.text(), candidate.mutant.path)
    for function in functions:
        code = function.__code__
        if code.co_filename == str(candidate.mutant.path):
            function.__code__ = new[code.co_qualname, code.co_firstlineno]
    return judge(session, items, candidate)


def show(mutant: Mutant) -> str:
    """Return the changed lines of a mutant."""
    lines = difflib.unified_diff(
        mutant.path.read_text().splitlines(), mutant.text().splitlines(), n=0, lineterm=""
    )
    changed = "\n".join(f"    {line}" for line in list(lines)[3:])
    return f"{mutant.path.relative_to(ROOT)} {mutant.function}\n{changed}"


def main() -> None:
    """Draw mutants and print what becomes of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--only", type=int, nargs="+", help="judge those of the drawn ones, by number")
    parser.add_argument("--packages", nargs="+", help="of the framework; by default all but cli and show")
    parser.add_argument("--seconds", type=float, default=20.0, help="of plain tests for each mutant")
    parser.add_argument("--slow", type=float, default=0.0, help="seconds of slow tests after them")
    options = parser.parse_args()

    for library in LIBRARIES:
        importlib.import_module(library)
    paths = sorted((ROOT / "framework").rglob("*.py"))
    test_paths = sorted((ROOT / "tests").rglob("test_*.py"))
    files = [str(path.relative_to(ROOT)) for path in test_paths if not LEFT_OUT & set(path.parts)]
    blocks = [key(path, block[0]) for path in paths for block in blocks_of(ast.parse(path.read_text()))]
    numbers = {block: number for number, block in enumerate(blocks)}
    digest = hashlib.sha1(b"".join(path.read_bytes() for path in paths + test_paths)).hexdigest()
    scratch = Path(tempfile.gettempdir()) / f"mutants-{digest[:12]}.json"
    if not scratch.exists():
        in_fork(partial(record, paths, numbers, files, scratch), 10000.0)
    tests = [Test(*test) for test in json.loads(scratch.read_text())]
    collected = reduce(or_, (test.reached for test in tests if "::" not in test.name))

    packages = options.packages or sorted(
        {path.parent.name for path in (ROOT / "framework").glob("*/__init__.py")} - {"cli", "show"}
    )
    candidates = {
        number: choose_tests(mutant, tests, 1 << numbers[mutant.block], options.seconds, options.slow)
        for number, mutant in enumerate(draw(options.seed, options.count, packages), 1)
        if not options.only or number in options.only
    }
    limit = 3.0 * options.seconds + 2.0 * options.slow + 60.0

    def judge_all(chosen: Iterable[int], judge_one: Callable[[Candidate], str]) -> dict[int, str]:
        def judge_in_fork(number: int) -> str:
            verdict = in_fork(partial(judge_one, candidates[number]), limit) or "dies: it hangs"
            print(f"{number}: {verdict}\n  {show(candidates[number].mutant)}", file=out, flush=True)
            return verdict

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            return dict(zip(chosen, pool.map(judge_in_fork, chosen), strict=True))

    def judge_swapped() -> dict[int, str]:
        chosen = [number for number in candidates if can_swap(candidates[number].mutant)]
        verdicts = dict[int, str]()

        def loop(session: Session, items: list[pytest.Item]) -> None:
            gc.unfreeze()  # `conftest` has hidden what is there
            functions = [thing for thing in gc.get_objects() if isinstance(thing, FunctionType)]
            verdicts.update(judge_all(chosen, partial(judge_by_swapping, functions, session, items)))

        Session(loop).run(files)
        return verdicts

    out = os.fdopen(os.dup(1), "w")
    verdicts = in_fork(judge_swapped, len(candidates) * limit)
    anew = [
        number
        for number, (mutant, *_) in candidates.items()
        if verdicts.get(number, SURVIVES).startswith(SURVIVES)
        and (number not in verdicts or collected >> numbers[mutant.block] & 1)
    ]
    verdicts |= judge_all(anew, judge_anew)
    survivors = [number for number in sorted(verdicts) if verdicts[number].startswith(SURVIVES)]
    print(f"{len(survivors)} of {len(verdicts)} survive: {' '.join(map(str, survivors))}")


if __name__ == "__main__":
    main()
