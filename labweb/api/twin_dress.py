"""What our own door adds to viser's page: its panel is hidden, our page moves the camera."""

from __future__ import annotations

_STYLE = """
.mantine-Paper-root, .mantine-Notifications-root, .mantine-Modal-root, [data-floating-window],
[data-dock-root] a { display: none !important; }
"""
"""Panel, toasts, dialogs and logo of viser. What stays is the picture and its labels."""

_SCRIPT = """
addEventListener("message", (event) => {
  if (event.source !== parent || parent === window) return;
  const wanted = event.data && event.data.labwebView;
  for (const button of document.querySelectorAll("button"))
    if (wanted && button.textContent.trim() === wanted) button.click();
});
"""
"""A page that frames this one may press a button of the hidden panel by its name. Who may frame
it is decided by the policy's `frame-ancestors`; buttons do nothing but move this one camera."""

_ADDED = f"<style>{_STYLE}</style><script>{_SCRIPT}</script>".encode()
_HEAD_END = b"</head>"


def dress(page: bytes) -> bytes:
    """Return viser's page without its panel; a page without a head is left as it is."""
    head, end, body = page.partition(_HEAD_END)
    return head + _ADDED + end + body if end else page
