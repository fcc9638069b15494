"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.workflows.api import drawing, recipes

urlpatterns = [
    path("steps", drawing.Steps.as_view()),
    path("workflows/<uuid:workflow_id>/draft", drawing.Drafts.as_view()),
    path("workflows/<uuid:workflow_id>/versions", drawing.Versions.as_view()),
    path("workflows/<uuid:workflow_id>/versions/<int:number>", drawing.OneVersion.as_view()),
    path("recipes/open", recipes.OpenRecipe.as_view()),
    path("recipes/advise", recipes.AdviseRecipe.as_view()),
    path("recipes/keep", recipes.KeepRecipe.as_view()),
]
