"""Every URL of the server."""

from __future__ import annotations

from django.contrib import admin
from django.urls import include, path, re_path

from labweb.api import errors, pages
from labweb.api.schema_view import Schema
from labweb.api.twin import proxy

admin.autodiscover()

urlpatterns = [
    path("healthz", pages.health),
    path("api/schema/", Schema.as_view(), name="schema"),
    path("api/v1/", include("labweb.api.urls")),
    re_path(r"^api/", errors.no_such),
    path("admin/", admin.site.urls),
    re_path(r"^twin/view(?:/(?P<path>.*))?$", proxy.page),
    re_path(r"^(?!api/|admin/|static/|ws/|twin/view).*$", pages.app),
]

handler500 = errors.server_error
