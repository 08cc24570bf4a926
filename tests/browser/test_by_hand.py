"""A robot moved by hand in a real browser."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import robots
from framework import ParallelRobot
from framework.show.jogging import move_by_hand
from framework.show.page import hand_page
from framework.show.server import PageServer
from tests.browser.conftest import wait_until
from tests.browser.pages import ON_SCREEN, gap, placements

pytestmark = pytest.mark.browser


@pytest.fixture
def by_hand():
    """Serves robots to be moved by hand; gives their addresses."""
    servers = []

    def serve(robot: ParallelRobot) -> str:
        server = PageServer(hand_page(robot), lambda asked: move_by_hand(robot, asked))
        thread = threading.Thread(target=server.serve_until_interrupted)
        thread.start()
        servers.append((server, thread))
        return server.address

    yield serve
    for server, thread in servers:
        server.shutdown()
        thread.join()


def drag(tab, part: str, index: int, value: float) -> dict:
    """Move a slider and wait for what the page then knows."""
    tab.evaluate(
        """([part, index, value]) => {
          const slider = document.querySelector(`input[data-part=${part}][data-index="${index}"]`);
          window.before = crossing.hand.state;
          slider.value = value;
          slider.dispatchEvent(new Event("input"));
          slider.dispatchEvent(new Event("change"));
        }""",
        [part, index, value],
    )
    wait_until(tab, "crossing.hand.state !== window.before && !crossing.hand.busy")
    return tab.evaluate("crossing.hand.state")


def test_sliders_move_the_robot_with_its_loops_closed(opened, by_hand):
    robot = robots.load("five_bar")
    tab = opened(by_hand(robot))
    before = placements(tab, "crossing.hand.view")
    for part, value in (("platform", 0.0), ("motor", 1.5)):
        state = drag(tab, part, 0, value)
        assert state[part][0] == pytest.approx(value, abs=2e-3)  # a slider has steps
        after = placements(tab, "crossing.hand.view")
        assert np.abs(after - before).max() > 0.01
        assert gap(robot, after) < ON_SCREEN
        assert tab.locator("output").first.inner_text().startswith(f"{state['platform'][0]:.4f}")
        before = after


def test_the_page_turns_colour_at_the_locus_and_stops_at_the_edge(opened, by_hand):
    tab = opened(by_hand(robots.load("five_bar")))
    drag(tab, "platform", 0, 0.0)
    assert "regular" in tab.get_attribute(".view", "class")
    on = drag(tab, "platform", 1, float(np.sqrt(0.06)))
    assert on["level"] == "singular"
    assert "singular" in tab.get_attribute(".view", "class")
    assert "Type 2" in tab.inner_text(".class")
    edge = drag(tab, "platform", 1, 0.75)
    assert "edge of the workspace" in tab.inner_text(".stop")
    shown = float(tab.evaluate("document.querySelectorAll('input[data-part=platform]')[1].value"))
    assert shown == pytest.approx(edge["platform"][1], abs=1e-3)  # the slider went back to where the robot is
    tab.click("button.back")
    assert tab.inner_text(".stop") == ""


@pytest.mark.parametrize("name", ["gough_stewart", "standing_quadruped"])
def test_other_robots_can_be_moved_by_hand(opened, by_hand, name):
    robot = robots.load(name)
    tab = opened(by_hand(robot))
    value = tab.evaluate("crossing.hand.state.platform[2]") - 0.02
    state = drag(tab, "platform", 2, value)
    assert state["platform"][2] == pytest.approx(value, abs=0.01 * robot.length)
    assert gap(robot, placements(tab, "crossing.hand.view")) < ON_SCREEN
    assert tab.locator("input[data-part=motor]").count() == (0 if name == "standing_quadruped" else 6)
