from framework.show.drawing import draw_robot, plot_still
from framework.show.film import Film, film_limit, film_motion, film_plan
from framework.show.jupyter import map_picture, plan_picture, robot_picture, show_figure, show_film
from framework.show.lesson import lesson_page
from framework.show.map import map_page, plot_locus, plot_map, plot_motor_locus, save_map_figures
from framework.show.moving import film_picture
from framework.show.page import film_page, hand_page
from framework.show.plots import (
    plot_eyes,
    plot_law,
    plot_phase_plane,
    plot_raw_torques,
    plot_singularity,
    plot_speeds,
    plot_torques,
    plot_wrench,
    save_figures,
)
from framework.show.report import report_page
from framework.show.sight import Sight
from framework.show.study_figures import plot_fidelity, plot_robustness, plot_study
from framework.show.style import ALARM, COLORS, CROSSING, DASHES, LOCUS, line_style, use_style

__all__ = [
    "ALARM",
    "COLORS",
    "CROSSING",
    "DASHES",
    "LOCUS",
    "Film",
    "Sight",
    "draw_robot",
    "film_limit",
    "film_motion",
    "film_page",
    "film_picture",
    "film_plan",
    "hand_page",
    "lesson_page",
    "line_style",
    "map_page",
    "map_picture",
    "plan_picture",
    "plot_eyes",
    "plot_fidelity",
    "plot_law",
    "plot_locus",
    "plot_map",
    "plot_motor_locus",
    "plot_phase_plane",
    "plot_raw_torques",
    "plot_robustness",
    "plot_singularity",
    "plot_speeds",
    "plot_still",
    "plot_study",
    "plot_torques",
    "plot_wrench",
    "report_page",
    "robot_picture",
    "save_figures",
    "save_map_figures",
    "show_figure",
    "show_film",
    "use_style",
]
