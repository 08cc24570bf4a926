"""The float constants of the framework's modules, and a change of one of them before it is imported.

A change rewrites the assignment while its module is loaded, so that names that other modules import, defaults
of arguments and constants that are computed from it follow.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import NamedTuple

ROOT = Path(__file__).parents[3]
TABLE = "framework.tolerances"


class Constant(NamedTuple):
    """A float that a module assigns."""

    module: str
    name: str
    value: float


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


def readers(constant: Constant) -> frozenset[str] | None:
    """Return the modules whose functions may look a constant up.

    None stands for any function: the constant is used while a module is imported, for a number made of it.
    """
    found = set()
    for module, tree in _trees().items():
        imported = any(
            isinstance(node, ast.ImportFrom)
            and node.module == constant.module
            and any(alias.name == constant.name for alias in node.names)
            for node in ast.walk(tree)
        )
        if not imported and module != constant.module:
            continue
        if any(_looks_up(part, constant.name) for part in _at_import(tree)):
            return None
        found.add(module)
    return frozenset(found)


def _looks_up(node: ast.AST, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name and isinstance(node.ctx, ast.Load)


def _at_import(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield what runs while a module is imported: all but the bodies of functions, and annotations."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.FunctionDef | ast.Lambda):
            parts: list[ast.AST | None] = [*child.args.defaults, *child.args.kw_defaults]
            parts += getattr(child, "decorator_list", [])
        else:
            parts = [child]
        for part in parts:
            if part is not None:
                yield part
                yield from _at_import(part)


@cache
def _trees() -> dict[str, ast.Module]:
    """Return the syntax of each module of the framework."""
    return {
        ".".join(file.relative_to(ROOT).with_suffix("").parts): ast.parse(file.read_text(encoding="utf-8"))
        for file in sorted((ROOT / "framework").rglob("*.py"))
    }


def change_on_import(change: Change) -> None:
    """Multiply a constant by a factor in its module, which must not have been imported yet."""
    if change.constant.module in sys.modules:
        raise RuntimeError(f"{change.constant.module} is imported already")
    sys.meta_path.insert(0, _Finder(change))


class _Finder(MetaPathFinder):
    def __init__(self, change: Change) -> None:
        self.change = change

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self.change.constant.module:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(self.change, spec.origin)
        return spec


class _Loader(SourceFileLoader):
    """Compiles the changed source, and keeps no bytecode of it."""

    def __init__(self, change: Change, file: str) -> None:
        super().__init__(change.constant.module, file)
        self.change = change

    def get_code(self, fullname: str) -> CodeType:
        file = self.get_filename(fullname)
        tree = ast.parse(self.get_data(file))
        for name, node in _assignments(tree):
            if name == self.change.constant.name:
                _replace(tree, node, self.change.factor)
                break
        else:
            raise RuntimeError(f"{fullname} has no {self.change.constant.name}")
        return compile(ast.fix_missing_locations(tree), file, "exec")


def _replace(tree: ast.Module, node: ast.expr, factor: float) -> None:
    """Put node * factor where the node stands."""

    class Replacement(ast.NodeTransformer):
        def visit(self, other: ast.AST) -> ast.AST:
            if other is node:
                return ast.BinOp(node, ast.Mult(), ast.Constant(factor))
            return self.generic_visit(other)

    Replacement().visit(tree)
