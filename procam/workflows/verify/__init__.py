"""Verifies a calibrated venue: a few photographs, compared with those of the session that was calibrated."""
