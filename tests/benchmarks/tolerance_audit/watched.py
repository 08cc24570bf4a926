"""Constants that note whether any comparison would come out otherwise, were they larger or smaller.

A watched constant computes along with its value what it would be under each change, through every operation.
Where a comparison has another outcome under a change, or where the number goes to what cannot be followed
(a solver, a cutoff of numpy), the change is noted as felt. A run in which a change is not felt is, operation
by operation, the same with that change, and need not be repeated.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np

FACTORS = (10.0, 0.1)
Key = tuple[str, float]  # a constant, and what it is multiplied by
felt: set[Key] = set()  # in this process


class Watched:
    """A number or an array, and what it would be under each change."""

    def __init__(self, value: Any, variants: dict[Key, Any]) -> None:
        self.value, self.variants = value, variants

    @classmethod
    def constant(cls, name: str, value: float) -> Watched:
        return cls(value, {(name, factor): factor * value for factor in FACTORS})

    def plain(self) -> Any:
        """Return the number itself; what becomes of it is not followed."""
        felt.update(self.variants)
        return self.value

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        if method == "__call__" and ufunc.nout == 1 and not options:
            return followed(ufunc, *inputs)
        options = {name: _plain(option) for name, option in options.items()}
        return getattr(ufunc, method)(*map(_plain, inputs), **options)

    def __array__(self, *arguments: Any, **options: Any) -> np.ndarray:
        return np.asarray(self.plain(), *arguments, **options)

    def __getitem__(self, item: Any) -> Any:
        return followed(lambda value: value[item], self)

    def __getattr__(self, name: str) -> Any:
        if name in {"value", "variants"} or (name.startswith("__") and not hasattr(float, name)):
            raise AttributeError(name)  # numpy asks for protocols of arrays
        return getattr(self.plain(), name)

    def __format__(self, form: str) -> str:
        return format(self.value, form)

    def __repr__(self) -> str:
        return repr(self.value)


def _plain(value: Any) -> Any:
    return value.plain() if isinstance(value, Watched) else value


def followed(operation: Callable[..., Any], *inputs: Any) -> Any:
    """Return what an operation makes of its inputs, watched if a number; note other truth values as felt."""
    watched = [one for one in inputs if isinstance(one, Watched)]
    value = operation(*(one.value if isinstance(one, Watched) else one for one in inputs))
    is_truth = np.asarray(value).dtype == bool
    variants = {}
    for key in {key for one in watched for key in one.variants} - felt:
        changed = (one.variants.get(key, one.value) if isinstance(one, Watched) else one for one in inputs)
        variants[key] = operation(*changed)
        if is_truth and not np.array_equal(variants[key], value):
            felt.add(key)
    return value if is_truth or not variants else Watched(value, variants)


def _methods() -> None:
    """Give Watched the operators of numbers: followed, or with the plain number where they leave it."""
    for name in ("lt", "le", "gt", "ge", "eq", "ne", "neg", "pos", "abs"):
        operation = getattr(operator, name)
        setattr(Watched, f"__{name}__", lambda *inputs, operation=operation: followed(operation, *inputs))
    for name in ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow"):
        operation = getattr(operator, name)
        setattr(Watched, f"__{name}__", lambda a, b, operation=operation: followed(operation, a, b))
        setattr(Watched, f"__r{name}__", lambda a, b, operation=operation: followed(operation, b, a))
    Watched.__bool__ = lambda self: bool(followed(bool, self))  # type: ignore[attr-defined]
    for function in (float, int, round, hash, len, iter):
        name = f"__{function.__name__}__"
        setattr(Watched, name, lambda self, *more, function=function: function(self.plain(), *more))


_methods()
