"""Springs from section and material against the closed-form deflections of a cantilever."""

import numpy as np
import pinocchio as pin
import pytest

from framework import InvalidInput
from framework.model import read_robot_file
from framework.model.beams import Material, Section, beam_spring, beam_stiffness, split_beam, spring_entry
from framework.model.description import AXES, Spring
from framework.model.urdf_edits import insert_springs
from tests.oracles.placements import placements
from tests.urdf_edits import edited

STEEL = Material(E=210e9, G=81e9)
BAR = Section(A=3.0e-4, Iy=2.0e-9, Iz=5.0e-9, J=4.0e-9)
SHEARED = Section(A=3.0e-4, Iy=2.0e-9, Iz=5.0e-9, J=4.0e-9, shear_y=0.85, shear_z=0.6)
LENGTH = 0.4


def urdf(xyz: str = "0.4 0 0", rpy: str = "0 0 0") -> str:
    """A clamped link and its tip."""
    return (
        '<robot name="beam"><link name="base"/><link name="tip"/><joint name="rod" type="fixed">'
        f'<parent link="base"/><child link="tip"/><origin xyz="{xyz}" rpy="{rpy}"/></joint></robot>'
    )


def tip_compliance(urdf_text: str, spring: Spring) -> np.ndarray:
    """Displacement and rotation of the tip (in its own axes, at rest) for unit forces and moments there."""
    model = pin.buildModelFromXML(edited(urdf_text, (insert_springs, [spring])))
    data = model.createData()
    q = pin.neutral(model)
    pin.computeJointJacobians(model, data, q)
    pin.framesForwardKinematics(model, data, q)
    jacobian = pin.getFrameJacobian(model, data, model.getFrameId("tip"), pin.ReferenceFrame.LOCAL)
    return np.asarray(jacobian @ np.diag(1.0 / np.array(spring.stiffness)) @ jacobian.T)


def cantilever(section: Section, material: Material, length: float) -> np.ndarray:
    """The compliance (6, 6) at the end of a clamped beam along x, from the textbook."""
    E, G, L = material.E, material.G, length
    matrix = np.diag(
        [
            L / (E * section.A),
            L**3 / (3 * E * section.Iz),
            L**3 / (3 * E * section.Iy),
            L / (G * section.J),
            L / (E * section.Iy),
            L / (E * section.Iz),
        ]
    )
    matrix[1, 5] = matrix[5, 1] = L**2 / (2 * E * section.Iz)
    matrix[2, 4] = matrix[4, 2] = -(L**2) / (2 * E * section.Iy)
    if section.shear_y is not None and section.shear_z is not None:
        matrix[1, 1] += L / (section.shear_y * G * section.A)
        matrix[2, 2] += L / (section.shear_z * G * section.A)
    return matrix


@pytest.mark.parametrize("section", [BAR, SHEARED], ids=["Euler-Bernoulli", "Timoshenko"])
def test_a_spring_in_the_middle_is_the_whole_cantilever(section):
    split = split_beam(urdf(), "rod")
    assert split.length == pytest.approx(LENGTH, rel=1e-15)
    spring = beam_spring("flex", split.middle, section, STEEL, split.length)
    expected = cantilever(section, STEEL, LENGTH)
    found = tip_compliance(split.urdf_text, spring)
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13 * np.abs(expected).max())


def test_a_beam_may_point_anywhere_and_its_tip_be_turned():
    split = split_beam(urdf("0.1 -0.2 0.3", "0.4 -0.5 0.6"), "rod")
    length = np.sqrt(0.14)
    assert split.length == pytest.approx(length)
    round_bar = Section.tube(0.01)
    spring = beam_spring("flex", split.middle, round_bar, STEEL, split.length)
    along = np.array([0.1, -0.2, 0.3]) / length
    across = np.cross(along, [0, 0, 1])
    across /= np.linalg.norm(across)
    beam_axes = np.column_stack([along, across, np.cross(along, across)])
    turn = np.kron(np.eye(2), pin.rpy.rpyToMatrix(0.4, -0.5, 0.6).T @ beam_axes)
    expected = turn @ cantilever(round_bar, STEEL, float(length)) @ turn.T
    found = tip_compliance(split.urdf_text, spring)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


