"""Settings: base, local (embedded default), production, test."""
