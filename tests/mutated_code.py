"""Functions changed in one place, to see whether a test notices."""

from __future__ import annotations

import inspect
from textwrap import dedent
from types import CodeType, FunctionType


def mutated_code(function: FunctionType, old: str, new: str) -> CodeType:
    """Return the code of a function in whose source `old`, which must occur once, is replaced by `new`.

    Set as `function.__code__` it reaches every module that has imported the function.
    """
    source = dedent(inspect.getsource(function))
    assert source.count(old) == 1, f"{function.__qualname__}: {source.count(old)} times {old!r}"
    annotated = "from __future__ import annotations\n" + source.replace(old, new)
    compiled = compile(annotated, inspect.getfile(function), "exec", dont_inherit=True)
    namespace: dict[str, object] = {}
    exec(compiled, dict(function.__globals__), namespace)
    changed = namespace[function.__name__]
    for inner in ("__func__", "fget"):  # of a static method, of a property
        changed = getattr(changed, inner, changed)
    return inspect.unwrap(changed).__code__
