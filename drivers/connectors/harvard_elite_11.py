"""Harvard Apparatus Pump 11 Elite.

Protocol: USB serial, 115200 8N1, address, command, arguments, CR LF; lines of address and prompt.
Quality: bronze, simulated instrument.
Safe state: the drive stands; on a lost link a stroke ends at its target volume.

Every stroke sets diameter, target and rate, reads them back, and then runs to the target. The pump
knows neither what is in the syringe nor where its plunger stands.

No accuracy of a volume is stated: no figure of the maker was found. The pump moves its block, and
diameter and fit of the syringe make a volume of that.

Source:
    Harvard Apparatus, Pump 11 Elite user's guide, section "Command set".
"""

from __future__ import annotations

import re
from typing import Annotated, ClassVar, NamedTuple

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.connectors._infusion import Barrel, InfusionTarget, run_to_target
from drivers.interfaces.infusion_pump import InfusionPump
from drivers.transports.base import ByteTransport
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError

ANSWER = re.compile(rb"\d\d(?:T\*|[:><*])[^\r\n]*\r\n")
"""A whole answer: a line that begins with address and prompt."""

MODEL = "11 ELITE"
IDLE, INFUSING, WITHDRAWING, AT_TARGET, STALLED = ":", ">", "<", "T*", "*"
ANSWER_S = 1.0
SLOWEST_MM_S, FASTEST_MM_S = 0.1837e-3 / 60, 190.8 / 60
"""Travel of the pusher block, section "Specifications": 0.1837 µm/min to 190.8 mm/min."""

READ_BACK_RATIO = 0.005
COUNT_RATIO = 0.001
"""How finely the pump tells a volume: three digits after the point of its unit."""

REFUSALS = ("Command error", "Unknown command", "Argument error", "Out of range")
VOLUMES_UL = {"l": 1e6, "ml": 1e3, "ul": 1.0, "nl": 1e-3, "pl": 1e-6}
TIMES_S = {"s": 1.0, "sec": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0, "hr": 3600.0}

