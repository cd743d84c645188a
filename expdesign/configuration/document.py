"""YAML files and mappings as plain data, with the line of every key."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
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

from expdesign.configuration.errors import InputError, Key, Problem, key_path, nearest_name, quote

LARGEST_FILE = 512 * 1024
"""Bytes of a YAML file; a robot with every key has a hundredth."""

LARGEST_EXPANSION = 50_000
"""Number of values in a YAML file with its anchors expanded."""

_SUFFIXES = (".yaml", ".yml")


@dataclass(frozen=True)
class Document:
    """Plain data (dict, list, str, int, float, bool, None) and its origin."""

    data: dict[str, Any]
    file: Path | None = None
    """None for a mapping from a program."""
    lines: Mapping[Key, int] = field(default_factory=dict)
    """Line of every key and list item, from one."""
    texts: Mapping[Key, str] = field(default_factory=dict)
    """Numbers and texts with the digits of the file."""
    questions: tuple[str, ...] = ()
    """Keys after comments ``# ?``, which mark values as assumed."""

    @property
    def label(self) -> str:
        """File name, or ``configuration``."""
        return "configuration" if self.file is None else self.file.name

    @property
    def folder(self) -> Path:
        """Folder for relative paths of the document."""
        return Path.cwd() if self.file is None else self.file.parent

    def line(self, key: Key) -> int | None:
        """Return the line of a key, or of the innermost known key around it."""
        known = (key[:length] for length in range(len(key), 0, -1) if key[:length] in self.lines)
        return next((self.lines[part] for part in known), None)

    @property
    def warnings(self) -> list[str]:
        """One warning if values are marked as assumed."""
        asked = ", ".join(self.questions)
        return [f"assumed, to be checked (`# ?` in {self.label}): {asked}"] if asked else []

    def problem(
        self, key: Key, message: str, allowed: str | None = None, nearest: str | None = None
    ) -> Problem:
        """Return a problem of the value at a key."""
        return Problem(message, self.file, self.line(key), key_path(key), allowed, nearest)


Value_co = TypeVar("Value_co", covariant=True)


@dataclass(frozen=True)
class Located(Generic[Value_co]):
    """A value and its place in a document."""

    value: Value_co
    document: Document
    key: Key = ()

    def problem(self, key: Key, message: str, allowed: str | None = None) -> Problem:
        """Return a problem of the value at a key inside this value."""
        return self.document.problem((*self.key, *key), message, allowed)


def document_from_mapping(mapping: Mapping[Any, Any]) -> Document:
    """Copy a mapping to plain data: tuples and arrays become lists, NumPy numbers Python's.

    Examples
    --------
    >>> document_from_mapping({"home": (0.0, 1)}).data
    {'home': [0.0, 1]}
    """
    problems: list[Problem] = []

    def copy(value: Any, key: Key) -> Any:
        if isinstance(value, np.ndarray | np.generic):
            value = value.tolist()
        if isinstance(value, Mapping):
            problems.extend(
                Problem(f"the key {quote(name)} is not a text", key=key_path(key))
                for name in value
                if not isinstance(name, str)
            )
            items = value.items()
            return {name: copy(item, (*key, name)) for name, item in items if isinstance(name, str)}
        if isinstance(value, list | tuple):
            return [copy(item, (*key, place)) for place, item in enumerate(value)]
        if isinstance(value, Path):
            return str(value)
        if isinstance(value, bool) or not isinstance(value, Real):
            return value  # the schema refuses objects
        return int(value) if isinstance(value, Integral) else float(value)

    try:
        data = copy(mapping, ())
    except RecursionError:
        raise InputError("the mapping is nested too deeply") from None
    if problems:
        raise InputError(problems)
    return Document(data)


def absolute(path: str | PathLike[str], folder: Path | None = None) -> Path:
    """Return an absolute path with ``~`` expanded; relative ones start from a folder."""
    expanded = os.path.expanduser(Path(path))  # noqa: PTH111 - leaves unknown users as they are
    return (folder or Path.cwd()).absolute() / expanded


def find_file(
    name_or_path: str | PathLike[str],
    kind: str,
    shipped: Mapping[str, Path],
    folder: Path | None = None,
) -> Path:
    """Return the file for the name of a shipped robot or run, or for a path from a folder.

    `kind` is ``robot`` or ``run``. A path need not lead to a file.
    """
    path = absolute(name_or_path, folder)
    if not isinstance(name_or_path, str):
        return path
    if name_or_path in shipped:
        return shipped[name_or_path]
    is_path = "/" in name_or_path or name_or_path.lower().endswith(_SUFFIXES)
    if is_path or os.path.isfile(path):  # noqa: PTH113 - whatever the text is
        return path
    message = f"there is no file {quote(name_or_path)}, and no {kind} of this name is included"
    allowed = f"{', '.join(shipped)}, or the path of a {kind} file"
    raise InputError(message, allowed=allowed, nearest=nearest_name(name_or_path, shipped))


