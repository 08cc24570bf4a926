"""The numbers that decide a verdict, in one table: accept or refuse, singular or not, resolved or not.

Each says what it compares, why it has that value (a bound on rounding, or a measured gap between right and
wrong), and what happens at ten times and at a tenth of it. All are relative: what they are compared with is
without dimension, by the scales of the robot and of the request. Settings that only cost time stay beside
their algorithm. An audit planned 75 scenes with each number at ten times and at a tenth, and held plans
against equations of motion that know none of them. No answer was wrong (tests/benchmarks/README.md). What an
entry calls measured was so there; the rest is derived from what the number is compared with.

The scales are three numbers, and every other one follows: the robot's `length` [m] and `mass` [kg], and the
duration [s] of a motion where there is one (mass length / duration^2 is a force, times length a torque).
Models are not copied into other units: pinocchio computes as well in micrometres as in metres, and results
stay in the units of their files. What has a unit is divided by its scale where it is compared with a number.
`tests/stability/test_scale_invariance.py` holds that nothing else knows a unit.
"""

from __future__ import annotations

# ------------------------------------------------------------------ rounding

RANK_ROUNDING = 1e-9
"""A singular value over the largest, or an entry of a null vector over its length, that is zero.

Rounding leaves 1e-16 to 1e-12, the latter a kilometre from the base's origin; the weakest real loop equation
of the catalogue has 8e-3. At 1e-8 and 1e-10 nothing changes but parts 1e-9 of the others in mass or hold.
"""

EIGENVALUE_ROUNDING = 1e-12
"""An eigenvalue of a stiffness or inertia, or a squared frequency, over the largest, that is zero.

Rounding leaves 1e-15. At 1e-11 parts of 1e-11 of the mass count as massless, and frequencies of 3e-6 of the
highest as zero; at 1e-13 rounding of large robots comes near.
"""

ALIKE_CHOICES = 1e-3
"""Relative difference of the least singular values of two choices of motors that are alike.

Mirrored choices of a symmetric robot differ by what its file rounds, 1e-6; at 1e-2 choices are called alike
that a person tells apart by their lever arms.
"""

FILE_ROUNDING = 1e-6
"""A number of a file against the one it stands for: axes that are parallel, loops that are closed, at rest.

Lengths are over the robot's, rates over the motion's. Seven digits leave 1e-7. At 1e-5 poses pass that are
off by what a spring deflects; at 1e-7 files with six digits are refused, or their axes told apart.
"""

LOOP_RATE = 1e-5
"""The rate at which loops may open [1/s], over the largest speed of a joint or 1/s if this is more.

Simulated rates leave 1e-7, with method `fast` 2e-6, and of a robot at rest there is no speed to compare with.
At 1e-6 simulated rows are refused; at 1e-4 rates pass that were typed with four digits.
"""

EXPORT_ROUNDING = 1e-4
"""The same of exported drawings: loops that stay open [robot lengths].

A tenth of a millimetre in a metre; wrong lengths leave 1e-2. At 1e-3 a millimetre passes as rounding; at 1e-5
drawings in millimetres are refused.
"""

SAME_PLACE = 1e-9
"""Distance of two places (instants over the duration, s, positions, offsets over the largest) that are one.

Each is known to rounding, 1e-15 to 1e-13. At 1e-8 a path that starts as near to the locus is refused with
this reason, and else because no law comes up to speed there; at 1e-10 nothing changes.
"""

AT_REST = 1e-9
"""A speed over the largest of the motion that is a rest.

A polynomial leaves 5e-16 at its ends, up to smoothness 12. At 1e-8 a law that backs by as much passes for one
that advances; at 1e-10 nothing changes.
"""

NEWTON_STEP = 1e-8
"""The last step of Newton's method, its unknowns of unit size: it leaves about its square, which is rounding.

At 1e-7 loops are left open by 1e-14, which certificates show; at 1e-9 it costs a step more, and poses so near
to Type 1 that rounding makes the last step longer are refused.
"""

CLOSED_LOOP = 1e-12
"""The largest loop equation of an assembled reference [robot lengths, rad].

Newton's method stops at 4e-13 (delta) or below 1e-15 (most) in the catalogue. At 1e-13 the delta is refused
unless its next step does better; at 1e-11 nothing changes.
"""

LOOP_GAP = 1e-9
"""A loop equation [robot lengths, rad] that counts as closed where it was not solved for, or not last.

So between the nodes of a motion, where a dropped row follows the others, and where a search hands on. Poses
of other branches leave 1e-3. At 1e-8 loops pass that open by as much; at 1e-10 nothing changes.
"""

