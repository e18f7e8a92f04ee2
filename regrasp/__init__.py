"""Stable placements, free spots on supports, handovers, and the regrasp graph over them."""
