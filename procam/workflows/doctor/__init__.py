"""Examines every device that a venue names before a capture session."""