# ------------------------------------------------------------------ files

INERTIA_ROUNDING = 1e-2
"""By how much a body's principal moments may miss I1 <= I2 + I3 or be negative, over the largest.

Three written figures miss them by up to 1e-2 for thin plates and rods. At 1e-1 bodies pass whose moments are
wrong by a tenth; at 1e-3 plates written with three figures are refused.
"""

POINT_BODY_GYRATION = 1e-6
"""Radius of gyration over the longest distance of two joints, below which a body of a URDF is a point.

Exporters leave rounding for its inertia (1e-9 m and less), which no body has. At 1e-5 and 1e-7 only bodies
that small are examined or not.
"""

BEAM_NEAR_MINUS_X = 0.01
"""Angle [rad] of a beam from its link's -x axis below which the section's y axis has to be given.

The least turn from x has no axis there: 1 / 0.01 of an error of the beam turns its section. At 0.1 the axis
is asked for more often; at 0.001 five digits leave a section turned by 0.01 rad.
"""

NEARLY_AT_REST = 0.01
"""Rate [robot lengths a radian] of centres of mass: slower, and a freedom is idle, or proposed as such.

A plan measures what holding it costs (`HELD_IDLE`), so that no wrong torque comes of it. At 0.1 freedoms of
digit_like are taken for idle, at 1e-3 the rods of talos_like and of Digit's toes for freedoms without motors.
"""

HELD_IDLE = NEARLY_AT_REST
"""Torque that holds what turns and moves hardly a centre of mass, over the largest of a motor, joint side.

Centres slower than NEARLY_AT_REST load an idle freedom by at most that share of their weights times the
robot's length, which is the size of motor torques; more shows a faster centre or a large inertia. Motor
torques are off by that order, and plans say by how much. At 1e-1 plans hold pendulums; at 1e-4 bent rods,
which load their own line by up to 8e-3, stop plans.
"""

REFERENCE_MOVE = 0.2
"""How far [rad, robot lengths] a joint that the file gives may be from where the loops close.

References are drawn by eye. At 2 another way to assemble the robot is taken in silence; measured: at 0.02 the
catalogue's four_bar is refused.
"""

# ------------------------------------------------------------------ following a branch

TYPE_1_END = 1e-5
"""Least singular value of the inverse kinematics at the last pose of a ray: below, the ray ends at Type 1.

A ray that ends there is followed to 1e-9 to 4e-7 (nine poses of six robots); one that ends for another reason
had 7e-3. At 1e-3 such an end may be called Type 1; at 1e-8 most Type 1 ends are not named.
"""

RANK_LOST = 1e-7
"""A singular value without dimension (P, the loops, a twist), or g, that counts as zero at a singular pose.

A root of g to 1e-12 leaves as much; the least at the references of the catalogue is 2e-2. At 1e-6 regular
poses that near count as singular; at 1e-8 double singularities are taken for single ones.
"""

NEAR_SINGULAR_RATIO = 0.3
"""Least singular value over that of the reference, below which a robot moved by hand is near singular.

On the 5R at x = 0 that is from 35 mm beside the locus on: far enough to be seen before the motors lose it.
"""

SINGULAR_RATIO = 0.01
"""Least singular value over that of the reference, up to which a robot moved by hand is singular.

On the 5R at x = 0 that is from 1.2 mm beside the locus on, which a hand can set; RANK_LOST it cannot.
"""

BRANCHES_MEET = 1e-6
"""The least singular value of a pose at which branches are not told apart: none is decided there.

A distance d from a crossing, loops are closed to d^2 between branches: at 1e-6 to rounding. At 1e-5 ways end
and references are refused beside such places; at 1e-7 a side is chosen by rounding.
"""

BRANCHES_CROSS = 0.1
"""Least singular value of what holds a branch above which none cross near by: steps may bend sharply there.

At 1 every sharp bend is halved until it is straight; at 0.01 a step across a crossing may count.
"""

BRANCH_STEP_SHARE = 0.25
"""Correction, and turn of the tangent, of a long step over the step itself, that are small.

On one branch both are of its square. At 2.5 a step to another branch may count; at 0.025 long steps are cut.
"""

BRANCH_CORRECTION = 0.03
"""By how much [rad, robot lengths] the corrector of a step may move a joint, however short the step is.

What another branch closes to is farther off, except near to where branches meet. At 0.3 a step may land on
one; at 0.003 steps are shorter and more.
"""

