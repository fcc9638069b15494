"""SiLA 2 servers: what they tell of their features, and what they can be asked for."""
