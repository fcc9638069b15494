"""Registers the admin pages under our own site, when the first address is asked for."""

from __future__ import annotations

from collections.abc import Sequence

from django.apps import AppConfig
from django.contrib import admin
from django.contrib.admin.apps import SimpleAdminConfig
from django.contrib.admin.checks import check_admin_app, check_dependencies
from django.core import checks


class LabwebAdminConfig(SimpleAdminConfig):
    """`django.contrib.admin` with labweb's site in place of the default one.

    The pages are found by `labweb.urls`, and not at the start of every process: to load them is
    half of the start of one that serves none.
    """

    default = False
    default_site = "labweb.api.admin_site.LabAdminSite"

    def ready(self) -> None:
        """Register the checks of the admin, and load no page."""
        checks.register(check_dependencies, checks.Tags.admin)
        checks.register(check_pages, checks.Tags.admin)


def check_pages(
    app_configs: Sequence[AppConfig] | None, **kwargs: object
) -> Sequence[checks.CheckMessage]:
    """Look at every page of the admin, also where no address has been asked for yet."""
    admin.autodiscover()
    found: Sequence[checks.CheckMessage] = check_admin_app(app_configs, **kwargs)
    return found