BRANCH_TURN = 5.0
"""The change of the rates over a step, over its correction: s^k off the tangent has k, 2 to 4 on one branch.

At 50 a step to a branch that heads elsewhere counts; at 0.5 steps are halved until `BRANCHES_CROSS` decides.
"""

DETERMINANT_LOST = 1e-6
"""What a step leaves of a determinant if it ends on its zero: half the digits are lost there.

A sign counts above it only. At 1e-5 poses beside a singularity belong to no mode; at 1e-7 signs of what may
be rounding are believed.
"""

CONTINUATION_ERROR = 1e-11
"""Tail of a continuation through a singularity of the loops, and its gap to closed poses [rad, lengths].

A smooth branch falls to rounding, a kink with a power of the degree. At 1e-10 torques on it have a digit
less; at 1e-12 some smooth branches are refused.
"""

SHEET_TAIL = 1e-10
"""Truncation error [rad, robot lengths] of the offsets on a panel of a path, below which it is resolved.

From its series one Newton step closes a pose to rounding (1e-20 is left). At 1e-9 a torque needs a second
stack of poses; at 1e-11 panels are halved near Type 1, where poses themselves are known to 1e-12.
"""

CONTINUATION_STEP = 0.3
"""A Newton step to the branch over the least singular value there: longer ones may land on another branch.

Up to a half is safe for bends of unit size (Newton and Kantorovich). At 3 poses of two branches are mixed and
do not resolve; at 0.03 too few nodes may be left.
"""

REACHED_PLATFORM = 1e-9
"""Distance [robot lengths, rad] from a pose that was sought, or room of a joint's range, that is none.

Ends of searches are closed to 1e-12. At 1e-8 a pose counts that control can tell from its target; at 1e-10
some that are reached are called out of reach.
"""

LEAST_TYPE1_SHARE = 1e-5
"""The determinant of Type 1 over that at the reference, down to which a leg is stretched for a nearest pose.

One stretched leg is then 1e-10 of its length from the end of its reach. Of several that are stretched at
once each ends earlier: the distance found was up to 4e-5 m larger (orthoglide, 4.8 m away). At 1e-4
distances are off by 1e-8; at 1e-6 the leg's direction has no digits left to come back by.
"""

LEAST_TYPE2_SHARE = 1e-3
"""The determinant of Type 2 over that at the reference, down to which motors that hold go for a nearest pose.

The distance grows with it, to first order in proportion. At 1e-2 the pose is visibly not the nearest one; at
1e-4 motors that turn back by a step may be on either assembly mode.
"""

# ------------------------------------------------------------------ singular points on a path

MEASURE_TAIL = 1e-9
"""Tail of the series of g on a panel of the path, over its largest coefficient: below, it is resolved.

Roots and extrema are polished on the robot afterwards. At 1e-8 a shallower minimum may be missed; measured:
at 1e-10 an arc that is straight to 6e-8 is refused before its torques are asked for.
"""

MEASURE_ROUNDING = 1e-15
"""The least |g|, without dimension, that may be rounding: a quotient of sums of a dozen terms of size 1.

Two roots at a distance d leave d^2 / 8 between them where g" is 1. At 1e-14 roots 3e-7 apart look like a
touch, instead of 1e-7; at 1e-16 rounding decides whether a touch is a miss or two crossings.
"""

MIN_PANEL_WIDTH = 2e-4
"""Width, in s, of a panel that is halved no further: where g does not resolve on it, it is refused.

At 2e-3 crossings that near are refused that could be told apart; at 2e-5 a refusal takes three halvings more.
"""

DISTINCT_EXTREMA = 1e-6
"""Distance in s at which two extrema of g are one: their place is known to the root of the rounding of g.

At 1e-5 crossings that near are taken for one touch; at 1e-7 a touch may be listed twice where g is flat.
"""

MULTIPLE_ROOT_RADIUS = 1e-4
"""Distance in s from a place where several singular values vanish at which simple roots belong to it.

Rounding splits the roots of det G there by its square root or more. At 1e-3 a crossing that near is left out;
at 1e-5 one place may be listed twice.
"""

TANGENTIAL_SLOPE = 1e-5
"""Slope of a block G that vanishes, over the curvature or per unit motion: below, a path touches the locus.

Rounding of the differences leaves 1e-8. At 1e-4 slow crossings are called touches; at 1e-6 touches where
several vanish may be called crossings.
"""

