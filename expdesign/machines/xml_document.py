"""XML files as elements with their lines; declarations of documents and entities are refused."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.document import read_text
from expdesign.configuration.errors import InputError, quote

_LARGEST = 4 * 1024 * 1024
_DEEPEST = 100
_MOST_ELEMENTS = 100_000


@dataclass
class Element:
    """An element of an XML file."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""

    @property
    def label(self) -> str:
        """The element as a message names it: ``joint 'leg1'``."""
        name = self.attributes.get("name")
        return f"<{self.tag}>" if name is None else f"<{self.tag} name={quote(name)}>"

    def all(self, *tags: str) -> list[Element]:
        """Return the children with these tags, in the order of the file."""
        return [child for child in self.children if child.tag in tags]

    def first(self, tag: str) -> Element | None:
        """Return the first child with a tag; None without one."""
        return next(iter(self.all(tag)), None)

    def refusal(self, message: str, allowed: str | None = None) -> InputError:
        """Return the error that says what is wrong with the element."""
        return InputError(message, self.file, self.line, self.label, allowed)

    def numbers(self, text: str, what: str, *counts: int) -> Array:
        """Return the finite numbers of a text; refuse any other text or count."""
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.array([np.nan])
        if not np.all(np.isfinite(values)) or (counts and len(values) not in counts):
            many = " or ".join(str(count) for count in counts) or "some"
            raise self.refusal(f"{what} is {quote(text.strip())}", f"{many} finite numbers")
        return values


def read_xml(file: Path, root: str) -> Element:
    """Return the root element of an XML file.

    Raises
    ------
    InputError
        The file cannot be read, is no well-formed XML, has another root than `root`, declares a
        document type or entities, or is nested too deeply or too large.
    """
    text = read_text(file, _LARGEST, "XML in UTF-8")
    builder = _Builder(file)
    try:
        builder.parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        message = f"not valid XML: {expat.errors.messages[error.code]}"
        raise InputError(message, file, error.lineno) from None
    found = builder.top.children[0]
    if found.tag != root:
        raise InputError(f"the file holds <{found.tag}>", file, found.line, allowed=f"<{root}>")
    return found


class _Builder:
    """The tree of elements that are open, and those that are complete."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.top = Element("", {}, file, 0)
        self.open = [self.top]
        self.count = 0
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._refuse_declaration
        self.parser.EntityDeclHandler = self._refuse_declaration

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self.parser.CurrentLineNumber
        self.count += 1
        if len(self.open) > _DEEPEST or self.count > _MOST_ELEMENTS:
            message = "the elements are nested too deeply or too many"
            raise InputError(message, self.file, line)
        element = Element(tag, attributes, self.file, line)
        self.open[-1].children.append(element)
        self.open.append(element)

    def _end(self, _tag: str) -> None:
        self.open.pop()

    def _text(self, text: str) -> None:
        self.open[-1].text += text

    def _refuse_declaration(self, *_declared: object) -> None:
        message = "the file declares a document type or entities"
        line = self.parser.CurrentLineNumber
        raise InputError(message, self.file, line, allowed="XML without <!DOCTYPE …>")
