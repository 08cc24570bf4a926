"""XML and YAML texts of strangers, parsed within limits."""

from __future__ import annotations

import re
import reprlib
import xml.etree.ElementTree as ElementTree
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.cyaml import CParser  # type: ignore[attr-defined]  # its stub forgets to export it
from yaml.resolver import Resolver

from framework.errors import InvalidInput, MissingPackage, RobotFileError

LEADING_BLANKS = "\ufeff \t\r\n"  # may stand before the first element
MAX_XML_ELEMENTS = 200_000
MAX_YAML_CHARACTERS = 500_000
MAX_YAML_VALUES = 20_000  # aliases written out


@contextmanager
def naming(path: Path | str, kind: type[InvalidInput] = RobotFileError) -> Iterator[None]:
    """Put the name of the file in front of errors in its content.

    Raises:
        InvalidInput: of this kind, with the name; also for what is nested so deeply that Python gives up.
    """
    try:
        yield
    except MissingPackage as error:
        raise MissingPackage(f"{path}: {error}", package=error.package) from None
    except InvalidInput as error:
        raise kind(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    except RecursionError:
        raise kind(f"{path}: nested too deeply") from None


def parse_xml(text: str) -> ElementTree.Element:
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
    except (ElementTree.ParseError, ValueError) as error:
        try:
            return _build_tree(_mend(text))
        except (ElementTree.ParseError, ValueError):
            raise RobotFileError(f"not well-formed XML: {error}") from None


def _build_tree(text: str) -> ElementTree.Element:
    return ElementTree.fromstring(text, ElementTree.XMLParser(target=_Builder()))


def _mend(text: str) -> str:
    """Return an XML text with prefixes declared and comments emptied, as other parsers accept."""
    text = re.sub(r"<!--.*?-->", lambda comment: "\n" * comment[0].count("\n"), text, flags=re.DOTALL)
    used = set(re.findall(r"[<\s]/?([A-Za-z_][\w.-]*):[A-Za-z_][\w.-]*(?=[\s=/>])", text)) - {"xml", "xmlns"}
    new = "".join(f' xmlns:{name}="{name}"' for name in sorted(used) if f"xmlns:{name}" not in text)
    return re.sub(r"<[A-Za-z_][\w.:-]*", lambda tag: tag[0] + new, text, count=1)


class _Builder(ElementTree.TreeBuilder):
    """Builds a tree, and counts."""

    def __init__(self) -> None:
        super().__init__()
        self._count = 0

    def start(self, tag: str, attrs: dict[str, str]) -> ElementTree.Element:
        """Begin an element; refuse more than `MAX_XML_ELEMENTS`."""
        self._count += 1
        if self._count > MAX_XML_ELEMENTS:
            raise RobotFileError(f"more than {MAX_XML_ELEMENTS} XML elements")
        return super().start(tag, attrs)

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise RobotFileError("<!DOCTYPE>: document types and entities are not read; leave them out")


def parse_yaml(text: str) -> Any:
    """Parse a YAML text; refuse a huge one, with aliases expanded.

    Raises:
        RobotFileError: it is not, has a duplicate key, or is no YAML.
    """
    if len(text) > MAX_YAML_CHARACTERS:
        raise RobotFileError(f"{len(text)} characters of YAML; at most {MAX_YAML_CHARACTERS} are read")
    try:
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            if _size(node, {}) > MAX_YAML_VALUES:
                raise _too_many()
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
            raise _too_many()
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


def _too_many() -> RobotFileError:
    return RobotFileError(f"aliases: more than {MAX_YAML_VALUES} values when written out, or endless")


def _size(node: yaml.Node, known: dict[int, int]) -> int:
    """Count the values of a node with its aliases written out; an alias of itself counts as too many."""
    if id(node) in known:
        return known[id(node)]
    known[id(node)] = MAX_YAML_VALUES + 1  # for those met again below themselves
    total = 1
    if isinstance(node, yaml.SequenceNode):
        total += sum(_size(child, known) for child in node.value)
    elif isinstance(node, yaml.MappingNode):
        total += sum(_size(child, known) for pair in node.value for child in pair)
    known[id(node)] = total
    return total
