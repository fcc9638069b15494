"""The twin's page behind our door, and the lab as the twin sees it."""