FLAT = Section.rectangle(0.03, 0.01)  # 30 mm along y, 10 mm along z
ALUMINIUM = Material.isotropic(70e9, 0.33)


def in_link_axes(tip, y=None):
    """Compliance (6, 6) of the flat bar from the link's origin to `tip`, in the axes of the link."""
    split = split_beam(urdf(" ".join(map(repr, map(float, tip)))), "rod", y=y)
    return tip_compliance(split.urdf_text, beam_spring("flex", split.middle, FLAT, ALUMINIUM, split.length))


def turned(axes, length):
    """The textbook's cantilever with x, y and z along the columns of `axes`."""
    both = np.kron(np.eye(2), axes)
    return both @ cantilever(FLAT, ALUMINIUM, length) @ both.T


def directions():
    """Directions over the whole sphere, among them those in which two entries are equal in size."""
    rng = np.random.default_rng(11)
    equal = [(1, 1, 1), (1, -1, 0), (0, 1, 1), (0, 0, 1), (0, -1, 0), (-1, 1, 1), (1, 0, 1)]
    return [d / np.linalg.norm(d) for d in (*np.array(equal, dtype=float), *rng.normal(size=(20, 3)))]


def test_a_flat_bar_half_a_millimetre_off_its_axis_sags_as_before():
    """F = 1 N along z at the end of 0.5 m: F L^3 / (3 E Iy) with Iy = b h^3 / 12."""
    sag = 0.5**3 / (3 * 70e9 * 0.03 * 0.01**3 / 12)
    for tip in ((0.5, 0, 0), (0.5, 0, 0.0005), (0.5, 0.0005, 0), (0.5, -1e-9, 1e-12)):
        assert in_link_axes(tip)[2, 2] == pytest.approx(sag, rel=1e-5)


def test_by_default_the_section_follows_the_least_turn_from_the_link():
    for along in directions():
        axis = np.cross([1, 0, 0], along)
        angle = np.arctan2(np.linalg.norm(axis), along[0])
        turn = pin.exp3(angle * axis / max(np.linalg.norm(axis), 1e-300))
        expected = turned(turn, 0.5)
        np.testing.assert_allclose(
            in_link_axes(0.5 * along), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
        )


def test_the_default_does_not_jump():
    """The section turns at most 1 / sin(half the angle from -x) times as far as the beam does."""
    rng = np.random.default_rng(12)
    for along in directions():
        slope = 2.0 / np.sqrt(0.5 * (1.0 + along[0]))
        before, step = in_link_axes(0.5 * along), 1e-4 * rng.normal(size=3)
        after = in_link_axes(0.5 * (along + step))
        assert np.abs(after - before).max() < 10 * slope * np.linalg.norm(step) * np.abs(before).max()


def test_the_roll_is_the_users_to_give():
    rng = np.random.default_rng(13)
    for along in (*directions(), np.array([-1.0, 0, 0])):
        y = rng.normal(size=3)
        across = y - (y @ along) * along
        axes = np.column_stack([along, across, np.cross(along, across)])
        axes /= np.linalg.norm(axes, axis=0)
        expected = turned(axes, 0.5)
        found = in_link_axes(0.5 * along, 100 * y)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_splitting_leaves_the_tip_where_it_was():
    text = urdf("0.1 -0.2 0.3", "0.4 -0.5 0.6")
    (before,), (after,) = (
        placements(pin.buildModelFromXML(version), ("tip",))
        for version in (text, split_beam(text, "rod").urdf_text)
    )
    np.testing.assert_allclose(after.homogeneous, before.homogeneous, atol=1e-15)


