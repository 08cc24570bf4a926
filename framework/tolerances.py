"""The numbers that decide a verdict, in one table: accept or refuse, singular or not, resolved or not.

Each says what it compares, why it has that value (a bound on rounding, or a measured gap between right and
wrong), and what happens at ten times and at a tenth of it. All but one, `POINT_BODY_GYRATION`, are relative:
what they are compared with is without dimension, by the scales of the robot and of the request. Settings that
only cost time stay beside their algorithm. The audit, `python -m tests.benchmarks.tolerance_audit`, holds
each against equations of motion that know none of them.

The scales are three numbers, and every other one follows: the robot's `length` [m] and `mass` [kg], and the
duration [s] of a motion where there is one (mass length / duration^2 is a force, times length a torque).
Models are not copied into other units: pinocchio computes as well in micrometres as in metres, and results
stay in the units of their files. What has a unit is divided by its scale where it is compared with a number.
`tests/stability/test_scale_invariance.py` holds that nothing else knows a unit.
"""

from __future__ import annotations

NO_HOLD = 1e-9
"""Whether s" has an effect on t_s . W_p: |alpha| of condition (8) over the sum of the sizes of its terms.

Rounding leaves 1e-16 to 1e-12 of them, the latter a kilometre from the base's origin; what the catalogue's
crossings need is above 1e-3. Where there is none, the others of the coefficients are zero at the same level,
for they are all that is left. At 1e-8 a path within 1e-8 rad of orthogonal to t_s is refused instead of
getting an enormous s"; at 1e-10 nothing changes.
"""

CONDITION_ROUNDING = 1e-13
"""A coefficient of condition (8) that is zero but for rounding: its size over the sum of those of its terms.

Rounding leaves some 1e-16. What is below is not asked of a law, and said as zero. Ten times as much may leave
out the inertia of legs of 1e-10 of the payload's mass, which the proof of the crossing, to 1e-11, can find
missing: a refusal. A tenth changes nothing that was met.
"""

# ------------------------------------------------------------------ laws and paths

OVERSHOOT = 1e-3
"""How far, in s, a law may leave the path at its ends and come back; the path goes on there as a curve.

The paper's case C needs 1.3e-4 when its conditions are met with degree 8 (rigid robot). At 1e-2 laws that
visibly run back are taken, with a warning (`Certificate.monotone`); at 1e-4 the paper's case C is refused.
"""

STANDSTILL = 1e-9
"""Speed s' below zero, over the largest speed of the law, that is rounding of a stop and no way back.

A polynomial at rest at its ends has s' = 0 there to 5e-16 of the largest, up to smoothness 12. At 1e-8 a law
that backs with 1e-8 of its speed passes for one that advances; at 1e-10 nothing changes.
"""

AT_PATH_END = 1e-9
"""Distance, in s, at which a singular point is at an end of the path: the motion would stop on the locus.

Singular points are located to rounding, some 1e-13. At 1e-8 a path that starts 1e-8 of its length beside the
locus is refused with this reason, and else because no law comes up to speed there; at 1e-10 nothing changes.
"""

INSTANT_SLACK = 1e-9
"""How far, over the duration, an instant may lie outside a motion: t = k T / N rounds to 1e-15 of it.

The law goes on there as a polynomial with all its derivatives up to the smoothness zero: less than rounding.
At 1e-8 and 1e-10 nothing changes but which wrong instants are refused.
"""

INDEPENDENT_CONDITIONS = 1e-13
"""Least singular value of the scaled conditions on a polynomial law, below which they repeat each other.

It falls with the fifth power of the time between two crossings: 2e-13 where they are 1e-3 of the duration
apart (a rigid robot; the law then meets its conditions to 1e-14 all the same), 6e-16, which is rounding, for
3e-4. At 1e-12 the former are refused; at 1e-14 those 5e-4 apart come through, for the certificate to judge.
"""

COLLINEAR = 1e-8
"""Sine of the angle between the chords from the first of an arc's points, at which they lie on a line.

The centre is 1 / sine chords away, and the arc's points round to 1e-16 of that. At 1e-7 arcs whose bow is
2e-8 of their length are refused; at 1e-9 arcs come through that are known to 1e-7 of their length.
"""

