"""Edge hosts, driver versions and devices."""

from __future__ import annotations

from django.db import models

from labweb.common.models import Base, enum_choices
from labweb.domain.runs.host_link.host_session import SessionState


class EdgeHost(Base):
    """A machine that owns devices and keeps a journal."""

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="hosts")
    key = models.CharField(max_length=100)
    name = models.CharField(max_length=200)
    public_key = models.CharField(max_length=64, blank=True)
    """Ed25519, base64; empty until the host has been admitted. The newest of its keys."""

    machine_id = models.CharField(max_length=200, blank=True)
    """Hash that names the machine; a machine that comes with another key is found by it."""

    has_broker = models.BooleanField(default=True)
    """Its commands go through the server's broker; else over its uplink alone."""

    asks_as = models.ForeignKey(
        "accounts.User", null=True, blank=True, on_delete=models.PROTECT, related_name="+"
    )
    """In whose name nodes beside this host may ask for actions; None: they may not."""

    suspended_at = models.DateTimeField(null=True)
    """Something asks a person whether this host is still itself: it gets nothing new."""

    state = models.CharField(
        max_length=16, choices=enum_choices(SessionState), default=SessionState.ENROLLING.value
    )
    state_at = models.DateTimeField(null=True)
    journal_id = models.UUIDField(null=True)
    acked_seq = models.BigIntegerField(default=0)
    hash_at_acked = models.CharField(max_length=64, blank=True)
    acked_happened_s = models.FloatField(null=True)  # by the server's clock; none is before it
    acked_uncertainty_s = models.FloatField(default=0)
    epoch = models.BigIntegerField(default=0)
    floor = models.BigIntegerField(default=0)
    last_dseq = models.BigIntegerField(default=0)
    epoch_seen = models.BigIntegerField(default=0)
    """Latest session in which the host has spoken: it is on its disk."""

    boots = models.JSONField(default=list)
    """Starts of the machine that have had a session, the latest last."""

    instance_id = models.CharField(max_length=64, blank=True)
    """Process that speaks in the present session."""

    pace = models.FloatField(default=1.0)  # seconds of lab time in a real one; 1 in a live lab
    clock_skew_s = models.FloatField(null=True)
    """Host's wall clock less the server's at its last heartbeat; shown, never decided by."""

    away_since_at = models.DateTimeField(null=True)
    """When it was heard last before it was isolated: it works alone since."""

    last_seen_at = models.DateTimeField(null=True)
    session_id = models.UUIDField(null=True)  # live connection; a second one is refused
    stop_acknowledged = models.UUIDField(null=True)
    """Last software stop this host confirmed."""

    stop_acknowledged_at = models.DateTimeField(null=True)
    heartbeat = models.JSONField(default=dict)

    class Meta:
        constraints = [models.UniqueConstraint(fields=["lab", "key"], name="host_key_once")]

    def __str__(self) -> str:
        return self.name


class Fence(Base):
    """Two people declare a host lost: what it was given is in doubt, and people answer for it."""

    host = models.ForeignKey(EdgeHost, on_delete=models.PROTECT, related_name="fences")
    reason = models.TextField()
    first_by = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    first_at = models.DateTimeField()
    second_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    second_at = models.DateTimeField(null=True)
    withdrawn_at = models.DateTimeField(null=True)
    """The host was heard of before anybody signed second."""

    class Meta:
        constraints = [
            models.UniqueConstraint(
                fields=["host"],
                condition=models.Q(second_at__isnull=True, withdrawn_at__isnull=True),
                name="one_open_fence",
            ),
            models.CheckConstraint(
                condition=~models.Q(first_by=models.F("second_by")), name="fence_two_people"
            ),
        ]

    def __str__(self) -> str:
        return f"fence of {self.host_id}"


class DriverVersion(Base):
    """Driver source that was read, by digest; a host loads it only once it is approved."""

    class State(models.TextChoices):
        """Where its approval stands."""

        PROPOSED = "proposed"
        APPROVED = "approved"
        REJECTED = "rejected"
        WITHDRAWN = "withdrawn"

    class Origin(models.TextChoices):
        """Who vouches for it."""

        RELEASE = "release"
        UPLOAD = "upload"

    digest = models.CharField(max_length=64, unique=True)
    module = models.CharField(max_length=200)
    class_name = models.CharField(max_length=100)
    role = models.CharField(max_length=64)
    spec = models.JSONField()
    sources = models.JSONField(default=dict)
    """Text by dotted name: the driver and what it shares. The digest is of these."""

    origin = models.CharField(max_length=10, choices=Origin.choices, default=Origin.RELEASE)
    state = models.CharField(max_length=10, choices=State.choices, default=State.APPROVED)
    note = models.TextField(blank=True)
    proposed_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    proposed_at = models.DateTimeField(null=True)
    approved_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    approved_at = models.DateTimeField(null=True)
    approval = models.JSONField(default=dict)
    """A signed `DriverApproval`; empty while it is not approved."""

    read_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        constraints = [
            models.CheckConstraint(
                condition=~models.Q(proposed_by=models.F("approved_by")), name="driver_two_people"
            ),
            models.CheckConstraint(
                condition=~models.Q(state="approved", origin="upload", approved_by=None),
                name="driver_upload_is_approved_by_a_person",
            ),
        ]

    def __str__(self) -> str:
        return f"{self.class_name} {self.digest[:8]}"


