"""The table of refusals names every module on the way of a plan that makes an error of the kind "no"."""

from __future__ import annotations

import ast
import inspect
from importlib import import_module

import pytest

from framework import errors
from framework.planning import plan
from framework.planning.refusals.reasons import REASONS
from framework.singularity.piecewise_measure import Unresolved
from tests.test_imports import FILES, imports

REFUSALS = {
    name
    for name, value in vars(errors).items()
    if inspect.isclass(value) and issubclass(value, errors.NoAnswer)
}


def modules_on_the_way(start: str) -> set[str]:
    """All modules of the framework that one of them imports, by way of others too."""
    below, waiting = set[str](), [start]
    while waiting:
        module = waiting.pop()
        if module not in below:
            below.add(module)
            waiting += imports(module) & set(FILES)
    return below


def errors_made(module: str) -> set[str]:
    """The errors that say no and that a module calls by name."""
    calls = [node for node in ast.walk(ast.parse(FILES[module].read_text())) if isinstance(node, ast.Call)]
    names = {getattr(call.func, "id", "") for call in calls}
    return (names & REFUSALS) | ({"NotConverged"} if Unresolved.__name__ in names else set())


# what a plan leaves out is asked of it afterwards, and no reason to refuse it
AFTERWARDS = {"framework.planning.model_on_motion"}
ON_THE_WAY = modules_on_the_way(plan.__name__) - AFTERWARDS


@pytest.mark.parametrize("module", sorted(module for module in ON_THE_WAY if errors_made(module)))
def test_whatever_refuses_a_plan_is_in_the_table(module):
    listed = {
        reason.error.__name__
        for reason in REASONS
        if module in {function.__module__ for function in reason.decided_by}
    }
    assert errors_made(module) <= listed, f"{module} refuses with {errors_made(module) - listed} too"


@pytest.mark.parametrize("reason", REASONS, ids=lambda reason: reason.why)
def test_what_the_table_names_is_on_the_way_of_a_plan(reason):
    for function in reason.decided_by:
        assert function.__module__ in ON_THE_WAY
        assert getattr(import_module(function.__module__), function.__name__) is function
