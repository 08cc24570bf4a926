"""XML and YAML texts of strangers, parsed within limits; attributes and children of an XML element.

`where` names the element in messages.
"""

from __future__ import annotations

import math
import re
import reprlib
from collections.abc import Collection, Hashable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, ParseError, TreeBuilder

import numpy as np
import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.cyaml import CParser  # type: ignore[attr-defined]  # its stub forgets to export it
from yaml.resolver import Resolver

from framework.errors import InvalidInput, MissingPackage, RobotFileError, check_name, nearest, short
from framework.model.description import SMALLEST_LENGTH
from framework.model.placement import from_rpy, placement
from framework.numerics.arrays import Array
from framework.numerics.fields import LARGEST_NUMBER

LEADING_BLANKS = "\ufeff \t\r\n"  # may stand before the first element
MAX_XML_ELEMENTS = 200_000
MAX_YAML_CHARACTERS = 500_000
MAX_YAML_VALUES = 20_000  # aliases written out


@contextmanager
def prefix_errors(path: Path | str, kind: type[InvalidInput] = RobotFileError) -> Iterator[None]:
    """Put the name of a file in front of errors in its content, of type `kind`.

    Content that is nested too deeply for Python is such an error.
    """
    try:
        yield
    except MissingPackage as error:
        raise MissingPackage(f"{path}: {error}", package=error.package) from None
    except InvalidInput as error:
        raise kind(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    except RecursionError:
        raise kind(f"{path}: nested too deeply") from None


def parse_xml(text: str) -> Element:
    """Parse an XML text without a document type; return its root.

    Raises:
        RobotFileError: it has one (entities can grow without bound), has more than MAX_XML_ELEMENTS elements,
            or is not well-formed.
    """
    text = text.lstrip(LEADING_BLANKS)
    try:
        return _build_tree(text)
    except RobotFileError:
        raise
    except (ParseError, ValueError) as error:
        try:
            return _build_tree(_mend_xml(text))
        except (ParseError, ValueError):
            raise RobotFileError(f"not well-formed XML: {error}") from None


def _build_tree(text: str) -> Element:
    """Parse well-formed XML within the limits of `_Builder`."""
    return ElementTree.fromstring(text, ElementTree.XMLParser(target=_Builder()))


def _mend_xml(text: str) -> str:
    """Declare the prefixes of an XML text and empty its comments, which other parsers forgive."""
    text = re.sub(r"<!--.*?-->", lambda comment: "\n" * comment[0].count("\n"), text, flags=re.DOTALL)
    used = set(re.findall(r"[<\s]/?([A-Za-z_][\w.-]*):[A-Za-z_][\w.-]*(?=[\s=/>])", text)) - {"xml", "xmlns"}
    new = "".join(f' xmlns:{name}="{name}"' for name in sorted(used) if f"xmlns:{name}" not in text)
    return re.sub(r"<[A-Za-z_][\w.:-]*", lambda tag: tag[0] + new, text, count=1)


class _Builder(TreeBuilder):
    """Builds a tree of elements, and counts its elements."""

    def __init__(self) -> None:
        super().__init__()
        self._count = 0

    def start(self, tag: str, attrs: dict[str, str]) -> Element:
        """Begin an element; refuse more than `MAX_XML_ELEMENTS`."""
        self._count += 1
        if self._count > MAX_XML_ELEMENTS:
            raise RobotFileError(f"more than {MAX_XML_ELEMENTS} XML elements")
        return super().start(tag, attrs)

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Refuse a document type."""
        raise RobotFileError("<!DOCTYPE>: document types and entities are not read; leave them out")


def parse_yaml(text: str) -> Any:
    """Parse a YAML text of limited size, aliases written out; raise RobotFileError for duplicate keys."""
    if len(text) > MAX_YAML_CHARACTERS:
        raise RobotFileError(f"{len(text)} characters of YAML; at most {MAX_YAML_CHARACTERS} are read")
    try:
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            if _count_values(node, {}) > MAX_YAML_VALUES:
                raise _alias_error()
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except RobotFileError:
        raise
    # PyYAML on odd scalars and keys raises anything
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, AttributeError) as error:
        raise RobotFileError(f"not valid YAML: {' '.join(str(error).split())}") from None


class _Loader(Composer, CParser, SafeConstructor, Resolver):
    """SafeLoader that counts nodes and refuses duplicate keys.

    Read by libyaml, which takes a seventh of the time, but composed in Python, where each node is counted and
    has its line.
    """

    def __init__(self, text: str) -> None:
        """Set up libyaml's parser and the stages of a safe loader."""
        CParser.__init__(self, text)
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        Resolver.__init__(self)
        self._count = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a node; refuse more than `MAX_YAML_VALUES`."""
        self._count += 1
        if self._count > MAX_YAML_VALUES:
            raise _alias_error()
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        """Construct a mapping; refuse a key that occurs twice, with both lines."""
        lines: dict[Hashable, int] = {}
        for key_node, _ in node.value:
            key, line = self.construct_object(key_node, deep=True), key_node.start_mark.line + 1
            if not isinstance(key, Hashable):
                continue  # told below
            if key in lines:
                raise RobotFileError(
                    f"{reprlib.repr(key)}: duplicate key, in line {lines[key]} and in line {line}"
                )
            lines[key] = line
        return super().construct_mapping(node, deep=deep)


def _alias_error() -> RobotFileError:
    """Return the error for too many values."""
    return RobotFileError(f"aliases: more than {MAX_YAML_VALUES} values when written out, or endless")


def _count_values(node: yaml.Node, counted: dict[int, int]) -> int:
    """Count the values of a node, aliases written out; `counted` by node id."""
    if id(node) in counted:
        return counted[id(node)]
    counted[id(node)] = MAX_YAML_VALUES + 1  # for those met again below themselves
    total = 1
    if isinstance(node, yaml.SequenceNode):
        total += sum(_count_values(child, counted) for child in node.value)
    elif isinstance(node, yaml.MappingNode):
        total += sum(_count_values(child, counted) for pair in node.value for child in pair)
    counted[id(node)] = total
    return total


# ------------------------------------------------------------------ elements of XML


def parse_numbers(
    where: str, text: str | None, count: int, *, largest: float = LARGEST_NUMBER
) -> tuple[float, ...]:
    """Parse an attribute's text as `count` finite numbers of at most `largest`."""
    try:
        values = tuple(map(float, (text or "").split()))
    except ValueError:
        values = (math.nan,)
    problem = ""
    if not all(map(math.isfinite, values)):
        problem = "needs finite numbers"
    elif max(map(abs, values), default=0.0) > largest:
        problem = f"must be at most {largest:g} in size"
    elif len(values) != count:
        problem = f"needs {count} number{'s' * (count != 1)}"
    if problem:
        raise RobotFileError(f"{where}: {problem}, got {short(text)}")
    return values


def read_number(element: Element, where: str, key: str, default: str | None = None) -> float:
    """Parse the number in an attribute, a required one without `default`."""
    text = attribute(element, where, key) if default is None else element.get(key, default)
    return parse_numbers(where if key == "value" else f"{where} {key}", text, 1)[0]


def check_parts(element: Element, where: str, children: Collection[str], attributes: Collection[str]) -> None:
    """Refuse unknown and repeated children, and attributes that resemble a valid one."""
    tags = [child.tag for child in element]
    for tag in tags:
        check_name(where, "element", tag, children)
        if tags.count(tag) > 1:
            raise RobotFileError(f"{where}: duplicate <{tag}>")
    for attribute in element.attrib:
        if nearest(attribute, attributes):
            check_name(where, "attribute", attribute, attributes)


def child_element(element: Element, where: str, tag: str) -> Element:
    """Return the child with this tag; raise RobotFileError if missing."""
    child = element.find(tag)
    if child is None:
        given = ", ".join(f"<{child.tag}>" for child in element) or "nothing"
        raise RobotFileError(f"{where}: <{tag}> is missing (given: {given})")
    return child


def attribute(element: Element, where: str, key: str) -> str:
    """Return an attribute; raise RobotFileError if missing or empty."""
    value = element.get(key)
    if not value:
        given = ", ".join(element.attrib) or "nothing"
        raise RobotFileError(f"{where}: attribute {key!r} is missing or empty (given: {given})")
    return value


def remove_children(element: Element, *tags: str) -> None:
    """Remove all children with one of the tags."""
    for tag in tags:
        for child in element.findall(tag):
            element.remove(child)


def read_origin(element: Element | None, where: str) -> Array:
    """Read the placement (4, 4) of an `<origin xyz rpy>`; the identity without one."""
    if element is None:
        return np.eye(4)
    check_parts(element, where, (), ("xyz", "rpy"))
    xyz = parse_numbers(f"{where} xyz", element.get("xyz", "0 0 0"), 3)
    rpy = parse_numbers(f"{where} rpy", element.get("rpy", "0 0 0"), 3)
    return placement(from_rpy(rpy) if any(rpy) else None, xyz)


def read_axis(element: Element, where: str) -> Array:
    """Read the direction (3,) of an `<axis xyz>`, which must not be zero."""
    check_parts(element, where, (), ("xyz",))
    axis = np.array(parse_numbers(f"{where} xyz", attribute(element, where, "xyz"), 3))
    if np.abs(axis).max() < SMALLEST_LENGTH:
        raise RobotFileError(f"{where}: the axis is zero")
    return axis
