"""The largest multiple of a wrench that is crossed: planned below it, refused above it."""

import json
import math
from functools import cache

import pytest

import robots
from framework import InvalidInput, LimitsExceeded, NoLaw, NotConverged, largest_load, plan_crossing
from framework.cli import main
from framework.cli.fidelity import capacity_lines
from framework.fidelity.capacity import capacity_request, largest_load_of
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.planning.refusals import SearchEvidence
from framework.planning.scenes import scene_path
from framework.tolerances import LIMIT_MARGIN

LIMIT = 0.2  # [N m]
PUSH = {"left_tip": (0.0, -1.0, 0.0, 0.0, 0.0, 0.0)}


@cache
def five_bar():
    robot = robots.load("five_bar")
    return robot, scene_path(robot.description.scenes["C"])


@cache
def capacity():
    robot, path = five_bar()
    return largest_load(robot, path, torque_limit=LIMIT, wrenches=PUSH)


@cache
def pushed(multiple):
    """The quickest plan under a multiple of the push."""
    robot, path = five_bar()
    wrenches = {frame: [multiple * value for value in wrench] for frame, wrench in PUSH.items()}
    return plan_crossing(robot, path, optimize="time", torque_limit=LIMIT, wrenches=wrenches)


@pytest.mark.slow
def test_less_is_planned_and_more_is_refused():
    found = capacity()
    assert found.multiple < found.refused <= 1.001 * found.multiple
    for share in (0.5, 0.9, 0.99):
        assert max(pushed(share * found.multiple).peak_torque.values()) <= LIMIT
    for share in (1.01, 1.5):
        with pytest.raises(NoLaw):
            pushed(share * found.multiple)


@pytest.mark.slow
def test_the_ends_carry_what_they_rest_on():
    found = capacity()
    assert max(found.plan.peak_torque.values()) <= LIMIT
    assert found.plan.certificate.tail < 1e-9
    assert found.plan.request.wrenches == {"left_tip": [0, -found.multiple, 0, 0, 0, 0]}
    assert found.refusal.evidence.torque_peak > 1.0 - LIMIT_MARGIN  # of which so much is left free


@pytest.mark.slow
def test_a_little_above_the_refused_multiple_it_is_proved_that_no_law_is_left():
    found = capacity()
    assert found.refused <= found.impossible <= 1.01 * found.multiple
    assert "no law, proved" in "\n".join(capacity_lines(found))


def test_a_table_is_scaled_as_a_whole():
    table = [[0.0, 0, 0, 0, 0, 0, 0], [0.5, 0, -1, 0, 0, 0, 2], [1.0, 0, 0, 0, 0, 0, 0]]
    scaled = ExternalWrenches.of({"left_tip": table}).times(3.0).document["left_tip"]
    assert scaled == [[0.0, 0, 0, 0, 0, 0, 0], [0.5, 0, -3, 0, 0, 0, 6], [1.0, 0, 0, 0, 0, 0, 0]]


def test_without_a_wrench_or_a_limit_the_question_has_no_meaning():
    robot, path = five_bar()
    with pytest.raises(InvalidInput, match="wrenches: give a wrench that is not zero"):
        largest_load(robot, path, torque_limit=LIMIT)
    with pytest.raises(InvalidInput, match="wrenches: give a wrench that is not zero"):
        largest_load(robot, path, torque_limit=LIMIT, wrenches={"left_tip": [0.0] * 6})
    with pytest.raises(InvalidInput, match="torque_limit or speed_limit is needed"):
        largest_load(robot, path, wrenches=PUSH)
    with pytest.raises(
        InvalidInput, match="torque_limit or speed_limit is needed: without limits no multiple"
    ):
        largest_load(robot, path, duration=1.5, optimize="peak_torque", wrenches=PUSH)


@pytest.mark.parametrize(
    ("refusal", "proved"),
    [
        (NoLaw("none", proof="a proof"), True),
        pytest.param(NoLaw("none found"), False, marks=pytest.mark.slow),
        pytest.param(LimitsExceeded("beyond", exceeded={}), False, marks=pytest.mark.slow),
        (NotConverged("gave up", residual=1.0), False),
    ],
)
def test_only_a_refusal_is_one(monkeypatch, refusal, proved):
    """With planning that answers up to 5 times the push: a failure of the numbers refuses nothing."""
    plan = pushed(0.0)

    def planned(robot, request, **_):
        if any(abs(entry.rows[..., -6:]).max() > 5.0 for entry in request.external_wrenches.entries):
            raise refusal
        return plan

    monkeypatch.setattr("framework.fidelity.capacity.plan_request", planned)
    robot, path = five_bar()
    found = largest_load(robot, path, torque_limit=LIMIT, wrenches=PUSH)
    assert found.multiple <= 5.0 < found.end <= 1.001 * found.multiple
    decided = isinstance(refusal, NoLaw | LimitsExceeded)
    assert (found.refused, found.undecided)[decided] == math.inf
    assert (found.failure, found.refusal)[decided] is refusal
    assert found.proved == proved
    if decided:  # 6.1 times are planned, so that a bound of all laws must lie above
        assert 6.1 < found.impossible < 7.0


