"""The pages of the site: examples run, links lead somewhere, and it is built without a warning."""

import re
import shlex
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from framework.cli import main

ROOT = Path(__file__).parents[1]
PAGES = sorted(ROOT.glob("docs/**/*.md"))
BLOCK = re.compile(r'^```(\w+)(?: title="([\w.]+)")?\n(.*?)^```', re.MULTILINE | re.DOTALL)
WITH_CODE = [page for page in PAGES if "```python" in page.read_text(encoding="utf-8")]
TUTORIAL = ROOT / "docs" / "your_own_robot.md"


@pytest.mark.filterwarnings("ignore:zmq.eventloop")  # of meshcat
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=page.stem, marks=pytest.mark.slow if page.stem == "controllers" else ())
        for page in WITH_CODE
    ],
)
def test_the_code_of_a_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files with titles are written, commands of the tutorial run, then all Python in one namespace."""
    monkeypatch.chdir(tmp_path)
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    for _, title, text in blocks:
        if title:
            Path(title).write_text(text, encoding="utf-8")
    for kind, _, text in blocks if page == TUTORIAL else ():
        for line in text.splitlines() if kind == "sh" else ():
            assert main(shlex.split(line, comments=True)[1:]) == 0, line
    names: dict[str, object] = {}
    for kind, _, text in blocks:
        if kind == "python":
            exec(compile(text, str(page), "exec"), names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8")):
        if not link.startswith("http"):
            assert (page.parent / link).exists(), link  # in the repository, before `make docs`, too


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs")
    pytest.importorskip("mkdocstrings")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    files = {file for file in tmp_path.resolve().rglob("*") if file.is_file()}
    pages = {page: page.read_text(encoding="utf-8") for page in tmp_path.rglob("*.html")}
    assert "<math" in pages[tmp_path / "theory" / "index.html"]
    for page, text in pages.items():  # what a browser asks for is there; 404.html is of the web alone
        for link in re.findall(r'\s(?:href|src)="([^"]*)"', text) if page.stem != "404" else ():
            if not re.match(r"https?:|data:|mailto:|#", link):
                place = page.parent / unquote(urlsplit(link).path)
                assert place.resolve() in files, (page.name, link)
