"""Plain data with the line of every key, of a file or of a mapping in its place."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from expdesign.configuration.errors import InputError, Key, Problem, key_path, nearest, shown

LARGEST_MAPPING = 100_000
"""Values of a mapping that a program hands over."""
DEEPEST = 40
"""Levels of mappings and lists in each other."""
HALF_PAIR = "the text holds half of a surrogate pair"
"""What is wrong with a text that no file in UTF-8 can hold."""


@dataclass(frozen=True)
class Document:
    """Plain data (dict, list, str, int, float, bool, None) and where it comes from.

    `file` is None for a mapping that was handed over by a program; `lines` gives the line, from
    one, of every key and list item by its path, `texts` numbers and texts as they are written.
    """

    data: dict[str, Any]
    file: Path | None = None
    lines: Mapping[Key, int] = field(default_factory=dict)
    texts: Mapping[Key, str] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The file's name, or ``configuration``."""
        return "configuration" if self.file is None else self.file.name

    @property
    def folder(self) -> Path:
        """The folder that paths in the document are relative to."""
        return Path.cwd() if self.file is None else self.file.parent

    def line(self, key: Key) -> int | None:
        """Return the line of a key, or of what contains it."""
        for length in range(len(key), 0, -1):
            if key[:length] in self.lines:
                return self.lines[key[:length]]
        return None

    def problem(
        self, key: Key, message: str, allowed: str | None = None, nearest: str | None = None
    ) -> Problem:
        """Return a problem with the value at a key."""
        return Problem(message, self.file, self.line(key), key_path(key), allowed, nearest)


Value_co = TypeVar("Value_co", covariant=True)


@dataclass(frozen=True)
class Placed(Generic[Value_co]):
    """A value of a document, and where it stands there."""

    value: Value_co
    document: Document
    key: Key = ()

    def problem(self, key: Key, message: str, allowed: str | None = None) -> Problem:
        """Return a problem with what stands at a key of the value."""
        return self.document.problem((*self.key, *key), message, allowed)


def document_from_mapping(mapping: Mapping[Any, Any]) -> Document:
    """Copy a mapping to plain data: tuples and arrays become lists, NumPy numbers Python's.

    Refuse one with a key that is no text, that contains itself or far too many values.
    """
    copier = _Copier()
    data = copier.copy(mapping, (), 0)
    if copier.problems:
        raise InputError(copier.problems)
    return Document(data)


class _Copier:
    def __init__(self) -> None:
        self.problems: list[Problem] = []
        self.count = 0

    def copy(self, value: Any, key: Key, depth: int) -> Any:
        self.count += 1
        if depth > DEEPEST or self.count > LARGEST_MAPPING:
            raise InputError("the mapping is nested too deeply or too large", key=key_path(key[:4]))
        if isinstance(value, np.ndarray | np.generic):
            value = value.tolist()
        if isinstance(value, Mapping):
            return self._mapping(value, key, depth)
        if isinstance(value, list | tuple):
            return [self.copy(item, (*key, i), depth + 1) for i, item in enumerate(value)]
        if isinstance(value, str | Path):
            return self._text(str(value), key)
        if isinstance(value, Integral) and not isinstance(value, bool):
            return int(value)
        # What is no plain data is left to the schema, which refuses it.
        return float(value) if isinstance(value, Real) and not isinstance(value, bool) else value

    def _text(self, value: str, key: Key) -> str:
        if any("\ud800" <= character <= "\udfff" for character in value):
            self.problems.append(Problem(HALF_PAIR, key=key_path(key)))
        return value

    def _mapping(self, value: Mapping[Any, Any], key: Key, depth: int) -> dict[str, Any]:
        copied = {}
        for name, item in value.items():
            if isinstance(name, str):
                self._text(name, key)
                copied[name] = self.copy(item, (*key, name), depth + 1)
            else:
                problem = Problem(f"the key {shown(name)} is no text", key=key_path(key))
                self.problems.append(problem)
        return copied


def read_text(path: Path, largest: int, allowed: str) -> str:
    """Return the text of a file in UTF-8 of at most `largest` bytes; refuse any other.

    `allowed` is what the file should hold, for messages.
    """
    try:
        if stat.S_ISFIFO(path.stat().st_mode):
            # Opening one waits for whoever may write to it.
            raise InputError("this is a pipe, not a file", path, allowed=allowed)
        with path.open("rb") as stream:
            raw = stream.read(largest + 1)
    except FileNotFoundError:
        raise InputError("there is no such file", path) from None
    except IsADirectoryError:
        raise InputError("this is a folder, not a file", path) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be read: {reason}", path) from None
    if b"\0" in raw:
        raise InputError("the file is binary", path, allowed=allowed)
    if len(raw) > largest:
        most = f"{largest // 1024} KiB"
        raise InputError("the file is too large", path, allowed=most)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        message = f"byte 0x{raw[error.start]:02x} is not UTF-8"
        raise InputError(message, path, line, allowed=allowed) from None


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


_SUFFIXES = (".yaml", ".yml")


def absolute(path: str | PathLike[str], folder: Path | None = None) -> Path:
    """Return a path as absolute, ``~`` expanded, relative ones starting from a folder."""
    expanded = os.path.expanduser(Path(path))  # noqa: PTH111 - leaves unknown users as they are
    return (folder or Path.cwd()).absolute() / expanded


def find_file(
    name_or_path: str | PathLike[str],
    kind: str,
    shipped: dict[str, Path],
    folder: Path | None = None,
) -> Path:
    """Return the file of a robot or a run that ships, or that a path leads to.

    `kind` is ``robot`` or ``run``, `shipped` are files by their names; relative paths start from
    `folder`, by default the current one.

    Raises
    ------
    InputError
        If a name is not known; whether a path leads to a file is not checked.
    """
    path = absolute(name_or_path, folder)
    if not isinstance(name_or_path, str):
        return path
    if name_or_path in shipped:
        return shipped[name_or_path]
    is_path = any(mark in name_or_path for mark in "/\\")
    if is_path or name_or_path.lower().endswith(_SUFFIXES) or os.path.isfile(path):  # noqa: PTH113 - whatever the text is
        return path
    message = f"no {kind} {shown(name_or_path)} ships, and there is no such file"
    allowed = f"{', '.join(shipped)}, or the path of a {kind} file"
    raise InputError(message, allowed=allowed, nearest=nearest(name_or_path, shipped))
