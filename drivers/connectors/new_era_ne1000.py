"""New Era NE-1000 syringe pump.

Protocol: RS-232, 19200 8N1, address, command, CR; answers STX, address, prompt, data, ETX.
Quality: bronze, simulated instrument.
Safe state: the drive stands; on a lost link a stroke ends at its volume.

Every stroke sets diameter, volume, rate and direction, reads volume and rate back, and then runs
to the volume. Numbers have four digits at most, so a volume is rounded to that and `moved_ul` says
what went. The pump knows neither what is in the syringe nor where its plunger stands.

No accuracy of a volume is stated: no figure of the maker was found. The pump moves its block, and
diameter and fit of the syringe make a volume of that.

Source:
    New Era Pump Systems, NE-1000 series user manual, sections "RS-232 protocol" and "Commands".
"""

from __future__ import annotations

import re
from typing import Annotated, ClassVar, NamedTuple

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.connectors._infusion import Barrel, InfusionTarget, run_to_target
from drivers.interfaces.infusion_pump import InfusionPump
from drivers.transports.base import ByteTransport
from labweb.domain.errors import DeviceError, DeviceTimeoutError, Effect, FrameError, RejectedError

ETX = b"\x03"
INFUSING, WITHDRAWING, PURGING, ALARM = "I", "W", "X", "A"
RUNNING = frozenset({INFUSING, WITHDRAWING, PURGING})
ANSWER_S = 1.0
MOST_DIGITS, MOST_WHOLE = 4, 10_000
SLOWEST_MM_S, FASTEST_MM_S = 0.042_05 / 3600, 51.005 / 60
"""Travel of the block, section "Specifications": 0.004205 cm/h to 5.1005 cm/min."""

ALARMS = {
    "R": "it was reset: the power was away",
    "S": "motor stalled",
    "T": "time-out of the safe mode",
    "E": "error in the program",
    "O": "phase out of range",
}
VOLUMES_UL = {"UL": 1.0, "ML": 1000.0}
RATES_UL_S = {"UM": 1 / 60, "MM": 1000 / 60, "UH": 1 / 3600, "MH": 1000 / 3600}
READ_BACK_RATIO = 0.002