def read_text(path: Path, allowed: str, largest: int = 4 * 1024 * 1024) -> str:
    """Return the text of a file in UTF-8 of at most `largest` bytes.

    `allowed` describes the right content in error messages.
    """
    try:
        if path.is_dir():
            raise InputError("this is a folder, not a file", path)
        refuse_special(path, allowed)
        if path.stat().st_size > largest:
            most = f"{largest // 1024} KiB"
            raise InputError("the file is too large", path, allowed=most)
        raw = path.read_bytes()
    except FileNotFoundError:
        raise InputError("there is no such file", path) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be read: {reason}", path) from None
    if b"\0" in raw:
        raise InputError("the file is binary", path, allowed=allowed)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        message = f"byte 0x{raw[error.start]:02x} is not UTF-8"
        raise InputError(message, path, line, allowed=allowed) from None


def refuse_special(path: Path, allowed: str | None = None) -> None:
    """Refuse a pipe or a device: it may never end. A file, a folder or nothing is accepted."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise InputError("this is a pipe or device, not a file", path, allowed=allowed)


def read_yaml(path: Path, kind: str = "YAML file", keys: Collection[str] = ()) -> Document:
    """Read a YAML file with a mapping of plain data at its top level.

    Parameters
    ----------
    path : Path
    kind : str
        Name of this kind of file in messages.
    keys : collection of str, optional
        Top-level keys of this kind. A file without any of them belongs to another program; its
        content stays out of the message.

    Raises
    ------
    InputError
        The file is missing, empty, binary, not UTF-8, larger than `LARGEST_FILE`, not YAML, not a
        mapping or of another kind; a key occurs twice, a tag asks for more than plain data, an
        anchor contains itself, or the anchors expand to more than `LARGEST_EXPANSION` values.
    """
    text = read_text(path, "YAML in UTF-8", LARGEST_FILE)
    try:
        return replace(_read_document(text, kind, tuple(keys)), file=path)
    except InputError as error:
        raise InputError(replace(problem, file=path) for problem in error.problems) from None


@lru_cache(maxsize=32)
def _read_document(text: str, kind: str, keys: tuple[str, ...]) -> Document:
    """Return the document of a text, cached since files are read repeatedly and copied."""
    node = _compose(text)
    if node is None:
        raise InputError("the file is empty")
    if not isinstance(node, MappingNode):
        content = "a list" if isinstance(node, SequenceNode) else "one value"
        raise InputError(f"the file contains {content}", line=1, allowed="a mapping of keys")
    if keys and not any(name.value in keys for name in _names(node, [])):
        message = f"this is not a {kind}: it has none of its keys"
        raise InputError(message, allowed=f"the keys {', '.join(keys)}")
    converter = _Converter()
    data = converter.convert(node, (), ())
    if converter.problems or not isinstance(data, dict):
        raise InputError(converter.problems or "the file contains no mapping")
    questions = tuple(_open_questions(text))
    return Document(data, lines=converter.lines, texts=converter.texts, questions=questions)


_QUESTIONS = re.compile(r"((?:^ *# \?.*\n?)+)(?: *(?:# )?(\w+):)?", re.MULTILINE)
_QUESTION_OF_A_KEY = re.compile(r"^ *# \? ([a-z]\w*):", re.MULTILINE)


def _open_questions(text: str) -> Iterator[str]:
    """Yield the keys of comments that begin with ``# ?``: their own, or the next one in the file.

    A question without any has its line.
    """
    for found in _QUESTIONS.finditer(text):
        line = f"line {text.count(chr(10), 0, found.start()) + 1}"
        yield from dict.fromkeys(_QUESTION_OF_A_KEY.findall(found[1]) or [found[2] or line])


# ruamel.yaml raises all of these for malformed input.
_READER_FAILURES = (YAMLError, ValueError, LookupError, AttributeError, TypeError, AssertionError)
_QUOTED = re.compile(r"(['\"]).{2,}\1", re.DOTALL)


def _compose(text: str) -> Node | None:
    """Return the nodes of a text."""
    try:
        reader = YAML(typ="safe", pure=True)
        reader.composer.warn_double_anchors = False  # YAML allows them
        node: Node | None = reader.compose(text)
    except RecursionError:
        raise InputError("the values are nested too deeply") from None
    except _READER_FAILURES as error:
        line, message = None, "not valid YAML"
        if isinstance(error, MarkedYAMLError):
            marks = [mark.line for mark in (error.context_mark, error.problem_mark) if mark]
            line = marks[-1] + 1 if marks else None
            # The file may be anybody's: no quotations from it.
            reason = _QUOTED.sub("", str(error.problem or error.context))
            message = f"not valid YAML: {_printable(reason).strip()}"
            lines = text.splitlines()
            for number in range(marks[0], marks[-1] + 1) if marks else ():
                if number >= len(lines):
                    break
                indented = re.match(r" *\t", lines[number]) is not None
                if indented or ("token" in reason and "\t" in lines[number]):
                    line, verb = number + 1, "is indented with" if indented else "contains"
                    message = f"line {line} {verb} a tab; YAML allows spaces only"
                    break
        raise InputError(message, line=line) from None
    return node


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)


_TAG = "tag:yaml.org,2002:"
_MERGE = f"{_TAG}merge"
_TEXT_TAGS = (f"{_TAG}str", f"{_TAG}timestamp", f"{_TAG}value")
_SCALAR_TAGS = tuple(f"{_TAG}{kind}" for kind in ("bool", "int", "float", "null"))
_DEEPEST = 40


def _names(node: Node, seen: list[int]) -> Iterator[ScalarNode]:
    """Yield the keys of a mapping and of the mappings that it merges."""
    if id(node) in seen:
        return
    seen.append(id(node))
    if isinstance(node, SequenceNode):
        for part in node.value:
            yield from _names(part, seen)
    elif isinstance(node, MappingNode):
        for name, value in node.value:
            if str(name.tag) == _MERGE:
                yield from _names(value, seen)
            elif isinstance(name, ScalarNode):
                yield name


class _Converter:
    """Converts nodes to plain data; collects the problems that allow it to continue."""

    def __init__(self) -> None:
        self.lines: dict[Key, int] = {}
        self.texts: dict[Key, str] = {}
        self.problems: list[Problem] = []
        self._count = 0
        self._scalars = SafeConstructor(loader=YAML(typ="safe", pure=True))

    def convert(self, node: Node, key: Key, ancestors: tuple[int, ...]) -> Any:
        """Return the value of a node; its anchor must not name one of the `ancestors`."""
        self._count += 1
        for fault, message in (
            (self._count > LARGEST_EXPANSION, f"more than {LARGEST_EXPANSION} values in all"),
            (id(node) in ancestors, "the anchor contains itself"),
            (len(ancestors) > _DEEPEST, "the values are nested too deeply"),
        ):
            if fault:
                raise InputError(message, line=_line(node), key=key_path(key[:2]))
        within = (*ancestors, id(node))
        if isinstance(node, ScalarNode):
            return self._scalar(node, key)
        kind = "seq" if isinstance(node, SequenceNode) else "map"
        if str(node.tag) != f"{_TAG}{kind}":
            return self._refuse_tag(node, key)
        if isinstance(node, MappingNode):
            return self._mapping(node, key, within)
        self.lines |= {(*key, place): _line(item) for place, item in enumerate(node.value)}
        return [self.convert(item, (*key, k), within) for k, item in enumerate(node.value)]

    def _mapping(self, node: MappingNode, key: Key, within: tuple[int, ...]) -> dict[str, Any]:
        data: dict[str, Any] = {}
        merged: dict[str, Any] = {}
        for name_node, value_node in node.value:
            if str(name_node.tag) == _MERGE:
                merged = self._merged(value_node, key, within) | merged
        for name_node, value_node in node.value:
            if str(name_node.tag) == _MERGE or (name := self._name(name_node, key)) is None:
                continue
            path = (*key, name)
            if name in data:
                first = self.lines[path]
                self._report(name_node, path, f"the key occurs twice; it is also in line {first}")
                continue
            self.lines[path] = _line(name_node)
            data[name] = self.convert(value_node, path, within)
        return data | {name: value for name, value in merged.items() if name not in data}

    def _merged(self, node: Node, key: Key, within: tuple[int, ...]) -> dict[str, Any]:
        merged: dict[str, Any] = {}
        for part in node.value if isinstance(node, SequenceNode) else [node]:
            if isinstance(part, MappingNode):
                merged = (self.convert(part, key, within) or {}) | merged
            else:
                self._report(part, key, "only mappings can be merged with <<")
        return merged

    def _name(self, node: Node, key: Key) -> str | None:
        name = self._scalar(node, key) if isinstance(node, ScalarNode) else None
        if isinstance(name, str):
            return name
        hint = "put it in quotes"
        if isinstance(name, int | float) and not isinstance(name, bool):
            hint += ", or write decimals with a point: a comma begins the next key or value"
        self._report(node, key, f"a key is not a text; {hint}")
        return None

    def _scalar(self, node: ScalarNode, key: Key) -> Any:
        self.texts[key] = node.value
        try:
            if str(node.tag) in _TEXT_TAGS:
                return node.value
            if str(node.tag) in _SCALAR_TAGS:
                return self._scalars.construct_object(node)
        except (ValueError, LookupError, OverflowError):
            return self._report(node, key, f"{quote(node.value)} cannot be read with its tag")
        return self._refuse_tag(node, key)

    def _refuse_tag(self, node: Node, key: Key) -> None:
        tag = _printable(str(node.tag).replace(_TAG, "!!"))
        self._report(node, key, f"the tag {tag} is not allowed", "plain data without tags")

    def _report(self, node: Node, key: Key, message: str, allowed: str | None = None) -> None:
        self.problems.append(Problem(message, None, _line(node), key_path(key), allowed))


def _line(node: Node) -> int:
    return int(node.start_mark.line) + 1
