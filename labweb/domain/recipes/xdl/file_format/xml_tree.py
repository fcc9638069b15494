"""XML as a tree that loses nothing a reader may need, with the place of every piece.

XDL files come from anywhere. No document type, no entity and no reference to the outside is
read, and size, depth and counts are bounded before anything is built.

Source:
    Extensible Markup Language (XML) 1.0, fifth edition.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from labweb.domain.errors import Finding, ProtocolError

MAX_BYTES = 8 * 1024 * 1024
"""Largest file that is read."""

MAX_DEPTH = 48
"""Deepest nesting; the root is at depth 1."""

MAX_NODES = 50_000
"""Most elements, comments and pieces of text."""

MAX_ATTRIBUTES = 64
MAX_TEXT = 10_000
"""Longest value, comment or piece of text."""

_ATTRIBUTE = re.compile(r"([^\s=/>\"']+)\s*=\s*(?:\"[^\"]*\"|'[^']*')")
_DECLARED = re.compile(rb"^<\?xml[^>]{0,200}?encoding\s*=\s*[\"']([A-Za-z0-9._-]{1,40})[\"']")
_ENCODINGS = {
    **dict.fromkeys(("utf-8", "utf8"), "utf-8"),
    **dict.fromkeys(("us-ascii", "ascii"), "ascii"),
    **dict.fromkeys(("iso-8859-1", "latin-1", "latin1"), "iso-8859-1"),
    **dict.fromkeys(("utf-16", "utf-16le", "utf-16be"), "utf-16"),
}


@dataclass(frozen=True, slots=True)
class FilePlace:
    """Where something stands in the file: counted from 1, or a path into a JSON document."""

    line: int = 0
    column: int = 0
    path: str = ""

    def __str__(self) -> str:
        return self.path or f"line {self.line}, column {self.column}"


NOWHERE = FilePlace()


@dataclass(frozen=True, slots=True)
class Attribute:
    """Name and text of one attribute."""

    name: str
    value: str
    place: FilePlace = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Comment:
    """What a person wrote for another person."""

    text: str


@dataclass(frozen=True, slots=True)
class XmlText:
    """Text between elements, without the blanks around it. It means nothing in XDL."""

    text: str


@dataclass(frozen=True, slots=True)
class Instruction:
    """A processing instruction, such as `<?xdl version="2.0.0" ?>`."""

    target: str
    text: str


@dataclass(frozen=True, slots=True)
class XmlElement:
    """One element with all that is in it."""

    tag: str
    attributes: tuple[Attribute, ...] = ()
    children: tuple[Node, ...] = ()
    place: FilePlace = field(default=NOWHERE, compare=False)

    @property
    def elements(self) -> tuple[XmlElement, ...]:
        """Return the elements right inside, in order."""
        return tuple(child for child in self.children if isinstance(child, XmlElement))

    def attribute(self, name: str) -> Attribute | None:
        """Return the attribute of that name, or None."""
        return next((a for a in self.attributes if a.name == name), None)

    def text_of(self, name: str) -> str:
        """Return the value of the attribute, "" when there is none."""
        found = self.attribute(name)
        return "" if found is None else found.value


Node = XmlElement | Comment | XmlText | Instruction


@dataclass(frozen=True, slots=True)
class XmlDocument:
    """A whole file: what stands before the root, the root, and what comes after."""

    root: XmlElement
    before: tuple[Node, ...] = ()
    after: tuple[Node, ...] = ()


def refuse(code: str, message: str, place: FilePlace = NOWHERE) -> ProtocolError:
    """Build the error of a file that cannot be read at all."""
    context = {"line": place.line, "column": place.column} if place.line else {}
    subject = str(place) if place.line or place.path else ""
    return ProtocolError(message, code=code, findings=[Finding(code, message, subject, context)])


def parse_markup(raw: bytes) -> XmlDocument:
    """Read XML into a tree.

    Raises:
        ProtocolError: With one of the codes `xdl.too_large`, `xdl.encoding`, `xdl.markup`,
            `xdl.doctype`, `xdl.too_deep`, `xdl.too_many` and `xdl.text`, and the place.
    """
    data = _text_of(raw).encode()
    builder = _Builder(data)
    parser, is_all = builder.parser, True
    try:
        parser.Parse(data, is_all)
    except expat.ExpatError as error:
        place = FilePlace(error.lineno, error.offset + 1)
        told = expat.ErrorString(error.code)
        raise refuse("xdl.markup", f"not well-formed XML: {told} at {place}", place) from error
    return builder.document()


def render_markup(document: XmlDocument) -> str:
    """Write a tree as XML that `parse_markup` reads back to an equal tree."""
    lines: list[str] = []
    for node in (*document.before, document.root, *document.after):
        _render(node, 0, lines)
    return "\n".join(lines) + "\n"


def _text_of(raw: bytes) -> str:
    if len(raw) > MAX_BYTES:
        message = f"the file has more than {MAX_BYTES} bytes, the most that is read"
        raise refuse("xdl.too_large", message)
    declared = _DECLARED.match(raw.removeprefix(b"\xef\xbb\xbf"))
    name = declared[1].decode().lower() if declared else "utf-8"
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        name = "utf-16"
    if name not in _ENCODINGS:
        raise refuse(
            "xdl.encoding", f"the encoding {name!r} is not read: write UTF-8", FilePlace(1, 1)
        )
    codec = "utf-8-sig" if _ENCODINGS[name] == "utf-8" else _ENCODINGS[name]
    try:
        return raw.decode(codec)
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        place = FilePlace(before.count(b"\n") + 1, len(before) - before.rfind(b"\n"))
        raise refuse(
            "xdl.encoding", f"byte {error.start} is not {name}, at {place}", place
        ) from error


class _Builder:
    """Collects what expat tells, within the bounds."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._open: list[tuple[str, tuple[Attribute, ...], FilePlace, list[Node]]] = []
        self._top: list[Node] = []
        self._root_at: int | None = None
        self._count = 0
        self._deeper = 0
        self._too_deep: FilePlace | None = None
        self.parser = expat.ParserCreate("utf-8")
        self.parser.buffer_text = True
        # One text in one piece: longer ones are refused.
        self.parser.buffer_size = 8 * MAX_TEXT
        self.parser.ordered_attributes = True
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.CommentHandler = self._comment
        self.parser.ProcessingInstructionHandler = self._instruction

    def document(self) -> XmlDocument:
        if self._too_deep is not None:
            place = self._too_deep
            message = f"nested deeper than {MAX_DEPTH} elements, at {place}"
            raise refuse("xdl.too_deep", message, place)
        at = self._root_at
        root = self._top[at] if at is not None else None
        if at is None or not isinstance(root, XmlElement):
            raise refuse("xdl.markup", "the file holds no element")
        return XmlDocument(root, tuple(self._top[:at]), tuple(self._top[at + 1 :]))

    def _place(self) -> FilePlace:
        return FilePlace(self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1)

    def _doctype(self, *_declared: object) -> None:
        message = "document types and entities are not read"
        raise refuse("xdl.doctype", message, self._place())

    def _start(self, tag: str, flat: list[str]) -> None:
        place = self._place()
        if self._deeper or len(self._open) >= MAX_DEPTH:
            # What is nested too deep is counted, not kept: a missing end tag shows later.
            self._deeper += 1
            self._too_deep = self._too_deep or place
            return
        if len(flat) > 2 * MAX_ATTRIBUTES:
            message = f"more than {MAX_ATTRIBUTES} attributes, at {place}"
            raise refuse("xdl.too_many", message, place)
        places = self._attribute_places(place)
        attributes = tuple(
            Attribute(name, self._bounded(value), places.get(name, place))
            for name, value in zip(flat[::2], flat[1::2], strict=True)
        )
        self._open.append((tag, attributes, place, []))

    def _end(self, tag: str) -> None:
        if self._deeper:
            self._deeper -= 1
            return
        _, attributes, place, children = self._open.pop()
        if not self._open:
            self._root_at = len(self._top)
        self._add(XmlElement(tag, attributes, tuple(children), place))

    def _characters(self, text: str) -> None:
        # Pieces of one text come together: nothing else stands between them.
        if not text.strip() or self._deeper:
            return
        inside = self._open[-1][3]
        if inside and isinstance(inside[-1], XmlText):
            text = f"{inside.pop().text} {text.strip()}"  # type: ignore[union-attr]
        self._add(XmlText(self._bounded(" ".join(text.split()))))

    def _comment(self, text: str) -> None:
        self._add(Comment(self._bounded(text)))

    def _instruction(self, target: str, text: str) -> None:
        self._add(Instruction(target, self._bounded(text)))

    def _add(self, node: Node) -> None:
        if self._deeper:
            return
        self._count += 1
        if self._count > MAX_NODES:
            raise refuse(
                "xdl.too_many", f"the file has more than {MAX_NODES} pieces", self._place()
            )
        (self._open[-1][3] if self._open else self._top).append(node)

    def _bounded(self, text: str) -> str:
        if len(text) > MAX_TEXT:
            place = self._place()
            message = f"a text of more than {MAX_TEXT} characters, at {place}"
            raise refuse("xdl.text", message, place)
        return text

    def _attribute_places(self, place: FilePlace) -> dict[str, FilePlace]:
        start = self.parser.CurrentByteIndex
        end = _end_of_tag(self._data, start)
        tag = self._data[start:end].decode("utf-8", "replace")
        found: dict[str, FilePlace] = {}
        line, column, before = place.line, place.column, 0
        for match in _ATTRIBUTE.finditer(tag):
            between = tag[before : match.start()]
            breaks = between.count("\n")
            line += breaks
            column = len(between) - between.rfind("\n") if breaks else column + len(between)
            before = match.start()
            found[match[1]] = FilePlace(line, column)
        return found


