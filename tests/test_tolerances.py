"""The table of tolerances holds each number once, with its reason."""

import ast
from pathlib import Path

import framework.tolerances

BODY = ast.parse(Path(framework.tolerances.__file__).read_text(encoding="utf-8")).body
NUMBERS = [
    (k, target.id)
    for k, node in enumerate(BODY)
    if isinstance(node, ast.Assign)
    for target in ast.walk(node.targets[0])
    if isinstance(target, ast.Name)
]


def test_no_number_is_given_twice():
    names = [name for _, name in NUMBERS]
    assert len(set(names)) == len(names)


def test_each_number_says_what_it_compares():
    for k, name in NUMBERS:
        after = BODY[k + 1] if k + 1 < len(BODY) else None
        assert isinstance(after, ast.Expr), name
        assert isinstance(after.value, ast.Constant), name