NEAR_MISS = 1e-2
"""Smallest singular value of P at a minimum, over the largest on the path: below, it is a near miss.

It is reported, and torques are looked at there. At 0.1 paths with a tenth of their clearance are reported; at
1e-3 only those with a thousandth.
"""

NEAR_MISS_WIDTHS = 3.0
"""Distance of a plan's largest torque from a near miss, in widths of that, at which it is the peak there.

What a motor needs beside a near miss is largest within one width, and has fallen to 0.6 of that at three. At
30 most plans of such a path are made by the optimal law too; at 0.3 peaks beside a near miss stay.
"""

# ------------------------------------------------------------------ condition (8) and laws

NO_HOLD = 1e-9
"""Whether s" has an effect on t_s . W_p: |alpha| of condition (8) over the sum of the sizes of its terms.

Rounding leaves up to 1e-12, crossings need more than 1e-3. At 1e-8 a path that near to orthogonal to t_s is
refused instead of getting an enormous s"; at 1e-10 nothing changes.
"""

CONDITION_ROUNDING = 1e-13
"""A coefficient of condition (8) that is zero but for rounding, 1e-16: its size over the sum of its terms.

It is not asked of a law. At 1e-12 the inertia of legs of 1e-10 of the payload may be left out, which the
proof, to `CONDITION_RESIDUAL`, finds missing: a refusal; at 1e-14 nothing changes.
"""

INDEPENDENT_CONDITIONS = 1e-13
"""Least singular value of the scaled conditions on a law, below which they repeat each other.

It falls with the fifth power of the time between two crossings: 2e-13 where they are 1e-3 of the duration
apart, rounding at 3e-4. Measured: at 1e-12 the former are refused for this reason instead of having no law
that advances; at 1e-14 nothing changes.
"""

OVERSHOOT = 1e-3
"""How far, in s, a law may leave the path at its ends and come back; the path goes on there as a curve.

The paper's case C needs 1.3e-4. At 1e-2 laws that visibly run back are taken, with a warning; measured: at
1e-4 case C is refused, of five_bar_heavy too.
"""

SEAM_JUMP = 1e-8
"""Difference of two motions that meet, of positions, speeds or torques over the largest, that is no jump.

Torques of both are known to their tails, 1e-11 or less as a rule, but beside a crossing, where they lose
digits. At 1e-9 plans that are left 2 % of their duration before a crossing do not meet; at 1e-7 a force that
jumps by as much would go unseen.
"""

SEAM_JUMP_GROWTH = 100.0
"""Factor of SEAM_JUMP for each time derivative that is compared.

The derivative of a Chebyshev series with n coefficients loses up to n^2 in accuracy, at the ends of a panel;
on panels of some twenty coefficients two digits are lost in practice.
"""

PATH_JUMP = 1e-6
"""Jump of x' or x'' of a user's path, over the largest value, that is no rounding.

It makes the torque jump by about this share, while the tail of its series has to fall below 1e-10. A formula
of differences rounds to 1e-8; one of ten digits in a table, to 1e-10.
"""

DEGENERATE_PATH = 1e-8
"""Sine between the chords of an arc's points, or distance of a spline's points over its longest chord.

Below, they are on a line, or one. The centre of an arc rounds to 1e-16 over the sine. Measured: arcs of 6e-8,
refused by this at 1e-7, and of 6e-9, which pass at 1e-9, do not resolve.
"""

SMALLEST_BLEND = 1e-4
"""Distance from a corner at which a blend begins, over half the shortest segment of the polyline.

Below, it is refused. Torques grow with one over it. Measured on the 5R, with segments half as long as its
rods: tails of 4e-15 at 1e-2 and 1e-12 at 1e-4, where torques are 431 N m. A tenth asks for ten times that;
at 1e-3 blends of 0.05 mm on segments of 0.1 m are refused.
"""

WRONG_DERIVATIVE = 1e-4
"""Difference of a given derivative of a path or law from that of its values, over the largest.

Differentiating twice loses up to ten digits. At 1e-3 a factor of 1.001 in x' is overlooked, and torques are
wrong by as much; at 1e-5 paths that interpolate tables need finer ones.
"""

STOP_AT_CROSSING = 1e-7
"""Speed at a crossing over the largest of the law: below, the motion stops on the locus, which is refused.

A stop at a place known to 1e-13 leaves the square root of that. At 1e-6 and 1e-8 refusals have another name.
"""