REPEATED_POINT = 1e-9
"""Distance of two points of a spline, over its longest chord, at which they are one.

The parameter of a spline is the length of its chords; the curvature at so short a one is 1e9 over its
length. At 1e-8 and 1e-10 the same holds of splines with points that near, which are given by mistake alone.
"""

WRONG_DERIVATIVE = 1e-4
"""Difference of a user's path(s, order + 1) from the slope of path(s, order), over the largest on the path.

Rounding is below 1e-10. At 1e-3 a factor of 1.001 in x' is overlooked, and torques are wrong by as much; at
1e-5 paths that interpolate a table, with derivatives from another one, need ten times as fine a table.
"""

SAVED_MISMATCH = 1e-6
"""Difference of a number of plan.json from what the robot gives now, over its size, that is no change.

Rigid robots give the same number to rounding; deformed ones, whose deflections start from another guess, to
their certificate, 1e-10. At 1e-5 and 1e-7 only robots that were edited by so little are told otherwise.
"""

EQUAL_TORQUES = 1e-9
"""Difference of the torques of two levels of fidelity, over the peak, at which they are the same.

Torques are planned to 1e-10; levels that see a difference at all differ by 1e-7 and more (massless legs by
none). At 1e-8 nothing changes; at 1e-10 equal levels would be told apart by their rounding, and simulated.
"""

# Of kinematics and simulation: at ten times and at a tenth of each number 380 answers were compared (every
# robot of the catalogue loaded and checked, six lines tracked, twelve turns of the motors; two robots with
# springs simulated). One number changed a verdict there (`REFERENCE_MOVE`). What else is said of ten times
# and a tenth is for motions beside singularities, and follows from what the number is compared with.

# ------------------------------------------------------------------ files

INERTIA_ROUNDING = 1e-2
"""By how much a body's principal moments may miss I1 <= I2 + I3 or be negative, over the largest.

Three written figures miss them by up to 1e-2 for thin plates and rods, where equality holds. At 1e-1 bodies
pass whose moments are wrong by a tenth; at 1e-3 plates written with three figures are refused.
"""

POINT_BODY_GYRATION = 1e-6
"""Radius of gyration [m] below which a body is a point, whose inertia is not examined.

The one number of this table with a unit: a file is read before its scale is known. A point that is written
with a tiny inertia may have any; at 1e-5 and at 1e-7 only such bodies, of some micrometres, are examined or
not. Robots of that size are therefore not protected against wrong inertias.
"""

PARALLEL_AXES = 1e-9
"""Distance of the ends of two unit axes at which a gear of ratio 1 becomes a closure between their links.

Computed axes agree to some 1e-15, those written with seven digits to 1e-7. At 1e-8 and at 1e-10 only files
whose axes are rounded there change: a gear of theirs is refused, or read as a coupling, instead.
"""

SECTION_AXIS_ALONG_BEAM = 1e-6
"""Sine of the angle from the beam to the given y axis of its section: below, that axis gives no direction.

The section's turn about the beam is known to the rounding of the file, 1e-7, over this sine. At 1e-5 and at
1e-7 only directions so nearly along the beam, given by mistake alone, are refused or taken.
"""

BEAM_NEAR_MINUS_X = 0.01
"""Angle [rad] of a beam from its link's -x axis below which the section's y axis has to be given.

Turning the beam by an angle turns its section by 1 / 0.01 of it there, as the least turn from x has no axis
at -x. At 0.1 the axis is asked for more often; at 0.001 a beam written with five digits has a section that is
turned by up to 0.01 rad.
"""

# ------------------------------------------------------------------ linear algebra

FLAT_DIRECTION = 1e-9
"""A singular value of a polytope's generators or rows, over the largest: below, a direction has no width.

Rounding leaves some 1e-15, and a set of wrenches flatter than 1e-9 is of no use to anybody. At ten times and
at a tenth only sets that flat are taken for flat ones or not.
"""

ON_FACET = 1e-9
"""A point's distance from a facet over the largest offset: nearer, it lies on it, and inside.

Offsets are sums of a few products, rounded to some 1e-15. At ten times and at a tenth vertices differ only
where two lie as near to each other.
"""

