"""The interfaces of devices, and the rig that holds them by name.

`protocols` defines cameras, projectors and remote controls; `rig` opens the backend that a venue names;
`control/` drives projectors over serial ports.
"""
