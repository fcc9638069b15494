"""Leave out the tests of a command that the project does not have."""

from __future__ import annotations

from pathlib import Path

_COMMAND = "labweb/*/management/commands/compile_transfers.py"
HAS_COMMAND = any(Path(__file__).parents[2].glob(_COMMAND))
collect_ignore = [] if HAS_COMMAND else ["test_compiled_transfers.py", "test_compiled_routes.py"]