VERTEX_RANK = 1e-6
"""Least singular value of unit normals that meet in a point: above, they fix it, and it is a vertex.

Facets that differ by less than 1e-6 rad are one. At 1e-5 a vertex between two such facets is left out, at
1e-7 one more is listed, beside its neighbour.
"""

# ------------------------------------------------------------------ closing the loops

REDUNDANT_ROW = 1e-9
"""A pivot or singular value of all loop equations, over the largest: below, a row repeats others.

At the references of the catalogue what repeats leaves at most 2e-16, the weakest real row 8e-3 (delta).
At 1e-8 and at 1e-10 nothing changes. Exports that are rounded to 1e-7 have redundant rows above it.
"""

HELD_IDLE = 1e-4
"""Torque that holds still what turns and moves no centre of mass, over the largest of a motor, joint side.

Such a rod or pen is held by the plan and free in truth: the motors' torques are off by that order, which the
certificate says. Files of the world have 1e-8 to 1e-5 there, from inertia a little beside a rod's line; what
really has to be held, a pendulum or a wheel, has more than 1e-2. At 1e-3 plans may be off by a thousandth; at
1e-5 and below sound robots are refused for their exporters' rounding.
"""

SINGULAR_REFERENCE = 1e-6
"""A singular value at the reference that counts as zero if it is none nearby, over the largest.

At a distance d from where branches cross, loops are closed to d^2 between them: at 1e-6 from it all are the
same to 1e-12. At 1e-5 references are refused that could be told apart; at 1e-7 one is taken on a crossing,
where what is decided is wrong everywhere else.
"""

CLOSED_LOOP = 1e-12
"""The largest loop equation of an assembled reference [lengths of the robot, rad].

Newton's method stops at 4e-13 (delta) or below 1e-15 (most) in the catalogue. At 1e-11 nothing changes, at
1e-13 the delta is refused unless its next step does better.
"""

ROUNDED_LOOP = 1e-4
"""A loop equation [lengths, rad] that stays open in an overconstrained mechanism of rounded numbers.

Exports round to 1e-7 (onshape-to-robot) or to a tenth of a millimetre; backlash is as much. Wrong lengths
leave 1e-2 and more. At 1e-3 a millimetre in a metre passes as rounding, at 1e-5 drawings in millimetres do
not.
"""

ROUNDED_ROW = 1e-3
"""A singular value of loops that do not close, over the largest: below, a row repeats others when rounded.

Rounding by ROUNDED_LOOP turns rows by as much; the weakest real row of the catalogue has 8e-3. At 1e-2 that
one is taken for rounded, if its loops do not close; at 1e-4 rows count as real whose loops are 1e-4 open.
"""

OPEN_LOOP = 1e-6
"""A loop equation [lengths, rad] of a pose that is given as assembled, or of a redundant row in a simulation.

Also the rate of a loop equation under joint rates that are given, over the largest of these [rad, lengths].
Angles and rates written with seven digits leave 1e-7. At 1e-5 poses pass that are off by what a spring
deflects; at 1e-7 poses out of a file with six digits do not.
"""

NEARLY_CLOSED = 1e-9
"""The largest loop equation [lengths, rad] at which the search for a closed pose hands on to Newton's method.

The search runs to slopes of 1e-12, so that it ends far below, or at a gap that is none of rounding.
"""

NEWTON_STEP = 1e-8
"""A step of Newton's method [rad, lengths] after which the loops are closed: it leaves about its square.

So 1e-8 leaves 1e-16. At 1e-7 loops are left open by 1e-14, which certificates show; at 1e-9 it costs a step
more, and poses so near to Type 1 that rounding makes the last step longer are refused.
"""

REFERENCE_MOVE = 0.2
"""How far [rad, lengths] a joint that the file gives may be from where the loops close.

For references drawn by eye, and short of another way to assemble the robot. At 2 another way is taken in
silence; at 0.02 the reference of the catalogue's four_bar is refused.
"""

TURNED_OVER = 1.0
"""Distance between the ends of two unit axes that a closure keeps alike.

Closed equations leave 0, or sqrt(2) and more: there is nothing between. At ten times a hinge with its axis
turned round passes; at a tenth nothing changes of loops that are closed.
"""

