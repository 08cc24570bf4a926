"""A page of its own: everything inline, nothing fetched, so that it plays with the network off.

The viewer is the JavaScript of the installed `meshcat` package, read when a page is made.
"""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Any

from framework.errors import MissingPackage

SCRIPTS = ("shapes.js", "view.js", "curves.js", "film.js", "hand.js", "main.js")


def scene_page(documents: Sequence[dict[str, Any]], *, heading: str, lead: str) -> str:
    """The page that plays films, or moves a robot by hand: HTML, complete.

    `heading` is plain text, `lead` is HTML.
    """
    return whole_page(heading, scene_part(heading, lead), documents)


def scene_part(heading: str, lead: str) -> str:
    """The part of a page in which the scene is drawn."""
    return Template(_asset("scene.html")).substitute(heading=html.escape(heading), lead=lead)


def whole_page(title: str, body: str, documents: Sequence[dict[str, Any]]) -> str:
    """A page with this body and the scripts that fill its scene from the documents."""
    viewer, licences = _viewer()
    return Template(_asset("page.html")).substitute(
        title=html.escape(title),
        style=_asset("page.css"),
        licences=licences.replace("--", "- -"),
        body=body,
        viewer=viewer.replace("</script", "<\\/script"),
        documents=json.dumps(list(documents), allow_nan=False).replace("<", "\\u003c"),
        script="\n".join(_asset(name) for name in SCRIPTS),
    )


@cache
def _asset(name: str) -> str:
    return files("framework.show").joinpath("page", name).read_text(encoding="utf-8")


@cache
def _viewer() -> tuple[str, str]:
    """MeshCat's JavaScript and the licences of what is in it."""
    found = find_spec("meshcat")
    if found is None or found.origin is None:
        raise MissingPackage(
            "the viewer is part of meshcat, which is not installed: pip install meshcat", package="meshcat"
        )
    viewer = Path(found.origin).parent / "viewer"
    texts = [viewer / "LICENSE", viewer / "dist" / "main.min.js.LICENSE.txt"]
    licences = "\n\n".join(text.read_text(encoding="utf-8") for text in texts if text.is_file())
    return (viewer / "dist" / "main.min.js").read_text(encoding="utf-8"), licences
