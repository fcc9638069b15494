"""Announcements are hostile until parsed; admissions only narrow what a driver declares."""

from __future__ import annotations

import base64
import json
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.enrollment.admitted_interface import admitted_spec, check_admission, refusal
from labweb.domain.enrollment.device_announcements import (
    beacon_bytes,
    expand_addresses,
    is_key,
    is_legible,
    is_sane,
    legible,
    mark_of,
    parse_beacon,
    sighting_of,
)
from labweb.domain.enrollment.driver_spec import (
    ActionSpec,
    DriverSpec,
    ParameterSpec,
    check_arguments,
)
from labweb.domain.errors import DefinitionError
from labweb.domain.messages.certificates_and_sightings import Sighting

PLAIN: dict[str, Any] = {"labweb": 1, "name": "Stirrer", "port": 5000}
KEY = base64.b64encode(bytes(range(32))).decode()
HEAT = ActionSpec(
    name="heat",
    parameters=(ParameterSpec(name="temperature_c", type="number", minimum=0.0, maximum=300.0),),
)
SPEC = DriverSpec(class_name="Plate", module="m", digest="d", actions=(HEAT, ActionSpec(name="go")))


def packet(**changes: Any) -> bytes:  # noqa: ANN401 - JSON
    return json.dumps({**PLAIN, **changes}).encode()


def test_an_announcement_says_a_port_and_never_an_address() -> None:
    one = sighting_of(parse_beacon(packet(serial="0815")), "192.0.2.9")
    assert (one.address, one.serial, one.source) == ("tcp://192.0.2.9:5000", "0815", "beacon")
    with pytest.raises(DefinitionError):
        parse_beacon(packet(address="10.0.0.1"))


@pytest.mark.parametrize(
    "changes",
    [
        {"labweb": 2},
        {"port": 0},
        {"port": 65536},
        {"port": "5000"},
        {"name": " "},
        {"name": "x" * 101},
        {"name": "a\nb"},
        {"scheme": "file:///etc"},
        {"key": "x"},
        {"signature": "x"},
    ],
)
def test_a_wrong_field_spoils_the_announcement(changes: dict[str, Any]) -> None:
    with pytest.raises(DefinitionError):
        parse_beacon(packet(**changes))


@given(st.binary(max_size=1400))
def test_no_datagram_does_more_than_be_refused(data: bytes) -> None:
    with suppress(DefinitionError):
        parse_beacon(data)


def test_nesting_is_refused() -> None:
    with pytest.raises(DefinitionError):
        parse_beacon(b"[" * 1200)


def test_the_signature_is_over_every_other_field() -> None:
    one = parse_beacon(packet(key=KEY, signature="s"))
    assert beacon_bytes(one) == beacon_bytes(parse_beacon(packet(key=KEY, signature="t")))
    assert beacon_bytes(one) != beacon_bytes(parse_beacon(packet(key=KEY, signature="s", port=1)))


def test_another_key_is_another_candidate_and_a_serial_outlives_its_address() -> None:
    by_key = Sighting(source="beacon", address="a", serial="1", public_key="k")
    assert mark_of(by_key) == mark_of(Sighting(source="beacon", address="b", public_key="k"))
    assert mark_of(by_key) != mark_of(Sighting(source="beacon", address="a", serial="1"))
    moved = Sighting(source="serial", address="b", serial="1")
    assert mark_of(moved) == mark_of(Sighting(source="serial", address="a", serial="1"))


def test_what_is_long_or_of_no_known_source_is_not_kept() -> None:
    assert is_sane(Sighting(source="serial", address="serial:///dev/ttyUSB0"))
    assert not is_sane(Sighting(source="rumour", address="a"))
    assert not is_sane(Sighting(source="beacon", address="a" * 201))
    assert not is_sane(Sighting(source="beacon", address="a", name="\0"))


