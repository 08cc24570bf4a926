"""The table of refusals names every module on the way of a plan that makes an error of the kind "no"."""

import inspect
import pickle
import re
from functools import cache
from importlib import import_module

import pytest

from framework import errors
from framework.planning import plan, refusals
from framework.singularity.piecewise_measure import Unresolved
from tests.test_imports import FILES, imports

REFUSALS = {
    name
    for name, value in vars(errors).items()
    if inspect.isclass(value) and issubclass(value, errors.NoAnswer)
}


@cache
def modules_on_the_way() -> set[str]:
    """All modules that planning imports, by way of others too, but for what is asked of a plan afterwards."""
    below, waiting = set[str](), [plan.__name__]
    while waiting:
        module = waiting.pop()
        if module not in below:
            below.add(module)
            waiting += imports(module) & set(FILES)
    return below - AFTERWARDS


def errors_made(module: str) -> set[str]:
    """The errors that say no and that a module calls by name."""
    names = set(re.findall(r"(?<!class )\b(\w+)\(", FILES[module].read_text()))
    return (names & REFUSALS) | ({"NotConverged"} if Unresolved.__name__ in names else set())


# what a plan leaves out is asked of it afterwards, and no reason to refuse it
AFTERWARDS = {"framework.planning.neglected_effects"}


def read_table(text: str) -> list[tuple[str, str, list[str]]]:
    """The error, the sentence and the deciding functions of each reason."""
    rows: list[tuple[str, str, list[str]]] = []
    for line in text.splitlines():
        head, decides = re.fullmatch(r" {4}(\w+): (.+)", line), re.fullmatch(r" {8}([\w.]+)", line)
        if head:
            rows.append((head[1], head[2], []))
        elif decides:
            rows[-1][2].append(f"framework.{decides[1]}")
    return rows


TABLE = read_table(refusals.__doc__)


def test_whatever_refuses_a_plan_is_in_the_table():
    made = {module: errors_made(module) for module in modules_on_the_way()}
    assert sum(map(bool, made.values())) >= 20
    for module, refusals_made in made.items():
        listed = {error for error, _, names in TABLE if module in {name.rpartition(".")[0] for name in names}}
        assert refusals_made <= listed, f"{module} refuses with {refusals_made - listed} too"


@pytest.mark.parametrize("reason", TABLE, ids=lambda reason: reason[1])
def test_what_the_table_names_is_on_the_way_of_a_plan(reason):
    error, _, names = reason
    assert error in REFUSALS
    assert names
    for name in names:
        module, _, function = name.rpartition(".")
        assert module in modules_on_the_way()
        assert getattr(import_module(module), function).__module__ == module


def test_a_refusal_is_said_from_its_parts_also_behind_a_process():
    refusal = errors.NoLaw("the law turns back", name="arm").adding("give other times", "")
    wrong = pickle.loads(pickle.dumps(errors.RobotFileError("no loop").naming("arm.yaml").adding("add one")))
    assert (wrong.name, wrong.message, wrong.clauses) == ("arm.yaml", "no loop", ("add one",))
    assert str(wrong) == "arm.yaml: no loop; add one"
    more = refusal.adding("nor does a bend help").advising({"bend": None})
    assert (refusal.clauses, refusal.remedy) == (("give other times",), None)  # an error does not change
    for error in (more, pickle.loads(pickle.dumps(more))):
        assert (error.message, error.clauses) == (
            "the law turns back",
            ("give other times", "nor does a bend help"),
        )
        assert str(error) == "arm: the law turns back; give other times; nor does a bend help"


def test_nothing_takes_the_text_of_an_error_apart():
    cuts = re.compile(
        r"str\(\w+\)\.(removeprefix|removesuffix|r?partition|startswith|endswith)\(|\w\.args = "
    )
    assert not [module for module, file in FILES.items() if cuts.search(file.read_text())]
