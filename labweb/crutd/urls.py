"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.crutd import api
from labweb.crutd.api import desk, exports

urlpatterns = [
    path("resources", api.Resources.as_view()),
    path("resources/contents", exports.ContentsExport.as_view()),
    path("lots/export", exports.LotsExport.as_view()),
    path("lab/export", exports.LabExport.as_view()),
    path("resources/<uuid:resource_id>/lineage", api.Lineage.as_view()),
    path("resources/<uuid:resource_id>/stock", desk.Stock.as_view()),
    path("resources/<uuid:resource_id>/reaction", desk.Reaction.as_view()),
    path("tickets/<uuid:ticket_id>", desk.OneTicket.as_view()),
    path("tickets/<uuid:ticket_id>/close", desk.CloseTicket.as_view()),
]
