"""What a driver offers, as data: enrollment, planning and dispatch read it, never the code."""
