"""The springs that stand for a link's elasticity, from its section and material.

A slender straight beam of length L along x is clamped at one end. At the other end its compliance after
Euler and Bernoulli (or Timoshenko) couples displacement and rotation:

    y = F L^3 / (3 E Iz) + M L^2 / (2 E Iz),    rz = F L^2 / (2 E Iz) + M L / (E Iz).

At the middle of the beam displacement and rotation decouple, and the stiffness is diagonal:

    x  E A / L       y  12 E Iz / L^3    z  12 E Iy / L^3
    rx G J / L       ry E Iy / L         rz E Iz / L

(for Timoshenko 1/ky = L^3 / (12 E Iz) + L / (shear_y G A), likewise z). A virtual joint of six axes in the
middle of the link is therefore exact to first order in the deflection, for every load at the tip; it neglects
the mass of the beam. `split_beam` puts a fixed joint at the middle.

No diagonal stiffness is exact at the tip. An exception is a planar rod with a pin at each end: it carries no
bending, and its axial stiffness x is the same at the tip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple
from warnings import warn
from xml.etree.ElementTree import ParseError, fromstring

import numpy as np

from framework.errors import InvalidInput, check_name, finite_numbers, point
from framework.model.description import AXES, Spring
from framework.model.placement import invert_placement, placement, unit_vector
from framework.model.robot_file_writer import record_entry as spring_entry
from framework.model.urdf_edits import urdf_text as text_of
from framework.model.urdf_elements import Joint, read_tree
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.fields import CheckedNumbers, Positive, check_distinct, positive
from framework.tolerances import BEAM_NEAR_MINUS_X, FILE_ROUNDING


@dataclass(frozen=True)
class Material(CheckedNumbers):
    """Moduli of elasticity `E` and of shear `G` [Pa]."""

    E: Positive
    G: Positive

    @staticmethod
    def isotropic(E: float, poisson: float) -> Material:
        """Return the material with modulus `E` [Pa] and a Poisson's ratio.

        G = E / (2 (1 + poisson)).

        Raises:
            InvalidInput: E is not positive, or the ratio is not between -1 and 0.5.
        """
        if not -1.0 < poisson < 0.5:
            raise InvalidInput(f"poisson: must be between -1 and 0.5, got {poisson!r}")
        return Material(E, E / (2.0 * (1.0 + poisson)))


@dataclass(frozen=True)
class Section(CheckedNumbers):
    """A cross-section: area `A` [m^2], second moments `Iy`, `Iz` and torsion constant `J` [m^4].

    `Iy` resists bending about y (displacement along z). `shear_y` and `shear_z` are Timoshenko's shear
    factors; None leaves shear out (Euler-Bernoulli).
    """

    A: Positive
    Iy: Positive
    Iz: Positive
    J: Positive
    shear_y: Positive | None = None
    shear_z: Positive | None = None

    @staticmethod
    def tube(outer: float, inner: float = 0.0) -> Section:
        """Return the section of a round tube with radii [m], solid by default.

        Raises:
            InvalidInput: not 0 <= inner < outer.
        """
        positive("outer", outer)
        if not 0.0 <= inner < outer:
            raise InvalidInput(f"inner: must be from 0 to below outer ({outer!r}), got {inner!r}")
        area = math.pi * (outer**2 - inner**2)
        second_moment = math.pi / 4.0 * (outer**4 - inner**4)
        return Section(area, second_moment, second_moment, J=2.0 * second_moment)

    @staticmethod
    def rectangle(width: float, height: float) -> Section:
        """Return a solid rectangle, `width` [m] along y, `height` [m] along z.

        With the longer edge a and the shorter edge b, Saint-Venant's series over odd n gives

            J = a b^3 / 3 (1 - 192 b / (pi^5 a) sum tanh(n pi a / (2 b)) / n^5).
        """
        positive("width", width)
        positive("height", height)
        b, a = sorted((width, height))
        n = np.arange(1, 200, 2)  # the first term left out is below 1e-11 of the sum
        series = float(np.sum(np.tanh(n * math.pi * a / (2.0 * b)) / n**5.0))
        torsion = a * b**3 / 3.0 * (1.0 - 192.0 / math.pi**5 * b / a * series)
        bending_y = width * height**3 / 12.0
        bending_z = height * width**3 / 12.0
        return Section(width * height, bending_y, bending_z, torsion)


class SplitBeam(NamedTuple):
    """A URDF with a fixed joint `middle` halfway along a beam of `length` [m]."""

    urdf_text: str
    middle: str
    length: float


def beam_stiffness(section: Section, material: Material, length: float) -> dict[str, float]:
    """Compute the diagonal stiffness [N/m, N m/rad] at the middle of a beam, by axis.

    The formulas are those of the module. The beam has the same section and material along its `length` [m],
    and runs along x. The keys of the result are the axes x, y, z, rx, ry, rz.

    Raises:
        InvalidInput: the length is not positive.
    """
    positive("length", length)
    E, G, L = material.E, material.G, length

    def stiffness_across(second_moment: float, shear_factor: float | None) -> float:
        """Compute the stiffness [N/m] across the beam; bending and shear act in series."""
        bending = L**3 / (12.0 * E * second_moment)
        shearing = 0.0 if shear_factor is None else L / (shear_factor * G * section.A)
        return 1.0 / (bending + shearing)

    return {
        "x": E * section.A / L,
        "y": stiffness_across(section.Iz, section.shear_y),
        "z": stiffness_across(section.Iy, section.shear_z),
        "rx": G * section.J / L,
        "ry": E * section.Iy / L,
        "rz": E * section.Iz / L,
    }


def beam_spring(
    name: str, after: str, section: Section, material: Material, length: float, axes: tuple[str, ...] = AXES
) -> Spring:
    """Return the virtual joint in the middle of a link's beam.

    The module says in which sense the spring is exact.

    Args:
        name: of the spring.
        after: fixed joint at the middle, whose child frame has x along the beam; see `split_beam`.
        section, material: the same along the beam.
        length: of the whole beam [m].
        axes: elastic axes; the others are rigid.

    Raises:
        InvalidInput: length, name or axes are not valid.
    """
    stiffness = beam_stiffness(section, material, length)
    if not name or not after:
        raise InvalidInput(f"name and after: need names, got {name!r} and {after!r}")
    check_distinct("axes", "axis", axes, AXES)
    return Spring(name, "link", after, tuple(axes), tuple(stiffness[axis] for axis in axes))


def tip_spring(
    name: str, after: str, section: Section, material: Material, length: float, axes: tuple[str, ...] = AXES
) -> Spring:
    """Deprecated: the spring of a beam at its tip, without cross terms; see `beam_spring`."""
    warn("tip_spring goes in 0.9: see beam_spring", DeprecationWarning, stacklevel=2)
    spring = beam_spring(name, after, section, material, length, axes)
    stiffness = beam_stiffness(section, material, length)
    for axis, turn in (("y", "rz"), ("z", "ry")):  # the tip swings about the middle: (L/2)^2 / k
        stiffness[axis] = 1.0 / (1.0 / stiffness[axis] + length**2 / (4.0 * stiffness[turn]))
    return replace(spring, stiffness=tuple(stiffness[axis] for axis in spring.motion))


def split_beam(urdf_text: str, tip: str, *, y: ArrayLike | None = None) -> SplitBeam:
    """Return the URDF with a fixed joint halfway along the fixed joint `tip`.

    `tip` leads from a link's origin to the link's tip, which stays in its place. The masses of the link stay
    on the half before the new joint, `<tip>_middle`. The child frame of that joint has x along the beam; `y`
    directs the section.

    Args:
        urdf_text: a URDF.
        tip: name of the joint.
        y: direction (3,) of the section's y axis (the width of `Section.rectangle`) in the link's axes, of
            any length; only its part across the beam counts. By default the frame is that of the link after
            the least rotation that takes x to the beam. It changes continuously with the direction of the
            beam, except at -x, where `y` is required.

    Raises:
        InvalidInput: no fixed joint has this name, or the joint has no length; y is no direction, or runs
            along the beam; the beam runs along -x of its link (within 0.01 rad) and no y is given.
    """
    try:
        root = fromstring(urdf_text)
    except ParseError as error:
        raise InvalidInput(f"urdf_text: not well-formed XML: {error}") from None
    tree = read_tree(root)
    check_name("tip", "fixed joint", tip, [joint.name for joint in tree.joints.values() if not joint.moves])
    joint = tree.joints[tip]
    middle = f"{tip}_middle"
    if not {middle, f"{middle}_link"}.isdisjoint((*tree.links, *tree.joints)):
        raise InvalidInput(f"tip: the name {middle!r} is already there")

    # the middle of the beam, with x along the beam
    span = joint.origin[:3, 3]
    length = float(np.linalg.norm(span))
    if length == 0.0:
        raise InvalidInput(f"tip: joint {tip!r} has no length")
    to_middle = placement(_section_axes(span / length, y), 0.5 * span)

    # the new joint leads from the link to the middle, and `tip` from there to the tip
    tree.put(Joint(middle, "fixed", to_middle, parent=joint.parent, child=f"{middle}_link"))
    rest = invert_placement(to_middle) @ joint.origin
    tree.put(replace(joint, origin=rest, parent=f"{middle}_link", element=None))
    return SplitBeam(text_of(tree), middle, length)


def _section_axes(along: Array, y: ArrayLike | None) -> Array:
    """Return a beam's axes as columns (3, 3): `along` the beam (unit vector), its section's y and z.

    `y` (3,), of any length, directs the section; only its part across the beam counts. Without it the axes
    are those of the least rotation from x to `along`.
    """
    if y is None:
        # 1 + along_x is about angle^2 / 2 at a small angle from -x
        if 1.0 + along[0] < 0.5 * BEAM_NEAR_MINUS_X**2:
            raise InvalidInput(
                "y: required, because the beam runs along -x of its link, where the least turn has no axis; "
                "give the direction of the section's y axis in the link"
            )
        # the least rotation from x to `along` takes y to e_y - along_y / (1 + along_x) (e_x + along)
        across = unit_vector("y") - along[1] / (1.0 + along[0]) * (unit_vector("x") + along)
    else:
        width = finite_numbers("y", y, 3)
        across = width - (width @ along) * along
        if not np.linalg.norm(across) > FILE_ROUNDING * np.linalg.norm(width):
            raise InvalidInput(f"y: needs a direction across the beam, which runs along {point(along)}")
    across /= np.linalg.norm(across)
    return np.column_stack([along, across, np.cross(along, across)])


__all__ = ["Material", "Section", "SplitBeam", "beam_spring", "beam_stiffness", "split_beam", "spring_entry"]
