"""Every page that is written, before axe-core: nothing that keeps somebody from using it."""

import pytest

import robots
from framework import plan_scene
from framework.planning.scenes import scene, scene_path
from framework.show.lesson import lesson_page
from framework.show.map import map_page
from framework.show.page import film_page, hand_page
from framework.show.report import report_page
from tests.browser.pages import filmed
from tests.browser.test_map_page import found

axe = pytest.importorskip(
    "axe_playwright_python.sync_playwright", reason="axe-core is in the extra `browser`"
)
pytestmark = pytest.mark.browser

PAGES = {
    "film": lambda: film_page([filmed("five_bar", "C", "flexible_links")]),
    "films": lambda: film_page([filmed("five_bar", name) for name in "ABC"]),
    "six motors": lambda: film_page([filmed("gough_stewart", "turn")]),
    "by hand": lambda: hand_page(robots.load("five_bar")),
    "map": lambda: map_page(found()),
    "report": lambda: report_page(plan_scene(robots.load("five_bar"), "C"), name="Scene C"),
    "lesson": lambda: lesson_page(
        robots.load("five_bar"), scene_path(scene(robots.load("five_bar"), "C")), duration=1.5
    ),
}
STATES = {
    "lesson": [f"crossing.lesson.choose({step})" for step in range(5)],
    "map": ["0", "crossing.map.move([20, 30])"],
    "films": ["0", "crossing.clock.tell()"],
}


@pytest.mark.parametrize("kind", PAGES)
def test_axe_finds_nothing(opened, kind):
    tab = opened(PAGES[kind](), width=1440)
    states = STATES.get(kind, ["0"])
    light = [(1440, state, "light") for state in states]
    for width, state, scheme in [*light, (1440, states[-1], "dark"), (390, states[-1], "light")]:
        tab.set_viewport_size({"width": width, "height": 844})
        tab.emulate_media(color_scheme=scheme)
        tab.evaluate(state)
        answer = axe.Axe().run(tab).response
        assert len(answer["passes"]) > 10
        told = [
            (each["impact"], each["id"], [node["target"] for node in each["nodes"]])
            for each in answer["violations"]
        ]
        assert told == []
