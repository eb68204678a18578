"""Frozen dataclasses that describe a venue: devices, screen, light, plan, calibration.

They hold arrays and numbers and check their shapes. Physics is in `maths`, fits are in `estimate`.
`frame` is what simulators may import; it holds no formula that an estimator inverts.
"""
