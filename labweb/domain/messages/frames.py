"""Every frame of the uplink, by who sends it: JSON, tagged by `t`."""

from __future__ import annotations

from labweb.domain.action_files import FileAsked, FileGone, FileOffer, FilePart, FileTaken
from labweb.domain.messages.action_asks import Ask, AskTold, WithdrawAsk
from labweb.domain.messages.certificates_and_sightings import Renew, Renewed, Sightings
from labweb.domain.messages.chain_heads import (
    Heads,
)
from labweb.domain.messages.commands import (
    Nudge,
)
from labweb.domain.messages.device_looks import LookPart, LookTold
from labweb.domain.messages.devices_and_drivers import (
    Devices,
    DriverPart,
    WantDriver,
)
from labweb.domain.messages.driver_tryouts import (
    TryoutAsk,
    TryoutOffer,
    TryoutPart,
    TryoutTold,
)
from labweb.domain.messages.events import Ack, Events
from labweb.domain.messages.session import (
    Challenge,
    Heartbeat,
    Hello,
    Pulse,
    Refuse,
    Resume,
    Welcome,
)
from labweb.domain.messages.stops import StopAcknowledged, StopLab
from labweb.domain.messages.telemetry import Telemetry, TelemetryTaken

CLOSE_BAD_FRAME = 4400
"""Code with which the server closes a connection on which it was sent what it does not know."""


MAX_FRAME_BYTES = 256 * 1024


EdgeFrame = (
    Hello
    | Events
    | Heartbeat
    | Telemetry
    | StopAcknowledged
    | FileOffer
    | FilePart
    | FileGone
    | Renew
    | Sightings
    | WantDriver
    | Ask
    | WithdrawAsk
    | TryoutOffer
    | TryoutTold
    | LookTold
)


ServerFrame = (
    Challenge
    | Welcome
    | Refuse
    | Ack
    | Resume
    | StopLab
    | Nudge
    | FileTaken
    | FileAsked
    | Renewed
    | Devices
    | DriverPart
    | AskTold
    | TelemetryTaken
    | TryoutPart
    | TryoutAsk
    | LookPart
    | Heads
    | Pulse
)
