"""Drawing a workflow with the editor, as a person does it."""

from __future__ import annotations

from typing import Any

from playwright.sync_api import Locator, expect

from tests.e2e.visitor import Visitor
from tests.system.stack import Stack


def new_workflow(visitor: Visitor, name: str) -> str:
    """Make an empty workflow on the page of workflows, and return its id."""
    visitor.open("workflows")
    visitor.press("new-workflow")
    visitor.at("new-workflow-name").fill(name)
    visitor.key("Enter")
    visitor.page.wait_for_url("**/edit")
    visitor.at("editor").wait_for()
    return visitor.page.url.rstrip("/").split("/")[-2]


def field(visitor: Visitor, name: str) -> Locator:
    """Return a field of the selected step."""
    return visitor.at(f"field-{name}")


def add(visitor: Visitor, words: str) -> None:
    """Add a step with the keyboard alone: A, its name, Enter."""
    visitor.page.locator("#find-step").focus()
    visitor.page.keyboard.type(words)
    visitor.page.locator("[data-testid=palette] [data-testid^=add-]").first.wait_for()
    visitor.key("Enter")
    visitor.at("inspector").wait_for()


def pick(visitor: Visitor, name: str, choice: str) -> None:
    """Choose a resource by typing its name."""
    box = field(visitor, name)
    visitor.press(box)
    box.fill(choice)
    visitor.key("Enter")
    # What is merely typed is gone once the field is left; what was chosen stays.
    visitor.key("Tab")
    expect(box).to_have_value(choice)


def write(visitor: Visitor, name: str, text: str) -> None:
    """Type a value as a person does, over whatever stood there."""
    box = field(visitor, name)
    box.focus()
    visitor.key("Control+a")
    visitor.page.keyboard.type(text)


def wait_until_checked(visitor: Visitor) -> None:
    """Wait until the verdict belongs to what is drawn."""
    expect(visitor.at("findings-bar")).to_have_attribute("data-state", "checked")


def wait_until_saved(visitor: Visitor) -> None:
    """Wait until the server has what is drawn."""
    expect(visitor.at("saved")).to_have_attribute("data-state", "saved")


def draft(stack: Stack, workflow_id: str) -> dict[str, Any]:
    """Return the draft as the server keeps it."""
    found: dict[str, Any] = stack.client().get(f"workflows/{workflow_id}")["draft"]
    return found


def run_it(visitor: Visitor) -> None:
    """Start what is drawn, and wait for the page of the run."""
    wait_until_checked(visitor)
    visitor.press("run")
    visitor.press("start-run")
    visitor.page.wait_for_url("**/runs/*")
