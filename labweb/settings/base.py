"""What every deployment shares. Addresses and secrets come from the environment."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import django_stubs_ext
from psycopg.conninfo import conninfo_to_dict
from redis.connection import parse_url

django_stubs_ext.monkeypatch()  # lets Django's generic classes take their type argument

ROOT = Path(__file__).resolve().parents[2]

DATABASE_URL = os.environ.get("DATABASE_URL", "postgresql://labweb@/labweb")
REDIS_URL = os.environ.get("REDIS_URL", "redis://127.0.0.1:6379/0")
BROKER_URL = os.environ.get("AMQP_URL") or os.environ.get("LABWEB_BROKER_URL") or REDIS_URL
REDIS_DATABASE = int(parse_url(REDIS_URL).get("db", 0))  # type: ignore[no-untyped-call]
DATA_DIR = Path(os.environ.get("LABWEB_DATA", ROOT / "var" / "starter"))


LANES = {
    "stop": 2,
    "door": 3,
    "health": 1,
    "page": int(os.environ.get("LABWEB_PAGES_AT_ONCE", "6")),
    "work": int(os.environ.get("LABWEB_WORK_AT_ONCE", "3")),
    "slow": int(os.environ.get("LABWEB_SLOW_AT_ONCE", "3")),
    "twin": 3,
    "who": 2,
    "uplink": 3,
    "beat": 1,
    "joining": 2,
    "socket": 2,
    "feed": 1,
}
"""Connections to the database that each kind of request and socket has to itself, so that none
takes them from another; what belongs to which stands in `labweb.api.rate_limits`."""

_SPARE = 2
"""Of the start of a process, which belongs to no lane."""

POOL = {
    "min_size": 1,
    "max_size": sum(LANES.values()) + _SPARE,
    "timeout": 10,
    "reconnect_timeout": 3,
}
"""Times in seconds. The pool doubles its pause with each try to connect; a try that is given up
after three is begun anew by whoever asks next, so that a database that was long away is found
again as soon as one that was away for a moment."""


def database(url: str) -> dict[str, Any]:
    """Turn a PostgreSQL URL into Django's settings; any libpq form is accepted."""
    parts = conninfo_to_dict(url)
    return {
        "ENGINE": "django.db.backends.postgresql",
        "NAME": parts.pop("dbname", "labweb"),
        "USER": parts.pop("user", "labweb"),
        "PASSWORD": parts.pop("password", ""),
        "HOST": parts.pop("host", ""),
        "PORT": str(parts.pop("port", "")),
        "CONN_MAX_AGE": 0,
        # Of use to `labweb.common.database.prepared_queries` alone: what else runs binds its
        # values into the text.
        "OPTIONS": {**parts, "pool": POOL, "prepare_threshold": 0},
    }


def secret(name: str) -> str:
    """Read a secret from a file or the environment; never from the repository."""
    path = os.environ.get(f"{name}_FILE")
    return Path(path).read_text().strip() if path else os.environ.get(name, "")


SECRET_KEY = secret("LABWEB_SECRET_KEY")
DEBUG = False
ALLOWED_HOSTS = os.environ.get("LABWEB_HOSTS", "127.0.0.1,localhost").split(",")
APPEND_SLASH = False

INSTALLED_APPS = [
    "labweb.accounts",
    "labweb.resources",
    "labweb.enrollment",
    "labweb.crutd",
    "labweb.telemetry",
    "labweb.calibration",
    "labweb.workflows",
    "labweb.approvals",
    "labweb.runs",
    "labweb.records",
    "labweb.fleet",
    "rest_framework",
    "drf_spectacular",
    "channels",
    "labweb.common.apps.LabwebAdminConfig",
    "django.contrib.auth",
    "django.contrib.contenttypes",
    "django.contrib.sessions",
    "django.contrib.messages",
    "django.contrib.staticfiles",
]

MIDDLEWARE = [
    "django.middleware.security.SecurityMiddleware",
    "whitenoise.middleware.WhiteNoiseMiddleware",
    "labweb.api.middleware.headers",
    "django.contrib.sessions.middleware.SessionMiddleware",
    "django.middleware.common.CommonMiddleware",
    "django.middleware.csrf.CsrfViewMiddleware",
    "django.contrib.auth.middleware.AuthenticationMiddleware",
    "labweb.api.middleware.acts",
    "django.contrib.messages.middleware.MessageMiddleware",
    "django.middleware.clickjacking.XFrameOptionsMiddleware",
    "labweb.api.middleware.once_per_form",
]

