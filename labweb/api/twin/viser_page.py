"""What our door adds to viser's page: no panel; our page moves the camera and lights tubes."""

from __future__ import annotations

_STYLE = """
.mantine-Paper-root, .mantine-Notifications-root, .mantine-Modal-root, [data-floating-window],
[data-dock-root] a { display: none !important; }
"""
"""Panel, toasts, dialogs and logo of viser. What stays is the picture and its labels."""

_SCRIPT = """
const write = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set;
let route = "", waiting = 0;
function fieldOf(name) {
  let at = [...document.querySelectorAll("label")].find((one) => one.textContent.trim() === name);
  while (at && !at.querySelector("input")) at = at.parentElement;
  return at && at.querySelector("input");
}
function showRoute() {
  const field = fieldOf("Route");
  if (!field) return;
  clearInterval(waiting);
  if (field.value === route) return;
  write.call(field, route);
  field.dispatchEvent(new Event("input", { bubbles: true }));
}
addEventListener("message", (event) => {
  if (event.source !== parent || parent === window) return;
  const wanted = event.data && event.data.labwebView;
  for (const button of document.querySelectorAll("button"))
    if (wanted && button.textContent.trim() === wanted) button.click();
  if (event.data && Array.isArray(event.data.labwebRoute)) {
    route = JSON.stringify(event.data.labwebRoute);
    clearInterval(waiting);
    waiting = setInterval(showRoute, 200);
  }
});
"""
"""A page that frames this one may press a button of the hidden panel by its name, and fill in its
field for a route, which is there once viser is connected. Who may frame it is decided by the
policy's `frame-ancestors`; either changes nothing but what this one person sees."""

_ADDED = f"<style>{_STYLE}</style><script>{_SCRIPT}</script>".encode()
_HEAD_END = b"</head>"


def dress(page: bytes) -> bytes:
    """Return viser's page without its panel; a page without a head is left as it is."""
    head, end, body = page.partition(_HEAD_END)
    return head + _ADDED + end + body if end else page
