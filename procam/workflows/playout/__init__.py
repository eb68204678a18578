"""Content through the compensator: sources, frame pipeline, warping, track for shaders."""
