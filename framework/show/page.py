"""Pages in one file that fetch nothing and work offline: `standalone_page` makes any of them.

The others are pages on which robots move in three dimensions: films, and robots moved by hand. Their
viewer is the JavaScript of the installed `meshcat` package, copied into each page.
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
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.output import Document, plain
from framework.show.captions import display_name
from framework.show.film import Film
from framework.show.jogging import hand_document
from framework.show.scene import film_documents
from framework.show.style import page_colors

SCRIPTS = (
    "shapes.js",
    "forces.js",
    "view.js",
    "curves.js",
    "words.js",
    "vectors.js",
    "film.js",
    "jogging.js",
    "main.js",
)

FILM_LEAD = (
    "The motors of a parallel robot move its <b>platform</b> together. At a <b>Type 2 singularity</b> "
    "(purple) they cannot push it along one motion, t<sub>s</sub>, the <b>uncontrolled motion</b>: "
    "resisting a force there would take infinite torque. A motion can go through all the same, a "
    "<b>crossing</b>, if at that instant it asks for <b>no force along t<sub>s</sub></b>: "
    "t<sub>s</sub> · W<sub>p</sub> = 0."
)
HAND_LEAD = (
    "Move the platform (the part that the motors move together), or the motors, and watch how near the robot "
    "is to a singularity, where the arrow t<sub>s</sub> is the uncontrolled motion. The loops stay "
    "closed; at the edge of the workspace the robot stops rather than jump to another way of being "
    "assembled. <b>The platform's sliders lead it across a Type 2 singularity; the motors' end on it.</b>"
)


def film_page(films: Sequence[Film]) -> str:
    """Return the page (HTML) that plays films side by side."""
    names = " and ".join(dict.fromkeys(display_name(film.robot.name) for film in films))
    return whole_page(names, scene_part(names, FILM_LEAD), film_documents(films))


def hand_page(robot: ParallelRobot) -> str:
    """Return the page (HTML) with sliders that ask `move_by_hand`."""
    heading = display_name(robot.name)
    return whole_page(heading, scene_part(heading, HAND_LEAD), [hand_document(robot)])


def scene_part(heading: str, lead: str) -> str:
    """Return the part of a page (HTML) in which the scene is drawn.

    `heading` is plain text, `lead` is HTML.
    """
    return page_part("scene.html", heading=html.escape(heading), lead=lead)


def whole_page(title: str, body: str, documents: Sequence[Document]) -> str:
    """Return a page (HTML) with this body, and the scripts that draw its scene."""
    return standalone_page(
        title, body, documents, styles=["page.css"], scripts=SCRIPTS, library=_viewer_html()
    )


@cache
def _viewer_html() -> str:
    """Return MeshCat's JavaScript and its licences, as HTML."""
    package = find_spec("meshcat")
    if package is None or package.origin is None:
        raise MissingPackage(
            "the viewer is part of meshcat, which is not installed: pip install meshcat", package="meshcat"
        )
    viewer = Path(package.origin).parent / "viewer"
    files = [viewer / "LICENSE", viewer / "dist/main.min.js.LICENSE.txt"]
    licences = "\n\n".join(file.read_text(encoding="utf-8") for file in files if file.is_file())
    script = (viewer / "dist/main.min.js").read_text(encoding="utf-8")
    return page_part(
        "viewer.html", licences=licences.replace("--", "- -"), script=script.replace("</script", "<\\/script")
    )


# ------------------------------------------------------------------ any page


def standalone_page(
    title: str, body: str, data: object, *, styles: Sequence[str], scripts: Sequence[str], library: str = ""
) -> str:
    """Return a page (HTML) with styles, scripts and data inline.

    Args:
        title: plain text.
        body: HTML.
        data: for the scripts, which read it as JSON from the element `document`.
        styles, scripts: names of files in framework/show/page, in addition to those that all pages share.
        library: HTML in front of the scripts.
    """
    return page_part(
        "page.html",
        title=html.escape(title),
        style="\n".join([page_colors(), *map(_read_asset, ("shared.css", *styles))]),
        body=body,
        library=library,
        document=json.dumps(plain(data), allow_nan=False).replace("<", "\\u003c"),
        script="\n".join(map(_read_asset, ("shared.js", *scripts))),
    )


def page_part(name: str, **texts: Any) -> str:
    """Fill the placeholders of a file of framework/show/page with HTML."""
    return Template(_read_asset(name)).substitute(texts)


@cache
def _read_asset(name: str) -> str:
    """Read a file of framework/show/page."""
    return files("framework.show").joinpath("page", name).read_text(encoding="utf-8")
