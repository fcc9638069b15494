"""XML from anywhere: read within bounds, or refused with the place."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.errors import ProtocolError
from labweb.domain.recipes.xdl.file_format.xml_tree import (
    MAX_BYTES,
    MAX_DEPTH,
    Attribute,
    Comment,
    Instruction,
    XmlDocument,
    XmlElement,
    XmlText,
    parse_markup,
    render_markup,
)

LAUGHS = (
    b'<!DOCTYPE l [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">'
    b'<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]><XDL>&c;</XDL>'
)
OUTSIDE = b'<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]><XDL>&e;</XDL>'


@pytest.mark.parametrize(
    ("raw", "code"),
    [
        (LAUGHS, "xdl.doctype"),
        (OUTSIDE, "xdl.doctype"),
        (b"<!DOCTYPE XDL><XDL/>", "xdl.doctype"),
        (b"<XDL>&unknown;</XDL>", "xdl.markup"),
        (b"", "xdl.markup"),
        (b"   ", "xdl.markup"),
        (b"<XDL>\0</XDL>", "xdl.markup"),
        (b"\0" * 100, "xdl.markup"),
        (b"<XDL>", "xdl.markup"),
        (b"<XDL></Synthesis>", "xdl.markup"),
        (b"<XDL/><XDL/>", "xdl.markup"),
        (b'<XDL a="1" a="2"/>', "xdl.markup"),
        (b'<XDL a="\xff"/>', "xdl.encoding"),
        (b'<?xml version="1.0" encoding="cp1252"?><XDL/>', "xdl.encoding"),
        (b'<?xml version="1.0" encoding="utf-16"?><XDL/>', "xdl.encoding"),
        (b"\xfe\xff<XDL/", "xdl.encoding"),
        (b"<a>" * (MAX_DEPTH + 1) + b"</a>" * (MAX_DEPTH + 1), "xdl.too_deep"),
        (b"<a>" * 100_000 + b"</a>" * 100_000, "xdl.too_deep"),
        (b"<a>" * 100_000, "xdl.markup"),
        (b" " * (MAX_BYTES + 1), "xdl.too_large"),
        (b"<a>" + b"x" * 50_000_000 + b"</a>", "xdl.too_large"),
        (b"<a>" + b"x" * 20_000 + b"</a>", "xdl.text"),
        (b"<a " + b" ".join(b'b%d=""' % i for i in range(100)) + b"/>", "xdl.too_many"),
        (b"<a>" + b"<b/>" * 50_001 + b"</a>", "xdl.too_many"),
    ],
    ids=lambda value: value[:24].decode("latin-1") if isinstance(value, bytes) else value,
)
def test_a_bad_file_is_refused_and_says_where(raw: bytes, code: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        parse_markup(raw)
    assert caught.value.code == code
    assert [finding.code for finding in caught.value.findings] == [code]


def test_every_attribute_knows_its_line_and_column() -> None:
    raw = '<XDL>\n  <Add vessel="ä>b"\n       reagent="x"/>\n</XDL>'.encode()
    (step,) = parse_markup(raw).root.elements
    assert (step.place.line, step.place.column) == (2, 3)
    places = {a.name: (a.place.line, a.place.column) for a in step.attributes}
    assert places == {"vessel": (2, 8), "reagent": (3, 8)}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1"])
def test_the_declared_encoding_is_read(encoding: str) -> None:
    declared = encoding.removesuffix("-sig")
    written = f'<?xml version="1.0" encoding="{declared}"?><a b="25 °C µ"/>'
    assert parse_markup(written.encode(encoding)).root.text_of("b") == "25 °C µ"


NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_.-]{0,8}", fullmatch=True).filter(
    lambda name: not name.lower().startswith("xml")
)
SIGNS = st.characters(codec="utf-8", exclude_categories=("Cs", "Cc", "Cn")) | st.sampled_from(
    "\n\t"
)
VALUES = st.text(SIGNS, max_size=12)
WORDS = VALUES.map(lambda text: " ".join(text.split())).filter(bool)
COMMENTS = VALUES.filter(lambda text: "--" not in text and not text.endswith("-"))
ATTRIBUTES = st.lists(st.builds(Attribute, NAMES, VALUES), max_size=4, unique_by=lambda a: a.name)


def _without_neighbours(children: list[object]) -> tuple[object, ...]:
    kept: list[object] = []
    for child in children:
        if not (isinstance(child, XmlText) and kept and isinstance(kept[-1], XmlText)):
            kept.append(child)
    return tuple(kept)


def _elements(children: st.SearchStrategy[object]) -> st.SearchStrategy[XmlElement]:
    return st.builds(
        XmlElement,
        NAMES,
        ATTRIBUTES.map(tuple),
        st.lists(children, max_size=4).map(_without_neighbours),
    )


NODES = st.recursive(
    st.builds(Comment, COMMENTS)
    | st.builds(XmlText, WORDS)
    | st.builds(XmlElement, NAMES, ATTRIBUTES.map(tuple)),
    _elements,
    max_leaves=12,
)
INSTRUCTIONS = st.builds(Instruction, NAMES, st.just('version="2.0.0"'))


@settings(max_examples=50)
@given(_elements(NODES), st.lists(INSTRUCTIONS | st.builds(Comment, COMMENTS), max_size=3))
def test_what_is_written_is_read_back_the_same(root: XmlElement, before: list[Comment]) -> None:
    document = XmlDocument(root, tuple(before), (Comment("end"),))
    assert parse_markup(render_markup(document).encode()) == document


@given(st.binary(max_size=200) | st.text(max_size=100).map(lambda text: f"<a>{text}</a>".encode()))
def test_any_bytes_are_read_or_refused(raw: bytes) -> None:
    try:
        document = parse_markup(raw)
    except ProtocolError:
        return
    assert parse_markup(render_markup(document).encode()) == document
