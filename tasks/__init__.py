"""Top floor: what users meet, from quantities and command line to pictures."""
