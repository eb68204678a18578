"""Frozen dataclasses: what is known about a rig. They hold arrays and numbers, no physics."""
