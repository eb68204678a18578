"""Domes that a media server already aligned: camera pose and response from dome masters."""
