"""Who may use a thing: locks, reservations, claims, holds, and custody of a resource."""
