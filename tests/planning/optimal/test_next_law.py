"""Programs of the next law: their models of duration and energy, against the quantities themselves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.polynomial.chebyshev import poly2cheb

import robots
from framework import Line
from framework.planning.optimal.law_problem import _rows_of_response
from framework.planning.optimal.next_law import _model_cost
from framework.planning.optimal.speed_program import Units
from tests.planning.optimal.tasks import series_program, task_of

LINE = Line([0.1, 0.345], [-0.05, 0.195])


@pytest.mark.parametrize(("goal", "limits"), [("time", {"torque_limit": 2.0}), ("energy", {"duration": 1.5})])
def test_the_model_of_a_step_is_right_to_second_order(goal, limits):
    robot = robots.load("five_bar")
    program = series_program(task_of(robot, LINE, optimize=goal, **limits), 12)
    program = replace(program, problem=program.problem._replace(response=SimpleNamespace(holds_rest=False)))
    y_0 = np.pad(poly2cheb([1.0, 0.2, 0.3]), (0, 10))
    change = np.random.default_rng(0).uniform(-0.05, 0.05, 13)
    unit = 0.7
    cost, squares = _model_cost(program, y_0, Units(unit, 1.0), smoothness=0.0)

    def model(y: np.ndarray) -> float:
        scaled = y * unit**2
        rows = squares.parts["y"] @ scaled + squares.offset
        return float(cost.get("y", np.zeros(13)) @ scaled + rows @ rows)

    def quantity(y: np.ndarray) -> float:
        z = program.z @ y
        weights = program.weights[1:-1]
        if goal == "time":
            return float(weights @ z**-0.5)
        torque = np.stack([row(y)[1 : len(z) + 1] for row in program.rows.torque])
        torque /= program.problem.reference[:, None]
        return float(weights @ ((torque**2).sum(axis=0) * z**-0.5))

    errors = []
    for share in (0.4, 0.2):
        y = y_0 + share * change
        errors.append(model(y) - model(y_0) - (quantity(y) / quantity(y_0) - 1.0))
    assert abs(errors[0]) < 0.02 * abs(quantity(y_0 + 0.4 * change) / quantity(y_0) - 1.0)
    assert errors[0] / errors[1] == pytest.approx(8.0, rel=0.2)  # of third order


def test_rows_of_a_response_have_its_torques_with_friction_against_the_speed_of_each_motor():
    rng, friction = np.random.default_rng(1), np.array([0.3, 0.0])
    torque, slopes, y = rng.normal(size=(4, 2)), rng.normal(size=(4, 2, 3)), rng.normal(size=3)
    speed = np.array([[1.0, -2.0], [-1.0, 2.0], [-3.0, -1.0], [2.0, 1.0]])
    response = SimpleNamespace(y=y, evaluate_motors=lambda xi: (torque, slopes, speed))
    specification = SimpleNamespace(friction=friction, drives=None, speed_limit=np.full(2, np.inf))
    problem = SimpleNamespace(specification=specification, response=response, sigma=lambda xi: xi)
    program = series_program(task_of(robots.load("five_bar"), LINE, duration=1.5), 2)
    rows = _rows_of_response(problem, response, program.basis, np.linspace(-0.5, 0.5, 4)).torque
    change = rng.normal(size=3)
    for j, row in enumerate(rows):
        expected = torque[:, j] + slopes[:, j] @ change + friction[j] * np.sign(speed[:, j])
        np.testing.assert_allclose(row(y + change), expected, atol=1e-14)
