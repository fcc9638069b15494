"""The separator of the ChinWe workstation, in the bytes of its published tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from drivers.processing._xkc import crc_of
from drivers.processing.chinwe_separator import ChinweSeparator
from drivers.transports.replay import ReplayTransport

CONFIG = {
    "vessel_ul": 250_000.0,
    "max_speed_rpm": 1000.0,
    "low_count": 200,
    "threshold_count": 300,
    "high_count": 500,
    "drain_rate_ul_s": 1000.0,
    "tolerance_ratio": 0.4,
    "valve_limit_s": 0.1,
    "speed_limit_s": 0.2,
    "grace_s": 0.05,
    "poll_s": 0.1,
}
WATER, ETHER, AIR = 620, 150, 60
VERSIONS = "1ff4786b"
OPENS = "05fd00001e0000000320 01006b"
CLOSES = "05fd00001e0000000000 01006b"
TAKEN, NOT_MET, NOT_KNOWN = "05fd026b", "05fde26b", "0500ee6b"
BEYOND = "053601000040006b"
AT_ZERO, A_QUARTER, HALFWAY = "053600000000006b", "053600000040006b", "053600000020006b"


def escaped(data: str) -> str:
    return "".join(f"\\x{byte:02x}" for byte in bytes.fromhex(data))


def ask(request: str, answer: str = "", mark: str = ">") -> str:
    return f"{mark} {escaped(request)}\n" + (f"< {escaped(answer)}\n" if answer else "")


def checked(body: str) -> str:
    return body + crc_of(bytes.fromhex(body)).hex()


def level(signal: int, output: int = 1, mark: str = ">") -> str:
    return ask(checked("060300010002"), checked(f"060304{output:04x}{signal:04x}"), mark)


def speed(rpm: int, mark: str = ">") -> str:
    return ask("04356b", f"043501{rpm:04x}6b", mark)


def place(told: str, mark: str = ">") -> str:
    looks = 1 if mark != ">" or told in {A_QUARTER, HALFWAY, BEYOND} else 2
    return ask("05366b", told, mark) * looks


def flags(told: str = "03", mark: str = ">") -> str:
    return ask("053a6b", f"053a{told}6b", mark)


LET_GO, STRUCK = flags("02"), flags("0d")
STANDS = ask("04fe98006b", "04fe026b") + speed(0)
SHUT = place(AT_ZERO) + flags()
"""The valve is at its zero, and its motor holds it there."""

CONFIRMED = flags() + ask("050a6d6b", "050a026b") + place(AT_ZERO) + SHUT + place(AT_ZERO)
READY = speed(0) + SHUT + level(WATER) * 5 + flags()
CLOSED = place(A_QUARTER) * 2 + ask(CLOSES, TAKEN) + place(HALFWAY) + SHUT


def separator(transport: object, **config: object) -> ChinweSeparator:
    return ChinweSeparator(transport, {**CONFIG, **config})  # type: ignore[arg-type]


def confirmed(play: Callable[..., ReplayTransport], text: str, **config: object) -> ChinweSeparator:
    """Return a separator whose drain a person has seen closed."""
    before = CONFIRMED.replace(flags(), "") if flags(mark=">?") in text else CONFIRMED
    device = separator(play(text=before + text), **config)
    device.confirm_drain_closed()
    return device


def draining(signals: Iterable[int], told: str = A_QUARTER) -> str:
    return "".join(level(signal) + place(told) for signal in signals)


def replayed(device: ChinweSeparator) -> ReplayTransport:
    assert isinstance(device.transport, ReplayTransport)
    return device.transport