MIN_POLYNOMIAL_ADVANCE = 0.1
"""Least speed of a polynomial law over its mean, ends divided out: below, the optimal law is planned with.

Polynomials of the catalogue's scenes have 0.16 to 0.52. At 1 every crossing is planned with the optimal law;
at 0.01 laws that nearly stop are kept, with the peaks that starting again costs.
"""

LIMIT_MARGIN = 5e-4
"""Share of a limit that an optimal law leaves free at its rows, for what torques reach between them.

Where limits bind along the path a quickest law costs a fourth of it. At 1e-4 the certificate finds a limit
exceeded, and the law is sought once more, in every second case; measured on upright five-bars.
"""

BOUND_MARGIN = 1e-4
"""Share by which the bound of all laws' peaks must exceed the limits for a refusal to be called proved.

Its series count with errors of 1e-9 to 1e-4 of it, which take the decay of their coefficients for granted.
At 1e-3 refusals that near to the limits are not called proved; at 1e-5 less is left for a slower decay.
"""

SMOOTHNESS_COST = 4e-3
"""Share of the least cost found that an optimal law may cost more, to be smooth.

At 5e-3 the quickest law of the flat 5R misses 0.738 s, where 0.7345 s is the least found; at 5e-4 the root
mean square of s"' is 1.1 to 2.5 times as large on four random robots, and at 2e-5 some have no law.
"""

SQUARED_SPEED_FLOORS = (1e-2, 1e-4, 1e-6, 1e-8)
"""Least squared speeds of an optimal law over the mean speed squared, tried in turn: it is to creep nowhere.

With the first alone crossings that ask for a slow passage are refused, of 42 upright five-bars 6; below the
last one rounding of the squared speed is felt in the duration.
"""

SLOWNESS_ROUNDING = 1e-8
"""Share of the duration that rounding of an optimal law's squared speed may leave open.

Torques resolve to 1e-9 of it. At 1e-7 laws pass whose torques do not; at 1e-9 some that all but stop are
refused at once.
"""

DRIVE_SLACK = 5e-4
"""Share of a torque-speed curve or RMS limit that the linearisation of an optimal law may leave free.

It is half of the 1e-3 to which limits are reached where they bind.
"""

DAMPING_TORQUE_ERROR = 1e-4
"""Torque that viscous damping linearised about the previous law is off, over the peak of the law.

Limits leave 1e-3 free. At 1e-5 laws that almost stand still somewhere take twice the passes; at 1e-3 limits
are exceeded, and found so by the certificate.
"""

PEAK_TORQUE_MISMATCH = 2e-3
"""Difference of the peak that an optimal program has from that of its resolved motion, over the former.

At 2e-2 an elastic robot's law settles before its deflections do, and costs up to that more; measured: at 2e-4
that of a biglide does not settle. Costs of laws that differ by less count as equal.
"""

# ------------------------------------------------------------------ torques

CONDITION_RESIDUAL = 1e-11
"""|t_s . W_p| over the sum of the sizes of its terms at a crossing: below, condition (8) holds.

Rounding leaves 1e-15. At 1e-10 a pole passes that is 1e-10 of the forces over the distance from the locus;
measured: at 1e-12 a law is refused whose imposed point is 1e-12 of the path beside the locus.
"""

TORQUE_TAIL = 1e-10
"""Tail of the torques' series over its largest coefficient: below, they are resolved.

A crossing falls to 1e-12, a pole stalls (a point 72 um off leaves 2e-3). Measured: at 1e-9 two refused paths
are planned, right to 4e-10 (a nearly straight arc, an end 1e-8 m beyond the locus); at 1e-11 one that ends
1e-7 m before the locus is refused.
"""

STRICTEST_TAIL = 1e-14
"""The strictest tail that may be asked for: rounding leaves 1e-15 to 1e-14 of the torques.

Measured on the five-bar: 6e-15 of the polynomial law, 4e-13 of the optimal law on the finest grid.
"""

RESOLVABLE_TAIL = 1e-6
"""The loosest tail that tells a resolved torque from a pole, and what a pole leaves at least.

At 1e-5 narrow poles of near misses may pass unseen; at 1e-7 a request with tolerance 1e-6 is refused.
"""

# ------------------------------------------------------------------ simulation

SPRINGS_BALANCED = 1e-8
"""How far [rad, robot lengths] springs without mass are from balance in a state that is given.

At 1e-7 accelerations pass that a robot so far out of balance would not have; at 1e-9 states that a simulation
has left there are refused.
"""

