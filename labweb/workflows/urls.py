"""Routes of the app."""

from __future__ import annotations

from django.urls import path

from labweb.workflows.api import recipes, workflows

urlpatterns = [
    path("steps", workflows.Steps.as_view()),
    path("workflows/<uuid:workflow_id>/draft", workflows.Drafts.as_view()),
    path("workflows/<uuid:workflow_id>/versions", workflows.Versions.as_view()),
    path("workflows/<uuid:workflow_id>/versions/<int:number>", workflows.OneVersion.as_view()),
    path("recipes/open", recipes.OpenRecipe.as_view()),
    path("recipes/advise", recipes.AdviseRecipe.as_view()),
    path("recipes/keep", recipes.KeepRecipe.as_view()),
]
