"""Example venues, golden calibrations and small real captures that come with procam."""
