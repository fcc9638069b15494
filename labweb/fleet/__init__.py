"""Edge hosts at work: their link, reports, loss, devices, drivers and tries of drivers."""
