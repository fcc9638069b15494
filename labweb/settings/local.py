"""The embedded default: one machine, plain HTTP on loopback."""

from __future__ import annotations

from labweb.settings.base import *

SESSION_COOKIE_SECURE = False
CSRF_COOKIE_SECURE = False
WHITENOISE_AUTOREFRESH = True  # a page that was built again is served without a restart
