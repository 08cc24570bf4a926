"""The unknowns of an identification: parameters that are asked for, in units of what the file leaves open.

The parameters of links and motors are file + change z, with independent unit normals z by the prior about the
file. With the singular values s of the base parameters' derivatives by z, U s V', only c = V' z changes
torques; c are unit normals as well. The rest of z changes no torque, whatever the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from framework.dynamics.body_parameters import INERTIAL
from framework.errors import InvalidInput, did_you_mean, list_names, short
from framework.identification.base_parameters import OF_MOTORS, BaseParameters, LinkParameters
from framework.kinematics.mechanism import frame_index
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.tolerances import EIGENVALUE_ROUNDING, FILE_SHARE, NARROWED_SHARE

GROUPS = {
    "friction": (".friction", ".damping"),
    "rotor": (".rotor_inertia",),
}  # endings of names
PAYLOAD = "payload"


class Unknowns(NamedTuple):
    """The k unknowns c that change torques, and the derivatives of all parameters."""

    design: Array  # (rank, k) derivatives of the base parameters by c
    shown: Array  # (u, k) derivatives of the parameters of links and motors by c
    hidden: Array  # (u, h) their derivatives by the rest of z

    @property
    def prior_root(self) -> Array:
        """L (u, k + h), where L L' is the covariance of the parameters by the file."""
        return np.hstack([self.shown, self.hidden])


def is_narrowed(deviations: Array, by_prior: Array) -> BoolArray:
    """Return whether data narrow quantities far below the file's deviations, (p,)."""
    return np.asarray(deviations < NARROWED_SHARE * by_prior)


def rests_on_data(deviations: Array, by_file: Array) -> BoolArray:
    """Return whether the noise of data makes most of the variance of estimates.

    With independent unit normals as prior and the covariance S S' after the data, the file's own error has
    the part S S' of an estimate's error: `by_file` are the lengths of a S S', deviations those of a S.
    """
    return np.asarray(by_file**2 < FILE_SHARE * deviations**2)


def choose_unknowns(
    base: BaseParameters, links: LinkParameters, only: Sequence[str] = (), prior: float = 1.0
) -> Unknowns:
    """Choose the unknowns of the parameters that are asked for.

    Args:
        only: "payload", "friction", "rotor", or names of links, motors' joints or parameters; by default all.
        prior: factor of the standard deviations of the file's values.

    Raises:
        InvalidInput: an unknown name.
    """
    sizes = base.described.sizes  # (p,)
    coefficients = base.combinations.coefficients  # (rank, p)
    # bodies without mass have no link whose parameters could change: they have typical sizes of this robot
    is_massless = ~links.to_parameters.any(axis=1)  # (p,)
    massless = np.diag(sizes)[:, is_massless & (not only)]  # (p, m)
    change = np.zeros((len(links.values), len(links.values) + massless.shape[1]))  # (u, u + m) by z
    free = _free_parameters(base, links, only)
    root = links.prior_root.copy()
    if only:  # a rotor that is asked for is unknown where the file has none
        rotors = np.arange(links.motor_slice.start, len(root), len(OF_MOTORS)) + OF_MOTORS.index(
            "rotor_inertia"
        )
        absent = rotors[links.values[rotors] == 0.0]
        root[absent, absent] = sizes[absent - len(root)]  # motors are the last of both
    change[free, : len(root)] = prior * root[free]
    by_change = coefficients @ (links.to_parameters @ change)  # (rank, u + m) base parameters by z
    by_change[:, len(links.values) :] = prior * coefficients @ massless
    scale = sizes[base.combinations.leading, None]  # (rank, 1) makes the base parameters comparable
    by_change /= scale
    by_change[np.abs(by_change) <= EIGENVALUE_ROUNDING * np.abs(by_change).max(initial=0.0)] = 0.0
    _, s, V_rows = np.linalg.svd(by_change)
    k = int(np.sum(s > EIGENVALUE_ROUNDING * s.max(initial=0.0)))
    V = V_rows.T
    return Unknowns(scale * (by_change @ V[:, :k]), shown=change @ V[:, :k], hidden=change @ V[:, k:])


def _free_parameters(base: BaseParameters, links: LinkParameters, only: Sequence[str]) -> IntArray:
    """Return the indices (f,) of the parameters of links and motors that are asked for."""
    motors = base.robot.actuator_names
    names = [f"{link}.{name}" for link in links.links for name in INERTIAL]
    names += [f"{joint}.{name}" for joint in motors for name in OF_MOTORS]
    if not only:
        return np.arange(len(names))
    parts = [name.rpartition(".")[0] for name in names]
    chosen: set[int] = set()
    for asked in only:
        wholes = [PAYLOAD, *GROUPS, *dict.fromkeys(parts)]
        if asked not in (valid := [*wholes, *names]):
            raise InvalidInput(
                f"--only: {short(asked)} is none of {list_names(wholes)}, nor a parameter of one, such as "
                f"{names[0]}{did_you_mean(asked, valid)}"
            )
        words = _payload_links(base, links) if asked == PAYLOAD else [asked]
        ends = GROUPS.get(asked, ())
        chosen.update(
            k for k, name in enumerate(names) if name.endswith(ends) or name in words or parts[k] in words
        )
    return np.array(sorted(chosen), dtype=np.intp)


def _payload_links(base: BaseParameters, links: LinkParameters) -> list[str]:
    """Return the massive link of the platform's frame, else the links fixed to the frame."""
    robot = base.robot
    frame = robot.model.frames[frame_index(robot.model, robot.description.platform.frame)]
    body = np.flatnonzero(base.described.bodies == frame.parentJoint)
    rows = (10 * body[:, None] + np.arange(10)).ravel()  # of this body's parameters; none without mass
    carried = [
        link
        for link, part in zip(links.links, links.link_slices, strict=True)
        if links.to_parameters[rows, part].any()
    ]
    if not carried:
        raise InvalidInput(
            f"{robot.name}: the body of the platform's frame {frame.name} has no mass in the file; give it "
            f"one near the payload's"
        )
    return [frame.name] if frame.name in carried else carried
