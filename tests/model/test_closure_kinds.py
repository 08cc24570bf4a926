"""Every closure kind, on two bodies: it lets go what its name says, at any angle, and holds the rest."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from framework import Mechanism, RobotFileError
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import FrameStack
from framework.model.description import AXES, CLOSURE_KINDS, Actuator, Closure, Platform, RobotDescription
from framework.model.description import locked_axes as locked
from framework.model.loop_rows import LoopRows

URDF = """
<robot name="pair"> <link name="one"/> <link name="two"/>
  <joint name="turn" type="revolute"> <parent link="one"/> <child link="two"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/> </joint> </robot>
"""
ANGLES = [0.3, -1.1, 2.5]  # [rad], also far beyond a quarter turn
KINDS = [(kind, axis) for kind in CLOSURE_KINDS for axis in "xyz"]
UNIT = np.eye(3)
ROD = 0.7  # [m] length of a distance


@cache
def rows(axes: tuple[str, ...]) -> LoopRows:
    """The loop equations of one closure between frames `one` and `two`, which are frames 1 and 0."""
    description = RobotDescription(
        name="pair",
        file=Path("pair.yaml"),
        urdf_text=URDF,
        platform=Platform("two", ("x",)),
        actuators=(Actuator("turn"),),
        closures=(Closure("c", ("one", "two"), axes, ROD if "distance" in axes else None),),
    )
    return Mechanism.from_description(description).rows


def pair(relative: Rotation, apart, *, first: Rotation | None = None) -> FrameStack:
    """Frame two at (relative, apart) in frame one, which stands somewhere; the rates are both twists."""
    first = Rotation.from_rotvec([0.5, -1.3, 0.8]) if first is None else first
    at = np.array([0.3, -0.2, 0.7])
    position = np.array([at + first.apply(apart), at])
    rotation = np.array([(first * relative).as_matrix(), first.as_matrix()])
    # columns 6 f .. 6 f + 5 move frame f alone: along the base's axes, and about them through its origin
    screws = np.concatenate(
        [
            [(*axis, 0, 0, 0) for axis in UNIT] + [(*np.cross(p, axis), *axis) for axis in UNIT]
            for p in position
        ]
    )
    placements = np.concatenate([rotation.swapaxes(1, 2), position[:, None]], axis=1)
    return FrameStack(placements[None], screws[None], np.repeat(np.eye(2), 6, axis=1), np.empty((1, 0)))


def turn(axis: str, angle: float) -> Rotation:
    return Rotation.from_rotvec(angle * UNIT["xyz".index(axis)])


def allowed(kind: str, axis: str, angle: float):
    """Finite motions (relative rotation, displacement in the first frame) that the kind leaves free."""
    along = UNIT["xyz".index(axis)]
    across = [UNIT[k] for k in range(3) if "xyz"[k] != axis]
    second, third = (name for name in "xyz" if name != axis)
    still, nowhere = Rotation.identity(), np.zeros(3)
    return {
        "fixed": [(still, nowhere)],
        "revolute": [(turn(axis, angle), nowhere)],
        "prismatic": [(still, angle * along)],
        # a cross: one pin on the first body, the other on the second
        "universal": [(turn(second, angle) * turn(third, b), nowhere) for b in ANGLES],
        "cylindrical": [(turn(axis, angle), b * along) for b in ANGLES],
        "spherical": [(turn("x", angle) * turn("z", b) * turn("y", angle), nowhere) for b in ANGLES],
        "planar": [(turn(axis, angle), b * across[0] - 0.4 * across[1]) for b in ANGLES],
        # the second origin anywhere on a sphere about the first, its body turned anyhow
        "distance": [(turn(second, b), turn(third, angle).apply(ROD * along)) for b in ANGLES],
    }[kind]


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize(("kind", "axis"), KINDS)
def test_what_a_kind_leaves_free_keeps_the_loop_closed_at_any_angle(kind, axis, angle):
    for relative, apart in allowed(kind, axis, angle):
        residual = loop_equations(rows(locked(kind, axis)), pair(relative, apart)).residual
        np.testing.assert_allclose(residual, 0.0, atol=1e-15)  # rounding of numbers of order one


# at a right angle rows may take each other's place
@pytest.mark.parametrize(("amount", "angle"), [(1e-3, np.pi / 2), (-1.2, 0.3), (-1.2, np.pi / 2)])
@pytest.mark.parametrize(("kind", "axis"), KINDS)
def test_what_a_kind_locks_opens_the_loop_wherever_it_stands(kind, axis, amount, angle):
    names = locked(kind, axis)
    for name in names:
        for relative, apart in allowed(kind, axis, angle):
            k = AXES.index(name) % 3 if name in AXES else 0
            if name == "distance":
                moved = (relative, (1 + abs(amount) / ROD) * apart)
            elif name.startswith("r"):
                if len([n for n in names if n.startswith("r")]) == 1:  # a cross: tilt its second pin
                    second, third = (other for other in "xyz" if other != axis)
                    moved = (turn(second, angle) * turn(axis, amount) * turn(third, 0.7), apart)
                else:
                    moved = (turn(name[-1], amount) * relative, apart)
            else:
                moved = (relative, apart + amount * UNIT[k])
            residual = loop_equations(rows(names), pair(*moved)).residual
            assert np.abs(residual).max() >= 0.5 * abs(amount)  # sin(1.2) / 1.2 = 0.78


@pytest.mark.parametrize(("kind", "axis"), KINDS)
def test_close_to_home_each_row_is_the_displacement_along_its_own_axis(kind, axis):
    names = locked(kind, axis)
    slip = 1e-6 * np.array([3.0, -2.0, 1.0, -1.0, 2.0, 3.0])
    along = UNIT["xyz".index(axis)]
    home = ROD * along if kind == "distance" else np.zeros(3)
    at = pair(Rotation.from_rotvec(slip[3:]), home + slip[:3])
    table = rows(names)
    assert table.names == tuple(f"c.{name}" for name in names)
    expected = [slip[:3] @ along if name == "distance" else slip[AXES.index(name)] for name in names]
    np.testing.assert_allclose(loop_equations(table, at).residual[0], expected, atol=2e-11)  # slip squared


LISTS = [("x",), ("x", "y"), ("rz",), ("rx", "ry"), ("ry", "rz"), ("z", "rx"), ("rx", "ry", "rz"), AXES]


@pytest.mark.parametrize("axes", [*LISTS, *(locked(kind, axis) for kind, axis in KINDS)], ids=" ".join)
def test_the_jacobian_is_the_derivative_anywhere_closed_or_open(axes):
    rng = np.random.default_rng(5)
    table, h = rows(axes), 1e-6
    for _ in range(3):
        relative, first = Rotation.from_quat(rng.standard_normal((2, 4)))
        at = pair(relative, rng.standard_normal(3), first=first)
        jacobian = loop_equations(table, at).jacobian[0]
        for column in range(12):
            ahead, back = (loop_equations(table, _nudged(at, column, step)).residual[0] for step in (h, -h))
            # h^2 and eps / h
            np.testing.assert_allclose(jacobian[:, column], (ahead - back) / (2 * h), atol=1e-9)


def _nudged(at: FrameStack, column: int, step: float) -> FrameStack:
    """One frame moved by a small twist on world axes."""
    frame, k = divmod(column, 6)
    placements = at.placements.copy()
    if k < 3:
        placements[0, frame, 3, k] += step
    else:
        placements[0, frame, :3] = Rotation.from_rotvec(step * UNIT[k - 3]).apply(placements[0, frame, :3])
    return at._replace(placements=placements)


def test_the_number_of_locked_axes_is_that_of_mechanics():
    count = {"fixed": 6, "revolute": 5, "prismatic": 5, "universal": 4, "cylindrical": 4, "spherical": 3}
    count |= {"planar": 3, "distance": 1}
    assert {kind: len(locked(kind)) for kind in CLOSURE_KINDS} == count


@pytest.mark.parametrize(("axes", "length"), [(("distance",), None), (("x", "y", "z"), 0.7), ((), 0.7)])
def test_a_distance_and_nothing_else_has_a_length(axes, length):
    with pytest.raises(RobotFileError, match="closure c: a length goes with rows such as distance"):
        Closure("c", ("one", "two"), axes, length)


@pytest.mark.parametrize(
    ("kind", "axis", "words"),
    [
        ("weld", "z", "unknown closure kind 'weld'.*cylindrical"),
        ("revolute", "w", "unknown closure axis 'w'"),
    ],
)
def test_unknown_kinds_and_axes_list_the_known_ones(kind, axis, words):
    with pytest.raises(RobotFileError, match=words):
        locked(kind, axis)


def test_an_unknown_row_is_refused():
    with pytest.raises(RobotFileError, match="closure c: unknown axis 'distanse'; did you mean 'distance'"):
        Closure("c", ("a", "b"), ("distanse",), 1.0)
