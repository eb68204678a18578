"""Frames of one projector, sampled from a dome master of direct light."""
