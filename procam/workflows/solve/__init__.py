"""From stored captures to a calibration, without devices."""
