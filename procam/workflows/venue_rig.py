"""From venue.toml to a rig with its remote controls."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import cache

from procam.devices.protocols import BackendRig, ProjectorControl, SystemClock
from procam.devices.rig import FROM_BACKEND, Rig, known_backends, open_backend, open_control
from procam.errors import InputError
from procam.files.venue.load import Venue
from procam.files.venue.tables import BY_HAND

NO_BACKEND = BackendRig({}, {}, SystemClock())


def open_rig(venue: Venue) -> Rig:
    """Open all devices that a venue names; refuses names and sizes that their backends do not have.

    Where there are several backends, the clock is that of the first camera's.
    """
    table = venue.table
    with ExitStack() as undo:  # what was opened is let go if the rest cannot be
        backends = _open_backends(venue, undo)
        _check_devices(venue, backends)
        controls = {}
        for name, entry in table.projectors.items():
            if entry.control:
                controls[name] = _open_control(venue, name, backends[entry.backend])
                undo.callback(controls[name].close)
        undo.pop_all()
    cameras = {n: backends[entry.backend].cameras[n] for n, entry in table.cameras.items()}
    return Rig(
        cameras,
        {n: backends[entry.backend].projectors[n] for n, entry in table.projectors.items()},
        controls,
        next(iter(backends.values())).clock,
        tuple(closer for backend in backends.values() for closer in backend.closers),
    )


@contextmanager
def rig_owner(venue: Venue) -> Iterator[Callable[[], Rig]]:
    """A function that gives the rig of a venue, which its first call opens; it is left with the block."""
    with ExitStack() as stack:
        yield cache(lambda: stack.enter_context(open_rig(venue)))


@contextmanager
def open_projector_control(venue: Venue, name: str) -> Iterator[ProjectorControl]:
    """The remote control of one projector, without any camera; by hand too, if it has a cable.

    Raises
    ------
    InputError
        venue.toml has no such projector, or no control of it.
    """
    if name not in venue.table.projectors:
        raise InputError(
            f"projector {name!r} is not in venue.toml; choose one of {', '.join(venue.table.projectors)}"
        )
    entry = venue.table.projectors[name]
    if not entry.control:
        raise InputError(
            f"projector {name} has no control table in venue.toml; add "
            'control = { protocol = "escvp21", port = "/dev/ttyUSB0" }'
        )
    with ExitStack() as stack:
        backend = NO_BACKEND
        if entry.control.port == FROM_BACKEND and entry.backend != BY_HAND:
            settings = venue.backends.get(entry.backend, {})
            backend = open_backend(entry.backend, settings, venue.directory)
            for closer in backend.closers:
                stack.callback(closer)
        control = _open_control(venue, name, backend)
        stack.callback(control.close)
        yield control


def _open_control(venue: Venue, name: str, backend: BackendRig) -> ProjectorControl:
    table = venue.table.projectors[name].control
    assert table is not None
    return open_control(name, table.protocol, table.port, backend)


def _open_backends(venue: Venue, undo: ExitStack) -> dict[str, BackendRig]:
    """The backends of all devices by name; refuses devices that no backend drives."""
    path, names = venue.directory / "venue.toml", dict[str, str]()
    for kind, entries in (("camera", venue.table.cameras), ("projector", venue.table.projectors)):
        for name, entry in entries.items():
            if entry.backend == BY_HAND:
                raise InputError(
                    f"{path}: {kind} {name} is driven by hand; use `procam session plan "
                    f"{venue.directory}`, `procam doctor --photos` and `procam session add`"
                )
            names.setdefault(entry.backend, f"{kind}s.{name}.backend")
    for backend, where in names.items():
        if backend not in known_backends():
            raise InputError(
                f"{path}: {where}: no backend {backend!r} is installed, only "
                f"{', '.join([BY_HAND, *known_backends()])}; correct it, or install its package"
            )
    backends = dict[str, BackendRig]()
    for name in names:
        backends[name] = open_backend(name, venue.backends.get(name, {}), venue.directory)
        for closer in backends[name].closers:
            undo.callback(closer)
    return backends


def _check_devices(venue: Venue, backends: Mapping[str, BackendRig]) -> None:
    """Refuse names and sizes that the backends do not have."""
    for kind, wanted in (("cameras", venue.table.cameras), ("projectors", venue.table.projectors)):
        for name, entry in wanted.items():
            there = getattr(backends[entry.backend], kind)
            if name not in there:
                raise InputError(
                    f"{venue.directory / 'venue.toml'}: {kind}.{name}: backend {entry.backend!r} has no "
                    f"device of this name, only {', '.join(there)}; correct the name"
                )
            if tuple(there[name].size) != tuple(entry.size):
                raise InputError(
                    f"{venue.directory / 'venue.toml'}: {kind}.{name}.size: "
                    f"{list(entry.size)}, but the device has {list(there[name].size)}; correct it"
                )
