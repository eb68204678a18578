"""Intrinsics from photographs of flat targets, of a camera alone or of a projector-camera pair."""
