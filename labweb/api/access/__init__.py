"""Who calls: sessions, access tokens, and how often a password may be tried."""
