"""Edge hosts, devices and driver versions, and who admitted them."""
