"""Frozen dataclasses that describe a venue: devices, screen, light, plan, calibration.

They hold arrays and numbers and check their shapes. Physics is in `maths`, fits are in `estimate`.
Simulators may import this package: it gives them no formula that an estimator inverts.
"""
