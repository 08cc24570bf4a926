"""Figures, and pages for the browser. Open `film` first: it samples the motions that pages and pictures show.

No other package imports matplotlib or MeshCat. This one draws results and computes none. A node is the joint
that carries a shape, 0 the base.

What is shown
    film                a motion sampled in time: poses, torques, distance to the singularity; torque limits
    captions            sentences about a film
    shapes              the solids of a robot and of its motors
    sight               the direction of view that shows most of a robot

Figures
    style               the look of all figures
    plots               torques, law, phase plane and certificate of a plan; the eye of the needle
    map                 maps over the workspace, as figures and as a page; the singular locus
    study_figures       one figure for each study: dimensions, fidelity, robustness
    vibration_figures   softest direction and vibrations of a pose; vibrations along a path
    transmission_figures  inertia, limits and errors of a linkage as a transmission
    drawing             a robot, and one frame of a film, as a picture
    moving              pictures and animated GIFs as files

Pages
    scene               a film as a JSON document
    page, page/         a page in one file, with its scripts, styles and data; pages on which robots move
    jogging             a robot moved by hand: replies to its page, and the server that sends them
    report              the report of a plan, with the call that repeats the plan
    lesson              a page on which readers try condition (8) by hand
    jupyter             pictures of robots and plans in notebooks
"""

from framework.errors import InvalidInput
from framework.lazy_names import lazy_names
from framework.numerics.interruption import defer_signals

try:
    with defer_signals():  # an interrupted import of matplotlib's compiled modules aborts Python at its end
        import matplotlib  # noqa: F401  reads MPLBACKEND when it is imported
except ValueError as error:
    raise InvalidInput(f"MPLBACKEND: {error}") from None

__getattr__, __dir__ = lazy_names(__name__, __file__)
