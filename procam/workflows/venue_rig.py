"""From venue.toml to a rig with its remote controls."""

from contextlib import ExitStack

from procam.devices.protocols import BackendRig
from procam.devices.rig import Rig, open_backend, open_control
from procam.errors import InputError
from procam.files.venue import Venue


def open_rig(venue: Venue) -> Rig:
    """Open all devices that a venue names; refuses names and sizes the backend does not have."""
    table = venue.table
    names = {d.backend for d in table.cameras.values()}
    names |= {d.backend for d in table.projectors.values()}
    if len(names) != 1:
        raise InputError(
            f"{venue.directory / 'venue.toml'}: got backends {', '.join(sorted(names))}, expected "
            "one for all devices"
        )
    backend_name = names.pop()
    backend = open_backend(backend_name, venue.backends.get(backend_name, {}), venue.directory)
    with ExitStack() as undo:  # what was opened is let go if the rest cannot be
        for closer in backend.closers:
            undo.callback(closer)
        _check_devices(venue, backend_name, backend)
        controls = {}
        for name, entry in table.projectors.items():
            if entry.control:
                controls[name] = open_control(
                    name, entry.control.protocol, entry.control.port, backend
                )
                undo.callback(controls[name].close)
        undo.pop_all()
    return Rig(
        {name: backend.cameras[name] for name in table.cameras},
        {name: backend.projectors[name] for name in table.projectors},
        controls,
        backend.clock,
        backend.closers,
    )


def _check_devices(venue: Venue, backend_name: str, backend: BackendRig) -> None:
    """Refuse names and sizes that the backend does not have."""
    table = venue.table
    for kind, wanted, there in (
        ("cameras", table.cameras, backend.cameras),
        ("projectors", table.projectors, backend.projectors),
    ):
        for name, entry in wanted.items():
            if name not in there:
                raise InputError(
                    f"{venue.directory / 'venue.toml'}: {kind}.{name}: got a name that backend "
                    f"{backend_name!r} does not have, expected one of {', '.join(there)}"
                )
            if tuple(there[name].size) != tuple(entry.size):
                raise InputError(
                    f"{venue.directory / 'venue.toml'}: {kind}.{name}.size: got "
                    f"{list(entry.size)}, but the device has {list(there[name].size)}"
                )