# ------------------------------------------------------------------ following a branch

BRANCH_CORRECTION = 0.03
"""By how much [rad, lengths] the corrector of a step may move a joint, or a quarter of the predictor.

What another branch closes to is farther off, except near to where branches meet. At 0.3 a step may land on
one; at 0.003 steps are shorter and more.
"""

BRANCH_ADVANCE = 1.0
"""By how much [rad, lengths] a predictor may move a joint.

Beside a singularity the tangent may lead round by whole turns, and what closes there is a pose on another
turn. At 10 that is taken for the same pose; at 0.1 steps are up to ten times as many.
"""

BRANCH_TURN = 5.0
"""The change of the rates over a step, over its correction.

If the offset from the tangent goes as s^k the rates change by k times the correction, 2 to 4 on one branch;
where branches cross, the corrector may land close by on one that heads elsewhere. At 50 such a step counts;
at 0.5 steps are halved until `BRANCHES_CROSS` lets them through.
"""

BRANCH_STEP = 1e-7
"""The shortest step of a way, over its length: below, the branch has ended.

It tells the last place that closes from the first that does not. At 1e-6 ways end that much before a
singularity; at 1e-8 rounding decides which steps count.
"""

BRANCHES_CROSS = 0.1
"""Least singular value of what holds a branch (P, or all loop equations): above, no branches cross near by.

Only then may a step bend by more than `BRANCH_TURN`. At 1 every sharp bend is halved until it is straight; at
0.01 a step across a crossing may count.
"""

MODES_MEET = 1e-6
"""Least singular value of P where two assembly modes meet and no step, however short, tells them apart.

In symmetric robots, each mode has the sign of det P on one side that the other has behind. At 1e-5 ways end
that pass beside such a place; at 1e-7 one through it is led on, on a side that rounding chooses.
"""

ENDS_AT_TYPE_2 = 0.05
"""Least singular value of P over the usual one: where a way of the motors ends below, it does so at Type 2.

Decides between two words for a refusal, `Type2Singularity` and `NotAssembled`. At 0.5 a way that ends for
another reason is called singular; at 0.005 one that ends a step before the singularity is not.
"""

DETERMINANT_LOST = 1e-6
"""What a step leaves of a determinant if it ends on its zero: half the digits are lost there.

A sign counts above it only. At 1e-5 poses beside a singularity belong to no mode; at 1e-7 signs of what may
be rounding are believed.
"""

RANK_LOST = 1e-7
"""A singular value without dimension (P, the loop equations, a twist of the platform) that counts as zero.

A root of g to 1e-12 leaves as much, and 1e-6 where two singular values vanish as a square. The least of P at
the references of the catalogue is 2e-2 (delta). At 1e-6 regular poses so near to a singularity count as on
it; at 1e-8 double singularities are taken for single ones.
"""

RANK_LOST_AHEAD = 1e-4
"""Singular values of the loop equations where no step is left: below, their loss of rank ends the way.

A way ends within `BRANCH_STEP` of where they vanish. Decides between two words for a refusal: this, Type 1.
"""

TURNING_POINT_BEND, TURNING_POINT_SKEW = 0.1, 0.25
"""How far a branch may be from a parabola up to the turning point that is found ahead.

The chord is the mean of both tangents to the first part of its length, and the parameter gains half its first
slope times the way, to the second part of that gain. At ten times a turning point of another branch is taken
for the end of this one; at a tenth none is found but from steps away, and ways end by halving.
"""

CONTINUATION_ERROR = 1e-11
"""Tail of a continuation through a singularity of the loops, and its gap to closed poses [rad, lengths].

The series of a smooth branch falls to rounding, that of a kink with a power of its degree. At 1e-10 torques
computed on it have a digit less; at 1e-12 some smooth branches are refused.
"""

CONTINUATION_STEP = 0.3
"""A Newton step to the branch over the least singular value there: longer ones may land on another branch.

By the theorem of Newton and Kantorovich up to a half is safe for bends of unit size. At 3 a continuation may
go through poses of two branches, and does not resolve; at 0.03 too few nodes may be left.
"""