FIXED_STEP_ERROR = 0.05
"""What fixed steps may leave out of a motion [rad, robot lengths], all together: more is another motion.

At 0.5 motions pass that are half a radian off; at 0.005 previews are refused that look right.
"""

MOTION_OFF_PATH = 1e-3
"""Distance of a simulated platform from its path [robot lengths, rad]: above, `crossing simulate` says no.

Certified torques come back to 1e-5. At 1e-2 torques pass that leave the path by as much; at 1e-4 long motions
may be refused, in which errors grow.
"""

# ------------------------------------------------------------------ proofs

FRAME_ROUNDING = 1e-13
"""Rounding of positions, directions and loop equations, in lengths of all links, that proofs allow for.

A bound: pinocchio multiplies one matrix a joint, some 1e-15 of the links' lengths. At 1e-12 the proofs of the
tests still succeed; at 1e-14 they would trust less than a robot of many joints rounds to.
"""

LEG_COEFFICIENT_ROUNDING = 1e-14
"""Uncertainty of leg conditions, over the largest coefficient of each: solutions are proved for all of it.

A bound: three times what null spaces were measured to be off, 2e-15. At 1e-13 Dietmaier's 40 poses are still
proved; at 1e-15 it is no bound.
"""

DISTINCT_SOLUTIONS = 1e-6
"""Distance at which two solutions are one [rad, robot lengths; of 1 for points of projective space].

Equal ones agree to 1e-10, and poses 1e-6 apart are nearly singular. At 1e-5 and 1e-7 nothing else changes.
"""

ENDGAME_MIN_EXPONENT = 0.1
"""Exponent w of a homotopy path's size s^-w towards its end: above it the path grows, below it is finite.

Exponents are 1 or 1/2 as a rule. At 1 paths with 1/2 are called finite and octahedral platforms miscounted;
at 0.01 nothing changes.
"""

# ------------------------------------------------------------------ deflections

SETTLED_SHARE = 0.1
"""Change of the deflections that is left, over the tolerance of the request, for them to be settled.

Measured on 53 scenes with flexible links: at 1 the polynomial of standing_quadruped's sway is given up and
another law taken; at 0.01 there is a pass more, and torques agree to 1e-12 of the largest.
"""

MAX_DEFLECTION = 1.0
"""A deflection [rad, robot lengths] beyond which a linear spring means nothing: the robot is too soft.

Scenes of the catalogue deflect springs by 0.004 at most. At 10 equilibria pass in which a joint has turned
over; at 0.1 robots on soft springs, such as legs, are refused.
"""

WEAK_COLUMN = 1e-6
"""A combination of unknown coefficients that changes the balance by less of their size, and is left to rest.

Below it deflections on the singularity are not told by their forces, nor are vibrations. At 1e-5 and 1e-7 an
upright five-bar whose springs vibrate moves otherwise, also in balance: torques change by 0.2 and 2 % of the
peak, the peak by 3e-8. An orthoglide keeps its torques to 3e-13.
"""

STIFFER_THAN_FOLD = 1.02
"""Stiffness of springs that are advised where springs give way at rest, over that at the fold.

The fold is found to 2e-3. At 1.002 the springs that are advised may be those that give way.
"""

SOFTENING_NEAR_CROSSING = 0.06
"""Measure g, over the largest of the path, below which the softening counts less than in full.

At a crossing it is 0 / 0. At 0.02 the least softening of random robots is up to a fourth larger (0.52, 0.67).
"""

MAX_SOFTENING = 0.5
"""Share of its singularity measure that an elastic robot may lose under loads, to first order.

At 0.5 the balance beside a crossing has a fold. At 0.25 robots that were planned would be refused.
"""

REQUIRED_SPEED_ERROR = 1e-6
"""Speed of an elastic robot at a crossing less the speed required there, over the latter.

Deflections move the crossing, and the law is sought again with the moved one: the second law of a 5R with
flexible joints leaves 2e-14. The programs before the rows of speed were kept left up to 0.8.
"""

REQUIRED_TIME_ERROR = 1e-10
"""Time of an elastic robot's crossing less the time required, over the latter; sought as the speed above."""

MAX_END_RATE = 1e-3
"""Rate of a spring at the ends of an elastic optimal motion, over its own largest.

Deflections in balance need not be at rest where the law is: with inertia their rates follow the law's fifth
derivative. Motions that swing for milliseconds at an end had 1e-2 to 1. At 1e-2 some of those pass; at 1e-4
soft robots get smoother laws with higher peaks.
"""