def test_sections():
    tube = Section.tube(0.02, 0.015)
    assert pytest.approx(np.pi * (4e-4 - 2.25e-4)) == tube.A
    assert pytest.approx(tube.Iy + tube.Iz) == tube.J
    square = Section.rectangle(0.02, 0.02)
    assert pytest.approx(0.1405770 * 0.02**4, rel=1e-6) == square.J  # Timoshenko and Goodier, table 11
    flat = Section.rectangle(0.02, 0.01)
    assert pytest.approx(0.2286820 * 0.02 * 0.01**3, rel=1e-5) == flat.J
    assert (flat.Iy, flat.Iz) == pytest.approx((0.02 * 0.01**3 / 12, 0.01 * 0.02**3 / 12))
    assert Section.rectangle(0.01, 0.02).J == flat.J
    assert pytest.approx(210e9 / 2.6) == Material.isotropic(210e9, 0.3).G


def test_the_entry_goes_into_a_robot_file(tmp_path):
    import yaml

    import robots

    source = robots.CATALOGUE["five_bar"].file
    document = yaml.safe_load(source.read_text())
    split = split_beam(source.with_suffix(".urdf").read_text(), "left_rod_tip")
    spring = beam_spring("left_beam", split.middle, BAR, STEEL, split.length, axes=("x", "y", "rz"))
    document["springs"] = [spring_entry(spring)]
    (tmp_path / "five_bar.urdf").write_text(split.urdf_text)
    (tmp_path / "five_bar.yaml").write_text(yaml.safe_dump(document))
    description = read_robot_file(tmp_path / "five_bar.yaml")
    assert description.springs == (spring,)
    from framework import ParallelRobot, check_robot

    found = check_robot(ParallelRobot.from_description(description, flexibility="flexible_links"))
    assert found.springs == ("left_beam_x", "left_beam_y", "left_beam_rz")
    assert found.mobility == 2


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Material(0.0, 1.0), "E: must be greater than zero, got 0.0"),
        (lambda: Material(1.0, float("nan")), "G: needs a finite number"),
        (lambda: Material.isotropic(1.0, 0.5), "poisson: must be between"),
        (lambda: Section(1.0, -1.0, 1.0, 1.0), "Iy: must be"),
        (lambda: Section(1.0, 1.0, 1.0, 1.0, shear_y=0.0), "shear_y: must be"),
        (lambda: Section.tube(0.01, 0.01), "inner: must be from 0 to below outer"),
        (lambda: Section.rectangle(0.01, float("inf")), "height: needs a finite number"),
        (lambda: beam_stiffness(BAR, STEEL, -1.0), "length: must be"),
        (lambda: beam_spring("", "rod", BAR, STEEL, 1.0), "name and after: need names"),
        (lambda: beam_spring("a", "rod", BAR, STEEL, 1.0, axes=("q",)), "axes: unknown axis 'q'"),
        (
            lambda: beam_spring("a", "rod", BAR, STEEL, 1.0, axes=("x", "x")),
            "axes: needs at least one axis, and each once",
        ),
        (
            lambda: beam_spring("a", "rod", BAR, STEEL, 1.0, axes=()),
            "axes: needs at least one axis, and each once",
        ),
        (lambda: split_beam(urdf(), "arm"), "tip: unknown fixed joint 'arm'"),
        (lambda: split_beam(urdf("0 0 0"), "rod"), "has no length"),
        (lambda: split_beam(urdf("a b c"), "rod"), "needs finite numbers"),
        (lambda: split_beam(urdf("-0.4 0 0"), "rod"), "y: required, because the beam runs along -x"),
        (lambda: split_beam(urdf("-0.4 0.003 0"), "rod"), "y: required, because the beam runs along -x"),
        (lambda: split_beam(urdf("0.4 0 0.4"), "rod", y=(1, 0, 1)), "across the beam, which runs along"),
        (lambda: split_beam(urdf(), "rod", y=(0, 0, 0)), "y: needs a direction across the beam"),
        (lambda: split_beam(urdf(), "rod", y=(0, 1)), "y must be 3 finite numbers"),
        (lambda: split_beam("<robot", "rod"), "not well-formed XML"),
        (lambda: split_beam(split_beam(urdf(), "rod").urdf_text, "rod"), "already there"),
    ],
)
def test_what_cannot_be_right_is_refused(call, message):
    with pytest.raises(InvalidInput, match=message):
        call()


def test_all_six_axes_by_default():
    assert beam_spring("flex", "rod", BAR, STEEL, LENGTH).motion == AXES
