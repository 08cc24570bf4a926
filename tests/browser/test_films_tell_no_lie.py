"""What a film shows is true: all of the robot, angles, instants and labels."""

import numpy as np
import pytest

from framework.show.page import film_page
from tests.browser.conftest import wait_until
from tests.browser.pages import filmed, nodes_at

pytestmark = pytest.mark.browser


# A film at many of its times: the angle that it draws the sign of a right angle for, in degrees.
CORNERS = """([k, times]) => [crossing.films[k]].flatMap((film) => times.flatMap((t) => {
  film.show(t);
  const { corner, arrows, origin, turning } = film.vectors;
  if (!corner.object.visible) return [];
  const kind = turning.some(Boolean) ? "angular" : "linear";
  const [a, b] = ["t_s", "W_p"].map((name) => arrows[name][kind].tip.clone().sub(origin));
  return [(a.angleTo(b) * 180) / Math.PI];
}))"""


@pytest.mark.parametrize(
    ("scenes", "drawn"),
    [
        (
            [("five_bar", "bow"), ("biglide", "bow"), ("orthoglide", "cross"), ("spherical_rrr", "cross")],
            True,
        ),
        (
            [
                ("five_bar", "C"),  # W_p vanishes there
                ("five_bar", "B"),
                ("delta", "cross-unprepared"),
                ("orthoglide", "cross-unprepared"),
                ("biglide", "unprepared"),
                ("gough_stewart", "turn"),  # forces and moments: no angle
            ],
            False,
        ),
    ],
)
def test_the_right_angle_is_drawn_where_it_is_proven_and_within_half_a_degree(opened, scenes, drawn):
    films = [filmed(*scene) for scene in scenes]
    tab = opened(film_page(films))
    for k, film in enumerate(films):
        times = [*np.linspace(0.0, film.time[-1], 241), *(instant.time for instant in film.instants)]
        angles = np.array(tab.evaluate(CORNERS, [k, times]))
        assert np.all(np.abs(angles - 90.0) <= 0.5)
        assert bool(tab.evaluate(CORNERS, [k, times[-len(film.instants) :]])) == drawn
        assert bool(len(angles)) == drawn


# Where the arrows of a force and of a moment begin, and the arrows themselves; null for one that is not seen.
ARROW = """(name) => {
  const { vectors } = crossing.films[0], { linear, angular } = vectors.arrows[name];
  const drawn = ({ object: { position, visible }, tip }) =>
    (visible ? [position.toArray(), tip.clone().sub(position).toArray()] : null);
  return [drawn(linear), drawn(angular)];
}"""


def test_wrenches_of_the_world_are_arrows_where_they_act(opened):
    table = [[0.0, 30, 0, 0, 0, 0, 0], [1.0, 0, -40, 0, 0, 0, 0]]
    wrenches = {"left_tip": table, "right_rod": [0, 0, 0, 0, 0, 2.0]}
    film = filmed("five_bar", "A", wrenches=wrenches)
    tab = opened(film_page([film]))
    assert "force and moment of the world" in tab.inner_text(".left .legend")
    for k in (0, 200, len(film.time) - 1):
        nodes_at(tab, film.time[k])
        force, none = tab.evaluate(ARROW, "world 0")
        asked, _ = tab.evaluate(ARROW, "W_p")
        hidden, moment = tab.evaluate(ARROW, "world 1")
        assert (none, hidden) == (None, None)
        s = film.law(film.time[k])
        scale = np.linalg.norm(asked[1]) / np.linalg.norm(film.W_p[k])
        np.testing.assert_allclose(np.array(force[1]) / scale, [30 * (1 - s), -40 * s, 0], atol=1e-3)
        np.testing.assert_allclose(force[0], film.wrenches[0].origin[k], atol=1e-6)
        np.testing.assert_allclose(moment[0], film.wrenches[1].origin[k], atol=1e-6)
        np.testing.assert_allclose(moment[1][:2], 0.0, atol=1e-6)
        assert moment[1][2] > 0
    assert opened(film_page([filmed("five_bar", "A")])).inner_text(".left .legend").count("of the world") == 0


def test_a_playing_film_stands_for_two_seconds_at_its_singular_instant(opened):
    tab = opened(film_page([filmed("five_bar", "C")]), playing=True)
    held, there, told = tab.evaluate(HELD)
    assert there == pytest.approx(1.0, abs=1e-12)
    assert "Singular now" in told
    assert 1990 < held < 2600
    wait_until(tab, "crossing.clock.t > 1")
    assert "Just past" in tab.inner_text(".now")


# From a little before the crossing: for how long [ms] the film stands, at which time, and with which words.
HELD = """() => new Promise((done) => {
  const { clock } = crossing;
  clock.seek(0.97);
  let from = null, there, told;
  const look = (now) => { // in each frame, as the clock does
    if (from === null && clock.holding > 0) {
      [from, there, told] = [now, clock.t, document.querySelector(".now").innerText];
    }
    if (from !== null && clock.holding <= 0) done([now - from, there, told]);
    else requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
})"""


def test_singular_now_is_said_at_the_instant_alone(shared):
    tab = shared("five_bar", "C")
    for t in (0.99, 0.9999, 1.0001, 1.01):
        nodes_at(tab, t)
        assert "Singular now" not in tab.inner_text(".now")
    # a hand that leads the time bar near it means it
    tab.evaluate(
        "(bar) => { bar.value = 1.004; bar.dispatchEvent(new Event('input')); }", tab.query_selector(".bar")
    )
    assert tab.evaluate("crossing.clock.t") == pytest.approx(1.0, abs=1e-12)