# ------------------------------------------------------------------ limits and freedoms

ON_JOINT_LIMIT = 1e-9
"""How far [rad, m] beyond a limit a position is still on it: the rounding of a way that ends there."""

AXIS_AT_REST = 1e-6
"""Rate of a platform axis over that of the motion [lengths a radian]: slower, and the axis does not move.

Files with seven digits leave 1e-7 where nothing moves.
"""

CENTRE_AT_REST = 1e-4
"""The same for centres of mass: slower, and a motion is idle.

A tenth of a millimetre off the axis in a robot of one metre, as exporters leave it. At 1e-3 rods that carry a
small tool are called idle; at 1e-5 rods of such files are called loose.
"""

NEARLY_AT_REST = 0.01
"""The same for what `convert` proposes, of centres of mass, motors and a point of the platform.

A rod whose centre of mass lies off its line by a hundredth of the robot's length still needs no motor; the
plan measures what holding it costs, and refuses above HELD_IDLE, so that no wrong torque comes of it. At 0.1
freedoms of digit_like are taken for idle, at 1e-3 the rod of talos_like for a freedom without a motor, and
either is refused; eleven other files are proposed alike.
"""

PLANAR_AXES = 1e-6
"""Angle [rad] between the axes of a planar robot: above, it is a robot in space.

Axes written with seven digits are 1e-7 apart.
"""

# ------------------------------------------------------------------ singular points on a path

# From here to the simulation, what is said of ten times and of a tenth is derived from what the number is
# compared with, not tried.

MEASURE_TAIL = 1e-9
"""Tail of the series of g on a panel of the path, over its largest coefficient: below, it is resolved.

Roots and extrema are polished on the robot afterwards and need no more. At 1e-8 a shallower minimum may be
missed; at 1e-10 more panels are halved.
"""

MEASURE_TAIL_ROUNDING = 1e-13
"""The same tail, without dimension, where g itself is small all along a panel: it ends in rounding.

Terms of size 1 round to 1e-16, and a series sums dozens. At 1e-12 a g of size 1e-4 counts as resolved to 1e-8
of itself; at 1e-14 rounding may keep such a panel from being resolved.
"""

MIN_PANEL_WIDTH = 2e-4
"""Width, in s, of a panel that is halved no further: where g does not resolve on it, it is refused.

There the branch breaks down, or several motions escape. At ten times crossings are refused that are told
apart between 2e-4 and 2e-3; at a tenth a refusal takes three halvings more.
"""

MEASURE_ROUNDING = 1e-15
"""The least |g|, without dimension, that may be rounding: a quotient of sums of a dozen terms of size 1.

Two roots at a distance d leave d^2 / 8 between them where g" is 1. At 1e-14 roots 3e-7 apart look like a
touch, instead of 1e-7; at 1e-16 rounding decides whether a touch is a miss or two crossings.
"""

ROOT_RESIDUAL = 1e-12
"""What is left of |g|, over its largest on the path, where Newton's method counts though it did not converge.

It converges by the length of its step (`ROOT_STEP`) at every root with a slope. At 1e-11 and at 1e-13 only
flat roots may differ.
"""

ROOT_STEP = 1e-8
"""A step of Newton's method for a root of g, over the interval of its parameter, that is the last one.

The slope is known to the square of the stencil (`root_of_g.STENCIL`), 1e-8, which leaves 1e-16. At 1e-7 it is
1e-15; at 1e-9 it costs a step, and flat roots may not reach it for rounding.
"""

DISTINCT_ROOTS = 1e-10
"""Distance in s at which two simple roots of g are one: each is polished to rounding.

Roots that near together look like a touch before (`MEASURE_ROUNDING`), so that at 1e-9 and at 1e-11 nothing
changes.
"""

DISTINCT_EXTREMA = 1e-6
"""Distance in s at which two extrema of g are one.

The place of an extremum is known to the root of the rounding of g, some 1e-8. At 1e-5 crossings whose extrema
are nearer together are taken for one; at 1e-7 a touch may be listed twice where g is flat.
"""

