"""Keys, certificates, times that an authority confirms, and signed heads of chains."""
