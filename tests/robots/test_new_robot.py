"""A robot more in the catalogue is a robot more in every generated test, with no edit of another file.

The robot is a 3-PRR that is in no catalogue (tests/data/three_prr), added by the recipe of robots/README.md.
Its drive springs sit behind motors without inertia, so they balance the motors and no torque depends on them,
and its energy needs more nodes than most. The generated tests have to pass for it as for any right robot.
"""

import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from framework.model.description import FLEXIBILITIES

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