@pytest.mark.parametrize(
    ("peak", "is_found", "most"),
    [
        # of the multiple m, over the limits; whether it is found before any plan
        (lambda m: (1.0 - LIMIT_MARGIN) * (1.0 + 0.16 * (m - 5.3)), False, 9),
        (lambda m: (1.0 - LIMIT_MARGIN) * (m / 5.3) ** 3, False, 12),
        (lambda m: 3.0 + m, False, 20),  # evidence that misleads
        (lambda m: 9.0 - m, False, 20),
        (lambda m: 1.0, False, 20),
        (lambda m: (1.0 - LIMIT_MARGIN) * (1.0 + 0.16 * (m - 5.3)), True, 2),
        (lambda m: (1.0 - LIMIT_MARGIN) * (m / 5.3) ** 3, True, 12),
        (lambda m: 3.0 + m, True, 20),
        (lambda m: (1.0 - LIMIT_MARGIN) * m / 90.0, True, 24),  # far above what is planned
        (lambda m: (1.0 - LIMIT_MARGIN) * m / 0.01, True, 24),  # far below
    ],
)
def test_whatever_peaks_are_found_the_bracket_is_right(monkeypatch, peak, is_found, most):
    """Planned up to 5.3 times the push: peaks that rise with it save plans, others do no harm."""
    plan, tried, counted = pushed(0.0), [], []
    capacity = "framework.fidelity.capacity._Multiples"
    monkeypatch.setattr(f"{capacity}.find_least_peak", lambda self, m: peak(m) if is_found else 0.0)
    monkeypatch.setattr(f"{capacity}.bound_peaks", lambda self, m: 0.0)

    def planned(robot, request, **_):
        (entry,) = request.external_wrenches.entries or (None,)
        tried.append(multiple := 0.0 if entry is None else float(abs(entry.rows[..., -6:]).max()))
        if multiple > 5.3:
            raise NoLaw("none", proof="a proof", evidence=SearchEvidence(9, peak(multiple)))
        return plan

    monkeypatch.setattr("framework.fidelity.capacity.plan_request", planned)
    robot, path = five_bar()
    request = capacity_request(robot, path, torque_limit=LIMIT, wrenches=PUSH)
    found = largest_load_of(robot, request, progress=counted.append)
    assert counted == list(range(1, len(tried) + 1))
    assert found.multiple <= 5.3 < found.refused <= 1.001 * found.multiple
    assert len(tried) <= most


def test_the_command_says_no_where_no_multiple_is_planned(monkeypatch, capsys):
    plan = pushed(0.0)

    def planned(robot, request, **_):
        if request.external_wrenches.is_nonzero:
            raise NotConverged("gave up", residual=1.0)
        return plan

    monkeypatch.setattr("framework.fidelity.capacity.plan_request", planned)
    words = ["capacity", "five_bar", "--scene", "C", "--torque-limit", str(LIMIT), "--wrench", "0", "-1"]
    assert main([*words, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["multiple"] == 0.0
    assert not document["proved"]
    assert document["refused"] is None
    assert document["failure"] == "gave up"


def test_the_command_does_not_say_more_than_was_tried(monkeypatch, capsys):
    plan = pushed(0.0)
    monkeypatch.setattr("framework.fidelity.capacity.plan_request", lambda robot, request, **_: plan)
    monkeypatch.setattr("framework.fidelity.capacity._Multiples.find_least_peak", lambda self, multiple: 0.0)
    words = ["capacity", "five_bar", "--scene", "C", "--torque-limit", str(LIMIT), "--wrench", "0", "-1"]
    assert main(words) == 0
    assert "nothing refused up to 1.04858e+06 times" in capsys.readouterr().out


@pytest.mark.slow
def test_the_command_says_the_multiple_and_what_binds(capsys, monkeypatch):
    """It asks for what `largest_load` does, whose answer stands for a search of its own here."""
    asked = []

    def known(robot, request, **_):
        asked.append(request)
        return capacity()

    monkeypatch.setattr("framework.cli.fidelity.largest_load_of", known)
    words = ["capacity", "five_bar", "--scene", "C", "--torque-limit", str(LIMIT), "--wrench", "0", "-1"]
    assert main([*words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert asked == [capacity_request(*five_bar(), torque_limit=LIMIT, wrenches=PUSH)]
    assert document["multiple"] == capacity().multiple
    assert "condition (8)" in document["binds"]
    monkeypatch.undo()
    assert main([*words[:-3]]) == 2
    assert "give a wrench" in capsys.readouterr().err