def test_addresses_are_counted_before_they_are_tried() -> None:
    assert expand_addresses(["192.0.2.0/30:5000"]) == [("192.0.2.1", 5000), ("192.0.2.2", 5000)]
    assert expand_addresses(["192.0.2.7:1", "[2001:db8::1]:2"]) == [
        ("192.0.2.7", 1),
        ("2001:db8::1", 2),
    ]
    for wrong in (["192.0.2.0/16:1"], ["192.0.2.1"], ["host:1"], ["192.0.2.1:0"]):
        with pytest.raises(DefinitionError):
            expand_addresses(wrong)
    with pytest.raises(DefinitionError):
        expand_addresses(["192.0.2.0/24:1", "192.0.3.0/24:1"])


def test_what_was_withheld_is_not_in_the_interface() -> None:
    narrowed = admitted_spec(SPEC, {"heat": {"temperature_c": 60.0}})
    assert [action.name for action in narrowed.actions] == ["heat"]
    assert check_arguments(narrowed.actions[0], {"temperature_c": 60.0}) == []
    assert check_arguments(narrowed.actions[0], {"temperature_c": 60.1}) != []
    assert admitted_spec(SPEC, None) is SPEC
    assert admitted_spec(SPEC, {}).actions == ()


def test_a_limit_only_lowers() -> None:
    assert check_admission(SPEC, {"heat": {"temperature_c": 60.0}, "go": {}}) == []
    wrong: tuple[dict[str, dict[str, float]], ...] = (
        {"fly": {}},
        {"heat": {"speed": 1.0}},
        {"heat": {"temperature_c": 301.0}},
        {"heat": {"temperature_c": -1.0}},
        {"heat": {"temperature_c": float("nan")}},
    )
    for admission in wrong:
        assert len(check_admission(SPEC, admission)) == 1, admission


def test_the_host_asks_the_same() -> None:
    admission = {"heat": {"temperature_c": 60.0}}
    assert refusal(admission, "heat", {"temperature_c": 60}) == ("", "")
    assert refusal(admission, "heat", {"temperature_c": 61})[0] == "edge.over_limit"
    assert refusal(admission, "go", {})[0] == "edge.not_admitted"
    assert refusal({}, "heat", {})[0] == "edge.not_admitted"
    assert refusal(None, "go", {}) == ("", "")


@pytest.mark.parametrize(
    "text",
    [
        *("0815\u202e", "0815\u200b", "0815\u3164", "0815\u034f", "\u2066a", "a\tb", "a\u00a0b"),
        *(" a", "a ", "a  b", "e" + "\u0301" * 4, "e\u0301", "\x1b[2J", "a\ufe0f"),
    ],
)
def test_what_a_person_does_not_see_as_it_is_is_not_legible(text: str) -> None:
    assert not is_legible(text)
    assert not is_sane(Sighting(source="beacon", address="a", serial=text))
    with pytest.raises(DefinitionError):
        parse_beacon(packet(serial=text))


@pytest.mark.parametrize("text", ["", "RCT basic", "Rührer №2", "天平", "<b>", "ตู้อบ", "ميزان"])
def test_names_of_any_language_are_legible(text: str) -> None:
    assert is_legible(text)


def test_what_usb_says_is_kept_as_far_as_it_can_be_read() -> None:
    assert legible("FT232R  USB UART ") == "FT232R USB UART"
    assert legible("A\u202eB") == ""
    assert legible("x" * 300) == "x" * 100


def test_a_key_is_written_in_one_way() -> None:
    assert is_key(KEY)
    others = [KEY[:-2] + last + "=" for last in "ABCDEFGHIJKLMNOPQRSTUVWXYZ89+/"]
    same = [one for one in others if one != KEY and base64.b64decode(one) == base64.b64decode(KEY)]
    assert same, "base64 has another way to write this key"
    for wrong in (*same, "", "AAAA", KEY + "\n", KEY.rstrip("="), "k"):
        assert not is_key(wrong)
        assert not wrong or not is_sane(Sighting(source="beacon", address="a", public_key=wrong))
    for wrong in same:
        with pytest.raises(DefinitionError):
            parse_beacon(packet(key=wrong, signature="s"))
