"""What a file of `robots` must say to be in the catalogue under its own name."""

import subprocess
import sys
from importlib import import_module
from inspect import Parameter, signature, unwrap
from pathlib import Path

import pytest

import robots
from framework import InvalidInput, ParallelRobot, load_robot
from framework.catalogue import URDF, CatalogueEntry

HERE = Path(robots.__file__).parent
MODULES = sorted(path.stem for path in HERE.glob("*.py") if "ENTRY = " in path.read_text(encoding="utf-8"))
KINDS = {"type_1", "type_2", "leg_passive", "constraint", "closure"}


@pytest.mark.parametrize("name", MODULES)
def test_an_entry_has_the_name_of_its_module_and_says_what_it_is(name):
    """Two entries of one name would hide one another."""
    module = import_module(f"robots.{name}")
    assert module.ENTRY.name == name
    assert robots.CATALOGUE[name] == module.ENTRY
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
    [load_robot, CatalogueEntry.load, ParallelRobot.from_file, ParallelRobot.from_description],
    ids=["load_robot", "CatalogueEntry.load", "from_file", "from_description"],
)
def test_flexibility_is_said_by_name_wherever_a_robot_is_made(load):
    assert signature(load).parameters["flexibility"].kind is Parameter.KEYWORD_ONLY


@pytest.mark.parametrize("name", MODULES)
def test_a_robot_is_made_by_its_entry_and_not_by_its_module(name):
    assert not hasattr(import_module(f"robots.{name}"), "load")


def test_a_name_and_a_path_load_the_same_robot():
    file = robots.CATALOGUE["five_bar"].file
    named = load_robot("five_bar", flexibility="flexible_links")
    for path in (file, str(file)):
        robot = load_robot(path, flexibility="flexible_links")
        assert robot.spring_names == named.spring_names
        assert robot.description.file == named.description.file
    assert unwrap(robots.load) is load_robot  # `conftest` wraps it


@pytest.mark.parametrize(
    ("given", "hint"), [("five_bare", "did you mean 'five_bar'?"), (None, ""), (5, ""), (["five_bar"], "")]
)
def test_what_names_no_robot_is_answered_with_the_valid_names(given, hint):
    with pytest.raises(InvalidInput, match=r"unknown robot .*agile_eye.*path of a robot file") as caught:
        load_robot(given)
    assert hint in str(caught.value)


def test_a_robots_py_beside_the_users_script_hides_no_robot(tmp_path):
    (tmp_path / "robots.py").write_text("raise SystemExit('not this one')", encoding="utf-8")
    script = tmp_path / "script.py"
    script.write_text("import framework; print(framework.load_robot('five_bar').name)", encoding="utf-8")
    run = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False
    )
    assert (run.stdout, run.stderr) == ("five_bar\n", "")
