"""Registers the admin pages under our own site."""

from __future__ import annotations

from django.contrib.admin.apps import AdminConfig


class LabwebAdminConfig(AdminConfig):
    """`django.contrib.admin` with labweb's site in place of the default one."""

    default = False
    default_site = "labweb.common.admin.Site"