MULTIPLE_ROOT_RADIUS = 1e-4
"""Distance in s from a place where several singular values vanish at which simple roots belong to it.

There the roots of det G are split by the square root of its rounding, or more. At ten times a crossing that
follows within 1e-3 is left out; at a tenth one place may be listed twice.
"""

VANISH_TOGETHER = 1e-3
"""Singular values, without dimension, that may vanish together: the block G is as wide as there are below.

A wider G costs time alone. Where g does not resolve it decides between two words, `UncontrolledMotions` and
`NotConverged`; at ten times and at a tenth more and fewer of them are the former.
"""

TANGENTIAL_SLOPE = 1e-5
"""Slope of a block G that vanishes: below, a path touches the locus and does not cross it.

Per unit motion [rad, lengths] of a pose, over the second derivative on a path. Rounding of the differences
leaves 1e-8. At 1e-4 slow crossings are called touches; at 1e-6 the method that places several at once, which
halves its distance where they touch, may call them crossings.
"""

HALVING_STEP = 1e-9
"""Last step, in s, of the search for a place where several singular values vanish: longer, they touch.

Gauss and Newton's method squares its distance where there is a slope, and halves it where there is none:
after eight steps it is below 1e-11, or some 1e-2 of the first. At ten times and at a tenth nothing changes.
"""

NEAR_MISS = 1e-2
"""Smallest singular value of P at a minimum, over the largest on the path: below, the path just misses.

It is reported, and what torques do there is looked at. At ten times paths are reported that have a tenth of
their clearance left; at a tenth only those with a thousandth.
"""

NEAR_SINGULAR_RATIO, SINGULAR_RATIO = 0.3, 0.01
"""Smallest singular values, over those at the reference, of a pose near a singularity, and on one.

Words for whoever leads it: no motion ends by them. At ten times all poses are near one; at a tenth they are
called regular until 3 % of the hold is left, and singular at a thousandth.
"""


# ------------------------------------------------------------------ forces at one instant

CONDITION_RESIDUAL = 1e-11
"""|t_s . W_p| over the sum of the sizes of its terms: below, condition (8) holds at an instant.

The same as for a plan. At 1e-10 a pole passes that is 1e-10 of the forces over the distance from the locus;
at 1e-12 poses that are closed no better than that are refused.
"""

TORQUE_TAIL = 1e-10
"""Tail of the torques' series across a singularity, over its largest coefficient: below, they are resolved.

The same as for a plan: a crossing falls to 1e-12, a pole stalls (a point 72 um off leaves 2e-3). At 1e-9
torques have a digit less; at 1e-11 limits that stall in rounding between the two are refused.
"""

CROSSING_OFFSET = 0.01
"""Distance of the root of g from the instant of a singular pose, over half a panel: farther, it is another.

A pose singular to `RANK_LOST` is some 1e-6 of a panel off. At 0.1 the root lies beyond the nodes next to the
middle, and the limit is taken at another pose; at 0.001 nothing changes but beside slow crossings.
"""

INDETERMINATE_FORCE = 1e-9
"""How far a unit of what may be added to the loop forces moves one of them: above, it is indeterminate.

Null vectors are orthonormal, in robot lengths and radians. At the references of the catalogue rounding leaves
3e-16, a kilometre from the base's origin 9e-13, and what is open is moved by 4e-2 at least. At 1e-8 and 1e-10
nothing changes there.
"""

LINE_PITCH = 1e-6
"""What a line leaves of a wrench's moment, over the moment or the robot's length: above, it is a screw.

Rounding leaves far less. At 1e-5 and at 1e-7 only screws differ whose pitch is so small a part of the robot.
"""

TORN_LOOP = 1e-9
"""A dropped loop equation [rad, lengths] on a node of a motion: more open, the motion tears the loop.

The independent ones are closed to rounding, and one that repeats them by a factor follows. At 1e-8 loops pass
that open by as much; at 1e-10 nothing changes of numbers that are exact.
"""


# ------------------------------------------------------------------ stiffness and loads

EQUILIBRIUM_STEP = 1e-9
"""A step of Newton's method for an equilibrium, and an open loop there [rad, lengths]: below, it is reached.

What is left is the square of the step, rounding. So it is at 1e-8 for the steps, but loops may be that open;
at 1e-10 soft robots, whose steps round more, may not reach it.
"""