def test_the_space_bar_plays_but_for_what_it_operates_itself(shared):
    tab = shared("five_bar", "C")
    tab.locator("button.telling").focus()
    tab.keyboard.press("Space")
    assert not tab.evaluate("crossing.clock.playing")
    assert tab.evaluate("crossing.clock.t") == pytest.approx(1.0, abs=1e-12)
    for focus in ("button.play", ".bar", "body"):
        tab.evaluate("crossing.clock.pause()")
        tab.locator(focus).focus()
        tab.keyboard.press("Space")
        assert tab.evaluate("crossing.clock.playing"), focus
        tab.keyboard.press("Space")
        assert not tab.evaluate("crossing.clock.playing"), focus


def test_a_resize_leaves_each_scene_at_its_own_instant(shared):
    tab = shared("five_bar", "B", "C")
    tab.click("button.telling")
    tab.set_viewport_size({"width": 1000, "height": 700})
    tab.wait_for_timeout(200)
    assert all("Singular now" in text for text in tab.locator(".now").all_inner_texts())


def test_the_button_to_the_singularity_is_there_where_there_is_one(opened, shared):
    assert opened(film_page([filmed("five_bar", "A")])).locator("button.telling").count() == 0
    assert shared("five_bar", "C").locator("button.telling").count() == 1


WRITTEN = [
    ("five_bar", "B"),
    ("five_bar", "C"),
    ("biglide", "across"),
    ("four_bar", "full_turn"),
    ("par4", "cross"),
]


@pytest.mark.parametrize(("width", "scenes"), [(390, WRITTEN), (1280, WRITTEN[:2]), (1280, WRITTEN[3:4])])
def test_no_curve_runs_through_what_is_written_beside_it(opened, width, scenes):
    tab = opened(film_page([filmed(*scene) for scene in scenes]), width=width)
    assert tab.locator("text.said").count() >= len(scenes)
    assert tab.evaluate(STRUCK) == []
    assert tab.evaluate(CUT_OFF) == []


# What is written in a chart and does not fit into it.
CUT_OFF = """() => [...document.querySelectorAll(".chart")].flatMap((chart) => {
  const { width, height } = chart.viewBox.baseVal;
  return [...chart.querySelectorAll("text")].filter((text) => {
    const box = text.getBBox();
    return box.x < 0 || box.x + box.width > width || box.y < -2 || box.y + box.height > height + 2;
  }).map((text) => text.textContent);
})"""


# What is written in a chart and has a curve in its box, but for two pixels above and below.
STRUCK = """() => [...document.querySelectorAll(".chart")].flatMap((chart) => {
  const boxes = [...chart.querySelectorAll("text.said")].map((text) => [text.textContent, text.getBBox()]);
  return [...chart.querySelectorAll("path")].flatMap((path) => {
    const step = path.getTotalLength() / 1999;
    const points = Array.from({ length: 2000 }, (_, k) => path.getPointAtLength(k * step));
    return boxes.filter(([, { x, y, width, height }]) => points.some((point) =>
      x < point.x && point.x < x + width && y + 2 < point.y && point.y < y + height - 2));
  });
})"""


def corners(tab, t: float) -> np.ndarray:
    """The corners of the forces that the motors can give, as drawn at t."""
    tab.evaluate("t => crossing.clock.seek(t)", t)
    return np.array(tab.evaluate("crossing.films[0].vectors.polytope.corners"))


def extents(tab, t: float) -> np.ndarray:
    """How far these corners spread along their principal axes, the largest first."""
    found = corners(tab, t)
    return np.linalg.svd(found - found.mean(axis=0), compute_uv=False)


def test_the_polygon_of_forces_is_a_line_across_t_s_at_the_singular_instant(opened):
    film = filmed("five_bar", "bow")
    tab = opened(film_page([film]))
    (instant,) = film.instants

    assert extents(tab, 0.0)[1] > 0.2 * extents(tab, 0.0)[0]
    assert extents(tab, instant.time)[1] < 1e-5 * extents(tab, instant.time)[0]
    # at the same scale as W_p, its area is that of the parallelogram of the motors: 4 |det G| limit^2
    k = int(np.argmin(np.abs(film.time - 0.2)))
    (x0, y0), (x1, y1), (x2, y2) = corners(tab, float(film.time[k]))[:3]
    area = abs((x1 - x0) * (y2 - y1) - (y1 - y0) * (x2 - x1))
    limit = 1.5 * np.abs(film.torque).max()
    scale = 0.45 * tab.evaluate("crossing.films[0].content.length") / np.linalg.norm(film.W_p, axis=1).max()
    expected = 4.0 * abs(np.linalg.det(film.motors.motor_speed[k])) * limit**2 * scale**2
    assert area == pytest.approx(expected, rel=1e-4)


def test_the_solid_of_forces_is_flat_and_all_lines_of_the_motors_lie_across_t_s_at_the_crossing(opened):
    """On the delta: three lines, and what they span, in the plane across t_s."""
    film = filmed("delta", "cross")
    tab = opened(film_page([film]))
    (instant,) = film.instants

    assert tab.evaluate("crossing.films[0].vectors.lines.drawn.object.visible") is False  # far from the locus
    assert extents(tab, 0.0)[2] > 1e-3 * extents(tab, 0.0)[0]
    assert extents(tab, instant.time)[2] < 1e-5 * extents(tab, instant.time)[0]
    assert tab.evaluate("crossing.films[0].vectors.lines.drawn.object.visible") is True
    ways = tab.evaluate(
        """() => crossing.films[0].vectors.lines.drawn.rods.map((rod) =>
          new MeshCat.THREE.Vector3(0, 1, 0).applyQuaternion(rod.quaternion).toArray())"""
    )
    t_s = film.t_s[int(np.argmin(np.abs(film.time - instant.time)))]
    np.testing.assert_allclose(np.array(ways) @ t_s / np.linalg.norm(t_s), 0.0, atol=1e-5)
