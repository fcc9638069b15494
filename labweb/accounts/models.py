"""Users, their roles on subtrees, and the audit trail."""

from __future__ import annotations

from django.contrib.auth.models import AbstractUser
from django.db import models

from labweb.common.clock import new_id
from labweb.common.models import Base, enum_choices
from labweb.domain.approvals.access_tokens import AccessScope


class User(AbstractUser):
    """A person who signs in."""

    class PasswordFrom(models.TextChoices):
        """Who chose the password that is in force."""

        OWN = "own"
        ADMIN = "admin"
        """Somebody else knows it: it has to be changed before anything else."""

        SEED = "seed"
        """The start of a lab with simulated instruments made it: a change is advised."""

    id = models.UUIDField(primary_key=True, default=new_id, editable=False)
    password_from = models.CharField(
        max_length=8, choices=PasswordFrom.choices, default=PasswordFrom.OWN, editable=False
    )

    @property
    def printed_name(self) -> str:
        """Name as it stands under a decision."""
        return self.get_full_name() or self.username


class Grant(Base):
    """A role on a subtree: it holds for the resource and everything below it."""

    class Role(models.TextChoices):
        """What a person does in the lab."""

        OBSERVER = "observer"
        CHEMIST = "chemist"
        APPROVER = "approver"
        ADMIN = "admin"

    user = models.ForeignKey(User, on_delete=models.CASCADE, related_name="grants")
    role = models.CharField(max_length=16, choices=Role.choices)
    resource = models.ForeignKey("resources.Resource", on_delete=models.CASCADE, related_name="+")

    class Meta:
        constraints = [
            models.UniqueConstraint(fields=["user", "role", "resource"], name="grant_once")
        ]

    def __str__(self) -> str:
        return f"{self.user} as {self.role}"


class AccessToken(Base):
    """Leave for a program to act in the name of a person; of its secret only the hash is here."""

    user = models.ForeignKey(User, on_delete=models.CASCADE, related_name="access_tokens")
    lab = models.ForeignKey("resources.Lab", on_delete=models.CASCADE, related_name="+")
    name = models.CharField(max_length=100)
    scope = models.CharField(max_length=16, choices=enum_choices(AccessScope))
    secret_hash = models.CharField(max_length=64, unique=True)
    created_at = models.DateTimeField()
    expires_at = models.DateTimeField()
    revoked_at = models.DateTimeField(null=True)
    used_at = models.DateTimeField(null=True)
    """When it was last used, to the minute."""

    class Meta:
        ordering = ["-created_at"]

    def __str__(self) -> str:
        return self.name


class AuditEntry(models.Model):
    """Who did what to which object. Appended, never edited; each row binds the one before."""

    id = models.BigAutoField(primary_key=True)
    at = models.DateTimeField()
    actor = models.ForeignKey(User, null=True, on_delete=models.PROTECT, related_name="+")
    action = models.CharField(max_length=64)
    subject = models.CharField(max_length=128)
    reason = models.TextField(blank=True)
    detail = models.JSONField(default=dict)
    prev_hash = models.CharField(max_length=64)
    hash = models.CharField(max_length=64, unique=True)

    class Meta:
        verbose_name_plural = "audit entries"
        ordering = ["-id"]

    def __str__(self) -> str:
        return f"{self.action} {self.subject}"


class SignedHead(models.Model):
    """Where a chain ended at a time, signed with a key that is in no database.

    Appended, never edited. A chain that was hashed anew fits its signed heads no more.
    """

    id = models.BigAutoField(primary_key=True)
    chain = models.CharField(max_length=64)
    """`audit`, `decisions`, or `events:` and the id of a lab."""

    seq = models.BigIntegerField()
    """Number of the last row of the chain."""

    at = models.DateTimeField()
    key = models.CharField(max_length=64)
    """Public half of the key, base64. A verifier must know it from elsewhere to trust it."""

    body = models.TextField()
    """The signed text, a `ChainHead`."""

    signature = models.CharField(max_length=100)

    class Meta:
        ordering = ["-id"]
        constraints = [models.UniqueConstraint(fields=["chain", "seq"], name="head_once")]

    def __str__(self) -> str:
        return f"{self.chain} at {self.seq}"


class KeptAnswer(models.Model):
    """What was answered to a request that acts, by the key that its sender gave it.

    Only who has the key can read the answer: it is sealed with it, and the key is kept as a digest.
    """

    id = models.BigAutoField(primary_key=True)
    user = models.ForeignKey(User, on_delete=models.CASCADE, related_name="+")
    key_digest = models.CharField(max_length=64)
    request_digest = models.CharField(max_length=64)
    """Of method, address and body: the same key is good for the same request alone."""

    sealed = models.BinaryField()
    at = models.DateTimeField(db_index=True)

    class Meta:
        constraints = [
            models.UniqueConstraint(fields=["user", "key_digest"], name="one_answer_to_a_key")
        ]

    def __str__(self) -> str:
        return f"the answer to {self.key_digest[:12]}"
