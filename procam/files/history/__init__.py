"""The life of a venue in VENUE/history.sqlite: its runs, devices, calibrations, figures and hashes of files.

`recorded` writes one run, `History` reads, `verify_unchanged` compares a calibration with its hashes.
"""
