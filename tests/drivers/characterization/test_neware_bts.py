"""The BTS interface against answers that a real cycler gave, and a simulated one."""

import pytest

from drivers.characterization.neware_bts import (
    END,
    NewareBts,
    decode_answer,
    decode_element,
    encode_command,
)
from drivers.transports.replay import RecordedExchange, ReplayTransport
from labweb.domain.errors import DeviceError, Effect, FrameError, PreconditionError, RejectedError
from tests.corpus import INSTRUMENTS, NO_INSTRUMENTS
from tests.drivers.conformance.analysers import CYCLERS
from tests.drivers.conformance.placed_models import Doing, do, running
from tests.fixtures.running import until

RECORDED = INSTRUMENTS / "neware"
recorded = pytest.mark.skipif(not RECORDED.is_dir(), reason=NO_INSTRUMENTS)
CASE = CYCLERS[0]
SETTINGS = {"device_index": 21, "subdevice_index": 1, "channel_index": 1, "poll_s": 0.005}
ADDRESS = 'ip="127.0.0.1" devtype="27" devid="21" subdevid="1" chlid="1"'
STATUS = encode_command("getchlstatus", f'<list count="1"><status {ADDRESS}>true</status></list>')
INQUIRE = encode_command(
    "inquire", f'<list count="1"><inquire {ADDRESS} aux="0" barcode="1">true</inquire></list>'
)
CONNECT = encode_command(
    "connect", "<username>admin</username><password>neware</password><type>bfgs</type>"
)
STOP = encode_command("stop", f'<list count="1"><stop {ADDRESS}>true</stop></list>')
CELL = {"protocol_path": "C:/p.xml", "backup_path": "C:/data", "barcode": "cell-1"}


def told(name: str) -> bytes:
    return (RECORDED / f"{name}_response.xml").read_bytes() + END


def state(text: str) -> bytes:
    body = f'<list count="1"><status {ADDRESS} reservepause="0">{text}</status></list>'
    return encode_command("getchlstatus_resp", body)


def channel(*exchanges: tuple[bytes, bytes]) -> NewareBts:
    script = [RecordedExchange(">", request, reply) for request, reply in exchanges]
    transport = ReplayTransport(script, line="replay:bts")
    transport.open()
    device = NewareBts(transport, SETTINGS)
    device.transport.acquire(device)
    return device


@recorded
def test_a_real_cycler_is_signed_in_to_and_read() -> None:
    device = channel(
        (CONNECT, told("connect")),
        (STATUS, told("get_status_21_1_1")),
        (INQUIRE, told("inquire_21_1_1")),
        (INQUIRE, told("inquire_21_1_1")),
        (STATUS, told("get_status_21_1_1")),
    )
    device.connect()
    assert device.voltage_v() == 3.8834
    assert device.current_ma() == 0.0
    assert device.channel_state() == "finish"
    device.close()


@recorded
def test_a_stop_is_taken_as_a_real_cycler_takes_it() -> None:
    device = channel((STATUS, state("working")), (STOP, told("stop_21_1_1")))
    device.stop()
    device.close()


@recorded
@pytest.mark.parametrize("name", ["inquire_21_1_4", "inquire_21_1_1_and_2"])
def test_the_answer_of_another_channel_is_not_taken(name: str) -> None:
    device = channel((INQUIRE, told(name)))
    with pytest.raises(FrameError):
        device.voltage_v()
    device.close()


@recorded
def test_every_recorded_answer_names_its_command() -> None:
    files = sorted(RECORDED.glob("*.xml"))
    for file in files:
        text = file.read_text(encoding="utf-8")
        command = text.partition("<cmd>")[2].partition("_resp</cmd>")[0]
        assert decode_answer(file.read_bytes() + END, command)
    assert len(files) == 16


def test_a_channel_that_works_is_not_started_again() -> None:
    device = channel((STATUS, state("working")))
    with pytest.raises(RejectedError, match="working") as caught:
        device.start_test(**CELL)
    assert caught.value.effect is Effect.NONE
    device.close()


@pytest.mark.parametrize("field", sorted(CELL))
@pytest.mark.parametrize("text", ["", 'a"b', "<x/>", "a&b", "a\nb", "x" * 201])
def test_signs_of_xml_never_get_into_a_command(field: str, text: str) -> None:
    device = channel()
    with pytest.raises(PreconditionError):
        device.start_test(**{**CELL, field: text})
    device.close()


def test_a_test_that_was_stopped_has_not_finished() -> None:
    device = channel((STATUS, state("stop")))
    with pytest.raises(DeviceError, match="did not finish") as caught:
        device.await_end(10.0)
    assert (caught.value.code, caught.value.effect) == ("device.alarm", Effect.NONE)
    device.close()


@pytest.mark.parametrize("text", ["", "<stop>ok</stop><stop>ok</stop>", '<stop chlid="1>ok</stop>'])
def test_an_answer_without_its_one_element_is_a_frame_error(text: str) -> None:
    with pytest.raises(FrameError):
        decode_element(text, "stop")


def test_a_simulated_cell_is_cycled_and_stopped() -> None:
    with running([CASE]) as bench, bench.connected(CASE) as device:
        assert do(device, ("start_test", CELL)).evidence["barcode"] == "cell-1"
        waiting = Doing(device, ("await_end", {"duration_s": 600.0}))
        assert not waiting.is_over
        evidence = do(device, ("stop_test", {})).evidence
        assert (evidence["channel_state"], evidence["current_ma"]) == ("stop", 0.0)
        assert waiting.failure().code == "device.alarm"
        until(lambda: bench.is_over(CASE), 1)
