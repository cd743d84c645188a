"""A YAML file as plain data with the line of every key.

A file is composed into nodes by ruamel.yaml's pure Python reader and only then converted, by this
module: only the plain types of YAML's core schema, every key once, anchors expanded up to a
bound, and the line of every key remembered.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from expdesign.configuration.document import DEEPEST, HALF_PAIR, Document
from expdesign.configuration.problem import InputError, Key, Problem, key_path, shown
from expdesign.configuration.text_file import read_text

LARGEST_FILE = 512 * 1024
"""Bytes; a robot with every key is a hundred times smaller."""

LARGEST_EXPANSION = 50_000
"""Values of a file after its anchors are expanded."""

_QUOTED = re.compile(r"(['\"]).{2,}\1", re.DOTALL)
_TAG = "tag:yaml.org,2002:"
_TEXT_TAGS = (f"{_TAG}str", f"{_TAG}timestamp", f"{_TAG}value")
_SCALAR_TAGS = tuple(f"{_TAG}{kind}" for kind in ("bool", "int", "float", "null"))
_MERGE = f"{_TAG}merge"

# ruamel.yaml meets malformed input with these, too.
_READER_FAILURES = (YAMLError, ValueError, LookupError, AttributeError, TypeError, AssertionError)


@dataclass(frozen=True)
class FileKind:
    """What a file should be, told by the keys of its top level."""

    name: str
    """Such as ``run file``."""
    keys: Collection[str]
    """A file with none of them is another program's."""


def read_yaml(path: Path, kind: FileKind | None = None) -> Document:
    """Read one YAML file in UTF-8, of at most `LARGEST_FILE` bytes, whose top level is a mapping.

    Parameters
    ----------
    path : Path
    kind : FileKind, optional
        What it should be; any mapping by default.

    Raises
    ------
    InputError
        If the file is missing, a folder, empty, binary, not UTF-8, too large, no YAML, no mapping
        or nothing of its kind; if a key stands twice, a tag asks for more than plain data, an
        anchor contains itself, or the anchors expand to more than `LARGEST_EXPANSION` values.
    """
    text = read_text(path, LARGEST_FILE, "YAML in UTF-8")
    node = _compose(path, text)
    if node is None:
        raise InputError("the file is empty", path)
    if not isinstance(node, MappingNode):
        # Any file may be named here: what is no mapping is not ours to show.
        held = "a list" if isinstance(node, SequenceNode) else "one value"
        raise InputError(f"the file holds {held}", path, 1, allowed="a mapping of keys")
    if kind is not None and _top_keys(node).isdisjoint(kind.keys):
        # Nor is this one: neither its keys nor what else is wrong with it.
        message = f"this is no {kind.name}: it has none of the keys of one"
        raise InputError(message, path, allowed=f"the keys {', '.join(kind.keys)}")
    converter = _Converter(path)
    data = converter.convert(node, (), ())
    if converter.problems or not isinstance(data, dict):
        raise InputError(converter.problems or "the file holds no mapping", path)
    return Document(data, path, converter.lines, converter.texts)


@lru_cache(maxsize=8)
def _compose(path: Path, text: str) -> Node | None:
    """Return the nodes of a text, which nobody changes: a robot is often read again."""
    try:
        reader = YAML(typ="safe", pure=True)
        reader.composer.warn_double_anchors = False  # YAML allows them
        node: Node | None = reader.compose(text)
    except RecursionError:
        raise InputError("the values are nested too deeply", path) from None
    except _READER_FAILURES as error:
        line = None
        message = "not valid YAML"
        if isinstance(error, MarkedYAMLError):
            mark = error.problem_mark or error.context_mark
            line = None if mark is None else mark.line + 1
            # Without the texts that it quotes: the file may be any.
            told = _QUOTED.sub("", str(error.problem or error.context))
            message = f"not valid YAML: {_printable(told).strip()}"
        raise InputError(message, path, line) from None
    return node


def _top_keys(node: MappingNode) -> set[str]:
    """Return the keys of a mapping, with those of mappings that are merged into it."""
    found, seen, waiting = set[str](), set[int](), list[Node]([node])
    while waiting:
        part = waiting.pop()
        if id(part) in seen:  # an anchor, which may be merged into itself
            continue
        seen.add(id(part))
        if isinstance(part, SequenceNode):
            waiting += part.value
        elif isinstance(part, MappingNode):
            waiting += (value for name, value in part.value if str(name.tag) == _MERGE)
            found |= {name.value for name, _ in part.value if isinstance(name, ScalarNode)}
    return found


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)


