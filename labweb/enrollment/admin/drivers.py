"""Admin pages of driver versions."""

from __future__ import annotations

from django.contrib import admin

from labweb.common.admin import ReadOnly
from labweb.enrollment.models import DriverVersion


@admin.register(DriverVersion)
class DriverVersions(ReadOnly):
    """Driver source that was read, and who vouches for it."""

    list_display = ("class_name", "module", "state", "origin", "digest", "read_at")
    list_filter = ("state", "origin", "role")
    search_fields = ("class_name", "module", "digest")
