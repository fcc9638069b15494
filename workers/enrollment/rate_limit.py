"""How much of what strangers say a host listens to, so that what it knows is always heard.

```text
datagram ─┬─ byte for byte as a served device signed it ─────────▶ told, 15 s apart
          └─ anything else ─▶ allowance of its sender's share ─▶ parsed, its signature checked
                                                             └─▶ allowance of all news ─▶ told
```

A sender is what a datagram says it is, and costs nothing to forge. So strangers have shares, and
a sender falls into one by a hash that only this process knows: who forges many senders fills many
shares, and cannot aim at one but by its own address. What a served device says needs no share.

Source:
    P. E. McKenney, "Stochastic fairness queueing", INFOCOM 1990; RFC 7693 (keyed BLAKE2).
"""

from __future__ import annotations

import hashlib
import secrets
import time
from collections.abc import Callable, Collection

from labweb.domain.enrollment.device_announcements import Beacon, mark_of
from labweb.domain.messages.certificates_and_sightings import Sighting

SHARES_COUNT = 256
SHARE_PACKETS_PER_S = 2.0
"""Of one share; more are dropped unread. All together take a tenth of a processor."""

NEWS_PER_S = 20.0
"""What strangers may have told to the server, all together."""

SAME_AGAIN_S = 15.0
"""How long the same thing is not told again."""

MOST_REMEMBERED = 1000
MOST_FORMS = 4
"""How many announcements of one served device are known by their bytes."""

COMPLAINT_S = 60.0


class RateLimit:
    """So many a second, with a burst of twice that; what is beyond is dropped."""

    def __init__(self, per_s: float, now_s: float) -> None:
        self._per_s = per_s
        self._left = 2 * per_s
        self._at_s = now_s

    def take(self, now_s: float) -> bool:
        """Use one, if there is one left."""
        self._left = min(2 * self._per_s, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        if self._left < 1:
            return False
        self._left -= 1
        return True


class AnnouncementFilter:
    """Lets through what is known, and of the rest as much as a person could look at."""

    def __init__(self, mono_s: Callable[[], float] = time.monotonic) -> None:
        self._mono_s = mono_s
        self._secret = secrets.token_bytes(16)
        self._shares = [RateLimit(SHARE_PACKETS_PER_S, mono_s()) for _ in range(SHARES_COUNT)]
        self._news = RateLimit(NEWS_PER_S, mono_s())
        self._served: frozenset[str] = frozenset()
        self._forms: dict[bytes, Beacon] = {}
        self._told_s: dict[tuple[str, str], float] = {}
        self._complained_s = mono_s()
        self.dropped_count = 0

    def serve(self, keys: Collection[str]) -> None:
        """Say which keys the devices have that this host serves."""
        self._served = frozenset(keys) - {""}
        self._forms = {
            digest: beacon for digest, beacon in self._forms.items() if beacon.key in self._served
        }

    def known(self, packet: bytes) -> Beacon | None:
        """Return what a served device has signed in these very bytes before; None: it is news."""
        return self._forms.get(hashlib.sha256(packet).digest())

    def learn(self, packet: bytes, beacon: Beacon) -> None:
        """Remember an announcement whose signature was checked; a stranger's is forgotten."""
        if beacon.key not in self._served:
            return
        forms = [digest for digest, one in self._forms.items() if one.key == beacon.key]
        if len(forms) >= MOST_FORMS:
            del self._forms[forms[0]]
        self._forms[hashlib.sha256(packet).digest()] = beacon

    def admits(self, sender: str) -> bool:
        """Say whether what this sender says is read at all."""
        digest = hashlib.blake2b(sender.encode(), key=self._secret, digest_size=4).digest()
        share = self._shares[int.from_bytes(digest) % SHARES_COUNT]
        is_admitted = share.take(self._mono_s())
        self.dropped_count += not is_admitted
        return is_admitted

    def is_news(self, one: Sighting) -> bool:
        """Say whether this was not told just now, and may be told.

        Of a served device it is told that its key was heard, from wherever: who repeats it from
        a thousand addresses has it told no more often.
        """
        now_s, is_served = self._mono_s(), one.public_key in self._served
        key = (mark_of(one), "" if is_served else one.address)
        if now_s - self._told_s.get(key, -SAME_AGAIN_S) < SAME_AGAIN_S:
            return False
        if not is_served and one.source == "beacon" and not self._news.take(now_s):
            self.dropped_count += 1
            return False
        if len(self._told_s) >= MOST_REMEMBERED:
            self._forget(now_s)
        self._told_s[key] = now_s
        return True

    def _forget(self, now_s: float) -> None:
        """Forget what may be told again; where that is nothing, the oldest half."""
        kept = {key: at_s for key, at_s in self._told_s.items() if now_s - at_s < SAME_AGAIN_S}
        if len(kept) >= MOST_REMEMBERED:
            kept = dict(sorted(kept.items(), key=lambda one: one[1])[MOST_REMEMBERED // 2 :])
        self._told_s = kept

    def complaint(self) -> str:
        """Say once a minute how much was dropped; "" where nothing was."""
        now_s, count = self._mono_s(), self.dropped_count
        if count == 0 or now_s - self._complained_s < COMPLAINT_S:
            return ""
        self._complained_s, self.dropped_count = now_s, 0
        return (
            f"{count} announcements were passed over: strangers say more than is listened to. "
            "Devices that are served are heard; a new one may take minutes to be found"
        )
