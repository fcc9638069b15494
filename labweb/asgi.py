"""The ASGI entry points: `application` for `uvicorn`, `door` for `manage.py edge_door`."""

from __future__ import annotations

import os

import django

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "labweb.settings.local")
django.setup()

from labweb import celery  # noqa: E402 - needs configured settings
from labweb.api.host_door import application as build_door  # noqa: E402
from labweb.api.lifespan import with_lifespan  # noqa: E402
from labweb.api.outermost_layer import with_borders  # noqa: E402
from labweb.api.routing import application as build  # noqa: E402

application = with_borders(with_lifespan(build(), celery.app))
door = with_borders(build_door())
