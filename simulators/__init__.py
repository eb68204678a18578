"""A simulated venue: dome, projectors, cameras and wires that share one scene and one clock.

It is separate from procam and shares none of the formulas that it is used to test: light is transported
by flux tracing on the venue's real geometry. `backend.open_rig` is the entry point; `scene.DomeScene`
holds the dome (`surface`), the projectors (`builds`, `placement`, `projector_light`), the room
(`transport`) and the lines of sight (`sight_lines`); `devices`, `sensor`, `server`, `serial_port` and
`faults` are the devices that procam drives, and `truth` writes the exact answer after a run.
"""