Volume = Annotated[float, Range(0.001, 200_000.0)]
Rate = Annotated[float, Range(0.000_01, 10_000.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One pump and the syringe that is clamped in."""

    syringe_ul: Annotated[float, Range(0.5, 200_000.0)]
    """Volume of the syringe."""

    diameter_mm: Annotated[float, Range(0.1, 50.0)]
    """Inner diameter of the syringe: what the pump turns a rate into a speed by."""

    address_index: Annotated[int, Range(0, 99)] = 0


class NewEraReply(NamedTuple):
    """A decoded answer."""

    prompt: str
    data: str


def encode_command(address: int, command: str) -> bytes:
    r"""Build the frame of a command in basic mode.

    Example:
        >>> encode_command(0, "DIR INF")
        b'00 DIR INF\r'
    """
    return f"{address:02d} {command}\r".encode("ascii")  # section "RS-232 protocol": two digits


def encode_number(value: float) -> str:
    """Write a number in the four digits that the pump takes.

    Example:
        >>> encode_number(1.23456), encode_number(150.0), encode_number(5000)
        ('1.235', '150.0', '5000')
    """
    whole = len(str(int(value)))
    return f"{value:.{max(0, MOST_DIGITS - whole)}f}"


def decode_reply(frame: bytes, address: int) -> NewEraReply:
    r"""Read an answer of basic mode.

    Raises:
        FrameError: Not such an answer, or from another pump.

    Example:
        >>> decode_reply(b"\x0200S1.000MM\x03", 0)
        Reply(prompt='S', data='1.000MM')
    """
    match = re.search(rb"\x02(\d\d)([IWSPTUXA])([\x20-\x7e]*)\x03\Z", frame)
    if match is None or int(match[1]) != address:
        raise FrameError("answer is not of this pump", context={"frame": frame.hex()})
    return NewEraReply(match[2].decode("ascii"), match[3].decode("ascii"))


class NewEraNe1000(Driver[ByteTransport, Config], InfusionPump):
    """One pump at one address."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the diameter; the pump does not hear the first command after it is switched on.

        Nothing moves. The alarm that a reset leaves is cleared by being told.
        """
        try:
            self._exchange("DIA")
        except DeviceTimeoutError:
            self._exchange("DIA")
        self._ask("DIA")

    def halt(self) -> None:
        """Stop the drive."""
        self._exchange("STP")

    @status(every_s=0.5)
    def infused_ul(self) -> float:
        """Tell what the last stroke has pushed out, by the pump's count."""
        return self._counted_ul()[0]

    @status(every_s=0.5)
    def withdrawn_ul(self) -> float:
        """Tell what the last stroke has drawn in, by the pump's count."""
        return self._counted_ul()[1]

    @status(every_s=1.0)
    def is_running(self) -> bool:
        """Tell whether the drive turns."""
        return self._ask("DIS").prompt in RUNNING

    @action(timeout_s=1860.0, recovery="R2", hazards=("expels_liquid",), operation="transfer")
    def infuse(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Push liquid out of the syringe, and return once the volume is reached.

        Effect:
            `moved_ul` from the syringe out of its outlet, by the pump's count.
        """
        return self._stroke(volume_ul, rate_ul_s, "INF")

    @action(timeout_s=1860.0, recovery="R2", operation="transfer")
    def withdraw(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Draw liquid into the syringe, and return once the volume is reached.

        Effect:
            `moved_ul` from the outlet into the syringe, by the pump's count.
        """
        return self._stroke(volume_ul, rate_ul_s, "WDR")

    def _stroke(self, volume_ul: float, rate_ul_s: float, direction: str) -> Report:
        self.refuse_if_stopped()
        config = self.config
        barrel = Barrel(config.syringe_ul, config.diameter_mm, SLOWEST_MM_S, FASTEST_MM_S)
        barrel.check(volume_ul, rate_ul_s)
        with before_acting():
            if self.is_running():
                raise RejectedError("the pump already runs: stop it first")
            self._prepare(volume_ul, rate_ul_s, direction)
        return run_to_target(
            self,
            InfusionTarget(volume_ul, rate_ul_s, volume_ul / 1000),
            begin=lambda: self._do("RUN"),
            is_idle=lambda: not self.is_running(),
            counted_ul=self.infused_ul if direction == "INF" else self.withdrawn_ul,
        )

    def _prepare(self, volume_ul: float, rate_ul_s: float, direction: str) -> None:
        """Set the stroke up and read back what the pump holds."""
        self._do(f"DIA {encode_number(self.config.diameter_mm)}")
        unit = "UL" if volume_ul < MOST_WHOLE else "ML"
        self._do(f"VOL {unit}")
        self._do(f"VOL {encode_number(volume_ul / VOLUMES_UL[unit])}")
        self._do(f"DIR {direction}")
        rate_unit = "UM" if rate_ul_s / RATES_UL_S["UM"] < MOST_WHOLE else "MM"
        self._do(f"RAT C {encode_number(rate_ul_s / RATES_UL_S[rate_unit])} {rate_unit}")
        self._do("CLD INF")
        self._do("CLD WDR")
        held = {"VOL": (VOLUMES_UL, volume_ul), "RAT": (RATES_UL_S, rate_ul_s)}
        for command, (units, wanted) in held.items():
            told = self._quantity(command, units)
            if abs(told - wanted) > READ_BACK_RATIO * wanted:
                raise RejectedError(f"{command}: the pump holds {told:g}, not {wanted:g}")

    def _quantity(self, command: str, units: dict[str, float]) -> float:
        data = self._ask(command).data
        match = re.fullmatch(r"([0-9.]{1,6})([A-Z]{2})", data)
        if match is None or match[2] not in units:
            raise FrameError(f"{command} was answered with {data!r}")
        return float(match[1]) * units[match[2]]

    def _counted_ul(self) -> tuple[float, float]:
        data = self._ask("DIS").data
        match = re.fullmatch(r"I([0-9.]{1,6})W([0-9.]{1,6})(UL|ML)", data)
        if match is None:
            raise FrameError(f"DIS was answered with {data!r}")
        unit_ul = VOLUMES_UL[match[3]]
        return round(float(match[1]) * unit_ul, 3), round(float(match[2]) * unit_ul, 3)

    def _do(self, command: str) -> None:
        self._ask(command)

    def _ask(self, command: str) -> NewEraReply:
        """Send a command; alarms and what the pump does not take are raised."""
        reply = self._exchange(command)
        if reply.prompt == ALARM:
            kind = reply.data.removeprefix("?")
            raise DeviceError(
                f"{command}: the pump has an alarm: {ALARMS.get(kind, kind)}",
                effect=Effect.UNKNOWN,
                context={"alarm": kind},
            )
        if reply.data.startswith("?"):
            raise RejectedError(f"{command}: the pump says {reply.data!r}")
        return reply

    def _exchange(self, command: str) -> NewEraReply:
        frame = encode_command(self.config.address_index, command)
        answer = self.transport.exchange(frame, until=ETX, timeout_s=ANSWER_S)
        return decode_reply(answer, self.config.address_index)
