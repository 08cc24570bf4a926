"""MuJoCo's inverse dynamics of a planned motion of the 5R, and the force in its loop.

`mj_inverse` with the loop as an equality is no help: MuJoCo's loops are soft, and their force follows from
the gap between the tips, which is zero on a planned motion. So the tree is left open, and the force of the
loop f (2,) [N] is found from statics, with the Jacobians of MuJoCo at the two tips. With r the
`qfrc_inverse` of the tree, springs included,

    r - J' f = 0 on every joint without a motor,        J = J_left_tip - J_right_tip  (2, nv)

and r - J' f on the motors' joints is the torque. With springs these are six equations for two unknowns, of
full rank even at the singularity, and what they leave is a second proof. Rigid robots have two, of rank one
at the singularity.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from framework.numerics import Array
from tests.benchmarks.chart.bare import newton_in_stacks, solve_each
from tests.benchmarks.chart.peers.five_bar import GEAR_RATIO, SIDES, FiveBar
from tests.benchmarks.chart.peers.mujoco_five_bar import NEGLIGIBLE, model_of


class InverseDynamics(NamedTuple):
    """MuJoCo's forces on a motion, at T instants."""

    torque: Array  # (T, 2) [N m], motor side
    imbalance: Array  # (T,) what the loop's force leaves of the other joints' equations [N m, N]
    gap: Array  # (T,) distance between the two tips [m]


class Tree:
    """The open tree; `joints` are those of the robot under test, in its order."""

    def __init__(self, robot: FiveBar, joints: list[str], least_mass: float = NEGLIGIBLE) -> None:
        self.model = model_of(robot, least_mass=least_mass)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.data = mujoco.MjData(self.model)
        self.sites = [self.model.site(f"{side}_tip").id for side in SIDES]
        self.columns = [self.model.joint(name).id for name in joints]  # of MuJoCo, in the order of `joints`
        self.motors = [joints.index(f"{side}_motor") for side in SIDES]
        self.others = [k for k in range(len(joints)) if k not in self.motors]
        if sorted(self.columns) != list(range(self.model.nv)):
            raise ValueError(f"MuJoCo's 5R has {self.model.nv} joints, not {joints}")

    def equation(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, float]:
        """r (nv,), J (2, nv) and the gap [m] at one instant, in the order of the joints."""
        model, data, columns = self.model, self.data, self.columns
        data.qpos[columns], data.qvel[columns], data.qacc[columns] = q, v, a
        mujoco.mj_inverse(model, data)
        slopes = np.zeros((2, 3, model.nv))
        for slope, site in zip(slopes, self.sites, strict=True):
            mujoco.mj_jacSite(model, data, slope, None, site)
        first, second = data.site_xpos[self.sites]
        gap = first - second
        jacobian = (slopes[0] - slopes[1])[:2, columns]
        return data.qfrc_inverse[columns].copy(), jacobian, float(np.linalg.norm(gap))

    def inverse(self, q: Array, v: Array, a: Array) -> InverseDynamics:
        """Along a motion: q, v, a (T, nv) in the order of the joints."""
        torque, imbalance, gaps = [], [], []
        for instant in zip(q, v, a, strict=True):
            r, jacobian, gap = self.equation(*instant)
            force = np.linalg.lstsq(jacobian[:, self.others].T, r[self.others], rcond=None)[0]
            left = r - jacobian.T @ force
            torque.append(left[self.motors] / GEAR_RATIO)
            imbalance.append(np.abs(left[self.others]).max())
            gaps.append(gap)
        return InverseDynamics(np.array(torque), np.array(imbalance), np.array(gaps))

    def torques(self, q: Array, v: Array, a: Array) -> Array:
        """Motor torques (T, 2) [N m] along a motion, with one stacked solve for the forces of the loop."""
        forces, jacobians, _ = zip(*map(self.equation, q, v, a), strict=True)
        r, back = np.array(forces), np.array(jacobians).transpose(0, 2, 1)
        loop = solve_each(back[:, self.others], r[:, self.others])
        return np.asarray((r[:, self.motors] - np.matvec(back[:, self.motors], loop)) / GEAR_RATIO)

    def motion(self, x: Array, dx: Array, ddx: Array, guess: Array) -> tuple[Array, Array, Array]:
        """Joints (T, nv), rates and accelerations under x(t), x', x" (T, 2), by Newton's method from guesses.

        The rows of tips that stay together, and of the platform, are MuJoCo's Jacobians at the tips; poses
        are solved in stacks.
        """
        q, matrices = newton_in_stacks(lambda k, pose: self._equations(pose, x[k]), guess)
        still = np.zeros_like(x)
        v = solve_each(matrices, np.hstack([still, dx]))
        drift = np.array([self._drift(*state) for state in zip(q, v, strict=True)])
        return q, v, solve_each(matrices, np.hstack([still, ddx]) - drift)

    def _equations(self, q: Array, x: Array) -> tuple[Array, Array]:
        """Residual (4,) at q (nv,) of tips that stay together, one of them at x (2,), and its derivatives."""
        model, data = self.model, self.data
        data.qpos[self.columns] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        slopes = np.zeros((2, 3, model.nv))
        for slope, site in zip(slopes, self.sites, strict=True):
            mujoco.mj_jacSite(model, data, slope, None, site)
        first, second = data.site_xpos[self.sites, :2]
        one, other = slopes[:, :2, self.columns]
        return np.concatenate([first - second, first - x]), np.vstack([one - other, one])

    def _drift(self, q: Array, v: Array) -> Array:
        """The rows' second derivatives (4,) without accelerations of the joints."""
        model, data = self.model, self.data
        data.qpos[self.columns], data.qvel[self.columns] = q, v
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_comVel(model, data)
        rates = np.zeros((2, 3, model.nv))
        for rate, site in zip(rates, self.sites, strict=True):
            place, body = data.site_xpos[site], model.site_bodyid[site]
            mujoco.mj_jacDot(model, data, rate, None, place, body)
        first, second = rates[:, :2, self.columns] @ v
        return np.concatenate([first - second, first])

    def imbalance(self, q: Array, v: Array, a: Array, torque: Array) -> Array:
        """What torques (T, 2) leave of all joints' equations, whatever the loop's force: (T,) [N m, N].

        It needs no quotient that is 0/0 at the singularity: r - S' tau must be of the form J' f, and J keeps
        its rank there.
        """
        left = []
        for q_t, v_t, a_t, torque_t in zip(q, v, a, torque, strict=True):
            r, jacobian, _ = self.equation(q_t, v_t, a_t)
            r[self.motors] -= GEAR_RATIO * torque_t
            force = np.linalg.lstsq(jacobian.T, r, rcond=None)[0]
            left.append(np.abs(r - jacobian.T @ force).max())
        return np.array(left)
