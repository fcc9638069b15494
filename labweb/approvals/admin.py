"""Admin pages of policies, and of requests and decisions to read."""

from __future__ import annotations

from typing import Any

import msgspec
from django import forms
from django.contrib import admin
from django.db.models import Model
from django.http import HttpRequest

from labweb.accounts import services as account_services
from labweb.accounts.selectors import user_by_id
from labweb.approvals.models import ApprovalRequest, Decision, Policy
from labweb.common.admin import ReadOnly
from labweb.domain.approvals.approval_policy import parse_rule


class PolicyForm(forms.ModelForm):  # type: ignore[type-arg] # no generic at run time
    """A policy whose rule is one that the rules know."""

    class Meta:
        model = Policy
        fields = ("lab", "name", "rule", "allow_self", "is_active")

    def clean_rule(self) -> dict[str, Any]:
        """Refuse a rule that would never ask anybody."""
        rule: dict[str, Any] = self.cleaned_data["rule"]
        try:
            parse_rule(rule)
        except msgspec.ValidationError as error:
            raise forms.ValidationError(f"no such rule: {error}") from error
        return rule


@admin.register(Policy)
class Policies(admin.ModelAdmin[Policy]):
    """Rules that send a plan to a person. One that is not wanted is made inactive."""

    form = PolicyForm
    list_display = ("name", "lab", "is_active", "allow_self")
    list_filter = ("is_active",)
    list_select_related = ("lab",)

    def has_delete_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Refuse: requests name it."""
        del request, obj
        return False

    def save_model(
        self,
        request: HttpRequest,
        obj: Policy,
        form: forms.ModelForm[Policy],
        change: bool,  # noqa: FBT001 - Django's shape
    ) -> None:
        """Write the policy, who changed it, and what it was before."""
        before = _plain(Policy.objects.get(pk=obj.pk)) if change else None
        super().save_model(request, obj, form, change)
        account_services.write_audit(
            "policy.change" if change else "policy.add",
            str(obj.pk),
            actor=None if request.user.pk is None else user_by_id(request.user.pk),
            detail={**_plain(obj), "before": before},
            meaning="changes the policy" if change else "adds the policy",
        )


def _plain(row: Policy) -> dict[str, Any]:
    return {
        "name": row.name,
        "rule": row.rule,
        "allow_self": row.allow_self,
        "is_active": row.is_active,
    }


@admin.register(ApprovalRequest)
class ApprovalRequests(ReadOnly):
    """Questions. They are answered in the app."""

    nothing = "Nothing to approve. What a policy wants a second person for stands here."
    list_display = ("title", "state", "asked_by", "asked_at", "expires_at", "plan_digest")
    list_filter = ("state",)
    list_select_related = ("asked_by",)
    search_fields = ("title", "run_id", "plan_digest")


@admin.register(Decision)
class Decisions(ReadOnly):
    """Answers, with what was signed."""

    nothing = "Nobody has decided anything yet."
    list_display = ("at", "request", "printed_name", "meaning", "comment", "plan_digest")
    list_filter = ("is_approved",)
    list_select_related = ("request",)
    search_fields = ("printed_name", "plan_digest")
