"""The base of every endpoint: one wish has one effect, however often it is sent."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Collection, Mapping
from functools import partial
from http import HTTPStatus
from typing import Any, ClassVar

from django.core.files.uploadedfile import UploadedFile
from django.http import HttpResponse, QueryDict
from rest_framework.exceptions import APIException
from rest_framework.request import Request
from rest_framework.response import Response
from rest_framework.views import APIView

from labweb.accounts import services
from labweb.accounts.selectors import User, user_of
from labweb.accounts.selectors.access_tokens import AccessToken
from labweb.common.answers import AnswerRenderer, ApiAnswer
from labweb.common.requests import Parameter, check_query
from labweb.domain.approvals.access_tokens import AccessScope
from labweb.domain.errors import ForbiddenError, LabError, LockedError

ACTING = frozenset({"post", "put", "patch", "delete"})
READING = frozenset({"get", "head", "options"})
HEADER = "Idempotency-Key"
REPLAYED = "Idempotency-Replayed"

_HTTP = "http."

_KEY = re.compile(r"[!-~]{8,64}")
_JSON = "application/json"


class KeyMissingError(APIException):
    """What acts has to name the wish that it serves."""

    status_code = 400
    default_code = "http.key_missing"
    default_detail = (
        f"this request acts and has no {HEADER}: send one, a new UUID for each wish and the same "
        "one each time that you repeat the request"
    )


class KeyMalformedError(APIException):
    """The key is none."""

    status_code = 400
    default_code = "http.key_malformed"
    default_detail = f"{HEADER} has 8 to 64 visible ASCII characters, such as a UUID"


class KeyReusedError(APIException):
    """One key cannot name two wishes."""

    status_code = 409
    default_code = "http.key_reused"
    default_detail = (
        f"this {HEADER} belongs to another request that you sent before: send a new key with a "
        "new wish. Nothing was carried out now"
    )


class InProgressError(APIException):
    """The first request has not been answered yet."""

    status_code = 409
    default_code = "http.in_progress"
    default_detail = (
        f"a request with this {HEADER} is being carried out: send it again with the same key to "
        "get its answer"
    )
    wait = 1


def is_by_token(request: Request) -> bool:
    """Tell whether a program asks, with an access token."""
    return isinstance(request.auth, AccessToken)


def check_scope(request: Request, needed: AccessScope | None) -> None:
    """Refuse what an access token does not reach; whoever is signed in needs none.

    Args:
        request: By whom.
        needed: The scope; None: no token reaches it.

    Raises:
        ForbiddenError: The token does not reach it. Nothing was done.
    """
    token = request.auth
    if not isinstance(token, AccessToken):
        return
    if needed is None:
        text = "no access token may do this: sign in, and do it yourself"
        raise ForbiddenError(text, code="token.not_by_token")
    scope = AccessScope(token.scope)
    if not scope.holds(needed):
        text = f"this needs the scope {needed.value}, and the token {token.name!r} has {scope}"
        raise ForbiddenError(text, code="token.scope")


class Endpoint(APIView):
    """A view that answers with structs, and whose unsafe methods each carry out one wish once.

    A method is annotated with the struct that it returns, or with None; the schema says the same.

    A method acts unless `harmless` says why a second time does no more than the first. What
    acts needs a key. The first answer to a key, a refusal too, is kept for seven days and is
    the answer to each repetition. A request that could not be read (a code `http.…`) and a
    failure of the server change nothing and keep nothing.

    Source:
        IETF draft-ietf-httpapi-idempotency-key-header, "The Idempotency-Key HTTP Header Field".
    """

    harmless: ClassVar[Mapping[str, str]] = {}
    """Method that needs no key, in small letters → why."""

    queries: ClassVar[Mapping[str, Parameter]] = {}
    """What GET takes in the address; what is not declared here is refused, to any method."""

    statuses: ClassVar[Mapping[str, int]] = {}
    """Method, in small letters → status of its answer, where that is neither 200 nor 204."""

    answers: ClassVar[Mapping[str, Mapping[int, type[ApiAnswer]]]] = {}
    """Method → status → answer, of a method that has several and returns responses itself."""

    refusals: ClassVar[Mapping[str, Collection[int]]] = {}
    """Method, in small letters → statuses above 399 that no other method of its kind has."""

    documents: ClassVar[Mapping[str, str]] = {}
    """Parameter of the address → the value with which GET answers with a document in a format of
    its own instead of the struct."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {}
    """Method, in small letters → scope that an access token needs for it. GET needs `read`; what is
    not named here is done by nobody but a person who is signed in."""

    def perform_authentication(self, request: Request) -> None:
        """Find who calls; a token has to reach as far as the method."""
        super().perform_authentication(request)
        method = str(request.method).lower()
        check_scope(
            request, self.scopes.get(method, AccessScope.READ if method in READING else None)
        )

    def initial(self, request: Request, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - DRF's shape
        """Let who may call at all come in, with what is read; then guard what acts."""
        super().initial(request, *args, **kwargs)
        method = str(request.method).lower()
        check_query(request, self.queries if method in {"get", "head"} else {})
        handler = getattr(self, method, None)
        if handler is not None:
            respond = partial(self._respond, handler)
            once = partial(self._once, respond) if acts(type(self), method) else respond
            setattr(self, method, once)

    def _respond(
        self,
        handler: Callable[..., Any],
        request: Request,
        *args: Any,  # noqa: ANN401 - what the address names
        **kwargs: Any,  # noqa: ANN401
    ) -> Any:  # noqa: ANN401 - a response of whichever library
        """Return the response of a method: 204 where it returns nothing."""
        found = handler(request, *args, **kwargs)
        if found is None:
            return Response(status=HTTPStatus.NO_CONTENT)
        if not isinstance(found, ApiAnswer):
            return found
        method = str(request.method).lower()
        return Response(found, status=self.statuses.get(method, HTTPStatus.OK))

    def prepare(self, request: Request, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - what the address names
        """Do what takes long and changes nothing, before the act holds a transaction open.

        What it finds is kept in the view, which serves this request alone. A refusal here is
        the answer to the key, as one of the act is; but not that something is in use.
        """

    def _answer_before(self, actor: User, key: str, digest: str) -> services.WishAnswer | None:
        """Spare a repetition the preparation, where there is one."""
        if type(self).prepare is Endpoint.prepare:
            return None
        return services.find_answer(actor=actor, key=key, digest=digest)

    def _early(self, request: Request, *args: Any, **kwargs: Any) -> LabError | None:  # noqa: ANN401
        try:
            self.prepare(request, *args, **kwargs)
        except LabError as error:
            if error.code.startswith(_HTTP) or isinstance(error, LockedError):
                raise  # perhaps by the first request with this key, which is being prepared
            return error
        return None

    def _once(
        self,
        handler: Callable[..., Response],
        request: Request,
        *args: Any,  # noqa: ANN401 - what the address names
        **kwargs: Any,  # noqa: ANN401
    ) -> HttpResponse:
        first: list[Response] = []
        actor, key, digest = user_of(request), _key(request), digest_of(request)

        def act() -> services.WishAnswer:
            try:
                if refusal is not None:
                    raise refusal
                response = handler(request, *args, **kwargs)
            except LabError as error:
                if error.code.startswith(_HTTP):
                    raise
                response = self.handle_exception(error)
            first.append(response)
            content = b"" if response.data is None else AnswerRenderer().render(response.data)
            return services.WishAnswer(response.status_code, content, {})

        try:
            answer = self._answer_before(actor, key, digest)
            if answer is None:
                refusal = self._early(request, *args, **kwargs)
                answer = services.carry_out_once(act, actor=actor, key=key, digest=digest)
        except services.KeyOfAnotherRequestError as error:
            raise KeyReusedError from error
        except services.KeyInUseError as error:
            raise InProgressError from error
        return _replayed(answer) if answer.is_replayed else first[0]


def _replayed(answer: services.WishAnswer) -> HttpResponse:
    replayed = HttpResponse(answer.content, status=answer.status, content_type=_JSON)
    replayed[REPLAYED] = "true"
    return replayed


def acts(view: type[APIView], method: str) -> bool:
    """Tell whether a method of a view acts, so that it needs a key."""
    harmless: Mapping[str, str] = getattr(view, "harmless", {})
    return method in ACTING and hasattr(view, method) and method not in harmless


def _key(request: Request) -> str:
    key = str(request.headers.get(HEADER, ""))
    if not key:
        raise KeyMissingError
    if not _KEY.fullmatch(key):
        raise KeyMalformedError
    return key


def digest_of(request: Request) -> str:
    """Return the SHA-256 of method, address and body; of a form its fields and its files.

    The boundary of a form is left out: a browser makes another each time it sends the form.

    Raises:
        ParseError: The body cannot be read.
    """
    data = request.data
    body = sorted(map(_field, data.items())) if isinstance(data, QueryDict) else data
    told = [request.method, request.get_full_path(), body]
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def _field(item: tuple[str, object]) -> list[str]:
    name, value = item
    if not isinstance(value, UploadedFile):
        return [name, str(value)]
    value.seek(0)
    content = hashlib.file_digest(value, "sha256").hexdigest()
    value.seek(0)
    return [name, value.name or "", value.content_type or "", content]
