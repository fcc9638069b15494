"""Where runs and jobs stand, from the events of their hosts, and how events are exported."""
