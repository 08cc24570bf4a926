"""Lists and numbers in messages."""

import pytest

from framework.errors import InvalidInput, format_distinct, list_names, round_up


def test_a_copy_of_an_error_has_its_cause_and_leaves_the_context_of_others():
    cause = ValueError("number")
    with pytest.raises(InvalidInput) as told:
        raise InvalidInput("file") from cause
    assert told.value.adding("line 3").naming("arm").__cause__ is cause
    other = InvalidInput("file").adding("line 3")
    assert (other.__cause__, other.__suppress_context__) == (None, False)


@pytest.mark.parametrize(
    ("count", "expected"),
    [(0, "none"), (1, "n0"), (3, "n0, n1, n2"), (4, "n0, n1, n2, and 1 more"), (9, "n0, n1, n2, and 6 more")],
)
def test_a_list_says_how_many_names_it_leaves_out(count, expected):
    assert list_names([f"n{k}" for k in range(count)], 3) == expected


def test_a_list_has_forty_names_unless_it_is_told_otherwise():
    names = [f"n{k}" for k in range(41)]
    assert list_names(names[:40]).count(",") == 39
    assert list_names(names).endswith("n39, and 1 more")


@pytest.mark.parametrize(
    ("value", "digits", "expected"),
    [(1.2341, 3, 1.24), (1.23, 3, 1.23), (0.0998, 1, 0.1), (9.96, 2, 10.0), (0.0, 3, 0.0), (1e-7, 2, 1e-7)],
)
def test_a_bound_is_rounded_up(value, digits, expected):
    assert round_up(value, digits) == expected
    assert round_up(float("inf"), digits) == float("inf")


@pytest.mark.parametrize(
    ("one", "other", "texts"),
    [
        (1.0, 2.0, ("1", "2")),
        (1.23456, 1.23452, ("1.2346", "1.2345")),
        (1.0, 1.0 + 2.0**-52, ("1", "1.0000000000000002")),
    ],
)
def test_numbers_that_differ_are_written_so(one, other, texts):
    assert format_distinct(one, other) == texts
