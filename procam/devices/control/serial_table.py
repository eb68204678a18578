"""The serial protocol of a make of projector, as data."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from procam.devices.protocols import Power

WHEN_ON = frozenset({Power.ON})


@dataclass(frozen=True, slots=True)
class Query:
    """A query and its reply.

    Attributes
    ----------
    command : bytes to send.
    reply : pattern of a whole reply, with the group ``value``.
    answered_when : power states in which the projector answers it.
    """

    command: bytes
    reply: re.Pattern[bytes]
    answered_when: frozenset[Power] = WHEN_ON


@dataclass(frozen=True, slots=True)
class Timings:
    """Durations of a protocol.

    Attributes
    ----------
    reply_s : longest wait for an ordinary reply, on the wire [s].
    source_reply_s : longest wait for the reply to an input change, on the wire [s].
    quiet_s : silence on the wire after which no late reply will come [s].
    power_poll_s, confirm_poll_s : pause between two readings of a change, in the rig's time [s].
    power_change_s : longest cool-down and warm-up together, in the rig's time [s].
    confirm_s : longest time until a set value can be read back, in the rig's time [s].
    """

    reply_s: float
    source_reply_s: float
    quiet_s: float
    power_poll_s: float
    confirm_poll_s: float
    power_change_s: float
    confirm_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialTable:
    """One make's serial protocol.

    Attributes
    ----------
    make : name of the protocol, for messages.
    baud_rate : speed of the port [bit/s].
    terminator : bytes that end every reply.
    synchronise, synchronised : a command without effect, and its only reply.
    done : pattern of the reply to a command that was carried out.
    refused : pattern of the reply to a command or query that was refused.
    attempts : number of times that a command or query is sent before it fails.
    power, shutter, source, hours, errors : the queries.
    power_codes : power state by the value of `power`.
    power_on, power_off : commands.
    shutter_codes : shutter state by the value of `shutter`; True is dark.
    shutter_commands : command by wanted state; True is dark.
    source_command : prefix and suffix round a source code.
    source_code : pattern of a whole source code.
    source_names : meaning of each source code, on most models.
    source_groups : codes that may be read back after a code that leaves the choice to the projector.
    error_texts : meaning of each error code; empty for no error.
    timings : durations.
    """

    make: str
    baud_rate: int
    terminator: bytes
    synchronise: bytes
    synchronised: bytes
    done: re.Pattern[bytes]
    refused: re.Pattern[bytes]
    attempts: int
    power: Query
    power_codes: Mapping[str, Power]
    power_on: bytes
    power_off: bytes
    shutter: Query
    shutter_codes: Mapping[str, bool]
    shutter_commands: Mapping[bool, bytes]
    source: Query
    source_command: tuple[bytes, bytes]
    source_code: re.Pattern[str]
    source_names: Mapping[str, str]
    source_groups: Mapping[str, frozenset[str]] = field(default_factory=dict)
    hours: Query
    errors: Query
    error_texts: Mapping[str, str]
    timings: Timings
