"""What a file of `robots` must say to be in the catalogue under its own name."""

from __future__ import annotations

from importlib import import_module
from inspect import Parameter, signature
from pathlib import Path

import pytest

import robots
from framework import ParallelRobot
from framework.catalogue import CatalogueEntry
from robots.files import URDF

HERE = Path(robots.__file__).parent
MODULES = sorted(path.stem for path in HERE.glob("*.py") if "ENTRY = " in path.read_text(encoding="utf-8"))
KINDS = {"type_1", "type_2", "leg_passive", "constraint", "closure"}


@pytest.mark.parametrize("name", MODULES)
def test_an_entry_has_the_name_of_its_module_and_says_what_it_is(name):
    """Two entries of one name would hide one another."""
    module = import_module(f"robots.{name}")
    assert module.ENTRY.name == name
    assert robots.CATALOGUE[name] is module.ENTRY
    assert robots.load(name).name == name
    assert module.ENTRY.summary
    assert module.ENTRY.source
    assert set(module.ENTRY.singularities) <= KINDS


def test_every_folder_of_urdf_is_a_robot_and_has_its_own_tests():
    assert {folder.name for folder in URDF.iterdir() if folder.is_dir()} == set(MODULES)
    tests = {path.stem.removeprefix("test_") for path in Path(__file__).parent.glob("test_*.py")}
    assert set(MODULES) <= tests


@pytest.mark.parametrize(
    "load",
    [robots.load, CatalogueEntry.load, ParallelRobot.from_file, ParallelRobot.from_description],
    ids=["robots.load", "CatalogueEntry.load", "from_file", "from_description"],
)
def test_flexibility_is_said_by_name_wherever_a_robot_is_made(load):
    assert signature(load).parameters["flexibility"].kind is Parameter.KEYWORD_ONLY


@pytest.mark.parametrize("name", MODULES)
def test_a_robot_is_made_by_its_entry_and_not_by_its_module(name):
    assert not hasattr(import_module(f"robots.{name}"), "load")
