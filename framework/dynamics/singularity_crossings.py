"""The instants at which a motion is in a Type 2 singularity, with t_s . W_p.

There locked motors leave a motion of the joints uncontrolled, with joint rates eta and platform twist t_s.
t_s . W_p = eta . r is the power in this motion of the forces r that the planned motion requires. Condition
(8) sets this power to zero, which keeps the torques finite. g is a measure that vanishes at the singularity.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from framework.dynamics.elasticity import Pass, motion_at_rest
from framework.dynamics.forces import tree_forces
from framework.dynamics.path_forces import PathForces
from framework.dynamics.result import InverseDynamics, SingularityCrossing
from framework.errors import NoLaw, UnboundedTorque
from framework.kinematics.continuation.tracking import Branch, uncontrolled_error
from framework.kinematics.linearised_loops import linearised_at, passive_motion, type2_matrix
from framework.kinematics.modes import passive_determinants
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import MotionLaw, edges_of, law_derivatives
from framework.numerics.arrays import Array, freeze
from framework.numerics.chebyshev import TimeGrid, real_roots
from framework.singularity.bordered_system import Border, root_of_g, solve_bordered
from framework.singularity.points_on_path import SingularPoint
from framework.singularity.type2 import UNCROSSABLE, uncontrolled_motion, uncontrolled_space
from framework.tolerances import CONDITION_ROUNDING, NO_HOLD, SAME_PLACE, STOP_AT_CROSSING

LAW_ROOT_ROUNDING = 1e-12  # largest residual in s of a root of the law
ROUNDING_SHARE = 1e-15  # of the duration: a shorter Newton step to a root of the law is rounding
SAMPLES = np.linspace(0.0, 1.0, 17)  # shares of a motion at which sizes of speeds and forces are measured


def panel_edges(branch: Branch, law: MotionLaw, avoid: Iterable[float] = ()) -> Array:
    """Return the ascending edges [s] of panels on which all functions of time are smooth.

    Edges are the ends of the motion and of the law's panels, and the instants at which the motion passes the
    branch's knots. Every edge is a node, and no node may be at a crossing. So an edge of the law near a
    crossing is shifted aside. A law without panels and with many crossings gets a panel for each crossing, so
    that the number of nodes is proportional to the number of crossings.

    Args:
        avoid: instants [s] of crossings, which no edge may meet.
    """
    max_crossings_on_panel = 3  # of a law without panels; with more, 512 nodes are slow or not enough
    # of a panel's width; edges are nodes, so an edge nearer to a crossing is shifted
    edge_clearance = 0.1
    edges = np.array([0.0, law.duration])
    law_edges = edges_of(law)
    if len(law_edges):
        edges = law_edges.copy()
        for t in avoid:
            k = int(np.argmin(np.abs(edges - t)))  # the nearest edge
            if not 0 < k < len(edges) - 1:  # the ends of the motion stay
                continue
            narrower_width = min(edges[k] - edges[k - 1], edges[k + 1] - edges[k])
            if abs(edges[k] - t) < edge_clearance * narrower_width:  # shift well beyond the crossing
                edges[k] = t + 3.0 * edge_clearance * narrower_width
    else:
        crossings = np.sort(np.fromiter(avoid, dtype=float))
        if len(crossings) > max_crossings_on_panel:
            edges = np.insert(edges, 1, 0.5 * (crossings[1:] + crossings[:-1]))
    if not len(branch.knots):
        return edges
    return np.unique(np.concatenate([edges, *find_instants(law, edges, branch.knots)]))


def find_instants(law: MotionLaw, edges: Array, places: Sequence[float] | Array) -> list[Array]:
    """Find for each of k places s all instants [s] with law(t) = s, ascending.

    The roots of the law's Chebyshev series are refined by Newton's method on the law itself.

    Args:
        edges: instants [s] between which the law is smooth.
        places: path coordinates (k,).
    """
    newton_steps = 3
    if not len(places):
        return []
    grid = TimeGrid(edges, 65)  # nodes per panel; Newton's method removes what the series does not resolve
    series = grid.fit(np.asarray(law(grid.times))[:, None]).coefficients[..., 0]  # (panels, 65)
    # on a panel s is nowhere farther from its first coefficient than the sum of the other ones
    reach = np.abs(series[:, 1:]).sum(axis=1) + LAW_ROOT_ROUNDING
    starts = edges[:-1]
    widths = np.diff(edges)
    times, owners, panels = list[float](), list[int](), list[int]()  # of the R roots of all places
    for k, s in enumerate(places):
        for panel in np.flatnonzero(np.abs(series[:, 0] - s) <= reach):
            shifted = series[panel].copy()
            shifted[0] -= s  # the series of law(t) - s
            roots = starts[panel] + 0.5 * widths[panel] * (real_roots(shifted) + 1.0)
            times += roots.tolist()
            owners += [k] * len(roots)
            panels += [int(panel)] * len(roots)
    t = np.array(times)  # (R,)
    owner = np.array(owners, dtype=int)
    targets = np.array(places)[owner]
    rounding = ROUNDING_SHARE * edges[-1]  # [s]
    for _ in range(newton_steps if len(t) else 0):
        value, slope = law_derivatives(law, t, 2)
        # no step where the law stands still
        step = np.divide(value - targets, slope, out=np.zeros(t.shape), where=slope != 0.0)
        t = (t - step).clip(starts[panels], edges[1:][panels])
        if np.abs(step).max() < rounding:
            break
    is_root = np.abs(np.asarray(law(t)) - targets) < LAW_ROOT_ROUNDING  # an extremum close to s is none
    instants = [np.sort(t[is_root & (owner == k)]) for k in range(len(places))]
    # a root at an edge is found on both panels
    apart = SAME_PLACE * (edges[-1] - edges[0])
    return [roots[np.diff(roots, prepend=-np.inf) > apart] for roots in instants]


# an instant [s] at which a law passes a singular point, with its s' [1/s] and s" [1/s^2] there
CrossedPoint = tuple[float, float, float, SingularPoint]


def find_crossed_points(
    branch: Branch, points: tuple[SingularPoint, ...], law: MotionLaw
) -> list[CrossedPoint]:
    """Find all instants at which the undeformed robot passes one of the singular points of the path.

    Raises:
        NoLaw: the motion stands still on a singular point, or no law can cross it.
    """
    for singular in points:
        check_kind(branch.robot, singular)
    if not points:
        return []
    edges = panel_edges(branch, law)
    instants = find_instants(law, edges, [point.s for point in points])
    met = [point for point, times in zip(points, instants, strict=True) for _ in times]  # (k,) in all
    k = len(met)
    if not k:
        return []
    times = np.concatenate([*instants, law.duration * SAMPLES])  # (k + SAMPLES,)
    _s, speeds, accelerations = law_derivatives(law, times)
    values = (array[:k].tolist() for array in (times, speeds, accelerations))
    crossed = list(zip(*values, met, strict=True))
    stops = np.abs(speeds[:k]) <= STOP_AT_CROSSING * np.abs(speeds[k:]).max()
    if stops.any():
        t, _, _, singular = crossed[int(stops.argmax())]
        raise NoLaw(
            f"the motion stands still on a Type 2 singularity at t = {t:.6g} s, s = "
            f"{singular.s:.6g}: no law can rest on the locus",
            clauses=("shift the path's end or the law",),
            name=branch.robot.name,
        )
    return crossed


def rigid_crossings(
    branch: Branch, points: tuple[SingularPoint, ...], law: MotionLaw
) -> tuple[SingularityCrossing, ...]:
    """Find all instants at which the undeformed robot passes one of the singular points, with t_s . W_p.

    Raises:
        NoLaw: as `find_crossed_points`.
    """
    crossed = find_crossed_points(branch, points, law)
    if not crossed:
        return ()
    # T instants: first the crossings, then SAMPLES along the motion for the size of the forces
    times = np.concatenate([[t for t, *_ in crossed], law.duration * SAMPLES])
    forces = tree_forces(branch.robot, motion_at_rest(branch, times, law))
    return measure_crossings(branch.robot, law.duration, crossed, forces)


def measure_crossings(
    robot: ParallelRobot, duration: float, crossed: list[CrossedPoint], forces: Array
) -> tuple[SingularityCrossing, ...]:
    """Compute t_s . W_p = eta . r of the undeformed robot at each of k crossed points.

    Of several uncontrolled motions eta, that with the largest relative t_s . W_p counts.

    Args:
        duration: [s] of the motion.
        forces: (k + M, nv) forces r of the open tree at the crossed points, then along the motion for the
            size of their terms.
    """
    # the scale of eta . r is the largest sum of sizes of its terms along the motion, or that of inertia
    inertial_force = robot.mass * robot.length / duration**2
    crossings = []
    for (t, speed, acceleration, singular), r in zip(crossed, forces, strict=False):
        eta = singular.motion[None]  # (corank, nv) joint rates of the uncontrolled motions
        if singular.corank > 1:
            eta = uncontrolled_space(robot, singular.pose, at_least=singular.corank).motions
        sizes = np.abs(forces) @ np.abs(eta).T  # (k + M, corank)
        least_scale = inertial_force * robot.length * np.abs(eta / robot.column_scale).max(axis=1)
        scale = np.maximum(sizes.max(axis=0), least_scale)  # (corank,)
        wrench = eta @ r  # (corank,)
        worst = int(np.argmax(np.abs(wrench) / np.where(scale > 0.0, scale, 1.0)))
        crossings.append(
            SingularityCrossing(
                **vars(singular),
                time=t,
                speed=speed,
                acceleration=acceleration,
                wrench=float(wrench[worst]),
                scale=float(scale[worst]),
            )
        )
    return tuple(crossings)


def check_kind(robot: ParallelRobot, singular: SingularPoint) -> None:
    """Refuse a singular point to which condition (8), t_s . W_p = 0, does not apply.

    Raises:
        UncontrolledMotions: several motions are uncontrolled at once, and the singularity is not of Type 2 or
            the path only touches the locus.
        NoLaw: the singularity is not of Type 2.
    """
    if singular.corank > 1 and (singular.kind != "type_2" or singular.contact == "tangential"):
        reason = UNCROSSABLE.get(singular.kind, "a Type 2 singularity that it touches without crossing it")
        raise uncontrolled_error(
            robot, singular.s, singular.platform, singular.corank, f"the path meets {reason}"
        )
    if singular.kind != "type_2":
        raise NoLaw(f"at s = {singular.s:.6g} the path meets {UNCROSSABLE[singular.kind]}", name=robot.name)


def deformed_crossings(
    result: InverseDynamics, at_rest: tuple[SingularityCrossing, ...]
) -> tuple[SingularityCrossing, ...]:
    """Find the crossings of the deformed robot beside its crossings at rest, `at_rest`.

    The motion is evaluated at each crossing and at a second instant for the slope of g, all as one stack.
    """
    if not at_rest:
        return ()
    probe = 1e-6 * result.duration  # [s] from a crossing to the second instant, towards the middle
    t = np.array([crossing.time for crossing in at_rest])
    times = np.column_stack([t, t + np.copysign(probe, 0.5 * result.duration - t)])  # (k, 2)
    motion = result.motion(times.ravel())
    forces = tree_forces(result.robot, motion)  # (2 k, nv)
    pairs = [slice(2 * k, 2 * k + 2) for k in range(len(t))]
    return tuple(
        _deformed_crossing(result, crossing, pair_times, motion.select(pair), forces[pair])
        for crossing, pair_times, pair in zip(at_rest, times, pairs, strict=True)
    )


def _deformed_crossing(
    result: InverseDynamics, at_rest: SingularityCrossing, times: Array, motion: Motion, r: Array
) -> SingularityCrossing:
    """Find the crossing of the deformed robot, a root of g in time.

    Most laws are made for a crossing at the very instant of `at_rest`, with the deflections of the last pass.
    A secant step then leads to the root with the deflections of the motion, and to the wrench there. At the
    instant itself the wrench would be off by this step times its rate, which is large under a quick law.

    Args:
        at_rest: the crossing of the undeformed robot, at which the search begins. Its twist decides the sign
            of t_s.
        times: (2,) [s] of this crossing, and a little later or earlier.
        motion, r: the motion of the deformed robot at both instants, and its tree forces (2, nv).
    """
    law_root_rounding = 1e-12  # |g| at the crossing for which a law was made
    robot = result.robot

    def matrices(t: Array) -> Array:
        """Compute the Type 2 matrices (T, n, n) at t (T,)."""
        return type2_matrix(robot, linearised_at(robot, result.configuration(t), result.platform(t)))

    t, aside = times.tolist()
    P = type2_matrix(robot, motion.linearised)  # (2, n, n)
    bordered = solve_bordered(P, Border.of(P[0]))
    g, beside = bordered.g.tolist()
    change = np.zeros_like(r[0])  # (nv,) of the forces along eta, from the instant of the motion to the root
    if abs(g) > law_root_rounding:
        t, _ = root_of_g(matrices, t, high=result.duration)
        motion = result.motion(t)
        r = tree_forces(robot, motion)
    elif abs(beside) > 100.0 * law_root_rounding:  # else the path touches the locus, the slope is rounding
        step = g / (g - beside)  # of the secant, over the distance of the two instants
        t += step * (aside - t)
        eta = passive_motion(robot, bordered.eta[..., 0])  # (2, nv)
        power, power_beside = np.sum(r * eta, axis=1)
        change = step * (power_beside - power) * eta[0] / (eta[0] @ eta[0])
    motion = motion.select(slice(1))
    uncontrolled = uncontrolled_motion(robot, motion.linearised)
    sign = -1.0 if np.dot(uncontrolled.twist, at_rest.twist) < 0 else 1.0
    s, speed, acceleration = (float(value) for value in law_derivatives(result.law, t))
    freeze(motion.linearised)
    return replace(
        at_rest,
        time=float(t),
        s=s,
        speed=speed,
        acceleration=acceleration,
        kind=uncontrolled.kind,
        twist=sign * uncontrolled.twist,
        platform=result.path(s),
        motion=sign * uncontrolled.motion,
        pose=motion.linearised,
        wrench=float((r[0] + change) @ uncontrolled.motion) * sign,
    )


def check_bounded(branch: Branch, crossings: tuple[SingularityCrossing, ...], allowed: float) -> None:
    """Raise UnboundedTorque if a residual |t_s . W_p| / scale of condition (8) is above `allowed`."""
    robot = branch.robot
    worst = max(crossings, key=lambda crossing: crossing.residual, default=None)
    if worst is None or worst.residual <= allowed:
        return
    unit = "N" if np.any(worst.twist[robot.translations]) else "N m"
    raise UnboundedTorque(
        f"unbounded torque at t = {worst.time:.9g} s, s = {worst.s:.12g}, {robot.place(worst.platform)}: a "
        f"Type 2 singularity with t_s . W_p = {worst.wrench:.6g} {unit} where condition (8) asks for zero: "
        f"{_compare_accelerations(branch, worst)}",
        name=robot.name,
        time=worst.time,
        s=worst.s,
        platform=worst.platform,
        wrench=worst.wrench,
    )


def _compare_accelerations(branch: Branch, crossing: SingularityCrossing) -> str:
    """State s' and s" of the law, and if s" has an effect, the s" that condition (8) asks for.

    t_s . W_p = alpha s" + .. is affine in s", where alpha is the power of the inertial forces at s" = 1.
    It vanishes at the s" of the law minus t_s . W_p / alpha.
    """
    inertial = PathForces.compute(branch, np.array([crossing.s]), crossing.pose).inertial[0]  # (nv,)
    powers = crossing.motion * inertial  # (nv,), whose sum is alpha
    alpha = powers.sum()
    has_effect = abs(alpha) > NO_HOLD * np.abs(powers).sum()
    required = crossing.acceleration - crossing.wrench / alpha if has_effect else 0.0
    rounding = CONDITION_ROUNDING * max(abs(crossing.acceleration), crossing.speed**2)  # of s" [1/s^2]
    of_law, asked = (s if abs(s) > rounding else 0.0 for s in (crossing.acceleration, required))
    has = f"the law has s' = {crossing.speed:.6g} 1/s and s\" = {of_law:.6g} 1/s^2"
    if crossing.corank > 1 or not has_effect:  # with several motions each has a condition
        return has
    deflected = " and these deflections" if branch.robot.n_e else ""
    return f"{has}, and at this s'{deflected} it asks for s\" = {asked:.6g}"


def check_crossings(robot: ParallelRobot, solution: Pass, result: InverseDynamics) -> None:
    """Raise NoLaw if the assembly mode changes between two nodes without a crossing.

    An elastic robot in rigid geometry is not checked: the forces are those of the undeformed robot.
    """
    if result.geometry == "rigid" and robot.n_e:
        return
    signs, _ = passive_determinants(solution.motion.linearised)  # (T,) of the assembly mode
    times = solution.grid.times
    for k in np.flatnonzero(signs[1:] != signs[:-1]):
        if not any(times[k] <= crossing.time <= times[k + 1] for crossing in result.crossings):
            raise NoLaw(
                f"the deflected robot meets a Type 2 singularity between t = "
                f"{times[k]:.6g} and {times[k + 1]:.6g} s that the undeflected one does not",
                name=robot.name,
            )
