"""Example venues and small real captures that come with procam."""
