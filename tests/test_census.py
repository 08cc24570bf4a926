"""The framework does not grow unawares."""

from tests.census import FILES, FRAMEWORK, TABLE, count, read_table

SAMPLE = '''"""A module."""
LIMIT = -2.5
NAME = "a"


def move(a):
    """Return a."""
    return a


@dataclass(frozen=True)
class Record:
    """A record."""
'''


def test_counts_of_a_sample():
    """By hand: Module; LIMIT = -2.5 is 6 nodes, NAME = "a" 4; def, its arguments and one, return, a and its
    context are 6; class, decorator, its name and context, keyword and constant, and pass are 7."""
    assert count(SAMPLE) == {"files": 1, "lines": 13, "nodes": 1 + 6 + 4 + 6 + 7, "records": 1}


def test_the_framework_has_no_more_nodes_than_stored():
    nodes = sum(count(FILES[module].read_text(encoding="utf-8"))["nodes"] for module in FRAMEWORK)
    stored = read_table(TABLE.read_text(encoding="utf-8"))["total"]["nodes"]
    assert nodes <= stored, (
        f"{stored} -> {nodes} nodes. Say less, or store the growth with `python -m tests.census --store` and "
        f"its reason in the message of the commit."
    )