ROOT_URLCONF = "labweb.urls"
ASGI_APPLICATION = "labweb.asgi.application"
AUTH_USER_MODEL = "accounts.User"
AUTHENTICATION_BACKENDS = ["labweb.accounts.selectors.Backend"]
AUTH_PASSWORD_VALIDATORS = [
    {"NAME": "django.contrib.auth.password_validation.MinimumLengthValidator"},
    {"NAME": "django.contrib.auth.password_validation.CommonPasswordValidator"},
    {"NAME": "django.contrib.auth.password_validation.NumericPasswordValidator"},
]
LOGIN_URL = "/login"

TEMPLATES = [
    {
        "BACKEND": "django.template.backends.django.DjangoTemplates",
        "DIRS": [ROOT / "labweb" / "templates"],
        "APP_DIRS": True,
        "OPTIONS": {
            "context_processors": [
                "django.template.context_processors.request",
                "django.contrib.auth.context_processors.auth",
                "django.contrib.messages.context_processors.messages",
            ]
        },
    }
]

DATABASES = {"default": database(DATABASE_URL)}
DEFAULT_AUTO_FIELD = "django.db.models.BigAutoField"

CHANNEL_LAYERS = {
    "default": {
        "BACKEND": "channels_redis.pubsub.RedisPubSubChannelLayer",
        # Redis publishes to the listeners of all its databases: two labs would hear each other.
        "CONFIG": {"hosts": [REDIS_URL], "prefix": f"labweb.{REDIS_DATABASE}"},
    }
}

CACHES = {
    "default": {
        "BACKEND": "django.core.cache.backends.redis.RedisCache",
        "LOCATION": REDIS_URL,
        "KEY_PREFIX": "labweb",
    }
}

_MIB = 2**20

DISK_WARN_BYTES = float(os.environ.get("LABWEB_DISK_WARN_MB", "1024")) * _MIB
"""With less left on a disk of the server or of a host, a person is warned."""

DISK_WARN_RATIO = float(os.environ.get("LABWEB_DISK_WARN_PERCENT", "5")) / 100
"""Or with less than this part of it, which counts up to 10 GiB."""

DISK_FLOOR_BYTES = float(os.environ.get("LABWEB_DISK_FLOOR_MB", "200")) * _MIB
"""With less left, no run is started."""

HEADS_EVERY_S = float(os.environ.get("LABWEB_HEADS_EVERY_S", "600"))
"""How often the ends of the audit trail, the decisions and the events are signed."""

LANGUAGE_CODE = "en"
# Times in the admin as everywhere else: the day by its number, the clock with 24 hours, UTC.
FORMAT_MODULE_PATH = ["labweb.common.formats"]
TIME_ZONE = "UTC"
USE_TZ = True
STATIC_URL = "/static/"
STATIC_ROOT = DATA_DIR / "static"
STATICFILES_DIRS = [ROOT / "labweb" / "static"]
WHITENOISE_USE_FINDERS = True
# Vite puts a hash of their content into the names of what it builds.
WHITENOISE_IMMUTABLE_FILE_TEST = r"^/static/web/assets/.+-[\w-]{8}\.\w+$"

SESSION_ENGINE = "labweb.common.database.sessions"
SESSION_COOKIE_HTTPONLY = True
SESSION_COOKIE_SAMESITE = "Lax"
SESSION_COOKIE_AGE = 12 * 3600
SESSION_IDLE_S = 60 * float(os.environ.get("LABWEB_IDLE_MINUTES", "60"))
"""A session in which nobody did anything for so long ends; 0: it does not."""

CSRF_COOKIE_SAMESITE = "Lax"
X_FRAME_OPTIONS = "SAMEORIGIN"
# The twin is shown in a frame of our own page, so DENY, which this check asks for, is too much.
SILENCED_SYSTEM_CHECKS = ["security.W019"]
SECURE_CONTENT_TYPE_NOSNIFF = True
SECURE_REFERRER_POLICY = "same-origin"
DATA_UPLOAD_MAX_MEMORY_SIZE = 2 * 1024 * 1024
# A form is read before anybody knows who sends it: it has an end whatever it is for.
FILE_UPLOAD_HANDLERS = ["labweb.common.files.uploads.Bounded"]

