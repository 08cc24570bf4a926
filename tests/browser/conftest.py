"""A browser without a screen: Chromium as installed, driven by playwright."""

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from framework.show.page import film_page
from tests.browser.pages import filmed

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
WIDTH, HEIGHT = 1280, 760  # of a window, where nothing else is said
KEPT = 4  # pages that are kept open for other tests
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


class Tabs:
    """Pages in tabs of their own, and what they complained of or asked the network for."""

    def __init__(self, chromium: Any, folder: Path) -> None:
        self.chromium, self.folder = chromium, folder
        self.contexts: list[Any] = []
        self.complaints: list[str] = []

    def open(self, page: str, *, width: int = WIDTH, height: int = HEIGHT, playing: bool = False) -> Any:
        """A page given as HTML, opened from a file with the network off, or by its address.

        A film plays by itself where motion is wanted.
        """
        served = page.startswith("http://127.0.0.1:")
        context = self.chromium.new_context(
            viewport={"width": width, "height": height},
            offline=not served,
            reduced_motion="no-preference" if playing else "reduce",
        )
        self.contexts.append(context)
        if not served:
            file = self.folder / f"page{len(self.contexts)}.html"
            file.write_text(page, encoding="utf-8")
        address = page if served else f"file://{file}"
        tab = context.new_page()
        tab.on("console", lambda message: self.complaints.append(f"{message.type}: {message.text}"))
        tab.on("pageerror", lambda error: self.complaints.append(str(error)))
        tab.on(
            "request",
            lambda request: (
                None
                if request.url.startswith((address, "data:", "blob:"))
                else self.complaints.append(request.url)
            ),
        )
        tab.goto(address)
        wait_until(tab, "Boolean(window.crossing)")
        return tab

    def close(self) -> None:
        for context in self.contexts:
            context.close()


@pytest.fixture
def opened(chromium, tmp_path) -> Iterator[Callable[..., Any]]:
    """Opens pages, and fails if one complains or asks the network for more; see `Tabs.open`."""
    tabs = Tabs(chromium, tmp_path)
    yield tabs.open
    tabs.close()
    assert tabs.complaints == []


@pytest.fixture(scope="session")
def kept(chromium, tmp_path_factory) -> Iterator[dict[tuple[str, ...], tuple[Tabs, Any]]]:
    """The pages that `shared` has opened last."""
    pages: dict[tuple[str, ...], tuple[Tabs, Any]] = {}
    yield pages
    for tabs, _ in pages.values():
        tabs.close()


@pytest.fixture
def shared(chromium, kept, tmp_path_factory) -> Iterator[Callable[..., Any]]:
    """Films of a robot's scenes at their beginning, on a page that other tests may have used before."""

    def film_tab(name: str, *scenes: str) -> Any:
        key = (name, *scenes)
        if key not in kept:
            while len(kept) >= KEPT:
                kept.pop(next(iter(kept)))[0].close()
            tabs = Tabs(chromium, tmp_path_factory.mktemp("shared"))
            kept[key] = tabs, tabs.open(film_page([filmed(name, scene) for scene in scenes]))
        tab = kept[key][1]
        if tab.viewport_size != {"width": WIDTH, "height": HEIGHT}:
            tab.set_viewport_size({"width": WIDTH, "height": HEIGHT})
            tab.wait_for_timeout(100)
        tab.evaluate(
            "crossing.clock.pause(), crossing.clock.seek(0), document.activeElement.blur(), scrollTo(0, 0)"
        )
        return tab

    yield film_tab
    assert [complaint for tabs, _ in kept.values() for complaint in tabs.complaints] == []
