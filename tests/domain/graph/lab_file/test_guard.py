from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.errors import Finding, LabFileError
from labweb.domain.graph.lab_file.untrusted_json import MAX_BYTES, MAX_DEPTH, decode_json


@pytest.mark.parametrize(
    ("raw", "code"),
    [
        (b" " * (MAX_BYTES + 1), "lab_file.too_large"),
        (b'{"name": "\xff"}', "lab_file.encoding"),
        (b'{"name": ', "lab_file.json"),
        (b"", "lab_file.json"),
        (b'{"a": 1, "b": {"c": 1, "c": 2}}', "lab_file.duplicate_key"),
        (b'{"a": NaN}', "lab_file.number"),
        (b'{"a": -Infinity}', "lab_file.number"),
        (b'{"a": 1e999}', "lab_file.number"),
        (b'{"a": 9223372036854775808}', "lab_file.number"),
        (b'{"a": ' + b"9" * 5000 + b"}", "lab_file.number"),
        (b"[" * (MAX_DEPTH + 1) + b"]" * (MAX_DEPTH + 1), "lab_file.depth"),
        (b"[" * 200_000 + b"]" * 200_000, "lab_file.depth"),
        (b'{"a": "\\ud800"}', "lab_file.text"),
        (b'{"a\\u0000": 1}', "lab_file.text"),
    ],
)
def test_a_file_that_cannot_be_trusted_is_refused_with_its_own_code(raw: bytes, code: str) -> None:
    with pytest.raises(LabFileError) as caught:
        decode_json(raw)
    assert caught.value.code == code
    assert [finding.code for finding in caught.value.findings] == [code]


def test_the_deepest_nesting_that_is_allowed_is_read() -> None:
    assert decode_json(b"[" * MAX_DEPTH + b"]" * MAX_DEPTH)


def test_a_byte_order_mark_is_no_obstacle() -> None:
    assert decode_json(b"\xef\xbb\xbf[1]") == [1]


@given(st.binary(max_size=60))
def test_any_bytes_are_either_read_or_refused(raw: bytes) -> None:
    findings: tuple[Finding, ...] | None = None
    try:
        decode_json(raw)
    except LabFileError as error:
        findings = error.findings
    assert findings is None or len(findings) == 1
