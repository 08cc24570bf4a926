"""Figures, and pages for the browser. Open `film` first: it samples the motions that pages and pictures show.

The only package that knows matplotlib and MeshCat. It draws, and computes no result.

What is shown
    film                a motion sampled in time: poses, torques, distance to the singularity
    captions            sentences about a film
    shapes              the solids of a robot and of its motors
    sight               the direction from which a robot is looked at

Figures
    style               the look of all figures
    plots               torques, law, phase plane and certificate of a plan
    force_polygon       forces along t_s at a crossing: available and needed
    map, locus_figures  maps over the workspace, and as a page; the singular locus
    study_figures       one figure for each study: dimensions, fidelity, robustness
    drawing, still      a robot, and a scene, as a picture
    moving              pictures and animated GIFs as files

Pages
    scene               a film as a document in JSON
    standalone          any page in one file, with scripts, styles and data
    page, page/         pages on which robots move
    jogging, server     a robot moved by hand: the answers to the page, and their server
    report              the report of a plan, with the call that makes the plan again
    lesson              a page to learn condition (8) by hand
    jupyter             robots and plans that show themselves in notebooks
"""

from framework.errors import InvalidInput

try:
    import matplotlib  # noqa: F401  reads the environment as it is imported
except ValueError as error:
    raise InvalidInput(f"MPLBACKEND: {error}") from None