def _end_of_tag(data: bytes, start: int) -> int:
    quote = 0
    for index in range(start, len(data)):
        sign = data[index]
        if quote:
            quote = 0 if sign == quote else quote
        elif sign in b"\"'":
            quote = sign
        elif sign == ord(">"):
            return index + 1
    return len(data)


_WHITE = {"\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}


def _render(node: Node, depth: int, lines: list[str]) -> None:
    indent = "  " * depth
    match node:
        case Comment(text):
            lines.append(f"{indent}<!--{text}-->")
        case XmlText(text):
            lines.append(indent + escape(text, {"\r": "&#13;"}))
        case Instruction(target, text):
            lines.append(f"{indent}<?{target} {text}?>" if text else f"{indent}<?{target}?>")
        case XmlElement():
            _render_element(node, depth, lines)


def _render_element(element: XmlElement, depth: int, lines: list[str]) -> None:
    indent = "  " * depth
    written = "".join(f" {a.name}={quoteattr(a.value, _WHITE)}" for a in element.attributes)
    if not element.children:
        lines.append(f"{indent}<{element.tag}{written}/>")
        return
    lines.append(f"{indent}<{element.tag}{written}>")
    for child in element.children:
        _render(child, depth + 1, lines)
    lines.append(f"{indent}</{element.tag}>")