class _Converter:
    """Nodes to plain data; collects the problems that do not stop it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: dict[Key, int] = {}
        self.texts: dict[Key, str] = {}
        self.problems: list[Problem] = []
        self._count = 0
        self._scalars = SafeConstructor(loader=YAML(typ="safe", pure=True))

    def convert(self, node: Node, key: Key, ancestors: tuple[int, ...]) -> Any:
        self._count += 1
        if self._count > LARGEST_EXPANSION:
            raise self._stop(node, key[:2], f"more than {LARGEST_EXPANSION} values after expansion")
        if id(node) in ancestors:
            raise self._stop(node, key[:2], "the anchor contains itself")
        if len(ancestors) > DEEPEST:
            raise self._stop(node, key[:2], "the values are nested too deeply")
        within = (*ancestors, id(node))
        if isinstance(node, ScalarNode):
            return self._scalar(node, key)
        if isinstance(node, SequenceNode) and self._plain(node, key, "seq"):
            items = []
            for position, item in enumerate(node.value):
                self.lines[*key, position] = _line(item)
                items.append(self.convert(item, (*key, position), within))
            return items
        if isinstance(node, MappingNode) and self._plain(node, key, "map"):
            return self._mapping(node, key, within)
        return None

    def _mapping(self, node: MappingNode, key: Key, within: tuple[int, ...]) -> dict[str, Any]:
        data: dict[str, Any] = {}
        merged: dict[str, Any] = {}
        for name_node, value_node in node.value:
            if str(name_node.tag) == _MERGE:
                merged = self._merged(value_node, key, within) | merged
        for name_node, value_node in node.value:
            if str(name_node.tag) == _MERGE:
                continue
            name = self._name(name_node, key)
            if name is None:
                continue
            path = (*key, name)
            if name in data:
                first = self.lines[path]
                self._report(name_node, path, f"the key stands twice; it is also in line {first}")
                continue
            self.lines[path] = _line(name_node)
            data[name] = self.convert(value_node, path, within)
        return data | {name: value for name, value in merged.items() if name not in data}

    def _merged(self, node: Node, key: Key, within: tuple[int, ...]) -> dict[str, Any]:
        parts = node.value if isinstance(node, SequenceNode) else [node]
        merged: dict[str, Any] = {}
        for part in parts:
            value = self.convert(part, key, within) if isinstance(part, MappingNode) else None
            if not isinstance(value, dict):
                self._report(part, key, "only mappings can be merged with <<")
                continue
            merged = value | merged
        return merged

    def _name(self, node: Node, key: Key) -> str | None:
        name = self._scalar(node, key) if isinstance(node, ScalarNode) else None
        if isinstance(name, str):
            return name
        hint = "put it in quotes"
        if isinstance(name, int | float) and not isinstance(name, bool):
            hint += ", or write decimals with a point: a comma begins the next key or value"
        self._report(node, key, f"a key is no text; {hint}")
        return None

    def _scalar(self, node: ScalarNode, key: Key) -> Any:
        text: str = node.value
        self.texts[key] = text
        try:
            if str(node.tag) in _TEXT_TAGS:
                text.encode()
                return text
            if str(node.tag) in _SCALAR_TAGS:
                return self._scalars.construct_object(node)
            self._refuse_tag(node, key)
        except UnicodeEncodeError:
            self._report(node, key, HALF_PAIR)
        except (ValueError, LookupError, OverflowError):
            self._report(node, key, f"{shown(text)} cannot be read as what it is tagged")
        return None

    def _plain(self, node: Node, key: Key, kind: str) -> bool:
        if str(node.tag) == f"{_TAG}{kind}":
            return True
        self._refuse_tag(node, key)
        return False

    def _refuse_tag(self, node: Node, key: Key) -> None:
        tag = _printable(str(node.tag).replace(_TAG, "!!"))
        self._report(node, key, f"the tag {tag} is not allowed", "plain data without tags")

    def _report(self, node: Node, key: Key, message: str, allowed: str | None = None) -> None:
        self.problems.append(Problem(message, self.path, _line(node), key_path(key), allowed))

    def _stop(self, node: Node, key: Key, message: str) -> InputError:
        return InputError(message, self.path, _line(node), key_path(key))


def _line(node: Node) -> int:
    return int(node.start_mark.line) + 1
