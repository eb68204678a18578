"""A simulated venue: dome, projectors, cameras and wires that share one scene and one clock.

It stands beside procam and shares none of the formulas it is used to test: light is carried by
flux tracing on the venue's real geometry.
"""
