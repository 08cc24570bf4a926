"""What a file of `robots` must say to be in the catalogue under its own name."""

import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from importlib import import_module
from inspect import Parameter, signature, unwrap
from pathlib import Path

import pytest

import robots
from framework import InvalidInput, ParallelRobot, load_robot
from framework.catalogue import URDF, CatalogueEntry
from framework.model.description import FLEXIBILITIES
from tests.watchdog import PATIENCE

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
    assert unwrap(robots.load) is unwrap(load_robot)  # `conftest` wraps it


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
        [sys.executable, str(script)], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert (run.stdout, run.stderr) == ("five_bar\n", "")


# a robot more in the catalogue is a robot more in every generated test, with no edit of another file


PROJECT = Path(__file__).resolve().parents[2]
SUITE = sorted((PROJECT / "tests" / "robots").glob("test_every_robot*.py"))
SOURCE, NEW = "three_prr", "my_robot"
ENTRY = f'''
from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(file=own_file("{NEW}"), summary="a test", source="none")
'''


@pytest.mark.slow
def test_a_file_in_robots_is_all_that_the_generated_tests_need(tmp_path):
    for part in ("framework", "robots", "tests", "urdf"):
        shutil.copytree(PROJECT / part, tmp_path / part, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(PROJECT / "pyproject.toml", tmp_path)
    folder = tmp_path / "urdf" / NEW
    folder.mkdir()
    for file in (PROJECT / "tests" / "data" / SOURCE).iterdir():
        text = file.read_text(encoding="utf-8").replace(SOURCE, NEW)
        (folder / file.name.replace(SOURCE, NEW)).write_text(text, encoding="utf-8")
    (tmp_path / "robots" / f"{NEW}.py").write_text(ENTRY, encoding="utf-8")

    # its links are so stiff that the witness takes half a minute for them; drives are springs as well
    chosen = f"{NEW} and not (elastic_robot_along_the_path and flexible_links)"
    options = ["-q", "--assert=plain", "-m", "slow or not slow", "-k", chosen, "-p", "no:cacheprovider"]
    options.append("--junitxml=found.xml")
    files = [str(file.relative_to(PROJECT)) for file in SUITE]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *files],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert run.returncode == 0, run.stdout[-3000:] + run.stderr[-1000:]

    cases = ElementTree.parse(tmp_path / "found.xml").getroot().findall(".//testcase")
    assert all(len(case.findall("skipped")) == 0 for case in cases)
    names = [case.get("name", "") for case in cases]
    assert all(NEW in name for name in names)
    laws = [law for file in SUITE for law in re.findall(r"^def (test_\w+)", file.read_text(), re.MULTILINE)]
    assert {name.split("[")[0] for name in names} == set(laws)
    for flexibility in FLEXIBILITIES:
        assert any(flexibility in name for name in names)
