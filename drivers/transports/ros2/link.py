"""Where ROS 2 is spoken: the domain, the network card, and whom to tell.

Source:
    OMG, DDSI-RTPS 2.3, section 9.6.1 (ports and the multicast group); Eclipse Cyclone DDS 11,
    "Configuration"; that Fast DDS's type information has to be passed over: its pull request 2333.
"""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from labweb.domain.errors import DefinitionError

GROUP = "239.255.0.1"
PARTICIPANTS_COUNT = 32
"""As many per machine are looked for without multicast, as Fast DDS and Cyclone DDS do."""

HIGHEST_DOMAIN = 231
"""Above, ports would not fit into 16 bits."""

_BASE, _PER_DOMAIN, _UNICAST = 7400, 250, 10
_FAST_DDS = "1.15"


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """One DDS domain on one network card."""

    domain: int = 0
    """`ROS_DOMAIN_ID` of the peers."""

    address: str = "127.0.0.1"
    """Of this machine's network card; the loopback address: peers on this machine alone."""

    peers: tuple[str, ...] = ()
    """Addresses of machines that multicast does not reach."""

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            DefinitionError: One of them cannot be.
        """
        if not 0 <= self.domain <= HIGHEST_DOMAIN:
            raise DefinitionError(
                f"domain {self.domain}: 0 to {HIGHEST_DOMAIN} are possible", code="ros2.link"
            )
        for text in (self.address, *self.peers):
            try:
                found = ipaddress.IPv4Address(text)
            except ValueError:
                found = None
            if found is None or found.is_unspecified or found.is_multicast:
                raise DefinitionError(f"{text!r} is no address of a machine", code="ros2.link")

    @property
    def is_local(self) -> bool:
        """Say whether only this machine is spoken to."""
        return ipaddress.IPv4Address(self.address).is_loopback

    @property
    def group(self) -> tuple[str, int]:
        """Return where participants are announced by multicast."""
        return GROUP, _BASE + _PER_DOMAIN * self.domain

    def unicast_port(self, index: int) -> int:
        """Return where the participant of that index hears of others."""
        return _BASE + _PER_DOMAIN * self.domain + _UNICAST + 2 * index

    def announce_to(self) -> list[tuple[str, int]]:
        """Return every address at which participants may be."""
        hosts = (self.address, *self.peers)
        found = [
            (host, self.unicast_port(index))
            for host in dict.fromkeys(hosts)
            for index in range(PARTICIPANTS_COUNT)
        ]
        return found if self.is_local else [self.group, *found]

    def cyclone(self) -> str:
        """Return the configuration of Cyclone DDS.

        Multicast is for discovery alone, so that one slow reader costs no other one anything.
        Without key hashes Fast DDS does not take in that a participant has ended.
        """
        peers = "".join(
            f"<Peer address={quoteattr(host)}/>"
            for host in dict.fromkeys((self.address, *self.peers))
        )
        multicast = "false" if self.is_local else "spdp"
        return (
            f'<CycloneDDS><Domain id="any"><General><Interfaces><NetworkInterface'
            f" address={quoteattr(self.address)}/></Interfaces>"
            f"<AllowMulticast>{multicast}</AllowMulticast></General>"
            f"<Compatibility><IgnoreTypeInformation>{_FAST_DDS}</IgnoreTypeInformation>"
            f"</Compatibility><Internal><GenerateKeyhash>true</GenerateKeyhash></Internal>"
            f"<Discovery><ParticipantIndex>auto</ParticipantIndex>"
            f"<MaxAutoParticipantIndex>{PARTICIPANTS_COUNT}</MaxAutoParticipantIndex>"
            f"<Peers>{peers}</Peers></Discovery></Domain></CycloneDDS>"
        )