Volume = Annotated[float, Range(0.001, 200_000.0)]
Rate = Annotated[float, Range(0.000_001, 10_000.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One pump and the syringe that is clamped in."""

    syringe_ul: Annotated[float, Range(0.5, 200_000.0)]
    """Volume of the syringe."""

    diameter_mm: Annotated[float, Range(1.0, 33.0)]
    """Inner diameter of the syringe: what the pump turns a rate into a speed by."""

    address_index: Annotated[int, Range(0, 99)] = 0


class HarvardReply(NamedTuple):
    """A decoded answer."""

    prompt: str
    text: str


def encode_line(address: int, command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line(0, "irate 2.5 m/m")
        b'0irate 2.5 m/m\r\n'
    """
    return f"{address}{command}\r\n".encode("ascii")


def decode_reply(frame: bytes, address: int) -> HarvardReply:
    r"""Read the line with the prompt.

    Raises:
        FrameError: Not such a line, or from another pump.

    Example:
        >>> decode_reply(b"\r\n00T*1.000 ml\r\n", 0)
        Reply(prompt='T*', text='1.000 ml')
    """
    match = re.search(rb"(\d\d)(T\*|[:><*]) ?([\x20-\x7e\xb5]*)\r\n\Z", frame)
    if match is None or int(match[1]) != address:
        raise FrameError("answer is no line of this pump", context={"frame": frame.hex()})
    return HarvardReply(match[2].decode("ascii"), match[3].decode("latin-1").strip())


def decode_quantity(text: str) -> float:
    """Read a volume in µL, or a rate in µL/s.

    Raises:
        FrameError: Not a number with a unit.

    Example:
        >>> decode_quantity("1.2 ml"), decode_quantity("6 ml/min")
        (1200.0, 100.0)
    """
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?) ?([munp]?l)(?:/([a-z]+))?", text.lower())
    if match is None or (match[3] or "s") not in TIMES_S:
        raise FrameError(f"{text!r} is no volume and no rate")
    return float(match[1]) * VOLUMES_UL[match[2]] / TIMES_S[match[3] or "s"]


class HarvardElite11(Driver[ByteTransport, Config], InfusionPump):
    """One pump at one address."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the version, and refuse another model. Nothing moves."""
        if MODEL not in (text := self._ask("ver").text):
            raise RejectedError(f"{self.transport.line} answers {text!r}, expected {MODEL!r}")

    def halt(self) -> None:
        """Stop the drive."""
        self._ask("stp")

    @status(every_s=0.5)
    def infused_ul(self) -> float:
        """Tell what the last stroke has pushed out, by the pump's count."""
        return self._told("ivolume")

    @status(every_s=0.5)
    def withdrawn_ul(self) -> float:
        """Tell what the last stroke has drawn in, by the pump's count."""
        return self._told("wvolume")

    @status(every_s=1.0)
    def is_running(self) -> bool:
        """Tell whether the drive turns."""
        return self._ask("diameter").prompt in {INFUSING, WITHDRAWING}

    @action(timeout_s=1860.0, recovery="R2", hazards=("expels_liquid",), operation="transfer")
    def infuse(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Push liquid out of the syringe, and return once the volume is reached.

        Effect:
            `moved_ul` from the syringe out of its outlet, by the pump's count.
        """
        return self._stroke(volume_ul, rate_ul_s, "i")

    @action(timeout_s=1860.0, recovery="R2", operation="transfer")
    def withdraw(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Draw liquid into the syringe, and return once the volume is reached.

        Effect:
            `moved_ul` from the outlet into the syringe, by the pump's count.
        """
        return self._stroke(volume_ul, rate_ul_s, "w")

    def _stroke(self, volume_ul: float, rate_ul_s: float, way: str) -> Report:
        self.refuse_if_stopped()
        config = self.config
        barrel = Barrel(config.syringe_ul, config.diameter_mm, SLOWEST_MM_S, FASTEST_MM_S)
        barrel.check(volume_ul, rate_ul_s)
        with before_acting():
            if self.is_running():
                raise RejectedError("the pump already runs: stop it first")
            self._prepare(volume_ul, rate_ul_s, way)
        return run_to_target(
            self,
            InfusionTarget(volume_ul, rate_ul_s, max(1.0, volume_ul * COUNT_RATIO)),
            begin=lambda: self._begin(f"{way}run"),
            is_idle=self._is_idle,
            counted_ul=self.infused_ul if way == "i" else self.withdrawn_ul,
        )

    def _prepare(self, volume_ul: float, rate_ul_s: float, way: str) -> None:
        """Set the stroke up and read back what the pump holds."""
        self._set(f"diameter {self.config.diameter_mm:.4f}")
        self._set(f"svolume {self.config.syringe_ul / 1000:.6f} m")
        self._set("cvolume")
        self._set("ctvolume")
        self._set(f"tvolume {volume_ul / 1000:.6f} m")
        self._set(f"{way}rate {rate_ul_s * 60 / 1000:.7f} m/m")
        for command, wanted in (("tvolume", volume_ul), (f"{way}rate", rate_ul_s)):
            if abs((held := self._told(command)) - wanted) > READ_BACK_RATIO * wanted:
                raise RejectedError(f"{command}: the pump holds {held:g}, not {wanted:g}")

    def _begin(self, command: str) -> None:
        reply = self._ask(command)
        if reply.prompt == STALLED:
            raise DeviceError("the pump stalled", effect=Effect.UNKNOWN)

    def _is_idle(self) -> bool:
        prompt = self._ask("diameter").prompt
        if prompt == STALLED:
            raise DeviceError("the pump stalled", effect=Effect.UNKNOWN)
        return prompt not in {INFUSING, WITHDRAWING}

    def _told(self, command: str) -> float:
        return decode_quantity(self._ask(command).text)

    def _set(self, command: str) -> None:
        self._ask(command)

    def _ask(self, command: str) -> HarvardReply:
        """Send a command; what the pump says that it does not take is refused."""
        frame = encode_line(self.config.address_index, command)
        answer = self.transport.exchange(frame, until=ANSWER, timeout_s=ANSWER_S)
        reply = decode_reply(answer, self.config.address_index)
        if any(words in reply.text for words in REFUSALS):
            raise RejectedError(f"{command}: the pump says {reply.text!r}")
        return reply