RIGID_MOTION = 1e-9
"""Singular value of the platform's motions on its springs, over the largest: below, it is rigid along one.

A stiffness matrix is refused there. Rounding leaves 1e-15. At 1e-8 and at 1e-10 only robots differ whose
platform moves a hundred million times less along one axis than along another.
"""

MASSLESS_VIBRATION = 1e-9
"""Mass of a motion on the springs, over the largest: below, it follows the others and has no mode.

Above `MASSLESS_MOTION`: the squares of the frequencies of lighter ones would push those of the others below
`STIFFNESS_ROUNDING` of the largest. At 1e-8 parts of so small a share have no mode; at 1e-10 slow modes may
be said as zero.
"""

STIFFNESS_ROUNDING = 1e-13
"""An eigenvalue of a stiffness, or the square of a frequency, over the largest: below, it is zero.

Rounding leaves 1e-15. At 1e-12 a frequency of a millionth of the highest is zero; at 1e-14 it must be three
times smaller for that, and rounding of large robots may pass for stiffness.
"""

LOAD_STEP = 2.0**-20
"""The smallest share of the load that is added at once: what does not bear it has lost its stiffness.

At ten times folds are placed to 1e-5 of the load; at a tenth each costs three tries more, to 1e-7.
"""

CORRECTION_RATIO, CORRECTION_ROUNDING = 0.1, 1e-7
"""Newton's steps after the first, over that one, or [rad, lengths]: more may lead to another equilibrium.

A motion of 1e-7 has no room for a fold. At ten times a load may snap through unseen; at a tenth its steps are
shorter and more.
"""

# ------------------------------------------------------------------ simulation

MASSLESS_MOTION = 1e-11
"""Inertia of a motion that the loops allow, over the largest one: below, it moves no mass.

Rounding leaves some 1e-15. At 1e-10 motions of parts of a 1e-10th of the heaviest are balanced instead of
integrated; at 1e-12 alike down to there.
"""

MASSLESS_JOINT = 1e-9
"""The same for joints of the tree where pinocchio's contact dynamics divides by the mass matrix."""

MASSLESS_SHARE = 1e-9
"""Share of a joint in a unit motion without mass: above, its acceleration is undetermined."""

UNSPRUNG_MOTION = 1e-12
"""Stiffness of a motion without mass, over the largest one: below, nothing holds it, and it is refused."""

CONSISTENT_START = 1e-10
"""Open loops and springs out of balance [lengths, rad] at the start of a simulation, after Newton's method.

It ends at rounding, or does not converge.
"""

SPRINGS_BALANCED = 1e-8
"""How far [rad, lengths] springs without mass are from balance in a state that is given: more is refused.

At 1e-7 accelerations pass that a robot so far out of balance would not have; at 1e-9 states that a simulation
has left there are refused.
"""

SIMULATION_STEP = 1e-9
"""The shortest step of a simulation over its duration: where it takes shorter ones, it is given up."""

BRIDGING_LENIENCY = 1e3
"""Times its tolerance that a step over a singularity of the loops may leave unresolved.

No shorter step does better there, for rounding; `Simulation.unresolved` reports what is left. At 1e4 worse
ones pass, reported; at 1e2 simulations through constraint singularities stop there.
"""

FIXED_STEP_ERROR = 0.05
"""What fixed steps may leave out of a motion [rad, lengths], all together: more is another motion.

`Simulation.unresolved` reports it. At ten times motions pass that are half a radian off.
"""

STARTS_AT_REST = 1e-9
"""Velocity of a plan at its start over that in its middle: below, it starts at rest."""


MOTION_OFF_PATH = 1e-3
"""Distance of a simulated platform from its path [robot lengths, rad]: above, `crossing simulate` says no.

Certified torques bring the robots of the tests back to 1e-5 and better. At 1e-2 torques pass that leave the
path by a hundredth of the robot; at 1e-4 none of those is refused, but long motions may be, in which what is
off grows.
"""

# ------------------------------------------------------------------ the locus

