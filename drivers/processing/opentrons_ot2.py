"""Opentrons OT-2, a pipetting robot, with one single-channel pipette.

Protocol: HTTP, JSON by the maker's robot server, port 31950, `Opentrons-Version: 3`.
Quality: bronze, simulated instrument.
Safe state: the run is stopped; the robot then homes and may throw the tip away. On a lost link
    the command that has begun goes on to its end, and no other follows.

A session is one run without a protocol, made by `initialize`; each act is a command in it with a
key of its own. Where an answer is lost, the robot is asked for the command by that key, and
nothing is sent again. Neither tips nor liquid are sensed: what is told of them is what was done
here, and nobody knows after a failure.

No accuracy is stated: it is the pipette's and changes with the volume; the robot server does not
tell it.

Source:
    Opentrons, HTTP API of the robot server (`/openapi.json`); open clients of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from drivers.base import Driver, Range, Report, action, after_acting, before_acting, status
from drivers.interfaces.liquid_handler import LiquidHandler
from drivers.interfaces.showing import Showing
from drivers.processing._opentrons import OpentronsCommand, OpentronsRobot
from drivers.processing._ot2_deck import parse_deck, refuse_long_stroke, well_in
from drivers.transports.http import HttpTransport
from drivers.waiting import refuse_beyond
from labweb.domain.errors import DeviceError, Effect, FrameError, PreconditionError, RejectedError

MODEL = "OT-2 Standard"
FIXED_TRASH = "fixedTrash"
"""The waste of every OT-2: as labware on older software, as an area of the deck since."""

NEAR_UL = 1e-6
"""What sums of volumes leave by binary fractions."""

Volume = Annotated[float, Range(0.1, 1000.0)]
Rate = Annotated[float, Range(0.1, 1000.0)]
Stroke = Literal["aspirate", "dispense"]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One robot, its pipette and what stands on its deck."""

    pipette: str
    """Its name at the maker: `p300_single_gen2`."""

    mount: Literal["left", "right"]
    deck: dict[str, str]
    """By slot, 1 to 11: the definition of what stands there, `namespace/name/version`."""

    min_volume_ul: Annotated[float, Range(0.1, 1000.0)]
    """The least that this pipette moves."""

    max_volume_ul: Annotated[float, Range(0.1, 1000.0)]
    """The most that pipette and tip hold."""

    max_rate_ul_s: Annotated[float, Range(0.1, 1000.0)]
    above_bottom_mm: Annotated[float, Range(0.1, 100.0)] = 1.0
    """How far above the bottom of a well the tip draws and gives."""

    command_limit_s: Annotated[float, Range(0.5, 90.0)] = 60.0
    """Longest time for one command."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.5


class OpentronsOt2(Driver[HttpTransport, Config], LiquidHandler, Showing):
    """One robot with one pipette."""

    transport_type: ClassVar[type] = HttpTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def __init__(self, transport: HttpTransport, config: dict[str, Any]) -> None:
        """Read the deck, and refuse one that is malformed; nothing is opened."""
        super().__init__(transport, config)
        self._deck = parse_deck(self.config.deck)
        self._robot = OpentronsRobot(self, lambda: self.config.poll_s)
        self._pipette_id = ""
        self._labware: dict[str, str] = {}
        self._used_tips: set[tuple[str, str]] = set()
        self._has_trash = False
        self._has_tip: bool | None = None
        self._tip_volume_ul: float | None = None

    def identify(self) -> None:
        """Ask which robot answers, and refuse another model."""
        told = self._robot.health()
        if told.robot_model != MODEL:
            raise RejectedError(
                f"{told.robot_model!r} answers, expected {MODEL!r}",
                context={"robot_model": told.robot_model},
            )

    def halt(self) -> None:
        """Stop the run that does anything, whoever made it; where nothing does, nothing is sent."""
        run = self._robot.current_run()
        if run is not None and self._robot.is_moving(run):
            self._forget()
            self._robot.stop(run.id)

    @status(every_s=5.0)
    def is_initialized(self) -> bool:
        """Tell whether this session has a run, with axes and deck known."""
        return bool(self._robot.run_id and self._pipette_id)

    @status(every_s=5.0)
    def has_tip(self) -> bool | None:
        """Tell whether a tip is on, by what was done; None: nobody knows."""
        return self._has_tip

    @status(every_s=5.0)
    def tip_volume_ul(self) -> float | None:
        """Tell how much the tip holds, by what was done; None: nobody knows."""
        return self._tip_volume_ul

    @status(every_s=5.0)
    def running_state(self) -> str:
        """Tell the state of the robot's run, in its own words; `none`: it has none."""
        run = self._robot.current_run()
        return "none" if run is None else run.status

    @action(timeout_s=600.0, recovery="R0", hazards=("moving_parts", "expels_liquid"))
    def initialize(self) -> Report:
        """Make a run for this session, load pipette and deck, and find the zero of all axes.

        A tip that is still on has to be taken off by hand before: the robot does not see it.

        Raises:
            RejectedError: Another run moves, or pipette or deck are not what is set (NONE).
            DeviceError: The axes were not found (UNKNOWN).

        Effect:
            Gantry and plunger move; what a tip holds is pushed out.
        """
        self.refuse_if_stopped()
        with before_acting():
            self._forget()
            run = self._robot.current_run()
            if run is not None and self._robot.is_moving(run):
                raise RejectedError(f"run {run.id} of the robot is {run.status}: end it first")
            made = self._robot.make_run()
            self._has_trash = any(one.id == FIXED_TRASH for one in made.labware)
            pipette_id = self._load_deck()
        with after_acting():
            self._command("home", {})
        self._pipette_id = pipette_id
        self._has_tip, self._tip_volume_ul = False, 0.0
        self._used_tips.clear()
        return Report(evidence={"run": made.id, "deck": dict(self.config.deck)})

    @action(timeout_s=120.0, recovery="R0", hazards=("moving_parts",))
    def pick_up_tip(self, slot: str, well: str) -> Report:
        """Put on the tip that stands in a rack, once: a spot is empty from then on.

        Raises:
            PreconditionError: A tip is on, nobody knows, or that one was used (NONE).
            DeviceError: The robot failed: nobody knows whether a tip is on (UNKNOWN).

        Effect:
            The tip has gone from the rack to the pipette.
        """
        self.refuse_if_stopped()
        place = self._place(slot, well)
        if self._has_tip is not False:
            state = "nobody knows whether a tip is on" if self._has_tip is None else "a tip is on"
            raise PreconditionError(f"{state}: drop it, or initialise", code="device.tip")
        if (slot, well) in self._used_tips:
            raise PreconditionError(
                f"the tip of {slot} {well} was used in this session", code="device.tip"
            )
        with self._handling():
            self._command("pickUpTip", {**self._pipette, **place})
            self._used_tips.add((slot, well))
        self._has_tip, self._tip_volume_ul = True, 0.0
        return Report(evidence={"slot": slot, "well": well})

    @action(timeout_s=120.0, recovery="R0", hazards=("moving_parts",))
    def drop_tip(self) -> Report:
        """Throw the tip away over the robot's own waste, with what it holds.

        Raises:
            PreconditionError: No tip is on (NONE).
            DeviceError: The robot failed: nobody knows whether a tip is on (UNKNOWN).

        Effect:
            The tip lies in the waste, with what it held.
        """
        self.refuse_if_stopped()
        self._refuse_uninitialized()
        if self._has_tip is False:
            raise PreconditionError("no tip is on", code="device.tip")
        held_ul = self._tip_volume_ul
        with self._handling():
            if self._has_trash:
                trash = {"labwareId": FIXED_TRASH, "wellName": "A1"}
                self._command("dropTip", {**self._pipette, **trash})
            else:
                area = {"addressableAreaName": FIXED_TRASH, "alternateDropLocation": True}
                self._command("moveToAddressableAreaForDropTip", {**self._pipette, **area})
                with after_acting():
                    self._command("dropTipInPlace", self._pipette)
        self._has_tip, self._tip_volume_ul = False, 0.0
        return Report(evidence={"held_ul": held_ul})

    @action(timeout_s=120.0, recovery="R0", operation="transfer", hazards=("moving_parts",))
    def aspirate(self, slot: str, well: str, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Draw liquid from a well into the tip.

        Args:
            slot: Of the deck, 1 to 11.
            well: As SLAS names it, `A1`.
            volume_ul: How much.
            rate_ul_s: How fast.

        Raises:
            PreconditionError: No tip, more than it holds, beyond the pipette, or slower than a
                command may be (NONE).
            RejectedError: The robot refused before its plunger moved (NONE).
            DeviceError: It failed, or was stopped (UNKNOWN); `context` has run and key.

        Effect:
            `moved_ul` from the well into the tip.
        """
        self.refuse_if_stopped()
        place = self._place(slot, well)
        self._check_stroke("aspirate", volume_ul, rate_ul_s)
        return self._stroke("aspirate", place, volume_ul, rate_ul_s)

    @action(timeout_s=120.0, recovery="R0", operation="transfer", hazards=("expels_liquid",))
    def dispense(self, slot: str, well: str, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Push liquid from the tip into a well; arguments as `aspirate`.

        Raises:
            DeviceError, PreconditionError: As `aspirate`.

        Effect:
            `moved_ul` from the tip into the well.
        """
        self.refuse_if_stopped()
        place = self._place(slot, well)
        self._check_stroke("dispense", volume_ul, rate_ul_s)
        return self._stroke("dispense", place, volume_ul, rate_ul_s)

    @action(timeout_s=240.0, recovery="R0", operation="transfer", hazards=("expels_liquid",))
    def transfer_liquid(
        self,
        source_slot: str,
        source_well: str,
        target_slot: str,
        target_well: str,
        volume_ul: Volume,
        rate_ul_s: Rate,
    ) -> Report:
        """Move liquid from well to well, with the empty tip that is on.

        Args:
            source_slot: Where it is drawn from: slot of the deck.
            source_well: The well there.
            target_slot: Where it goes to: slot of the deck.
            target_well: The well there.
            volume_ul: How much, at most one filling of the tip.
            rate_ul_s: How fast, both ways.

        Raises:
            PreconditionError: As `aspirate`, or the tip is not empty (NONE).
            RejectedError: The robot refused to draw (NONE).
            LabError: It failed or was stopped: some may be in the tip (UNKNOWN).

        Effect:
            `moved_ul` from the source into the target.
        """
        self.refuse_if_stopped()
        source = self._place(source_slot, source_well)
        target = self._place(target_slot, target_well)
        if (source_slot, source_well) == (target_slot, target_well):
            raise PreconditionError("source and target are one well")
        if held_ul := self._held_ul():
            raise PreconditionError(f"the tip holds {held_ul:g} µL: empty it", code="device.tip")
        self._check_stroke("aspirate", volume_ul, rate_ul_s)
        drawn = self._stroke("aspirate", source, volume_ul, rate_ul_s)
        with after_acting():
            given = self._stroke("dispense", target, volume_ul, rate_ul_s)
        keys = [drawn.evidence["key"], given.evidence["key"]]
        evidence = {"run": self._robot.run_id, "keys": keys, "volume_ul": volume_ul}
        return Report(moved_ul=volume_ul, evidence=evidence)

    @action(timeout_s=70.0, recovery="R1", operation="read")
    def show_itself(self, text: str, shown_s: Annotated[float, Range(1.0, 60.0)]) -> Report:
        """Let the lights blink for a while, in whole seconds; no text is shown.

        Effect:
            None; after a stop they may blink to their end.
        """
        self.refuse_if_stopped()
        with before_acting():
            self._robot.blink(math.ceil(shown_s))
            self.pause(shown_s)
        return Report(evidence={"shown_s": shown_s, "text_left_out": text})

    def _stroke(
        self, kind: Stroke, place: dict[str, str], volume_ul: float, rate_ul_s: float
    ) -> Report:
        """Move the plunger at a place, and book what the tip holds from then on."""
        height = {"origin": "bottom", "offset": {"x": 0, "y": 0, "z": self.config.above_bottom_mm}}
        amount = {"volume": volume_ul, "flowRate": rate_ul_s, "wellLocation": height}
        held_ul, run_id = self._held_ul(), self._robot.run_id
        with self._handling():
            command = self._command(kind, {**self._pipette, **place, **amount})
            told = (command.result or {}).get("volume")
            if not isinstance(told, int | float) or abs(told - volume_ul) > NEAR_UL:
                raise FrameError(
                    f"{kind} of {volume_ul:g} µL is told as {told!r:.40}",
                    context={"run": self._robot.run_id, "key": command.key},
                )
        if self._robot.run_id == run_id:  # a halt in between has forgotten it
            more_ul = volume_ul if kind == "aspirate" else -volume_ul
            self._tip_volume_ul = max(0.0, round(held_ul + more_ul, 6))
        evidence = {"run": run_id, "key": command.key, "volume_ul": volume_ul}
        return Report(moved_ul=volume_ul, evidence=evidence)

    def _command(self, kind: str, params: dict[str, Any]) -> OpentronsCommand:
        return self._robot.command(kind, params, self.config.command_limit_s)

    def _load_deck(self) -> str:
        """Tell the run what is mounted and what stands on the deck; nothing moves."""
        config, limit_s = self.config, self.config.command_limit_s
        pipette_id = self._robot.load_pipette(config.pipette, config.mount, limit_s)
        for slot, definition in sorted(self._deck.items()):
            self._labware[slot] = self._robot.load_labware(slot, definition, limit_s)
        return pipette_id

    def _forget(self) -> None:
        """The session is over: nobody knows what is on the pipette."""
        self._robot.run_id = self._pipette_id = ""
        self._labware.clear()
        self._has_tip = self._tip_volume_ul = None

    @contextmanager
    def _handling(self) -> Iterator[None]:
        """Nobody knows the tip after a failure that may have moved anything."""
        try:
            yield
        except DeviceError as error:
            if error.effect is not Effect.NONE:
                self._has_tip = self._tip_volume_ul = None
            if not self._robot.run_id:
                self._forget()
            raise

    @property
    def _pipette(self) -> dict[str, str]:
        return {"pipetteId": self._pipette_id}

    def _place(self, slot: str, well: str) -> dict[str, str]:
        self._refuse_uninitialized()
        return well_in(self._labware, slot, well)

    def _refuse_uninitialized(self) -> None:
        if not self.is_initialized():
            raise PreconditionError("the session has no run: initialise first", code="device.tip")

    def _check_stroke(self, kind: Stroke, volume_ul: float, rate_ul_s: float) -> None:
        config = self.config
        if kind == "aspirate":
            refuse_beyond("volume", volume_ul, config.min_volume_ul, config.max_volume_ul)
        refuse_beyond("rate", rate_ul_s, 0.1, config.max_rate_ul_s)
        refuse_long_stroke(volume_ul, rate_ul_s, config.command_limit_s)
        held_ul = self._held_ul()
        if kind == "aspirate":
            most_ul = config.max_volume_ul + NEAR_UL
            refuse_beyond("volume in the tip", held_ul + volume_ul, 0, most_ul)
        elif volume_ul > held_ul + NEAR_UL:
            raise PreconditionError(
                f"{volume_ul:g} µL were asked for; the tip holds {held_ul:g} µL",
                code="device.limit",
            )

    def _held_ul(self) -> float:
        if not self._has_tip or self._tip_volume_ul is None:
            state = "no tip is on" if self._has_tip is False else "nobody knows what the tip holds"
            raise PreconditionError(f"{state}: pick one up, or drop it first", code="device.tip")
        return self._tip_volume_ul
