"""A server behind a TLS proxy."""

from __future__ import annotations

import os

from django.core.exceptions import ImproperlyConfigured

from labweb.settings.base import *
from labweb.settings.base import ALLOWED_HOSTS, SECRET_KEY

_SHORTEST_SECRET = 50
if len(SECRET_KEY) < _SHORTEST_SECRET:
    raise ImproperlyConfigured(
        "set LABWEB_SECRET_KEY_FILE to a file with a random key of at least 50 characters"
    )
if os.environ.get("LABWEB_ALLOW_SINGLE_FACTOR") != "yes":
    raise ImproperlyConfigured(
        "sign-in has one factor only: set LABWEB_ALLOW_SINGLE_FACTOR=yes to accept that, "
        "or put a sign-on proxy with a second factor in front"
    )
if os.environ.get("LABWEB_FAULTS"):
    raise ImproperlyConfigured("LABWEB_FAULTS breaks processes on purpose: never in production")

SECURE_SSL_REDIRECT = True
SECURE_PROXY_SSL_HEADER = ("HTTP_X_FORWARDED_PROTO", "https")
SECURE_HSTS_SECONDS = 31536000
SECURE_HSTS_INCLUDE_SUBDOMAINS = True
SECURE_HSTS_PRELOAD = True
SESSION_COOKIE_SECURE = True
CSRF_COOKIE_SECURE = True
CSRF_TRUSTED_ORIGINS = [f"https://{host}" for host in ALLOWED_HOSTS]
