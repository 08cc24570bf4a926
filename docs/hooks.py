"""What `make docs` adds: notebooks, commands, robots, the reference of Python, formulas as MathML."""

from __future__ import annotations

import ast
import json
import os
import re
from html import unescape
from pathlib import Path
from typing import Any

import griffe
from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

from framework.catalogue import own_robots
from framework.cli.commands import COMMANDS, parser_of
from framework.planning.options import OPTIONS

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
PACKAGES = ["framework"] + [
    f"framework.{stub.parent.name}" for stub in sorted((ROOT / "framework").glob("*/__init__.pyi"))
]


def on_config(config: Any) -> Any:
    """Add the notebooks to the contents."""
    config.nav[-1] = {"Notebooks": [f"notebooks/{notebook.stem}.md" for notebook in NOTEBOOKS]}
    reference = next(part["Reference"] for part in config.nav if "Reference" in part)
    reference += [f"reference/{package}.md" for package in PACKAGES]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are made, and the files that they show."""
    pages = {f"notebooks/{notebook.stem}.md": notebook_page(notebook) for notebook in NOTEBOOKS}
    pages |= {f"reference/{package}.md": package_page(package) for package in PACKAGES}
    pages["reference/python.md"] = python_page()
    pages["reference/commands.md"] = commands_page()
    pages["reference/robot_file.md"] = robot_file_page()
    pages["gallery.md"] = gallery_page()
    pages["changelog.md"] = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    for file in [*sorted((ROOT / "notebooks" / "figures").iterdir()), ROOT / "notebooks" / "lesson.html"]:
        path = f"figures/{file.name}" if file.suffix != ".html" else file.name
        files.append(File.generated(config, path, abs_src_path=str(file)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Lead links to files of the repository, which lie outside docs/, to the pages made of them."""
    made = {
        r"notebooks/(\d\d_\w+)\.ipynb": r"notebooks/\2.md",
        r"notebooks/(figures/[\w.]+|lesson\.html)": r"\2",
        r"notebooks": r"notebooks/01_the_paper_in_ten_minutes.md",
        r"urdf/README\.md": "reference/robot_file.md",
        r"urdf": "gallery.md",
        r"framework/cli/commands\.py": "reference/commands.md",
        r"framework/__init__\.py": "reference/python.md",
    }
    for source, page in made.items():
        markdown = re.sub(rf"\]\(((?:\.\./)*)\.\./{source}\)", rf"](\1{page})", markdown)
    return markdown


def on_page_content(html: str, **_: Any) -> str:
    """Write formulas as MathML, which needs no script."""

    def to_mathml(found: re.Match[str]) -> str:
        kind, text = found[1], unescape(found[2]).strip()
        return convert(text[2:-2], display="block" if kind == "div" else "inline")

    return re.sub(r'<(div|span) class="arithmatex">(.*?)</\1>', to_mathml, html, flags=re.DOTALL)


# ------------------------------------------------------------------ pages


def notebook_page(file: Path) -> str:
    """Return a stored notebook as a page: text, code, and what it printed and drew."""
    parts = [colab_link(file)]
    for cell in json.loads(file.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(relinked(source))
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {})
            if "image/png" in data:
                alt = output["metadata"].get("image/png", {}).get("alt", "").replace('"', "&quot;")
                image = "".join(data["image/png"]).replace("\n", "")
                parts.append(f'<img alt="{alt}" src="data:image/png;base64,{image}">')
            else:
                text = "".join(output.get("text", data.get("text/plain", "")))
                parts.append(f"```text\n{text}\n```")
    return "\n\n".join(filter(None, parts))


def colab_link(file: Path) -> str:
    """Return the link that opens a notebook of a tag in Colab, and what to install there first."""
    repository, tag = os.environ.get("GITHUB_REPOSITORY"), os.environ.get("GITHUB_REF_NAME", "")
    if not (repository and tag.startswith("v")):
        return ""
    address = f"https://colab.research.google.com/github/{repository}/blob/{tag}/notebooks/{file.name}"
    install = f"%pip install git+https://github.com/{repository}@{tag}"
    return f"[Open in Colab]({address}), and run `{install}` in a first cell."


def relinked(text: str) -> str:
    """Lead links of a notebook or a folder's README to pages; leave those to files of the code as words."""
    text = re.sub(r"\]\((?:\.\./notebooks/)?(\d\d_\w+)\.ipynb\)", r"](../notebooks/\1.md)", text)
    text = re.sub(r"\]\((?:\.\./notebooks/)?(figures/[\w.]+|lesson\.html)\)", r"](../\1)", text)
    text = re.sub(r"\]\((?:\.\./)?urdf/README\.md[^)]*\)", "](../reference/robot_file.md)", text)
    return re.sub(
        r"\[([^\]]+)\]\((?!\.\./(?:notebooks|figures|lesson|reference)|https?:|#)[^)]*\)", r"\1", text
    )


