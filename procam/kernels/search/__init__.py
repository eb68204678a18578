"""Projector columns from sinusoids of several periods."""
