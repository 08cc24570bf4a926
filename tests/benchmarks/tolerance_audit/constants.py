"""The float constants of the framework's modules, changed or watched from before they are imported.

The assignment is rewritten while its module is loaded, so that names that other modules import, defaults of
arguments and constants that are computed from it follow.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import NamedTuple

ROOT = Path(__file__).parents[3]
TABLE = "framework.tolerances"
WATCHED = "tests.benchmarks.tolerance_audit.watched"

Edit = Callable[[ast.expr], ast.expr]


class Constant(NamedTuple):
    """A float that a module assigns."""

    module: str
    name: str
    value: float

    @property
    def full_name(self) -> str:
        return f"{self.module}.{self.name}"


class Change(NamedTuple):
    """A constant times a factor."""

    constant: Constant
    factor: float


def table() -> tuple[Constant, ...]:
    """Return the numbers that decide verdicts."""
    return constants_of(TABLE)


def all_others(excluded: Sequence[str] = ("show", "cli", "tolerances")) -> tuple[Constant, ...]:
    """Return the float constants of the framework, but for those of some parts."""
    wanted = [module for module in _trees() if module.split(".")[1] not in excluded]
    return tuple(constant for module in wanted for constant in constants_of(module))


def constants_of(module: str) -> tuple[Constant, ...]:
    """Return the positive floats that a module assigns to names, in its order."""
    found = []
    for name, node in _assignments(_trees()[module]):
        value = _number(node)
        if isinstance(value, float) and value > 0.0:
            found.append(Constant(module, name, value))
    return tuple(found)


def _assignments(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Yield the names that a module assigns and the expression of each, (A, B) = (1.0, 2.0) included."""
    for statement in tree.body:
        if isinstance(statement, ast.AnnAssign) and statement.value is not None:
            targets, value = [statement.target], statement.value
        elif isinstance(statement, ast.Assign):
            targets, value = statement.targets, statement.value
        else:
            continue
        for target in targets:
            if isinstance(target, ast.Name):
                yield target.id, value
            elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                for one, part in zip(target.elts, value.elts, strict=True):
                    if isinstance(one, ast.Name):
                        yield one.id, part


def _number(node: ast.expr) -> object:
    """Return the value of an expression of numbers, else None."""
    numbers = (ast.Constant, ast.UnaryOp, ast.BinOp, ast.operator, ast.unaryop)
    if not all(isinstance(part, numbers) for part in ast.walk(node)):
        return None
    return eval(compile(ast.Expression(node), "<constant>", "eval"), {})


@cache
def _trees() -> dict[str, ast.Module]:
    """Return the syntax of each module of the framework."""
    return {
        ".".join(file.relative_to(ROOT).with_suffix("").parts): ast.parse(file.read_text(encoding="utf-8"))
        for file in sorted((ROOT / "framework").rglob("*.py"))
    }


def change_on_import(change: Change) -> None:
    """Multiply a constant by a factor in its module, which must not have been imported yet."""
    _rewrite_on_import(
        {change.constant: lambda node: ast.BinOp(node, ast.Mult(), ast.Constant(change.factor))}
    )


def watch_on_import(constants: Iterable[Constant]) -> None:
    """Replace constants by watched ones in their modules, which must not have been imported yet."""

    def watched(constant: Constant, node: ast.expr) -> ast.expr:
        call = ast.parse(f"__import__({WATCHED!r}, fromlist=['Watched']).Watched.constant", mode="eval").body
        return ast.Call(call, [ast.Constant(constant.full_name), node], [])

    _rewrite_on_import({one: partial(watched, one) for one in constants})


def _rewrite_on_import(edits: Mapping[Constant, Edit]) -> None:
    by_module: dict[str, dict[str, Edit]] = {}
    for constant, edit in edits.items():
        if constant.module in sys.modules:
            raise RuntimeError(f"{constant.module} is imported already")
        by_module.setdefault(constant.module, {})[constant.name] = edit
    sys.meta_path.insert(0, _Finder(by_module))


class _Finder(MetaPathFinder):
    def __init__(self, edits: Mapping[str, Mapping[str, Edit]]) -> None:
        self.edits = edits

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in self.edits:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(fullname, spec.origin, self.edits[fullname])
        return spec


class _Loader(SourceFileLoader):
    """Compiles the changed source, and keeps no bytecode of it."""

    def __init__(self, module: str, file: str, edits: Mapping[str, Edit]) -> None:
        super().__init__(module, file)
        self.edits = edits

    def get_code(self, fullname: str) -> CodeType:
        file = self.get_filename(fullname)
        tree = ast.parse(self.get_data(file))
        edits = {id(node): self.edits[name] for name, node in _assignments(tree) if name in self.edits}
        if len(edits) != len(self.edits):
            raise RuntimeError(f"{fullname} does not have all of {', '.join(self.edits)}")
        changed = _Replacement(edits).visit(tree)
        return compile(ast.fix_missing_locations(changed), file, "exec")


class _Replacement(ast.NodeTransformer):
    """Edits the expressions that are assigned to constants."""

    def __init__(self, edits: Mapping[int, Edit]) -> None:
        self.edits = edits

    def visit(self, node: ast.AST) -> ast.AST:
        edit = self.edits.get(id(node))
        return self.generic_visit(node) if edit is None else edit(node)  # type: ignore[arg-type]
