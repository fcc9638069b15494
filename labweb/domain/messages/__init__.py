"""Every message between server and edge host: typed, versioned, plain data."""
