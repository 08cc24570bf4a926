"""Errors of a public function that name an argument of another type than its annotation.

Single numbers are checked before the call: nan, infinity, truth values and texts are none. All else is
checked only after something has failed, so that a call that succeeds costs nothing.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import sys
from collections.abc import Callable, Sequence
from functools import wraps
from importlib import import_module
from numbers import Integral, Number, Real
from typing import Any, ParamSpec, TypeVar

import numpy as np

from framework.errors import LARGEST_NUMBER, FrameworkError, InvalidInput, did_you_mean, real_numbers, short

SUCH_AS = {  # examples of what an annotation names
    "ParallelRobot": 'load_robot("five_bar") or load_robot("my_robot.yaml")',
    "Mechanism": 'load_robot("five_bar") or Mechanism.from_file("my_robot.yaml")',
    "CrossingPlan": "plan_crossing(robot, path)",
    "Sequence[CrossingPlan]": "[plan, next_plan]",
    "Quantities": '{"duration": lambda plan: plan.duration}',
}
SINGLE_NUMBERS = ("float", "int", "float | None", "int | None")  # annotations that are checked before a call
PLAIN: Any = Number | str | list | tuple | np.ndarray  # values that may pass for a number
P = ParamSpec("P")
R = TypeVar("R")


def explain_errors(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a public function: its errors from inside name the wrong argument.

    Raises, when called:
        TypeError: an unknown option, with the similar one.
        InvalidInput: a number that is none; or an argument that does not fit its annotation, if the call
            failed by another error than those of the package itself.
    """
    names = function.__code__.co_varnames
    numbers = {name for name, wanted in function.__annotations__.items() if wanted in SINGLE_NUMBERS}

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in (*zip(names, args, strict=False), *kwargs.items()) if numbers else ():
            is_one = name not in numbers or not isinstance(value, PLAIN) or _is_finite(value)
            if not is_one or (name in numbers and np.ndim(value)):  # type: ignore[arg-type]
                raise InvalidInput(f"{name}: needs a finite number, got {short(value)}")
        try:
            return function(*args, **kwargs)
        except FrameworkError:
            raise
        except Exception as error:
            signature = inspect.signature(function)
            options = kwargs.keys() & signature.parameters.keys()
            for name in kwargs.keys() - options:
                if f"unexpected keyword argument {name!r}" in str(
                    error
                ):  # an option that is handed on may be right
                    hint = did_you_mean(name, signature.parameters)
                    raise TypeError(f"{function.__name__}: {name!r} is no option of it{hint}") from error
            bound = signature.bind_partial(*args, **{name: kwargs[name] for name in options})
            for name, value in bound.arguments.items():
                parameter = signature.parameters[name]
                wanted = "Any" if parameter.annotation is parameter.empty else str(parameter.annotation)
                values = value if parameter.kind is parameter.VAR_POSITIONAL else [value]
                for each in values:
                    if not _fits(each, ast.parse(wanted, mode="eval").body, function):
                        finite = " of finite numbers" if "Array" in wanted or "float" in wanted else ""
                        such_as = f", such as {SUCH_AS[wanted]}" if wanted in SUCH_AS else ""
                        got = f"{short(each)} ({type(each).__name__})"
                        raise InvalidInput(f"{name}: needs {wanted}{finite}{such_as}, got {got}") from error
            raise

    return call


def _fits(value: Any, wanted: ast.expr, function: Callable[..., Any]) -> bool:
    """Return whether a value fits an annotation of a function; True where this cannot be told."""
    match wanted:
        case ast.BinOp():
            return _fits(value, wanted.left, function) or _fits(value, wanted.right, function)
        case ast.Constant(value=None):
            return value is None
        case ast.Name(id="Any" | "object"):
            return True
        case ast.Name(id="int"):
            return isinstance(value, Integral) and not isinstance(value, bool)
        case ast.Name(id="ArrayLike" | "Array" | "float" as kind):
            dimensions = {"ArrayLike": range(9), "Array": range(1, 9), "float": range(1)}
            return _is_finite(value) and np.ndim(value) in dimensions[kind]
        case ast.Name(id="IntArray"):
            return _is_finite(value) and (np.size(value) == 0 or np.asarray(value).dtype.kind in "biu")
        case ast.Subscript(value=ast.Name(id="Sequence" | "tuple" | "Iterable"), slice=item):
            if isinstance(value, str | bytes) or not isinstance(value, Sequence | np.ndarray):
                return False
            items = item.elts if isinstance(item, ast.Tuple) else [item, ast.Constant(...)]
            if isinstance(items[-1], ast.Constant):  # any number of them, as in tuple[float, ...]
                items = items[:1] * len(value)
            return len(items) == len(value) and all(map(_fits, value, items, [function] * len(value)))
        case ast.Subscript():
            return _fits(value, wanted.value, function)
    kind = _find_type(ast.unparse(wanted), function)
    kind = getattr(kind, "__origin__", kind)  # of an alias such as Mapping[str, float]
    if not isinstance(kind, type):
        return True
    if getattr(kind, "_is_protocol", False):
        return all(hasattr(value, name) for name in vars(kind) if not name.startswith("_"))
    return isinstance(value, kind)


def _is_finite(value: Any) -> bool:
    """Return whether a value is one or more real numbers that are finite, of any shape; True is none."""
    if isinstance(value, bool):
        return False
    try:
        numbers = real_numbers("", float(value) if isinstance(value, Real) else value)
    except (InvalidInput, OverflowError):
        return False
    return bool(np.all(np.abs(numbers) <= LARGEST_NUMBER))


def _find_type(name: str, function: Callable[..., Any]) -> Any:
    """Return what a name means in the module of a function, also one imported for annotations alone."""
    module = sys.modules[function.__module__]
    known = {**vars(builtins), **vars(module)}
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.ImportFrom) and name in {alias.name for alias in node.names}:
            known.setdefault(name, getattr(import_module(str(node.module)), name))
    return known.get(name)
