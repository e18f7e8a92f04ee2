"""Kumitate: assembly planning for dual-arm robots, from CAD meshes to a verified, timed plan."""
