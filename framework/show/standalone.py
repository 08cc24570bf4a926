"""A page in one file, with styles, scripts and data inline. It fetches nothing and works offline."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from framework.numerics.output import plain
from framework.show.style import page_colors


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


def encode_array(values: np.ndarray) -> str:
    """Encode an array for the scripts, as base64 of its rows."""
    return base64.b64encode(values.tobytes()).decode("ascii")


def page_part(name: str, **texts: Any) -> str:
    """Fill the placeholders of a file of framework/show/page with HTML."""
    return Template(_read_asset(name)).substitute(texts)


@cache
def _read_asset(name: str) -> str:
    """Read a file of framework/show/page."""
    return files("framework.show").joinpath("page", name).read_text(encoding="utf-8")
