"""The border to the outside: routers, errors, websockets, the proxy to the twin."""
