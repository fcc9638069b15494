"""The ASGI entry point: `uvicorn labweb.asgi:application`."""

from __future__ import annotations

import os

import django

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "labweb.settings.local")
django.setup()

from labweb import celery  # noqa: E402 - needs configured settings
from labweb.api.lifespan import with_lifespan  # noqa: E402
from labweb.api.routing import application as build  # noqa: E402

application = with_lifespan(build(), celery.app)
