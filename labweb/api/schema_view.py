"""The page of the schema: made once, and cheap from then on."""

from __future__ import annotations

import hashlib
from threading import Lock
from typing import Any

from django.http import HttpResponse
from django.http.response import HttpResponseBase
from django.utils.cache import get_conditional_response
from drf_spectacular.views import SpectacularAPIView
from rest_framework.renderers import BaseRenderer
from rest_framework.request import Request

from labweb.common.requests import check_query, one_of

_FORMATS = {"format": one_of(("yaml", "json"))}
_made: dict[type[BaseRenderer], tuple[bytes, str]] = {}
_making = Lock()


class Schema(SpectacularAPIView):
    """The schema of the interface: the same for everybody, and until the process ends."""

    schema = None
    """It does not describe itself."""

    def get(self, request: Request, *_args: object, **_kwargs: object) -> HttpResponseBase:
        """Return the schema as YAML, or as JSON; 304 to who has it."""
        check_query(request, _FORMATS)
        renderer = request.accepted_renderer
        content, tag = self._rendered(renderer)
        answer = HttpResponse(content, content_type=renderer.media_type)
        answer["ETag"] = tag
        answer["Cache-Control"] = "private, no-cache"
        answer["Vary"] = "Accept"
        found = get_conditional_response(request, etag=tag, response=answer)
        return answer if found is None else found

    def _rendered(self, renderer: BaseRenderer) -> tuple[bytes, str]:
        """Make the schema once: of those who ask meanwhile, each waits for the first."""
        kind = type(renderer)
        with _making:
            if kind not in _made:
                generator: Any = self.generator_class(api_version=self.api_version)
                told: Any = renderer
                content: bytes = told.render(generator.get_schema(public=True), renderer_context={})
                _made[kind] = content, f'"{hashlib.sha256(content).hexdigest()}"'
            return _made[kind]
