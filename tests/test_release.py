"""One version everywhere, and a changelog that a user reads."""

import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
RELEASES = re.findall(r"^## \[([\d.]+)\] - (\d{4}-\d\d-\d\d)$", CHANGELOG, re.MULTILINE)


def test_package_citation_and_changelog_name_one_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    version, date = RELEASES[0]
    assert (project["version"], citation["version"], citation["date-released"].isoformat()) == (
        version,
        version,
        date,
    )


def test_releases_stand_in_order_below_what_is_not_released() -> None:
    headings = re.findall(r"^## \[([^\]]+)\]", CHANGELOG, re.MULTILINE)
    assert headings == ["Unreleased", *(version for version, _ in RELEASES)]
    numbers = [tuple(map(int, version.split("."))) for version, _ in RELEASES]
    assert numbers == sorted(set(numbers), reverse=True)
    assert [date for _, date in RELEASES] == sorted((date for _, date in RELEASES), reverse=True)


def test_a_release_has_each_heading_once_and_short_lines() -> None:
    for release in re.split(r"^## ", CHANGELOG, flags=re.MULTILINE)[2:]:
        headings = re.findall(r"^### (.+)$", release, re.MULTILINE)
        assert headings
        assert len(headings) == len(set(headings)), release[:20]
        assert set(headings) <= {"Added", "Changed", "Deprecated", "Fixed", "Removed"}
        assert max(map(len, release.splitlines())) <= 120


def test_actions_are_pinned_by_commit_and_keep_no_credentials() -> None:
    for file in sorted((ROOT / ".github" / "workflows").glob("*.yml")):
        for job in yaml.safe_load(file.read_text(encoding="utf-8"))["jobs"].values():
            for step in job["steps"]:
                action, _, commit = step.get("uses", "").partition("@")
                assert not action or re.fullmatch("[0-9a-f]{40}", commit), step
                assert action != "actions/checkout" or step["with"]["persist-credentials"] is False


def test_texts_install_extras_from_a_clone() -> None:
    """The package is on no index yet, so that its name alone installs nothing."""
    texts = [
        *ROOT.glob("*.md"),
        *ROOT.glob("*/*.md"),
        *ROOT.glob("docs/**/*.md"),
        *ROOT.glob("framework/**/*.py"),
    ]
    for file in texts:
        assert "pip install 'parallel-singularity-crossing[" not in file.read_text(encoding="utf-8"), file