class Device(Base):
    """One instrument with one serial number."""

    class State(models.TextChoices):
        """Where its enrollment stands."""

        CANDIDATE = "candidate"
        ENROLLED = "enrolled"
        SUSPENDED = "suspended"
        RETIRED = "retired"

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="devices")
    host = models.ForeignKey(EdgeHost, on_delete=models.PROTECT, related_name="devices")
    key = models.CharField(max_length=200)
    name = models.CharField(max_length=200)
    driver = models.ForeignKey(DriverVersion, on_delete=models.PROTECT, related_name="devices")
    next_driver = models.ForeignKey(
        DriverVersion, null=True, on_delete=models.PROTECT, related_name="+"
    )
    """Version that shall take over, once its host has tried it and the device is idle."""

    is_next_ready = models.BooleanField(default=False)
    """The host has the next version on its disk, and has built it once."""

    next_parts = models.JSONField(default=dict)
    """What was decided of parts that the next version changes: digest, actor_id, reason."""

    driver_problem = models.JSONField(default=dict)
    """Why the host did not take the last version that was wanted: digest, code, message."""

    serving = models.JSONField(default=dict)
    """What its host said last of which version serves it: digest, host_id, at. Empty: none."""

    transport = models.CharField(max_length=300)
    config = models.JSONField(default=dict)
    nodes = models.JSONField(default=dict)
    """Role in the driver → resource id."""

    past_nodes = models.JSONField(default=dict)
    """The same of roles that it lost with a version; one that has them brings these back."""

    state = models.CharField(max_length=16, choices=State.choices, default=State.CANDIDATE)
    admitted_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    admitted_at = models.DateTimeField(null=True)
    admission = models.JSONField(null=True)
    """Admitted actions with their limits; null: all that the driver declares."""

    admitted_as = models.JSONField(default=dict)
    """What it was when it was admitted last, an `Admitted`; empty: it never was, or not noted."""

    kept_review = models.JSONField(default=dict)
    """What a person has filled in since the last decision, a `KeptReview`; empty: nothing."""

    suspended_for = models.TextField(blank=True)
    """Why labweb itself suspended it: another key spoke in its name."""

    discovered_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        ordering = ["key"]
        constraints = [models.UniqueConstraint(fields=["lab", "key"], name="device_key_once")]

    def __str__(self) -> str:
        return self.name


class Look(Base):
    """A host was asked to look at a device that nothing serves: who answers, what it tells."""

    device = models.ForeignKey(Device, on_delete=models.PROTECT, related_name="looks")
    driver = models.ForeignKey(DriverVersion, on_delete=models.PROTECT, related_name="+")
    host = models.ForeignKey(EdgeHost, on_delete=models.PROTECT, related_name="+")
    epoch = models.BigIntegerField()
    transport = models.CharField(max_length=300)
    config = models.JSONField()
    asked_by = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    asked_at = models.DateTimeField()
    told_at = models.DateTimeField(null=True)
    told = models.JSONField(default=dict)
    """What the host said, a `LookTold`; empty: nothing yet."""

    class Meta:
        ordering = ["-asked_at"]

    def __str__(self) -> str:
        return f"look at {self.device_id}"


class JoinToken(Base):
    """Leave for one machine to ask; of its secret only the hash is here."""

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="+")
    name = models.CharField(max_length=100, blank=True)
    """Name that the host is to have; empty: the machine says one."""

    secret_hash = models.CharField(max_length=64)
    created_by = models.ForeignKey("accounts.User", on_delete=models.PROTECT, related_name="+")
    created_at = models.DateTimeField()
    expires_at = models.DateTimeField()
    used_at = models.DateTimeField(null=True)
    withdrawn_at = models.DateTimeField(null=True)

    class Meta:
        ordering = ["-created_at"]

    def __str__(self) -> str:
        return f"token of {self.created_at:%Y-%m-%d %H:%M}"


