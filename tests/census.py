"""Count how much code the framework has and how plainly it is written; `--store` writes the table census.md.

Nodes are those of the syntax tree without docstrings. A function has many locals where it assigns more than
15 names. The name of a function is unclear where it begins with a preposition or is a bare participle. The
first line of a docstring is one to look at where it has a pronoun or more than 20 words. All these are places
to look at, no verdicts.
"""

import ast
import io
import re
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

from tests.test_imports import FILES, FRAMEWORK, imports

TABLE = Path(__file__).with_name("census.md")
PLANNING = "framework.planning.plan"
COUNTS = ("files", "lines", "nodes", "many locals", "numbers", "unclear names", "first lines")
MAX_LOCALS, MAX_WORDS = 15, 20
PREPOSITION = re.compile(
    "at|of|in|on|under|near|by|between|beside|along|off|apart|without|within|into|over|beyond|until|instead|"
    "how|where|which|what|when|that"
)
PARTICIPLE = re.compile(
    "held|kept|found|told|made|given|known|taken|led|shown|written|left|met|cut|drawn|born|worn|chosen|begun|"
    "bound|built|bent|felt|fed|said|sent|sought|spent|stood|thrown|understood|"
    "(?!(?:(?:f|n|s|sp|proc|exc|succ)eed|(?:emb|b|r)ed)$).*ed"
)
PRONOUN = re.compile(r"\b(it|them|they|those|these|there|what)\b", re.IGNORECASE)
LAYOUT = frozenset(
    {tokenize.NL, tokenize.NEWLINE, tokenize.COMMENT, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
)
Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def is_unclear(name: str) -> bool:
    """Return whether a function's name is neither a verb with its object nor a noun."""
    words = [word for word in name.split("_") if word]
    if not words or name.startswith("__") or name in ("of", "on", "off"):
        return False
    is_participle = len(words) == 1 and PARTICIPLE.fullmatch(words[0])
    return bool(PREPOSITION.fullmatch(words[0]) or is_participle)


def is_number(value: ast.expr | None) -> bool:
    """Return whether an expression is a number, or several, written out."""
    match value:
        case ast.UnaryOp():
            return is_number(value.operand)
        case ast.BinOp():
            return is_number(value.left) and is_number(value.right)
        case ast.Tuple():
            return bool(value.elts) and all(map(is_number, value.elts))
    return isinstance(value, ast.Constant) and type(value.value) in (int, float)


def remove_docstrings(tree: ast.Module) -> Iterator[tuple[Documented, ast.Expr]]:
    """Take the docstrings out of a tree; yield the owner and the expression of each."""
    for owner in list(ast.walk(tree)):
        if isinstance(owner, Documented) and ast.get_docstring(owner, clean=False) is not None:
            docstring = owner.body[0]
            assert isinstance(docstring, ast.Expr)
            owner.body = owner.body[1:] or [ast.Pass()]
            yield owner, docstring


def count(text: str, *, drawing: bool = False) -> Counter[str]:
    """Count one module; numbers at module level only where it draws nothing."""
    tree = ast.parse(text)
    counts, prose = Counter(files=1, lines=text.count("\n")), set[int]()
    for owner, docstring in remove_docstrings(tree):
        prose.update(range(docstring.lineno, docstring.end_lineno + 1))
        first = next(iter(ast.literal_eval(docstring.value).strip().splitlines()), "")
        if not isinstance(owner, ast.Module):
            counts["first lines"] += bool(PRONOUN.search(first)) or len(first.split()) > MAX_WORDS
    code = set[int]()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in LAYOUT:
            code.update(range(token.start[0], token.end[0] + 1))
    counts["code lines"] = len(code - prose)
    for node in ast.walk(tree):
        counts["nodes"] += 1
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            decorators = {ast.unparse(d).rpartition(".")[2] for d in node.decorator_list}
            is_property = bool(decorators & {"property", "cached_property"})
            counts["unclear names"] += not is_property and is_unclear(node.name)
            names = [n for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
            counts["many locals"] += len({n.id for n in names}) > MAX_LOCALS
    assignments = [n for n in tree.body if isinstance(n, ast.Assign | ast.AnnAssign)]
    counts["numbers"] = 0 if drawing else sum(is_number(n.value) for n in assignments)
    return counts


def reach(module: str) -> set[str]:
    """Return all modules that a module imports, directly or by way of others, with itself."""
    reached, waiting = set[str](), [module]
    while waiting:
        reached.add(waiting[-1])
        waiting += (imports(waiting.pop()) & set(FILES)) - reached
    return reached


def take_census() -> dict[str, Counter[str]]:
    """Count the framework by package, in all, and what planning reaches."""
    packages = defaultdict[str, Counter[str]](Counter)
    planning = reach(PLANNING)
    for module in FRAMEWORK:
        package = ".".join(module.split(".")[:2])
        package = package if FILES[module].parent.name != "framework" else "framework"
        counts = count(FILES[module].read_text(encoding="utf-8"), drawing=package == "framework.show")
        packages[package] += counts
        packages["total"] += counts
        if module in planning:
            packages[f"reached by {PLANNING}"] += counts
    return packages


def format_table(packages: dict[str, Counter[str]]) -> str:
    """Return the census as a table, a package a line, with nodes for each line of code."""
    rows = [("package", *COUNTS, "nodes a code line"), ("---", *["---:"] * (len(COUNTS) + 1))]
    for package, counts in packages.items():
        density = counts["nodes"] / counts["code lines"]
        rows.append((package, *(str(counts[name]) for name in COUNTS), f"{density:.1f}"))
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def read_table(text: str) -> dict[str, Counter[str]]:
    """Return the counts of a stored table, by package."""
    rows = [[cell.strip() for cell in line.strip("|\n").split("|")] for line in text.splitlines()]
    return {row[0]: Counter(dict(zip(COUNTS, map(int, row[1:-1]), strict=True))) for row in rows[2:]}


if __name__ == "__main__":
    table = format_table(dict(sorted(take_census().items())))
    if "--store" in sys.argv:
        TABLE.write_text(table, encoding="utf-8")
    print(table, end="")
