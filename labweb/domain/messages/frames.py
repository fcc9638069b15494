"""Every frame of the uplink, by who sends it: JSON, tagged by `t`."""

from __future__ import annotations

from labweb.domain.action_files import FileAsked, FileGone, FileOffer, FilePart, FileTaken
from labweb.domain.messages.action_asks import ActionAsk, AskTold, WithdrawAsk
from labweb.domain.messages.certificates_and_sightings import Renew, Renewed, Sightings
from labweb.domain.messages.chain_heads import (
    Heads,
)
from labweb.domain.messages.commands import (
    Nudge,
)
from labweb.domain.messages.device_looks import LookPart, LookTold
from labweb.domain.messages.devices_and_drivers import (
    DevicesFrame,
    DriverPart,
    WantDriver,
)
from labweb.domain.messages.driver_tryouts import (
    TryoutAsk,
    TryoutOffer,
    TryoutPart,
    TryoutTold,
)
from labweb.domain.messages.events import Ack, EventsFrame
from labweb.domain.messages.session import (
    Challenge,
    Heartbeat,
    Hello,
    Pulse,
    Refuse,
    ResumeSession,
    Welcome,
)
from labweb.domain.messages.stops import StopAcknowledged, StopLabFrame
from labweb.domain.messages.telemetry import TelemetryFrame, TelemetryTaken

CLOSE_BAD_FRAME = 4400
"""Code with which the server closes a connection on which it was sent what it does not know."""


MAX_FRAME_BYTES = 256 * 1024


EdgeFrame = (
    Hello
    | EventsFrame
    | Heartbeat
    | TelemetryFrame
    | StopAcknowledged
    | FileOffer
    | FilePart
    | FileGone
    | Renew
    | Sightings
    | WantDriver
    | ActionAsk
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
    | ResumeSession
    | StopLabFrame
    | Nudge
    | FileTaken
    | FileAsked
    | Renewed
    | DevicesFrame
    | DriverPart
    | AskTold
    | TelemetryTaken
    | TryoutPart
    | TryoutAsk
    | LookPart
    | Heads
    | Pulse
)
