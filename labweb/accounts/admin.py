"""Admin pages of users, grants and the audit trail."""

from __future__ import annotations

from typing import Any

from django.contrib import admin
from django.contrib.auth.admin import UserAdmin
from django.contrib.auth.forms import AdminPasswordChangeForm
from django.contrib.auth.models import Group
from django.db.models import Model, QuerySet
from django.forms import ModelForm
from django.http import HttpRequest

from labweb.accounts import services
from labweb.accounts.models import AuditEntry, Grant, User
from labweb.accounts.selectors import user_by_id
from labweb.common.admin import ReadOnly

# Roles are grants on subtrees; Django's groups would be a second, silent way.
admin.site.unregister(Group)


def _audit(request: HttpRequest, action: str, row: Model, detail: dict[str, Any]) -> None:
    actor = None if request.user.pk is None else user_by_id(request.user.pk)
    services.write_audit(action, str(row.pk), actor=actor, detail=detail)


class ForeignPassword(AdminPasswordChangeForm):  # type: ignore[type-arg] # none at run time
    """A password that an admin sets: who signs in with it has to choose their own."""

    def save(self, commit: bool = True) -> User:  # noqa: FBT001, FBT002 - Django's shape
        """Set the password, and have its owner change it first thing."""
        user: User = super().save(commit)
        services.note_foreign_password(user)
        return user


@admin.register(User)
class Users(UserAdmin):  # type: ignore[type-arg] # no generic at run time
    """People who sign in. Nobody is deleted, for their name stands under decisions."""

    list_display = ("username", "printed_name", "email", "is_active", "is_staff", "last_login")
    list_filter = ("is_active", "is_staff")
    filter_horizontal = ()
    change_password_form = ForeignPassword
    fieldsets = (
        (None, {"fields": ("username", "password")}),
        ("Name", {"fields": ("first_name", "last_name", "email")}),
        ("May sign in", {"fields": ("is_active",)}),
        ("May use these pages", {"fields": ("is_staff", "is_superuser")}),
        ("Times", {"fields": ("last_login", "date_joined")}),
    )
    readonly_fields = ("last_login", "date_joined")

    def has_delete_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Refuse: take away `active` instead."""
        del request, obj
        return False

    def save_model(
        self,
        request: HttpRequest,
        obj: User,
        form: ModelForm[Any],
        change: bool,  # noqa: FBT001 - Django's shape
    ) -> None:
        """Write the user and who changed what; never the password."""
        super().save_model(request, obj, form, change)
        if not change and obj.pk != request.user.pk:
            services.note_foreign_password(obj)
        changed = sorted(set(form.changed_data) - {"password", "password1", "password2"})
        _audit(request, "user.change" if change else "user.add", obj, {"fields": changed})


@admin.register(Grant)
class Grants(admin.ModelAdmin[Grant]):
    """Roles on subtrees. A grant is given or taken away, never edited."""

    list_display = ("user", "role", "resource")
    list_filter = ("role",)
    list_select_related = ("user", "resource")
    search_fields = ("user__username", "resource__name")
    raw_id_fields = ("resource",)

    def has_change_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Refuse: delete it and give another."""
        del request, obj
        return False

    def save_model(
        self,
        request: HttpRequest,
        obj: Grant,
        form: ModelForm[Grant],
        change: bool,  # noqa: FBT001 - Django's shape
    ) -> None:
        """Write the grant and who gave it."""
        super().save_model(request, obj, form, change)
        _audit(request, "grant.add", obj, _detail(obj))

    def delete_model(self, request: HttpRequest, obj: Grant) -> None:
        """Take the grant away and write down who did."""
        _audit(request, "grant.remove", obj, _detail(obj))
        super().delete_model(request, obj)

    def delete_queryset(self, request: HttpRequest, queryset: QuerySet[Grant]) -> None:
        """Take several away, each with its own entry."""
        for row in queryset:
            self.delete_model(request, row)


def _detail(row: Grant) -> dict[str, str]:
    return {"user": str(row.user_id), "role": row.role, "resource": str(row.resource_id)}


@admin.register(AuditEntry)
class AuditEntries(ReadOnly):
    """Who did what."""

    list_display = ("at", "actor", "action", "subject", "reason")
    list_filter = ("action",)
    list_select_related = ("actor",)
    search_fields = ("subject", "reason", "actor__username")
