"""The pages in a real browser: what stands in the scene, moves in it, and answers."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import ParallelRobot
from framework.model.description import LineSpring
from framework.planning.scenes import scene_request
from framework.show.film import film_motion
from framework.show.page import film_page
from tests.browser.conftest import wait_until
from tests.browser.pages import BETWEEN, ON_SCREEN, filmed, gap, nodes_at, placements

pytestmark = pytest.mark.browser


# Vertices of all bodies that are seen, projected by the camera: how far the nearest comes to the rim, from
# 0, on it, to 1, and how large the whole is, of the picture.
RIM = """(film, t) => {
  film.show(t);
  const { viewer, robot } = film.view, seen = { rim: Infinity, size: [0, 0] };
  viewer.scene.updateMatrixWorld(true);
  viewer.camera.updateMatrixWorld(true);
  const low = [1, 1], high = [-1, -1];
  robot.traverse((mesh) => {
    if (!mesh.geometry) return;
    const at = mesh.geometry.attributes.position, point = mesh.position.clone();
    for (let k = 0; k < at.count; k++) {
      const { x, y } = point.fromBufferAttribute(at, k).applyMatrix4(mesh.matrixWorld).project(viewer.camera);
      [x, y].forEach((value, i) => { low[i] = Math.min(low[i], value); high[i] = Math.max(high[i], value); });
    }
  });
  const rim = Math.min(1 + low[0], 1 + low[1], 1 - high[0], 1 - high[1]);
  return [rim, Math.max(high[0] - low[0], high[1] - low[1]) / 2];
}"""


@pytest.mark.parametrize("name", robots.CATALOGUE)
def test_every_robot_stands_whole_in_its_picture_moves_and_keeps_its_loops_closed(opened, name):
    film = filmed(name)
    tab = opened(film_page([film]))
    robot, duration = film.robot, film.time[-1]
    solids = tab.evaluate("crossing.films[0].view.nodes.map((node) => node.children.length)")
    assert len(solids) == robot.model.njoints
    heavy = [j for j in range(1, robot.model.njoints) if robot.model.inertias[j].mass > 0]
    assert all(solids[j] > 0 for j in heavy)
    start, middle = nodes_at(tab, 0.0), nodes_at(tab, duration / 2)
    assert np.abs(middle - start)[heavy].max() > 1e-3
    for k in (0, 100, 240, 350, 480):
        assert gap(robot, nodes_at(tab, float(film.time[k]))) < ON_SCREEN
        between = 0.5 * (film.time[k] + film.time[max(k - 1, 0)])
        assert gap(robot, nodes_at(tab, float(between))) < BETWEEN
    for width, height, count in ((1280, 760, 25), (390, 800, 5), (1920, 1080, 5)):
        tab.set_viewport_size({"width": width, "height": height})
        tab.wait_for_timeout(100)
        times = np.linspace(0.0, duration, count).tolist()
        seen = tab.evaluate(f"times => times.map((t) => ({RIM})(crossing.films[0], t))", times)
        assert min(rim for rim, _ in seen) > 0.02  # nothing is cut off
        assert max(size for _, size in seen) > 0.45  # and it is not far away


def test_it_plays_by_itself_and_stops_when_told(opened):
    tab = opened(film_page([filmed("five_bar", "C")]), playing=True)
    assert tab.evaluate("crossing.clock.playing")
    tab.select_option("select.speed", "1")
    wait_until(tab, "crossing.clock.t > 0.2")  # it starts from rest, slowly
    started, before = tab.evaluate("crossing.clock.t"), placements(tab, "crossing.films[0].view")
    wait_until(tab, f"crossing.clock.t > {started} + 0.1")
    assert np.abs(placements(tab, "crossing.films[0].view") - before).max() > 1e-4
    tab.click("button.play")
    stopped = tab.evaluate("crossing.clock.t")
    tab.wait_for_timeout(200)
    assert tab.evaluate("crossing.clock.t") == stopped
    tab.select_option("select.speed", "1")
    tab.click("button.play")
    wait_until(tab, f"crossing.clock.t > {stopped} + 0.2")


def test_the_time_bar_and_the_curves_lead_to_an_instant(shared):
    tab = shared("five_bar", "C")
    tab.evaluate(
        "(bar) => { bar.value = 1; bar.dispatchEvent(new Event('input')); }", tab.query_selector(".bar")
    )
    assert tab.evaluate("crossing.clock.t") == pytest.approx(1.0, abs=1e-12)
    assert not tab.evaluate("crossing.clock.playing")
    assert "Singular now" in tab.inner_text(".now")
    assert "stays finite" in tab.inner_text(".now")
    mark = tab.locator(".chart .mark").first
    at_one = float(mark.get_attribute("x1"))
    chart = tab.locator(".chart").first.bounding_box()
    tab.mouse.click(chart["x"] + chart["width"] / 2, chart["y"] + chart["height"] / 2)
    assert 0.4 < tab.evaluate("crossing.clock.t") < 1.0
    assert float(mark.get_attribute("x1")) < at_one


def test_arrows_are_t_s_and_w_p(opened):
    film = filmed("biglide", "bow")
    tab = opened(film_page([film]))
    (instant,) = film.instants
    arrows = """() => Object.fromEntries(
      Object.entries(crossing.films[0].vectors.arrows).map(([name, {linear}]) =>
        [name, [linear.object.visible, ...linear.tip.clone().sub(linear.object.position).toArray()]]))"""
    for k in (150, int(np.argmin(np.abs(film.time - instant.time))), 400):
        nodes_at(tab, float(film.time[k]))
        drawn = tab.evaluate(arrows)
        for name, vector in (("t_s", film.t_s[k]), ("W_p", film.W_p[k])):
            visible, *shown = drawn[name]
            assert visible
            cosine = np.dot(shown[:2], vector) / np.linalg.norm(shown) / np.linalg.norm(vector)
            assert cosine == pytest.approx(1.0, abs=1e-5)
    nodes_at(tab, instant.time)
    drawn = tab.evaluate(arrows)
    t_s, W_p = (np.array(drawn[name][1:]) for name in ("t_s", "W_p"))
    assert abs(t_s @ W_p) < 1e-4 * np.linalg.norm(t_s) * np.linalg.norm(W_p)  # at a right angle


def test_motors_darken_with_their_torque_and_springs_stretch(opened):
    film = filmed("five_bar", "C", "flexible_links")
    tab = opened(film_page([film]))
    grey = tab.evaluate(
        "(crossing.clock.pause(), crossing.clock.seek(0), crossing.films[0].view.motors[1].color.getHex())"
    )
    strongest = float(film.time[np.argmax(np.abs(film.torque[:, 1]))])
    nodes_at(tab, strongest)
    assert tab.evaluate("crossing.films[0].view.motors[1].color.getHex()") != grey
    slide = film.robot.elastic_names.index("left_rod")
    springs = tab.evaluate("crossing.films[0].content.springs")
    for k in (0, 200, int(np.argmax(np.abs(film.deflection[:, slide])))):
        nodes_at(tab, float(film.time[k]))
        stretch = springs["factors"]["slide"] * film.deflection[k, slide] / springs["length"]
        scale = tab.evaluate(f"crossing.films[0].coils[{slide}].moving.scale.z")
        assert scale == pytest.approx(1 + stretch, abs=1e-6)
    assert abs(stretch) > 0.1  # it can be seen
    assert "springs: stretch drawn ×" in tab.inner_text(".column .legend")


def test_a_spring_between_points_leads_from_the_one_to_the_other_at_all_times(opened):
    spring = LineSpring(("base", "platform"), 50.0, 0.0, 0.0)
    robot = ParallelRobot.from_description(replace(robots.load("delta").description, line_springs=(spring,)))
    film = film_motion(robot, scene_request(robot, "cross"), name="cross")
    tab = opened(film_page([film]))
    ends = """() => crossing.films[0].view.springs.map(({ coil: { object, length } }) => {
      object.updateMatrix();
      const end = object.position.clone().set(0, 0, length).applyMatrix4(object.matrix);
      return [object.position.toArray(), end.toArray()];
    })"""
    for k in (0, 200, len(film.time) - 1):
        nodes_at(tab, float(film.time[k]))
        ((start, end),) = tab.evaluate(ends)
        assert start == pytest.approx(np.zeros(3), abs=1e-6)  # the base's origin
        assert end == pytest.approx(film.platform[k], abs=1e-5)


def test_turns_and_moments_stand_beside_the_shifts_and_forces_that_they_would_hide(opened):
    film = filmed("par4", "cross")
    tab = opened(film_page([film]))
    nodes_at(tab, film.instants[0].time)
    middle, *beside = tab.evaluate("""() => {
      const { arrows, origin, length } = crossing.films[0].vectors;
      const places = ["t_s", "W_p"].map((name) => arrows[name].angular.object.position.clone().sub(origin));
      const shift = arrows.t_s.linear.object.position.distanceTo(origin);
      return [shift, ...places.map((place) => place.divideScalar(length).toArray())];
    }""")
    assert middle < 1e-6
    assert np.linalg.norm(np.array(beside), axis=1).min() > 0.2
    assert np.dot(*beside) < 0  # on either side


def test_scenes_stand_side_by_side_and_the_unproved_one_says_so(shared):
    tab = shared("five_bar", "A", "B", "C")
    assert tab.locator(".column").count() == 3
    assert tab.locator("canvas").count() == 3
    assert tab.locator(".badge").all_inner_texts() == [
        "finite torque, proven",
        "unbounded torque",
        "finite torque, proven",
    ]
    pole = tab.evaluate("crossing.films[1].content.instants[0].time")
    nodes_at(tab, pole)
    said = tab.locator(".now").all_inner_texts()
    assert "No singularity" in said[0]
    assert "no motor torque is large enough" in said[1]
    assert "no bound" in tab.locator(".chart").nth(3).text_content()


def test_the_words_follow_the_time(shared):
    films = [filmed("five_bar", name) for name in ("B", "C")]
    tab = shared("five_bar", "B", "C")
    (pole,), (crossing,) = ([instant.time for instant in film.instants] for film in films)

    def said_at(t: float) -> list[str]:
        nodes_at(tab, t)
        return tab.locator(".now").all_inner_texts()

    failing, working = said_at(0.5)
    assert "must reach 0 by t = 0.887 s, and does not" in failing
    assert f"must reach 0 by t = {crossing:.3g} s." in working
    assert "Singular now" in said_at(pole)[0]
    failing, working = said_at(1.0)
    assert "would not get here" in failing
    assert "Singular now" in working
    assert "it coasts across" in working
    views = [element.get_attribute("class") for element in tab.query_selector_all(".view")]
    assert ["unreal" in views[0], "crossing" in views[1]] == [True, True]
    assert "was 0 at t = 1 s" in said_at(1.3)[1]


def test_the_view_keeps_its_size_while_the_words_change(shared):
    for names in (["C"], ["A", "B", "C"]):
        tab = shared("five_bar", *names)
        sizes = set()
        for t in (0.0, 0.5, 0.887, 1.0, 1.3):
            nodes_at(tab, t)
            sizes |= {(view["width"], view["height"]) for view in map(box, tab.query_selector_all(".view"))}
            for element in tab.query_selector_all(".now"):  # all words fit
                assert element.evaluate("now => now.scrollHeight - now.clientHeight") <= 1
        assert len({round(height) for _, height in sizes}) == 1
        assert min(height for _, height in sizes) >= 200


def box(element) -> dict[str, float]:
    return element.bounding_box()


@pytest.mark.parametrize(("width", "height"), [(1600, 900), (1280, 760)])
def test_side_by_side_both_conditions_are_seen_without_scrolling(opened, width, height):
    films = [filmed("five_bar", name) for name in ("A", "B", "C")]
    tab = opened(film_page(films), width=width, height=height)
    controls = box(tab.query_selector("footer"))["y"]
    for side in tab.query_selector_all(".side"):
        torque, power, _ = side.query_selector_all(".chart")
        assert side.evaluate("side => side.scrollHeight - side.clientHeight") <= 1
        for chart in (torque, power):
            assert box(chart)["y"] + box(chart)["height"] < controls


def test_a_button_leads_each_scene_to_its_own_singular_instant(shared):
    tab = shared("five_bar", "B", "C")
    tab.click("button.telling")
    said = tab.locator(".now").all_inner_texts()
    assert all("Singular now" in text for text in said)
    assert tab.inner_text(".clock") == "0.887 s, 1.000 s"
    assert not tab.evaluate("crossing.clock.playing")


def test_names_are_text(opened):
    film = filmed("five_bar", "A")
    name = "<img src=x onerror='document.title=1'> & <b>"
    tab = opened(film_page([replace(film, name=name, refusal=name)]))
    assert tab.locator("h2").inner_text().startswith(name)
    assert tab.locator("img").count() == 0
