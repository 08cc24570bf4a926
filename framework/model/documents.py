"""Parse XML and YAML from untrusted files within limits; read attributes and children of an XML element.

In all functions `where` names the element in messages, such as "joint 'hip': <axis>".
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Hashable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, ParseError, TreeBuilder

import numpy as np
import yaml
from yaml import CSafeLoader
from yaml.composer import Composer

from framework.errors import (
    LARGEST_NUMBER,
    InvalidInput,
    MissingPackage,
    RobotFileError,
    check_name,
    nearest,
    short,
)
from framework.model.description import SMALLEST_LENGTH
from framework.model.placement import from_rpy, placement
from framework.numerics.arrays import Array

LEADING_BLANKS = "\ufeff \t\r\n"  # characters that may precede the first element
MAX_XML_ELEMENTS = 200_000
MAX_YAML_VALUES = 20_000  # with aliases expanded
MAX_YAML_CHARACTERS = 25 * MAX_YAML_VALUES
# patterns that mend XML which other parsers accept
_COMMENT = re.compile(r"<!--.*?(?:-->|\Z)", re.DOTALL)  # one without an end is sought once
_PREFIX = re.compile(r"[<\s]/?([A-Za-z_][\w.-]*):[A-Za-z_][\w.-]*(?=[\s=/>])")  # of an element or attribute
# what is no XML before a program has filled it in, by a mark that no XML has
_TEMPLATES = {
    "<%": "a template of ERB: fill it in first: erb FILE > OUT",
    "{%": "a template of Jinja: render it first, and give the result",
}
_DECLARED = re.compile(r"xmlns:([\w.-]+)")
_TAG = re.compile(r"<[A-Za-z_][\w.:-]*")  # the first match begins the root element


@contextmanager
def prefix_errors(path: Path | str, kind: type[InvalidInput] = RobotFileError) -> Iterator[None]:
    """Prefix the errors of the block with the name of a file.

    InvalidInput becomes an error of this `kind`; MissingPackage stays one. Content that is nested too deeply
    for Python counts as an error of the content.
    """
    try:
        yield
    except InvalidInput as error:
        is_named = error.name == str(path)  # by an inner block
        message = error.sentence if is_named else str(error)
        if isinstance(error, MissingPackage):
            raise MissingPackage(message, package=error.package).naming(str(path)) from None
        raise kind(message).naming(str(path)) from None
    except RecursionError:
        raise kind("nested too deeply").naming(str(path)) from None


def parse_xml(text: str) -> Element:
    """Parse an XML text without a document type; return its root.

    Raises:
        RobotFileError: the text has a document type (its entities can grow without bound), has more than
            MAX_XML_ELEMENTS elements, or is not well-formed.
    """
    text = text.lstrip(LEADING_BLANKS)
    try:
        return _build_tree(text)
    except RobotFileError:  # a document type or too many elements; it is a ValueError, too
        raise
    except (ParseError, ValueError) as error:
        fault = str(error)
    try:
        return _build_tree(_mend_xml(text))
    except (ParseError, ValueError):  # also a RobotFileError, which the fault has hidden so far
        template = next((words for mark, words in _TEMPLATES.items() if mark in text), "")
        raise RobotFileError(template or f"not well-formed XML: {fault}") from None


def _mend_xml(text: str) -> str:
    """Mend two faults that other parsers accept: comments with `--` in them, undeclared prefixes."""
    text = erase_matches(_COMMENT, text)
    prefixes = set(_PREFIX.findall(text)) - {"xml", "xmlns"}
    undeclared = sorted(prefixes.difference(_DECLARED.findall(text)))
    declarations = "".join(f' xmlns:{name}="{name}"' for name in undeclared)
    return _TAG.sub(lambda tag: tag[0] + declarations, text, count=1)  # of the root


def _build_tree(text: str) -> Element:
    """Parse well-formed XML within the limits of `_Builder`; drop the namespace of the root."""
    root = ElementTree.fromstring(text, ElementTree.XMLParser(target=_Builder()))
    namespace, brace, _ = root.tag.rpartition("}")
    for element in root.iter() if brace else ():
        element.tag = element.tag.removeprefix(namespace + brace)
    return root


def erase_matches(pattern: re.Pattern[str], text: str) -> str:
    """Erase all matches of a pattern except line breaks, so that line numbers stay the same."""
    return pattern.sub(lambda match: "\n" * match[0].count("\n"), text)


class _Builder(TreeBuilder):
    """Builds a tree of elements within limits."""

    _count = 0  # of elements

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
    """Parse a YAML text within limits, aliases expanded.

    Raises:
        RobotFileError: the text is too large, is not valid YAML, or repeats a key of a mapping.
    """
    if len(text) > MAX_YAML_CHARACTERS:
        raise RobotFileError(f"{len(text)} characters of YAML; at most {MAX_YAML_CHARACTERS} are read")
    try:
        return _Loader(text).get_single_data()
    except RobotFileError:
        raise
    # PyYAML raises any of these on odd scalars and keys
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, AttributeError) as error:
        raise RobotFileError(f"not valid YAML: {' '.join(str(error).split())}") from None


class _Loader(Composer, CSafeLoader):
    """Safe loader that counts values, aliases expanded, and refuses duplicate keys.

    libyaml parses the text, in a seventh of the time of PyYAML's own parser. PyYAML's composer in Python
    makes the nodes, so that they can be counted and have line numbers.
    """

    def __init__(self, text: str) -> None:
        """Set up libyaml's parser and PyYAML's composer."""
        CSafeLoader.__init__(self, text)
        Composer.__init__(self)
        self._count = 0  # of all values so far
        self._counts: dict[int, int] = {}  # of the values in each finished node, by its id

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a node and its children, or return the node of an alias; count their values."""
        if self.check_event(yaml.AliasEvent):
            node = super().compose_node(parent, index)
            # a node that is not finished contains itself: it has endlessly many values
            self._add_values(self._counts.get(id(node), MAX_YAML_VALUES))
            return node
        count_before = self._count
        self._add_values(1)
        node = super().compose_node(parent, index)
        self._counts[id(node)] = self._count - count_before
        return node

    def _add_values(self, count: int) -> None:
        """Add to the count of values; refuse more than `MAX_YAML_VALUES`."""
        self._count += count
        if self._count > MAX_YAML_VALUES:
            raise RobotFileError(f"aliases: more than {MAX_YAML_VALUES} values when written out, or endless")

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        """Construct a mapping; refuse a key that occurs twice, with both lines."""
        lines: dict[Hashable, int] = {}
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                continue  # PyYAML's method, called below, raises the error
            line = key_node.start_mark.line + 1
            if key in lines:
                raise RobotFileError(f"{short(key)}: duplicate key, in line {lines[key]} and in line {line}")
            lines[key] = line
        return super().construct_mapping(node, deep=deep)


