"""The suite: the same services, a database of its own, quick password hashing."""

from __future__ import annotations

import os
from pathlib import Path

from labweb.settings.base import *
from labweb.settings.base import REDIS_URL

SECRET_KEY = "only-for-tests-" + "x" * 50
PASSWORD_HASHERS = ["django.contrib.auth.hashers.MD5PasswordHasher"]
SESSION_COOKIE_SECURE = False
CSRF_COOKIE_SECURE = False
ALLOWED_HOSTS = ["*"]
# As `make run` has it. Each client would else look through every file that can be served.
WHITENOISE_AUTOREFRESH = True

# Each worker of a run copies the tables; what is missing in a server of others, it makes.
DATABASES["default"]["TEST"] = {"TEMPLATE": os.environ.get("LABWEB_TEST_TEMPLATE")}

# One prefix per run and xdist worker: they share one server.
_RUN = Path(os.environ.get("LABWEB_TEST_FOLDER", "alone")).name
_PREFIX = f"test.{_RUN}.{os.environ.get('PYTEST_XDIST_WORKER', 'main')}"
CHANNEL_LAYERS = {
    "default": {
        "BACKEND": "channels_redis.pubsub.RedisPubSubChannelLayer",
        "CONFIG": {"hosts": [REDIS_URL], "prefix": _PREFIX},
    }
}
CACHES = {
    "default": {
        "BACKEND": "django.core.cache.backends.redis.RedisCache",
        "LOCATION": REDIS_URL,
        "KEY_PREFIX": _PREFIX,
    }
}
