"""Parameters of links and motors that can exist, nearest to what data say.

The pseudo-inertia of every link must be positive semidefinite (Wensing, Kim and Slotine, IEEE Robotics and
Automation Letters 3(1), 2018), and rotor inertia, damping and friction must not be negative. The misfit to
data and prior is a quadratic form. This is a semidefinite program. Links fixed to one another form one body;
the prior divides its parameters among the links.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from framework.dynamics.body_parameters import pseudo_inertia
from framework.errors import NotConverged
from framework.identification.base_parameters import LinkParameters, read_inertial_parameters, write_inertial
from framework.identification.least_squares import Estimate
from framework.identification.unknowns import Unknowns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.numerics.cone_program import Affine, Unsolved, least_norm_semidefinite
from framework.tolerances import RANK_ROUNDING


def fit_possible_parameters(
    robot: ParallelRobot, links: LinkParameters, unknowns: Unknowns, estimated: Estimate
) -> tuple[Array, Array]:
    """Compute the most probable parameters (u,) of links and motors that can exist, and a root (u, w).

    Without limits the parameters are best + spread y, with independent unit normals y: those of the estimate,
    and those that change no torque. The shortest y with possible parameters is the solution.
    The root S gives their covariance S S' without the limits of what can exist.

    Raises:
        NotConverged: the solver does not converge.
    """
    best = links.values + unknowns.shown @ estimated.values
    spread = np.hstack([unknowns.shown @ estimated.spread, unknowns.hidden])  # (u, w)

    # the shortest y with semidefinite pseudo-inertias, and with motor parameters that are not negative
    is_free = (spread != 0.0).any(axis=1)
    changed = [part for part in links.link_slices if is_free[part].any()]
    cones = []
    for part in changed:
        # D P D: the diagonal D gives the file's link mass 1 and largest second moment 1, so that rounding is
        # relative to 1, whatever units and link. Negative eigenvalues of the size of rounding are allowed
        in_file = np.diag(pseudo_inertia(links.values[part]))  # (4,) three second moments and the mass
        largest = in_file[:3].max() or in_file[3]  # a point mass at the origin gets the scale of its mass
        D = np.diag(1.0 / np.sqrt([largest, largest, largest, in_file[3]]))
        slopes = np.moveaxis(D @ pseudo_inertia(spread[part].T) @ D, 0, 2)  # (4, 4, w)
        cones.append(Affine(slopes, D @ pseudo_inertia(best[part]) @ D + RANK_ROUNDING * np.eye(4)))
    motors = links.motor_slice.start + np.flatnonzero(is_free[links.motor_slice])
    sizes = np.linalg.norm(unknowns.prior_root[motors], axis=1)
    y = least_norm_semidefinite(cones, Affine(spread[motors] / sizes[:, None], best[motors] / sizes))
    if isinstance(y, Unsolved):
        raise NotConverged(
            f"no parameters of bodies that can exist were found ({y.status})",
            name=robot.name,
            residual=float(np.linalg.norm(estimated.values)),
        )

    values = best + spread @ y
    values[motors] = np.maximum(values[motors], 0.0)  # against rounding
    for part in changed:
        link = Element("link")
        write_inertial(link, values[part])
        values[part] = read_inertial_parameters(link)  # exactly as a file would store this link
    return values, spread
