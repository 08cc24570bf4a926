"""Changes to files and command lines that know their structure: made by rule, the same for the same seed.

A file is parsed, changed in one to three places, and written again: a key or an element dropped, doubled,
moved or misspelt, a value in place of another, a number that is nearly right or far from it. One in four is
torn as text instead, so that it may no longer parse.
"""

import copy
import json
import math
import random
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from typing import Any

import yaml

TORN = 0.25  # share of files that are changed as text
RED = "\x1b[31mred"
NUMBERS = (0, 1, -1, 2, 0.5, 1e-300, 1e-12, 1e6, 1e17, 1e300, -1e300, 10**400, math.nan, math.inf, -math.inf)
VALUES = (
    *(None, True, "", "x", "1e5", "é", "\u202egnp", "a\nb", RED, "n" * 300, "n" * 5000),
    *([], {}, [1], [[]], {"a": 1}),
)
TEXTS = (
    "",
    *["x", "nan", "inf", "-1", "0", "1e300", "1e400", "0x1", "1_0"],
    "1 2",
    "0 0 0",
    "1 0 0 0",
    "é",
    "n" * 300,
)
SNIPPETS = ("", *'<>&":', "\x00", "\x1b", "]", "{", "\n  - ", "\t", "é", "&#10;", "-", "9" * 40)
WORDS = (
    *(
        "",
        *["-", "--", "-1", "0", "nan", "inf", "1e300", "1e-300", "1e400"],
        "9" * 20,
        "x",
        "é",
        RED,
        "a\nb",
        "n" * 300,
    ),
    *(
        "n" * 5000,
        "\udcff",
        *["/dev/null", "/dev/zero", ".", "/", "rigid", "flexible_links", "five_bar", "four_bar"],
    ),
    *[
        "--json",
        "--help",
        "--scene",
        "A",
        "B",
        "C",
        "--from",
        "--to",
        "--duration",
        "--times",
        "--speeds",
        "--raw",
    ],
    *[
        "--flexibility",
        "--geometry",
        "deformed",
        "--smoothness",
        "4",
        "--samples",
        "12",
        "--law",
        "--optimize",
        "time",
    ],
    *["--torque-limit", "0.2", "--axes", "rz", "--platform", "--motors", "--reference", "left_motor=1"],
)


def torn(text: str, rng: random.Random) -> str:
    """A text with a piece of it gone, doubled, or replaced."""
    for _ in range(rng.choice((1, 1, 2, 5))):
        at, length = rng.randrange(len(text) + 1), rng.choice((0, 1, 1, 2, 10, 100, 10**6))
        piece = text[at : at + length]
        text = text[:at] + rng.choice((*SNIPPETS, piece + piece, piece[::-1])) + text[at + length :]
    return text


# ------------------------------------------------------------------ YAML and JSON


def changed_yaml(text: str, rng: random.Random) -> str:
    """A YAML text with some of its values changed."""
    if rng.random() < TORN:
        return torn(text, rng)
    return yaml.safe_dump(_changed(yaml.safe_load(text), rng), allow_unicode=rng.random() < 0.5)


def changed_json(text: str, rng: random.Random) -> str:
    """A JSON text with some of its values changed."""
    return torn(text, rng) if rng.random() < TORN else json.dumps(_changed(json.loads(text), rng))


def _changed(content: Any, rng: random.Random) -> Any:
    content = copy.deepcopy(content)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        places = list(_places(content))
        if not places:
            return content
        holder, key = rng.choice(places)
        _change(holder, key, content, rng)
    return content


def _places(content: Any) -> Any:
    """Every (holder, key) below a value."""
    keys = content if isinstance(content, dict) else range(len(content)) if isinstance(content, list) else ()
    for key in list(keys):
        yield content, key
        yield from _places(content[key])


def _change(holder: Any, key: Any, content: Any, rng: random.Random) -> None:
    value, kind = holder[key], rng.randrange(10)
    if isinstance(value, int | float) and not isinstance(value, bool) and kind < 9:
        holder[key] = _number(value, rng)
    elif isinstance(value, str) and kind < 5:
        holder[key] = _name(value, content, rng)
    elif kind == 5:
        del holder[key]
    elif kind == 6 and isinstance(holder, list):
        holder.insert(key, copy.deepcopy(value))
    elif kind == 6:
        holder[_misspelt(str(key), rng)] = holder.pop(key)
    elif kind == 7:  # what stands elsewhere in the file
        other, place = rng.choice(list(_places(content)))
        holder[key] = copy.deepcopy(other[place])
    else:
        holder[key] = rng.choice((*NUMBERS, *VALUES))