REST_FRAMEWORK = {
    "DEFAULT_AUTHENTICATION_CLASSES": [
        "labweb.api.access.token_sign_in.TokenAuthentication",
        "rest_framework.authentication.SessionAuthentication",
    ],
    "DEFAULT_PERMISSION_CLASSES": ["labweb.api.access.permissions.SignedIn"],
    "DEFAULT_RENDERER_CLASSES": ["labweb.common.answers.AnswerRenderer"],
    "DEFAULT_PARSER_CLASSES": ["labweb.api.json_bodies.StrictJSONParser"],
    "DEFAULT_SCHEMA_CLASS": "labweb.api.schema.LabSchema",
    "EXCEPTION_HANDLER": "labweb.api.errors.handle",
    "UNAUTHENTICATED_USER": "django.contrib.auth.models.AnonymousUser",
}
SPECTACULAR_SETTINGS = {
    "TITLE": "labweb",
    "VERSION": "1",
    "DESCRIPTION": "The operating system of the autonomous laboratory.",
    "OAS_VERSION": "3.1.0",
    # Enumerations are types of their own already, named as their classes are.
    "POSTPROCESSING_HOOKS": [],
    "SERVE_INCLUDE_SCHEMA": False,
    # Answers are plain documents without serializers; that is no matter of deployment.
    "ENABLE_DJANGO_DEPLOY_CHECK": False,
    "SERVE_PERMISSIONS": ["labweb.api.access.permissions.SignedIn"],
}

TRUSTED_PROXIES = [
    one.strip() for one in os.environ.get("LABWEB_TRUSTED_PROXIES", "").split(",") if one.strip()
]
"""Addresses and networks of proxies whose `X-Forwarded-For` says where a request comes from;
`unix` is whoever connects by a unix socket. Of all others the header is not read."""

RATE_TIMES = float(os.environ.get("LABWEB_RATE_TIMES", "1"))
"""How many times as much as usual one user or address may ask."""

SEND_WITHIN_S = float(os.environ.get("LABWEB_SEND_WITHIN_S", "30"))
"""How long a client may take for a block of an answer, or a frame, before it is cut off."""

RECEIVE_WITHIN_S = float(os.environ.get("LABWEB_RECEIVE_WITHIN_S", "30"))
"""How long a client may be silent before the next part of its request."""

LIMS_SECRET = secret("LABWEB_LIMS_SECRET")
"""Shared with a laboratory information system that sends deliveries; empty closes the door."""

LIMS_USER = os.environ.get("LABWEB_LIMS_USER", "")
"""Name of the user in whose name that system receives."""

TWIN_TOKEN_FILE = Path(os.environ.get("LABWEB_TWIN_TOKEN_FILE", DATA_DIR / "twin.token"))
"""Service token with which a twin follows the lab feed; mode 0600."""

EDGE_ADDRESS = os.environ.get("LABWEB_EDGE_ADDRESS", "")
"""Address and port at which edge hosts of other machines find the door; empty: it is closed."""

HOST_CERTIFICATE_S = float(os.environ.get("LABWEB_HOST_CERTIFICATE_S", "7776000"))
"""How long the certificate of an edge host lives; it is renewed after two thirds of that."""

TELEMETRY_KEEP_S = {
    0: float(os.environ.get("LABWEB_TELEMETRY_KEEP_RAW_S", "86400")),
    1: float(os.environ.get("LABWEB_TELEMETRY_KEEP_1S_S", "604800")),
    60: float(os.environ.get("LABWEB_TELEMETRY_KEEP_1MIN_S", "7776000")),
    3600: float(os.environ.get("LABWEB_TELEMETRY_KEEP_1H_S", "157680000")),
}
"""How old samples (0), and buckets of so many seconds, grow before they are trimmed."""

CALIBRATION_RUNS = "labweb.runs.services.calibration_runs"
"""What starts the runs of calibrations, recalls their numbers and asks a second person: as
`labweb.calibration.services.calibration_runs` says."""

LOGGING = {
    "version": 1,
    "disable_existing_loggers": False,
    "formatters": {"line": {"format": "%(asctime)s %(levelname)s %(name)s %(message)s"}},
    "handlers": {"stderr": {"class": "labweb.common.logs.LossyStream", "formatter": "line"}},
    "root": {"handlers": ["stderr"], "level": "INFO"},
}
