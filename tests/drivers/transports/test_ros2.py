"""Interfaces, names and bytes of ROS 2, without a peer."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.transports.ros2 import discovery, ros_names, rtps
from drivers.transports.ros2.interfaces_table import INTERFACES
from drivers.transports.ros2.link import LinkSettings
from drivers.transports.ros2.message_definitions import Definitions, Field, parse_fields
from drivers.transports.ros2.reliable import ReliableReader, Writer
from drivers.transports.ros2.rtps import SampleIdentity
from drivers.transports.ros2.types import Types, type_name
from labweb.domain.errors import DefinitionError, FrameError

JOINTS = "sensor_msgs/msg/JointState"


@pytest.fixture(scope="module")
def types() -> Types:
    return Types(Definitions(INTERFACES))


def test_every_known_interface_becomes_a_type(types: Types) -> None:
    for name in INTERFACES:
        sort = name.split("/")[1]
        if sort == "msg":
            assert types.decode(name, types.encode(name, {})) == types.plain(
                name, types.build(name, {})
            )
        else:
            assert types.definitions.service(name).request == f"{name}_Request"


def test_fields_are_read_as_their_authors_write_them() -> None:
    text = """
    # a comment
    int8 LIMIT=-3   # a constant
    string NAME = "a"
    string<=5[<=3] words
    float64[36] covariance
    Point[] points  # of this package
    geometry_msgs/Pose pose
    bool read_only false
    """
    assert parse_fields(text, "nav", "nav/msg/X") == (
        Field(name="words", type="string", longest=5, most=3),
        Field(name="covariance", type="float64", count=36),
        Field(name="points", type="nav/msg/Point", most=0),
        Field(name="pose", type="geometry_msgs/msg/Pose"),
        Field(name="read_only", type="bool"),
    )


@pytest.mark.parametrize(
    "text",
    ["int32", "int32 Name", "wstring text", "int32<=3 x", "int32[0] x", "int32 x\nint32 x", "x; y"],
)
def test_what_is_no_field_is_refused(text: str) -> None:
    with pytest.raises(DefinitionError):
        parse_fields(text, "nav", "nav/msg/X")


def test_a_message_that_holds_itself_is_refused() -> None:
    types = Types(Definitions({"a/msg/Loop": "Loop inside"}))
    with pytest.raises(DefinitionError, match="holds itself"):
        types.of("a/msg/Loop")


def test_bytes_are_plain_cdr_little_endian(types: Types) -> None:
    # OMG CDR: a string counts its end, a double is aligned to 8 after the encapsulation.
    told = {"header": {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "ab"}, "position": [0.5]}
    expected = (
        b"\x00\x01\x00\x00"
        + struct.pack("<iI", 1, 2)
        + struct.pack("<I", 3)
        + b"ab\0"
        + b"\0"
        + struct.pack("<I", 0)
        + struct.pack("<I", 1)
        + struct.pack("<d", 0.5)
        + struct.pack("<II", 0, 0)
    )
    found = types.encode(JOINTS, told)
    assert found[:4] == expected[:4]
    assert found[4:].ljust(len(expected) - 4, b"\0") == expected[4:]
    assert type_name(JOINTS) == "sensor_msgs::msg::dds_::JointState_"


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ({"names": []}, "has no"),
        ({"name": "ab"}, "an array"),
        ({"position": ["1"]}, "float64"),
        ({"header": {"stamp": {"sec": 2**31}}}, "int32"),
        ({"header": {"stamp": {"sec": True}}}, "int32"),
        ({"header": {"frame_id": "a\0b"}}, "string"),
        ({"header": 5}, "an object"),
    ],
)
def test_a_value_that_does_not_fit_is_refused_by_field(
    types: Types, value: dict[str, object], reason: str
) -> None:
    with pytest.raises(DefinitionError, match=reason):
        types.build(JOINTS, value)


@given(st.binary(max_size=200))
def test_hostile_bytes_are_no_message(data: bytes) -> None:
    types = Types(Definitions(INTERFACES))
    try:
        types.decode(JOINTS, b"\x00\x01\x00\x00" + data)
    except FrameError:
        return


@given(st.binary(max_size=300))
def test_hostile_datagrams_are_read_or_refused(data: bytes) -> None:
    try:
        rtps.read_packet(rtps.HEADER + bytes(12) + data)
        discovery.read_participant(data)
        discovery.read_endpoint(data)
    except (struct.error, ValueError, IndexError):
        return


def test_names_go_to_the_wire_as_ros_maps_them() -> None:
    assert ros_names.topic("/bench/pump/volume_ul") == "rt/bench/pump/volume_ul"
    assert ros_names.request_topic("/a/b") == "rq/a/bRequest"
    assert ros_names.reply_topic("/a/b") == "rr/a/bReply"
    assert ros_names.action_names("/a").feedback == "/a/_action/feedback"
    for bad in ("a", "/a/", "/2a", "/a__b", "/a b", "/ä", "/" + "a" * 300):
        with pytest.raises(DefinitionError):
            ros_names.check_name(bad)


def test_the_link_is_loopback_unless_it_is_told_otherwise() -> None:
    text = LinkSettings().cyclone()
    assert '<NetworkInterface address="127.0.0.1"/>' in text
    assert "<AllowMulticast>false</AllowMulticast>" in text
    assert "<IgnoreTypeInformation>1.15</IgnoreTypeInformation>" in text
    assert all(host == "127.0.0.1" for host, _ in LinkSettings().announce_to())
    lan = LinkSettings(domain=3, address="192.0.2.7", peers=("192.0.2.9",))
    assert lan.group == ("239.255.0.1", 8150)
    assert ("192.0.2.9", 8160) in lan.announce_to()
    assert "<AllowMulticast>spdp</AllowMulticast>" in lan.cyclone()


@pytest.mark.parametrize("settings", [{"domain": 232}, {"address": "0.0.0.0"}, {"peers": ("x",)}])
def test_a_link_that_cannot_be_is_refused(settings: dict[str, object]) -> None:
    with pytest.raises(DefinitionError):
        LinkSettings(**settings)  # type: ignore[arg-type]


def a_pair() -> tuple[Writer, ReliableReader, bytes, bytes]:
    writer, reader = (
        Writer(b"\0\0\1\3", "t", "T"),
        ReliableReader(b"\0\0\1\4", "t", "T", lambda *_: None),
    )
    return writer, reader, b"w" * 12 + writer.entity, b"r" * 12 + reader.entity


def parts_of(data: bytes) -> list[rtps.Part]:
    packet = rtps.read_packet(rtps.HEADER + bytes(12) + data)
    assert packet is not None
    return [part for _, part in packet.parts]


@given(st.data())
def test_every_sample_arrives_once_and_in_order_whatever_is_lost(data: st.DataObject) -> None:
    writer, reader, writer_guid, reader_guid = a_pair()
    reader.match(writer_guid)
    line = [writer.match(reader_guid)]
    heard: list[bytes] = []
    for number in range(data.draw(st.integers(1, 12))):
        related = rtps.related(SampleIdentity(b"q" * 16, number))
        line.append(writer.samples(reader_guid, [writer.add(bytes([number]) * 4, related)]))
    for is_reliable in [False] * 6 + [True] * 3:
        for piece in line:
            for part in parts_of(piece):
                if not is_reliable and data.draw(st.booleans()):
                    continue
                heard += [one.payload for one in _take(reader, writer_guid, part)]
        line = [writer.beat(reader_guid)]
        for part in parts_of(line[0]):
            assert isinstance(part, rtps.HeartbeatSubmessage)
            due, answer = reader.take_beat(writer_guid, part)
            heard += [one.payload for one in due]
            for want in parts_of(answer):
                assert isinstance(want, rtps.Want)
                line.append(writer.samples(reader_guid, writer.take_want(reader_guid, want)))
    assert heard == [bytes([number]) * 4 for number in range(writer.sequence)]
    assert writer.waiting() == []


def _take(reader: ReliableReader, guid: bytes, part: rtps.Part) -> list[rtps.DataSubmessage]:
    match part:
        case rtps.DataSubmessage():
            return reader.take_data(guid, part)
        case rtps.Skip():
            return reader.take_skip(guid, part)
    return []


def test_a_writer_that_knew_of_us_first_has_told_where_it_begins() -> None:
    writer, reader, writer_guid, reader_guid = a_pair()
    writer.add(b"old!", {})
    (beat,) = parts_of(writer.match(reader_guid))
    assert isinstance(beat, rtps.HeartbeatSubmessage)
    assert reader.take_beat(writer_guid, beat) == ([], b"")
    reader.match(writer_guid)
    new = parts_of(writer.samples(reader_guid, [writer.add(b"new!", {})]))[0]
    assert [one.payload for one in _take(reader, writer_guid, new)] == [b"new!"]


def test_who_comes_late_hears_nothing_of_before() -> None:
    writer, reader, writer_guid, reader_guid = a_pair()
    for _ in range(3):
        writer.add(b"old!", {})
    reader.match(writer_guid)
    (beat,) = parts_of(writer.match(reader_guid))
    assert isinstance(beat, rtps.HeartbeatSubmessage)
    assert (beat.first, beat.last) == (4, 3)
    due, _ = reader.take_beat(writer_guid, beat)
    new = parts_of(writer.samples(reader_guid, [writer.add(b"new!", {})]))[0]
    assert due == []
    assert [one.payload for one in _take(reader, writer_guid, new)] == [b"new!"]


def test_a_long_answer_is_cut_into_datagrams_that_can_be_sent() -> None:
    parts = b"".join(
        rtps.data(b"\0\0\1\3", b"\0\0\1\4", number, bytes(20_000), {}) for number in range(9)
    )
    found = rtps.pieces(parts)
    assert b"".join(found) == parts
    assert len(found) == 3
    assert all(len(piece) < 65_000 for piece in found)
