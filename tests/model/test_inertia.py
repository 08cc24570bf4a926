"""An inertia that no body has is refused, by every reader; what bodies have, printed in few figures, is not.

The witness is a cloud of point masses: its inertia about the centre of mass is a body's by construction.
"""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from framework import RobotFileError
from framework.model import read_robot_file
from framework.model.readers import read_any
from framework.model.urdf_elements import check_inertia, check_inertial

DIALECTS = Path(__file__).parents[1] / "data" / "dialects"
SAID = {"platform": "left_rod", "axes": ["x", "y"], "motors": ["left_motor", "right_motor"]}
POINT_MASS = '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>'
# kg m^2: entries xx, yy, zz, xy, xz, yz, and the principal moments
IMPOSSIBLE = {
    "indefinite": ((0, 0, 0, 5000, 0, 0), "-5000, 0, 5000"),
    "hidden": ((1, 1, 1, 0.9, 0.9, -0.9), "-0.8, 1.9, 1.9"),
    "triangle": ((0.1, 0.2, 0.5, 0, 0, 0), "0.1, 0.2, 0.5"),
    "planar": ((0, 0, 0.3, 0, 0, 0), "0, 0, 0.3"),
}


def cloud(rng, size):
    """Mass and inertia about its centre of random point masses in a box of this size [m]."""
    masses = rng.uniform(0.1, 1.0, 6)
    points = rng.normal(size=(6, 3)) * size
    points -= masses @ points / masses.sum()
    matrix = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, points, strict=True))
    return masses.sum(), matrix


def printed(matrix, figures):
    """The matrix with its entries rounded to some significant figures, as files have them."""
    return np.vectorize(lambda value: float(f"{value:.{figures}g}"))(matrix)


@pytest.mark.parametrize("size", [(1, 1, 1), (1, 1, 0), (1, 0, 0), (1e-4, 1e-4, 1e-4), (1e3, 1, 0)])
def test_what_a_body_has_is_accepted_in_any_axes_and_in_three_figures(size):
    rng = np.random.default_rng(3)
    for _ in range(50):
        _, matrix = cloud(rng, np.array(size))
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        for inertia in (matrix, turn @ matrix @ turn.T, printed(turn @ matrix @ turn.T, 3)):
            check_inertia("body", inertia)


def test_two_per_cent_more_than_a_plate_has_is_refused():
    check_inertia("plate", np.diag([1.0, 2.0, 3.0]))
    with pytest.raises(RobotFileError, match=r"plate: has the principal moments 1, 2, 3\.06 kg m"):
        check_inertia("plate", np.diag([1.0, 2.0, 3.06]))


def test_entries_near_the_largest_number_do_not_hide_the_signs():
    with pytest.raises(RobotFileError, match="no body has"):
        check_inertia("body", 1.7e308 * np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0]]))


def element(entries):
    xx, yy, zz, xy, xz, yz = entries
    return f'<inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/>'


@pytest.mark.parametrize(("entries", "moments"), IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_the_robot_file_refuses_it_in_its_urdf(write_robot, entries, moments):
    file = write_robot(urdf=((POINT_MASS, element(entries)),))
    with pytest.raises(RobotFileError, match=f"link 'left_tip': <inertia>: .*moments {moments} kg"):
        read_robot_file(file)


@pytest.mark.parametrize(("entries", "moments"), IMPOSSIBLE.values(), ids=IMPOSSIBLE)
@pytest.mark.parametrize("name", ["five_bar_plus.urdf", "five_bar_ros.urdf", "gepetto/robot.urdf"])
def test_every_dialect_of_urdf_refuses_it(tmp_path, name, entries, moments):
    source = DIALECTS / name
    file = tmp_path / source.name
    file.write_text(source.read_text().replace(POINT_MASS, element(entries)))
    if source.name == "robot.urdf":
        file = file.with_suffix(".yaml")
        file.write_text(source.with_suffix(".yaml").read_text())
    with pytest.raises(RobotFileError, match=f"link '.*<inertia>: .*moments {moments} kg"):
        read_any(file, **SAID)


@pytest.mark.parametrize("case", IMPOSSIBLE)
@pytest.mark.parametrize("key", ["diaginertia", "fullinertia"])
def test_mjcf_refuses_it(tmp_path, key, case):
    entries, moments = IMPOSSIBLE[case]
    if key == "diaginertia" and any(entries[3:]):
        entries, moments = (2, -1, 2, 0, 0, 0), "-1, 2, 2"
    values = " ".join(map(str, entries[: 3 if key == "diaginertia" else 6]))
    text = (DIALECTS / "five_bar_sites.xml").read_text()
    file = tmp_path / "five_bar.xml"
    file.write_text(text.replace('diaginertia="0 0 0"', f'{key}="{values}"'))
    with pytest.raises(RobotFileError, match=f"line 15: body 'left_rod': inertia: .*moments {moments} kg"):
        read_any(file, **SAID)


@pytest.mark.parametrize("length", [1e-6, 1.0, 1e3])
def test_what_exporters_leave_of_a_point_is_no_inertia_in_robots_of_any_size(length):
    def link(gyration):
        entries = element((0, 0, 0, gyration**2, 0, 0))
        return ElementTree.fromstring(
            f'<link name="a"><inertial><mass value="1"/>{entries}</inertial></link>'
        )

    check_inertial(link(1e-9 * length), length)
    with pytest.raises(RobotFileError, match="no body has"):
        check_inertial(link(1e-3 * length), length)


@pytest.mark.parametrize("extent", [1e200, np.inf])
def test_a_body_without_mass_is_negligible_at_any_distance(extent):
    """Also where the square of the distance overflows: 0 times infinity is no number."""
    link = ElementTree.fromstring(f'<link name="a"><inertial><mass value="0"/>{POINT_MASS}</inertial></link>')
    check_inertial(link, extent)