class JoinRequest(Base):
    """A machine that asks to become a host, until a person has compared its code."""

    class State(models.TextChoices):
        """What a person said."""

        WAITING = "waiting"
        ADMITTED = "admitted"
        REJECTED = "rejected"

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="+")
    token = models.OneToOneField(JoinToken, on_delete=models.PROTECT, related_name="request")
    name = models.CharField(max_length=100)
    csr = models.TextField()
    public_key = models.CharField(max_length=64, unique=True)
    """Ed25519, base64. One that was rejected never asks again."""

    machine_id = models.CharField(max_length=200, blank=True)
    facts = models.JSONField(default=dict)
    address = models.CharField(max_length=64, blank=True)
    known_host = models.ForeignKey(
        EdgeHost, null=True, on_delete=models.PROTECT, related_name="claims"
    )
    """Host that the machine claims to be, with another key; it is suspended meanwhile."""

    state = models.CharField(max_length=16, choices=State.choices, default=State.WAITING)
    asked_at = models.DateTimeField()
    seen_at = models.DateTimeField()
    decided_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    decided_at = models.DateTimeField(null=True)
    reason = models.TextField(blank=True)
    host = models.ForeignKey(EdgeHost, null=True, on_delete=models.PROTECT, related_name="requests")

    class Meta:
        verbose_name = "join request"
        ordering = ["-asked_at"]

    def __str__(self) -> str:
        return self.name


class HostCertificate(Base):
    """One certificate of one host. Two may be good at the same time, while a key is changed."""

    host = models.ForeignKey(EdgeHost, on_delete=models.PROTECT, related_name="certificates")
    serial = models.CharField(max_length=64, unique=True)
    fingerprint = models.CharField(max_length=64, unique=True)
    """SHA-256 of the DER form, hex."""

    public_key = models.CharField(max_length=64)
    pem = models.TextField()
    not_before = models.DateTimeField()
    not_after = models.DateTimeField()
    issued_at = models.DateTimeField()
    used_at = models.DateTimeField(null=True)
    """First session that it opened."""

    ended_at = models.DateTimeField(null=True)
    """The next one is in use, or it was taken away."""

    class Meta:
        ordering = ["-issued_at"]

    def __str__(self) -> str:
        return f"certificate {self.serial[:8]}"


class Candidate(Base):
    """Something that a host sees and nobody has admitted; all it says is a claim."""

    class State(models.TextChoices):
        """What a person said."""

        NEW = "new"
        QUARANTINED = "quarantined"
        IGNORED = "ignored"
        REJECTED = "rejected"
        TAKEN_UP = "taken_up", "Taken up"

    lab = models.ForeignKey("resources.Lab", on_delete=models.PROTECT, related_name="+")
    host = models.ForeignKey(EdgeHost, on_delete=models.PROTECT, related_name="candidates")
    mark = models.CharField(max_length=64)
    """Hash of its key, else its serial, else its address: what makes it the same one."""

    source = models.CharField(max_length=16)
    address = models.CharField(max_length=200)
    also_at = models.CharField(max_length=200, blank=True)
    """Another address from which the same is announced: repeated by a stranger, or it has moved."""

    name = models.CharField(max_length=200, blank=True)
    model = models.CharField(max_length=200, blank=True)
    serial = models.CharField(max_length=200, blank=True)
    public_key = models.CharField(max_length=200, blank=True)
    driver_hint = models.CharField(max_length=200, blank=True)
    state = models.CharField(max_length=16, choices=State.choices, default=State.NEW)
    first_seen_at = models.DateTimeField()
    last_seen_at = models.DateTimeField()
    seen_count = models.BigIntegerField(default=1)
    key_changed_from = models.ForeignKey(
        "self", null=True, on_delete=models.PROTECT, related_name="+"
    )
    """It says it is this one, and has another key."""

    alone_since_at = models.DateTimeField(null=True)
    """Since when it is heard from where that device is, and that device's own key is not."""

    device = models.ForeignKey(Device, models.PROTECT, null=True, related_name="candidates")
    label = models.CharField(max_length=200, blank=True)
    """What a person read on the thing itself."""

    decided_by = models.ForeignKey(
        "accounts.User", null=True, on_delete=models.PROTECT, related_name="+"
    )
    decided_at = models.DateTimeField(null=True)
    reason = models.TextField(blank=True)

    class Meta:
        verbose_name = "discovered device"
        ordering = ["-last_seen_at"]
        constraints = [
            models.UniqueConstraint(fields=["host", "mark"], name="candidate_once_per_host")
        ]

    def __str__(self) -> str:
        return self.name or self.address
