"""Named parameters of a robot file: `${...}` in its text and in its URDF.

    parameters: {l1: [0.25, 0.2, 0.3]}      the first value is the robot's own, all are those of a study
    ... xyz="${l1} 0 0" ... stiffness: ${3e5 * (0.25 / l1)**3}

A placeholder is arithmetic with the parameters: numbers, + - * / **, parentheses, pi, sqrt, sin, cos, tan,
asin, acos, atan2. A file without `parameters` and without placeholders is read as it stands.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

from framework.errors import InvalidInput, RobotFileError, check_name, short
from framework.model.documents import parse_yaml
from framework.numerics.fields import number

PLACEHOLDER = re.compile(r"\$\{([^{}]*)\}")
MAX_EXPRESSION_CHARACTERS = 200
MAX_PARAMETER_VALUES = 100_000  # of one parameter
_OPERATORS: Mapping[type[ast.AST], Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
_FUNCTIONS: Mapping[str, Callable[..., float]] = {
    name: getattr(math, name) for name in ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan2")
}


def declared_parameters(text: str) -> dict[str, list[float]]:
    """Return the declared values of each parameter of a robot file, its own first."""
    if "parameters" not in text:
        return {}
    content = parse_yaml(PLACEHOLDER.sub("0", text))
    declared = content.get("parameters") if isinstance(content, dict) else None
    if declared is None:
        return {}
    if not isinstance(declared, dict):
        raise RobotFileError(f"parameters: needs a mapping of names to values, got {short(declared)}")
    return {_check_name(name): _read_values(name, values) for name, values in declared.items()}


def fill_parameters(text: str, given: Mapping[str, float] | None = None) -> tuple[str, dict[str, float]]:
    """Fill the placeholders of a robot file's text; return text and parameters.

    Args:
        given: values of some parameters, in place of their own.

    Raises:
        RobotFileError: see `declared_parameters` and `fill_placeholders`; or a parameter that is not
            declared.
    """
    declared = declared_parameters(text)
    for name in given or {}:
        check_name("parameters", "parameter", name, declared)
    own = {name: values[0] for name, values in declared.items()}
    values = own | {name: _read_values(name, [value])[0] for name, value in (given or {}).items()}
    return fill_placeholders(text, values), values


def fill_placeholders(text: str, values: Mapping[str, float]) -> str:
    """Replace each `${...}` of a text by its finite number."""
    return PLACEHOLDER.sub(lambda match: repr(_evaluate(match[1], values)), text)


def _check_name(name: Any) -> str:
    """Return a parameter's name; refuse all but identifiers, and names of functions."""
    if not isinstance(name, str) or not name.isidentifier() or name in _FUNCTIONS or name == "pi":
        raise RobotFileError(f"parameters: {short(name)} is no name for a parameter: letters, digits and _")
    return name


def _read_values(name: str, given: Any) -> list[float]:
    """Read the values of a parameter: a number, or a list."""
    values = given if isinstance(given, list) else [given]
    if not values or len(values) > MAX_PARAMETER_VALUES:
        raise RobotFileError(
            f"parameters.{name}: needs 1 to {MAX_PARAMETER_VALUES} numbers, got {len(values)}"
        )
    try:
        return [number(f"parameters.{name}", value) for value in values]
    except InvalidInput as error:
        raise RobotFileError(str(error)) from None


def _evaluate(expression: str, values: Mapping[str, float]) -> float:
    """Compute the finite value of an arithmetic expression."""
    where = f"${{{expression[:60]}}}"
    if len(expression) > MAX_EXPRESSION_CHARACTERS:
        raise RobotFileError(f"{where}: more than {MAX_EXPRESSION_CHARACTERS} letters")
    try:
        number = float(_evaluate_node(ast.parse(expression.strip(), mode="eval").body, values, where))
    except (SyntaxError, ValueError, ArithmeticError, TypeError, RecursionError, MemoryError) as error:
        if isinstance(error, RobotFileError):
            raise
        raise RobotFileError(f"{where}: not arithmetic with a finite value: {error}") from None
    if not math.isfinite(number):
        raise RobotFileError(f"{where}: not finite")
    return number


def _evaluate_node(node: ast.expr, values: Mapping[str, float], where: str) -> float:
    """Compute the value of a node of an expression's syntax tree."""
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)  # type: ignore[arg-type]  # a number, and no truth value
    if isinstance(node, ast.Name):
        if node.id == "pi":
            return math.pi
        check_name(where, "parameter", node.id, values)
        return values[node.id]
    if isinstance(node, ast.BinOp | ast.UnaryOp) and type(node.op) in _OPERATORS:
        parts = (node.left, node.right) if isinstance(node, ast.BinOp) else (node.operand,)
        return _OPERATORS[type(node.op)](*(_evaluate_node(part, values, where) for part in parts))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        check_name(where, "function", node.func.id, _FUNCTIONS)
        return _FUNCTIONS[node.func.id](*(_evaluate_node(part, values, where) for part in node.args))
    raise RobotFileError(f"{where}: only numbers, parameters, + - * / **, parentheses and functions")