def _number(value: float, rng: random.Random) -> float:
    if abs(value) > 1e300:
        return rng.choice(NUMBERS)
    near = (
        1.001 * value,
        1.1 * value,
        -value,
        2 * value,
        1e3 * value,
        1e-3 * value,
        value + 0.01,
        value + 6.3,
    )
    return rng.choice(near if rng.random() < 0.8 else NUMBERS)


def _name(value: str, content: Any, rng: random.Random) -> Any:
    names = [other for holder, key in _places(content) if isinstance(other := holder[key], str)]
    return rng.choice((rng.choice(names), rng.choice(names), _misspelt(value, rng), rng.choice(VALUES)))


def _misspelt(name: str, rng: random.Random) -> str:
    at = rng.randrange(len(name) + 1)
    return name[:at] + rng.choice(("", "_", "x", name[at : at + 1] * 2)) + name[at + 1 :]


# ------------------------------------------------------------------ XML


def changed_xml(text: str, rng: random.Random) -> str:
    """An XML text with some of its elements and attributes changed."""
    if rng.random() < TORN:
        return torn(text, rng)
    root = ElementTree.fromstring(text)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        _change_element(root, rng)
    return ElementTree.tostring(root, encoding="unicode")


def _change_element(root: ElementTree.Element, rng: random.Random) -> None:
    elements = list(root.iter())
    parents = {child: parent for parent in elements for child in parent}
    element = rng.choice(elements)
    if element.attrib and rng.random() < 0.7:
        _change_attribute(element, elements, rng)
        return
    parent, kind = parents.get(element), rng.randrange(5)
    if kind == 0 or parent is None:
        element.tag = rng.choice((_misspelt(element.tag, rng) or "x", rng.choice(elements).tag))
    elif kind == 1:
        parent.remove(element)
    elif kind == 2:
        parent.append(copy.deepcopy(element))
    elif kind == 3:
        parent.insert(rng.randrange(len(parent)), copy.deepcopy(rng.choice(elements)))
    else:
        parent.remove(element)
        rng.choice([other for other in elements if other not in set(element.iter())]).append(element)


def _change_attribute(
    element: ElementTree.Element, elements: list[ElementTree.Element], rng: random.Random
) -> None:
    key, kind = rng.choice(list(element.attrib)), rng.randrange(8)
    value = element.attrib[key]
    if kind == 0:
        del element.attrib[key]
    elif kind == 1:
        element.set(_misspelt(key, rng) or "x", element.attrib.pop(key))
    elif kind == 2:
        element.set(key, rng.choice(TEXTS))
    elif (numbers := _numbers(value)) is not None:
        numbers[rng.randrange(len(numbers))] = _number(rng.choice(numbers), rng)
        element.set(key, " ".join(map(repr, numbers)))
    else:
        others = [other.attrib[key] for other in elements if key in other.attrib]
        element.set(key, rng.choice((rng.choice(others), rng.choice(others), _misspelt(value, rng))))


def _numbers(text: str) -> list[float] | None:
    try:
        return [float(part) for part in text.split()] or None
    except ValueError:
        return None


# ------------------------------------------------------------------ command lines


def changed_words(words: list[str], rng: random.Random) -> list[str]:
    """A command line with words dropped, doubled, swapped or replaced."""
    words = list(words)
    for _ in range(rng.choice((1, 1, 2, 3))):
        at, kind = rng.randrange(len(words) + 1), rng.randrange(5)
        if kind == 0:
            words[at : at + 1] = []
        elif kind == 1:
            words[at:at] = words[at - 1 : at]
        elif kind == 2:
            words[at : at + 1] = [_misspelt(words[at], rng)] if at < len(words) else []
        elif kind == 3:
            words[at:at] = [rng.choice(WORDS)]
        else:
            words[at : at + 1] = [rng.choice(WORDS)]
    return words


PARSE: dict[str, Callable[[str], Any]] = {
    "yaml": yaml.safe_load,
    "json": json.loads,
    "xml": ElementTree.fromstring,
}


def is_well_formed(text: str, kind: str) -> bool:
    """Whether a text parses as YAML, JSON or XML."""
    try:
        PARSE[kind](text)
    except (yaml.YAMLError, ValueError, ElementTree.ParseError, RecursionError, AttributeError, TypeError):
        return False
    return True
