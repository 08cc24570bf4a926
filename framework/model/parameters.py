"""Named parameters of a robot file, and the placeholders `${...}` in its text and in its URDF.

    parameters: {l1: [0.25, 0.2, 0.3]}      the robot has the first value, a study goes through all
    ... xyz="${l1} 0 0" ... stiffness: ${3e5 * (0.25 / l1)**3}

A placeholder is an arithmetic expression of parameters, with numbers, + - * / **, parentheses, pi, sqrt, sin,
cos, tan, asin, acos and atan2. A file without `parameters` and without placeholders is not changed.
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

PLACEHOLDER = re.compile(r"\$\{([^{}]*)\}")  # group 1: the expression
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
    """Return the values of each parameter that a robot file's text declares, the robot's own first.

    Raises:
        RobotFileError: the text is no YAML, or a parameter has no valid name or no numbers.
    """
    if "parameters" not in text:
        return {}
    content = parse_yaml(PLACEHOLDER.sub("0", text))  # placeholders need not be valid YAML
    declared = content.get("parameters") if isinstance(content, dict) else None
    if declared is None:
        return {}
    if not isinstance(declared, dict):
        raise RobotFileError(f"parameters: needs a mapping of names to values, got {short(declared)}")
    for name in declared:
        if not isinstance(name, str) or not name.isidentifier() or name in (*_FUNCTIONS, "pi"):
            raise RobotFileError(f"parameters: {short(name)} is not a parameter name: letters, digits and _")
    return {name: _read_values(name, values) for name, values in declared.items()}


def fill_parameters(text: str, given: Mapping[str, float] | None = None) -> tuple[str, dict[str, float]]:
    """Fill the placeholders of a robot file's text; return text and parameters.

    Args:
        text: of the robot file.
        given: values that replace the robot's own values of some parameters.

    Raises:
        RobotFileError: see `declared_parameters` and `fill_placeholders`; or a parameter in `given` is not
            declared.
    """
    declared = declared_parameters(text)
    values = {name: choices[0] for name, choices in declared.items()}
    for name, value in (given or {}).items():
        check_name("parameters", "parameter", name, declared)
        (values[name],) = _read_values(name, [value])  # one value, not a list
    return fill_placeholders(text, values), values


def fill_placeholders(text: str, values: Mapping[str, float]) -> str:
    """Replace each placeholder of a text by the value of its expression of parameters `values`.

    Raises:
        RobotFileError: an expression has unknown names or operations, is too long, or has no finite value.
    """
    return PLACEHOLDER.sub(lambda match: repr(_evaluate(match[1], values)), text)


def _read_values(name: str, given: Any) -> list[float]:
    """Read the values of a parameter, one number or a list of numbers."""
    values = given if isinstance(given, list) else [given]
    if not values:
        raise RobotFileError(f"parameters.{name}: needs a number or a list of numbers, got an empty list")
    try:
        return [number(f"parameters.{name}", value) for value in values]
    except InvalidInput as error:
        raise RobotFileError(str(error)) from None


def _evaluate(expression: str, values: Mapping[str, float]) -> float:
    """Compute the finite value of an arithmetic expression of parameters `values`."""
    max_characters = 200
    where = f"${{{expression[:60]}}}"
    if len(expression) > max_characters:
        raise RobotFileError(f"{where}: more than {max_characters} letters")
    try:
        syntax = ast.parse(expression.strip(), mode="eval")
        result = float(_evaluate_node(syntax.body, values, where))
    except RobotFileError:
        raise
    except (SyntaxError, ValueError, ArithmeticError, TypeError, RecursionError, MemoryError) as error:
        raise RobotFileError(f"{where}: not arithmetic with a finite value: {error}") from None
    if not math.isfinite(result):
        raise RobotFileError(f"{where}: not finite")
    return result


def _evaluate_node(node: ast.expr, values: Mapping[str, float], where: str) -> float:
    """Compute the value of a node of an expression's syntax tree, of the kinds in the module's docstring.

    `where` is the placeholder, for messages.
    """
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)  # type: ignore[arg-type]  # `type` above excludes bool
    if isinstance(node, ast.Name):
        if node.id == "pi":
            return math.pi
        check_name(where, "parameter", node.id, values)
        return values[node.id]
    if isinstance(node, ast.BinOp | ast.UnaryOp) and type(node.op) in _OPERATORS:
        operation = _OPERATORS[type(node.op)]
        operands = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.operand]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        check_name(where, "function", node.func.id, _FUNCTIONS)
        operation, operands = _FUNCTIONS[node.func.id], node.args
    else:
        raise RobotFileError(f"{where}: only numbers, parameters, + - * / **, parentheses and functions")
    return operation(*(_evaluate_node(operand, values, where) for operand in operands))
