"""From venue.toml to a rig with its remote controls."""

from contextlib import ExitStack

from procam.devices.protocols import BackendRig
from procam.devices.rig import Rig, known_backends, open_backend, open_control
from procam.errors import InputError
from procam.files.venue.load import BY_HAND, Venue


def open_rig(venue: Venue) -> Rig:
    """Open all devices that a venue names; refuses names and sizes the backend does not have."""
    table = venue.table
    backend_name = _backend_of(venue)
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


def _backend_of(venue: Venue) -> str:
    """The one backend of all devices; refuses devices that no backend drives."""
    path, names = venue.directory / "venue.toml", dict[str, str]()
    for kind, entries in (("camera", venue.table.cameras), ("projector", venue.table.projectors)):
        for name, entry in entries.items():
            if entry.backend == BY_HAND:
                raise InputError(
                    f"{path}: {kind} {name} is driven by hand; use `procam patterns "
                    f"{venue.directory}`, `procam doctor --photos` and `procam ingest`"
                )
            names.setdefault(entry.backend, f"{kind}s.{name}.backend")
    for backend, where in names.items():
        if backend not in known_backends():
            raise InputError(
                f"{path}: {where}: no backend {backend!r} is installed, only "
                f"{', '.join([BY_HAND, *known_backends()])}; correct it, or install its package"
            )
    if len(names) != 1:
        raise InputError(
            f"{path}: devices of the backends {', '.join(sorted(names))} cannot be mixed; use one for all"
        )
    return next(iter(names))


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
                    f"{venue.directory / 'venue.toml'}: {kind}.{name}: backend {backend_name!r} has no "
                    f"device of this name, only {', '.join(there)}; correct the name"
                )
            if tuple(there[name].size) != tuple(entry.size):
                raise InputError(
                    f"{venue.directory / 'venue.toml'}: {kind}.{name}.size: "
                    f"{list(entry.size)}, but the device has {list(there[name].size)}; correct it"
                )