MAX_END_ACCELERATION = 1e-2
"""Acceleration of a spring at these ends, over its own largest.

It follows the law's sixth derivative, and is out of static balance by the share of inertia in the spring's
force alone. At 1e-3 laws of slider_crank and par4 are refused that cost 2 and 1 % less than those then taken.
"""

MAX_UNRESOLVED_MISFIT = 1e-6
"""What may be out of balance, over the largest load, in deflections that count as found.

Above, springs are softened stepwise. At 0.1 two of 60 random robots were refused that are planned so.
"""

# ------------------------------------------------------------------ identification

MIN_RANK_GAP = 1e3
"""The last singular value of a regressor that counts over the first that does not, of a rank that is certain.

The robots of the catalogue have 3e10 and more on random motions. At 1e4 more ranks are called uncertain; at
100 those too count as certain that noise in the data could make.
"""

MAX_NOISE_RATIO = 10.0
"""What a calibration leaves of the data, over the noise that was assumed, for the geometry to count as found.

Noise that is as assumed leaves 1; another robot, or rods swapped, hundreds. At 100 results pass that explain
nothing; at 1 those are refused whose noise was only stated too low.
"""

SPIKE = 10.0
"""How far a sample stands out from its neighbours to be a spike, over the distance of 99 % of the samples.

Normal noise reaches 2.5 in a hundred thousand samples, impacts that last for two samples nothing at all. At
100 spikes pass that make half of all misfit; at 2 noise is one.
"""

MAX_MOTOR_MISFIT = 0.1
"""How far a motor's joint may be from where the measured platform has it [rad, of slides robot lengths].

A degree of the file is 0.017 and a millimetre on a crank of 0.1 m 0.01. At 1 a zero that is off by half a
radian passes; at 0.01 files are refused that are off by a degree.
"""

MAX_PRIOR_DEVIATIONS = 5.0
"""How far a calibrated dimension may be from the file's, in standard deviations of what the file may be off.

Chance gives 5 once in two million. At 50 a wrong unit or a mirrored leg passes; at 0.5 every second file that
is off as stated is refused.
"""

MIN_NOISE_RATIO = 0.05
"""Least noise of a combination of torques, over the noisiest one of the instant, that it is weighed with.

Beside Type 2 one combination feels no motor's noise, but that of the pose. Measured on scene C of the 5R with
heavy legs, platform off by 0.1 mm: parameters off by 7 of their deviations, by 11 at 0.005; at 0.5 no instant
is left whose torques can be predicted.
"""

NARROWED_SHARE = 1.0 / 3.0
"""Deviation that data leave of a quantity, over that by the file alone, below which they show it.

At 0.9 quantities count that are known from the file; at 0.1 a mass that is known to a tenth does not.
"""

FILE_SHARE = 0.5
"""Share that the file's uncertainty makes of an estimate's variance, below which data determine it.

What remains is the noise of the data. If the file is right by chance, an interval of 95 % holds sqrt(2) times
as much: 99.4 %. Over six robots and three motions at 1/2 the intervals of all determined parameters held 93
to 97 %, at 1 up to 98.9 %. At 1/9 one stroke of a slider-crank or of a delta determines nothing.
"""

MASS_SHIFT = 0.03
"""How far the mass of a link may lie off its place in the file, over its radius about the link's origin.

Screws, cables and glue shift it by about so much, whatever the body's thickness. At 0.3 a slender rod may be
a ball, and what that hides of a delta's masses makes them six times less certain; at 0.003 a robot file's
mass without a size could not be moved by data.
"""

SIGNIFICANT_DEVIATIONS = 4.0
"""Standard deviations that an identified parameter is off the file's value by, to be called changed.

Chance gives 4 once in 16000. At 40 masses off by a tenth go unnamed in short recordings; at 0.4 two of three
parameters that are as in the file are named.
"""

FAULT_RATIO = 10.0
"""How much less of the torques or poses one change of a column must leave (squared), to be called its fault.

A reversed torque or a wrong unit leaves 100 to 1e6 times less. At 100 they go unnamed where friction is not
in the file; at 2 chance makes them.
"""

