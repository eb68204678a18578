"""Cameras, projectors, wires and the rig that holds them by name."""
