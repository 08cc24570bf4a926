"""A browser without a screen: Chromium as installed, driven by playwright."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
# Drawn in software; nothing goes out by itself.
FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]


def wait_until(tab: Any, condition: str, seconds: float = 30.0) -> None:
    """Wait until an expression is true on the page, whose policy forbids playwright's own way of waiting."""
    end = time.monotonic() + seconds
    while not tab.evaluate(condition):
        assert time.monotonic() < end, f"never true: {condition}"
        tab.wait_for_timeout(20)


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.fail(f"no browser found; install one of {', '.join(NAMES)} (Debian: apt-get install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def opened(chromium, tmp_path) -> Iterator[Callable[..., Any]]:
    """Opens a page, given as HTML or by its address, and fails if it complains or asks the network for more.

    HTML is opened from a file, with the network off. A film plays by itself where motion is wanted.
    """
    contexts, complaints = [], []

    def open_page(page: str, *, width: int = 1280, height: int = 760, playing: bool = False) -> Any:
        served = page.startswith("http://127.0.0.1:")
        context = chromium.new_context(
            viewport={"width": width, "height": height},
            offline=not served,
            reduced_motion="no-preference" if playing else "reduce",
        )
        contexts.append(context)
        if not served:
            file: Path = tmp_path / f"page{len(contexts)}.html"
            file.write_text(page, encoding="utf-8")
        address = page if served else f"file://{file}"
        tab = context.new_page()
        tab.on("console", lambda message: complaints.append(f"{message.type}: {message.text}"))
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.on(
            "request",
            lambda request: (
                None
                if request.url.startswith((address, "data:", "blob:"))
                else complaints.append(request.url)
            ),
        )
        tab.goto(address)
        wait_until(tab, "Boolean(window.crossing)")
        return tab

    yield open_page
    for context in contexts:
        context.close()
    assert complaints == []