CLEAR_MISFIT = 3e-3
"""Squared misfit of a recording to the model, over the recording itself, that raises no suspicion.

A wrong sign leaves 1 or more of a column; time in milliseconds left 0.016 of a slider-crank's torques, by
friction and weight. At 0.03 that passes; at 3e-4 columns are tried in vain where noise is 2 %.
"""

MAX_ACCELERATION_SPREAD = 3.0
"""Noise of smoothed accelerations, over its median in time, above which torques are not compared with them.

Splines know least at the ends of a recording and in its gaps. With the last samples, the torques of a delta
that missed a tenth of its rows were predicted to 20 %, at 3 without these to 2.8 %. At 1 half of all instants
are lost.
"""

MIN_SPEED_DEVIATIONS = 4.0
"""Standard deviations of its noise by which a motor's speed must differ from zero, for its sign to be known.

Chance gives 4 once in 16000 samples. At 1 friction at rest has a random sign; at 40 slow motions show no
friction.
"""

BETTER_DEVIATIONS = 2.0
"""By how many standard deviations of chance a twin must predict torques held out better than simpler models.

Of equally good models chance calls one in 40 better. At 0 every second; at 10 only recordings of many
minutes prove anything.
"""

REFERENCE_DISTANCE = 0.05
"""Least distance of a reference that `convert` chooses to singularities [rad, robot lengths].

It is the platform's to Type 1, the motors' to Type 2. Nearest closed poses of loops that are drawn open lie
beside them, a four-bar's at 0.007. At 0.01 few paths leave the pose to one side; at 0.2 small workspaces have
no pose that far from both ends.
"""

# ------------------------------------------------------------------ control

MAX_PREDICTED_SHARE = 0.5
"""Predicted standard deviation of the platform over the tolerance of runs, up to which runs are to pass.

Two standard deviations reach the tolerance. Of 24 elastic robots with sensors those below 0.5 passed in all
runs but a few, those above 1 in half of them or fewer; at 1 robots count as safe of which half fail.
"""

NOISE_FACTORS = (1.0, 10.0, 100.0, 1000.0)
"""Factors on the noise of accelerations and motor torques in the filter's model that are tried for lqg.

More noise makes the filter trust its sensors more than its springs. A delta with encoders on its elbows
needs 1, behind its drives 100, an upright 3-RRR 1000; with 3000 its prediction changes by 1 %.
"""

TORQUE_FACTORS = (1.0, 0.5, 0.25)
"""Factors on the torque share of lqg that are tried.

A smaller share makes the loop slower, and moves its poles away from vibrations. A par4 passes with 0.5, a
Gough-Stewart platform with 0.25; at 0.125 the loop of an upright 3-RRR is too slow, its prediction 1.6 times
that at 0.5.
"""

GOOD_EXCESS = 0.7
"""Predicted deviation over the allowed one, and torque over what limits leave, below which weights are good.

2.9 standard deviations then reach the tolerance. With 1.0, 2 of them, one of 20 robots of a par4 failed, with
8192 counts on all encoders.
"""

LEAST_ROOM = 0.05
"""Share of a motor's peak torque that counts as left for feedback where the plan is at the limit.

At the limit nothing is left, and a deviation over it would be infinite for every law of least time. The
number is a choice: a deviation of 5 % of the peak at the limit counts as one that is cut.
"""

TRIAL_RUNS = 20
"""Wrong robots of which all must pass before sensors or a margin are named; else see MAX_TRIAL_FAILURES.

If all of n robots pass, more than 0.05^(1/n) of all robots pass with a confidence of 95 %: 86 % for 20. Twice
as many would show 93 %, at twice the time.
"""

MAX_TRIAL_FAILURES = 2
"""Wrong robots of twice TRIAL_RUNS that may fail where no sensors keep all TRIAL_RUNS.

38 of 40 show 85 % with the same confidence as 20 of 20 do 86 %.
"""

LARGEST_MARGIN = 0.4
"""Share of the torque limits up to which a robust plan may leave them to feedback.

Beyond, motors 1 / (1 - 0.4) = 1.7 times as strong would serve the plan as well; the search ends there.
"""

MARGIN_STEP = 0.0125
"""Margin to which the search for a robust plan halves its last interval; it begins with twice as much.

Where inertia dominates, the least time goes with 1 / sqrt(limits): what is left open costs 0.6 % of it.
"""

MAX_TURNS = 20
"""Turns of the platform along a path that are followed.

The work grows with the turns, in each of which the robot may meet singular points: 80 take 20 s. Turns
repeat, so that one of them tells all; a number in degrees, such as 400, is told at once.
"""