# ------------------------------------------------------------------ elements of XML


def parse_numbers(
    where: str, text: str | None, count: int, *, largest: float = LARGEST_NUMBER
) -> tuple[float, ...]:
    """Parse a text as `count` finite numbers, of magnitude up to `largest`.

    Raises:
        RobotFileError: the text is missing or is something else.
    """
    try:
        values = tuple(map(float, (text or "").split()))
    except ValueError:
        values = (math.nan,)  # refused below
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
    """Parse the number in the attribute `key`, else in the text `default`.

    Raises:
        RobotFileError: this is no finite number, or the attribute is missing and there is no default.
    """
    text = attribute(element, where, key) if default is None else element.get(key, default)
    (number,) = parse_numbers(f"{where} {key}", text, 1)
    return number


def check_parts(element: Element, where: str, children: Collection[str], attributes: Collection[str]) -> None:
    """Refuse unknown and repeated children, and attributes that resemble a valid one.

    Args:
        element: of a URDF or one of its dialects.
        children: valid tags.
        attributes: valid names of attributes. Others that resemble none of these belong to other programs.

    Raises:
        RobotFileError: a child is unknown or repeated, or an attribute is probably a misspelling.
    """
    tags = [child.tag for child in element]
    for tag in tags:
        check_name(where, "element", tag, children)
        if tags.count(tag) > 1:
            raise RobotFileError(f"{where}: duplicate <{tag}>")
    for attribute in element.attrib:
        if attribute not in attributes and nearest(attribute, attributes):
            check_name(where, "attribute", attribute, attributes)


def child_element(element: Element, where: str, tag: str) -> Element:
    """Return the first child with this tag; raise RobotFileError if missing."""
    child = element.find(tag)
    if child is None:
        tags = ", ".join(f"<{other.tag}>" for other in element) or "nothing"
        raise RobotFileError(f"{where}: <{tag}> is missing (given: {tags})")
    return child


def attribute(element: Element, where: str, key: str) -> str:
    """Return the attribute `key` of an element; raise RobotFileError if missing or empty."""
    value = element.get(key)
    if not value:
        keys = ", ".join(element.attrib) or "nothing"
        raise RobotFileError(f"{where}: attribute {key!r} is missing or empty (given: {keys})")
    return value


def remove_children(element: Element, *tags: str) -> None:
    """Remove all children with one of the tags."""
    for tag in tags:
        for child in element.findall(tag):
            element.remove(child)


def read_origin(element: Element, where: str) -> Array:
    """Read the placement (4, 4) of an element's `<origin xyz rpy>` [m, rad]; the identity without one.

    Raises:
        RobotFileError: see `parse_origin`.
    """
    origin = element.find("origin")
    return np.eye(4) if origin is None else parse_origin(origin, f"{where}: <origin>")


def parse_origin(origin: Element, where: str) -> Array:
    """Return the placement (4, 4) of an element with attributes `xyz` [m] and `rpy` [rad].

    Raises:
        RobotFileError: the element has other parts, or its numbers are malformed.
    """
    check_parts(origin, where, (), ("xyz", "rpy"))
    xyz = parse_numbers(f"{where} xyz", origin.get("xyz", "0 0 0"), 3)
    rpy = parse_numbers(f"{where} rpy", origin.get("rpy", "0 0 0"), 3)
    return placement(from_rpy(rpy) if any(rpy) else None, xyz)


def read_link(element: Element, where: str, tag: str, links: Collection[str]) -> str:
    """Return the link that the child with this tag names.

    Raises:
        RobotFileError: the child or its attribute `link` is missing, or the link is none of `links`.
    """
    end = f"{where}: <{tag}>"
    link = attribute(child_element(element, where, tag), end, "link")
    check_name(end, "link", link, links)
    return link


def read_axis(element: Element, where: str) -> Array:
    """Read the direction (3,), of any length above zero, of an `<axis xyz>`.

    Raises:
        RobotFileError: the axis is missing, zero or malformed.
    """
    check_parts(element, where, (), ("xyz",))
    return parse_axis(where, attribute(element, where, "xyz"))


def parse_axis(where: str, text: str) -> Array:
    """Parse a text as the direction (3,) of an axis, of any length above zero.

    Raises:
        RobotFileError: the axis is zero or malformed.
    """
    axis = np.array(parse_numbers(f"{where} xyz", text, 3))
    if np.abs(axis).max() < SMALLEST_LENGTH:
        raise RobotFileError(f"{where}: the axis is zero")
    return axis