def commands_page() -> str:
    """Return the help of all commands."""
    parts = ["# Commands", "Every command takes `--json`: one JSON object on stdout, nothing else.", ""]
    for name in COMMANDS:
        parser = parser_of([name])
        (commands,) = (action for action in parser._actions if action.dest == "COMMAND" or action.choices)
        parts += [f"## {name}", f"```text\n{commands.choices[name].format_help()}```"]
    return "\n\n".join(parts)


def robot_file_page() -> str:
    """Return the reference of the keys of a robot file."""
    return relinked((ROOT / "urdf" / "README.md").read_text(encoding="utf-8"))


def gallery_page() -> str:
    """Return the robots of the catalogue with their scenes, each with its command."""
    parts = ["# The robots", "![The robots of the catalogue](figures/catalogue.png)"]
    parts.append(
        "Scenes *refused by design* ask nothing at their singular point, or beside it, to show the pole."
    )
    for name, entry in own_robots().items():
        content = entry.file.read_text(encoding="utf-8")
        scenes = re.findall(
            r"(?:^  # (.*)\n)?^  (\w[\w-]*):", content.partition("\nscenes:")[2], re.MULTILINE
        )
        plans = [
            f"crossing plan {name} --scene {scene} --out {name}_{scene}"
            + ("  # refused by design: the torques have a pole" if "pole" in comment else "")
            for comment, scene in scenes
        ]
        commands = "\n".join([f"crossing show {name}", *plans])
        summary = entry.summary[0].upper() + entry.summary[1:]
        parts.append(f"## {name}\n\n{summary}. {entry.why} Source: {entry.source}.")
        parts.append(f"```sh\n{commands}\n```")
    return "\n\n".join(parts)


def python_page() -> str:
    """Return the overview of the package, its packages linked."""
    module = ast.parse((ROOT / "framework" / "__init__.py").read_text(encoding="utf-8"))
    linked = re.sub(r"`(framework\.\w+)`", linked_package, ast.get_docstring(module) or "")
    return "# Python\n\n" + linked


def linked_package(found: re.Match[str]) -> str:
    """Link the page of a package; names of `framework.errors` and `framework.catalogue` are the core's."""
    page = found[1] if found[1] in PACKAGES else "framework"
    return f"[`{found[1]}`]({page}.md)"


def public_names(package: str) -> dict[str, str]:
    """Return the module of each public name of a package."""
    stub = ROOT / package.replace(".", "/") / "__init__.pyi"
    imports = [
        node for node in ast.parse(stub.read_text(encoding="utf-8")).body if isinstance(node, ast.ImportFrom)
    ]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def package_page(package: str) -> str:
    """Return the reference of the public names of a package; those of the core stand on its page alone."""
    homes = public_names(package)
    core = set() if package == "framework" else set(public_names("framework"))
    parts = [f"# {package}", f"`from {package} import ...`"]
    if there := [f"[`{name}`][{homes[name]}.{name}]" for name in sorted(core & set(homes))]:
        parts.append(f"Also public here, described with the [core](framework.md): {', '.join(there)}.")
    if "plan_crossing" in homes and not core:
        rows = [f"| `{each.name}` | {each.summary}{each.details} |" for each in OPTIONS.values()]
        table = "\n".join(["| option | meaning |", "|---|---|", *rows])
        parts.append(f"## Options of a plan\n\n{table}")
    parts += [
        f"::: {homes[name]}.{name}\n    options:\n      heading: {name}" for name in sorted(set(homes) - core)
    ]
    return "\n\n".join(parts)


class FieldComments(griffe.Extension):
    """Take the comment behind a field, with its shape and unit, for its docstring."""

    def on_function_instance(self, *, func: griffe.Function, **_: Any) -> None:
        """Lead from a function that takes the options of a plan to their list."""
        if func.docstring is not None and "{options}" in func.docstring.value:
            listed = "options: see [the list](framework.md#options-of-a-plan)."
            func.docstring.value = func.docstring.value.replace("{options}", listed)

    def on_attribute_instance(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Give a field without a docstring the comment at the end of its lines."""
        if attr.docstring is None and attr.lineno and attr.endlineno and attr.parent and attr.parent.is_class:
            line = attr.lines_collection[attr.filepath][attr.endlineno - 1]
            comment = line.partition("  # ")[2]
            if comment and not comment.startswith(("type:", "noqa")):
                attr.docstring = griffe.Docstring(comment, parent=attr)
