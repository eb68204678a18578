"""Remote control of projectors over serial ports.

A make is a `serial_table` of data, such as `escvp21`; `projector_control` is the engine for all makes, and
`serial_link` the port.
"""