CURVE_OFFSET = 0.05
"""Distance of a known point from the chord of a traced curve, over the chord, at which the curve passes it.

Chords leave the curve by 0.02 of their length (`MAX_TANGENT_TURN` a step); another curve is nearer only
beside a branch point. At 0.5 a branch of the 3-RPR's hyperbola is lost; at 0.005 curves of the 5R are traced
repeatedly.
"""

CURVE_COSINE = 0.7
"""Cosine between tangents at which a known point belongs to the curve that passes it.

The tangent turns by 0.15 rad a step, a cosine of 0.99; curves cross at larger angles as a rule. Above 1 no
curve would end; at 0.07 a curve may be taken for the one that it crosses at a right angle.
"""

RESTING_EXTENT = 1e-7
"""Extent of motors or platform along a curve of the locus [rad, lengths] that is rounding: they rest.

Points are solved to 1e-12; curves that are followed at all have steps of 1e-3. At 1e-6 and 1e-8 nothing
changes.
"""

MODE_EDGE = 1e-9
"""Determinant of a leg, of the sign of another working mode, that is zero.

Curves along a Type 1 singularity have determinants of rounding, 1e-14, and belong to both modes. At 1e-8 and
1e-10 nothing changes: curves that leave the mode do so by 1e-3 in a step.
"""

ON_LOCUS = 1e-8
"""Measure g, without dimension, at the foot point of a margin that is a singular pose.

Newton's method ends there with a step of 1e-9, which leaves 1e-9 of g at most. At 1e-7 and 1e-9 no
margin of the tests changes.
"""

# ------------------------------------------------------------------ proofs

FRAME_ROUNDING = 1e-13
"""Rounding of positions and directions at one configuration, in lengths of all links, that proofs allow for.

A bound: pinocchio multiplies one matrix a joint, some 1e-15 of the links' lengths. At 1e-12 the
proofs of the tests still succeed; at 1e-14 they would trust less than a robot of many joints rounds to.
"""

LEG_COEFFICIENT_ROUNDING = 1e-14
"""Uncertainty of leg conditions, over the largest coefficient of each: solutions are proved for all of it.

A bound: three times what their null spaces were measured to be off is 2e-15, times the ratio of the singular
values. At 1e-13 Dietmaier's 40 poses are still proved; at 1e-15 it is no bound.
"""

CLOSED_POSE_OFFSET = 1e-9
"""Distance of a configuration that Newton's method has closed from the exact one [rad, robot lengths].

Also what is left of its equations. Newton's method stops at rounding, 1e-12 where a pose is nearly singular;
configurations of other solutions leave 1e-3 and more. At 1e-8 and 1e-10 nothing changes.
"""

DISTINCT_SOLUTIONS = 1e-6
"""Distance at which two solutions are one [rad, robot lengths; of 1 for points of projective space].

A solution with an imaginary part of this size is its own conjugate, that is real, if the proof agrees. Equal
ones agree to 1e-10; poses 1e-6 apart are nearly singular. At 1e-5 and 1e-7 nothing changes but for them.
"""

LEG_CONDITION_RANK = 1e-10
"""Singular value, over the largest, at which conditions of legs depend on one another.

They are known to 1e-14, and other legs leave 1e-3. At 1e-9 and 1e-11 nothing changes; robots whose geometry
is within 1e-10 of an architecturally singular one are called so.
"""

ENDGAME_MIN_EXPONENT = 0.1
"""Exponent w of a path's size s^-w towards its end: above it the path grows, below it is finite.

Exponents are fractions: 1 or 1/2 as a rule, a tenth for ten paths that meet at infinity. Ten times larger,
paths with w = 1/2 are called finite and octahedral platforms miscounted; at a tenth nothing changes.
"""

ENDGAME_EXPONENT_SPREAD = 0.1
"""Relative difference of a path's exponents over successive segments at which they agree.

They settle as the path nears its end, to 1e-3 in the last segments. Ten times larger and at a tenth no count
of the tests changes: a path that is large and whose exponent is above the least one goes to infinity.
"""

ENDGAME_SIZE = 1e3
"""Size of a displacement [robot lengths] from which on a path may be on its way to infinity.

No leg is that long. At ten times and at a tenth of it nothing changes.
"""
