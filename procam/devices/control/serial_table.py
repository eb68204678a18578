"""How a make of projector talks over a serial wire, as data."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from procam.devices.protocols import Power

WHEN_ON = frozenset({Power.ON})


@dataclass(frozen=True, slots=True)
class Query:
    """A question and the answer it must get.

    Attributes
    ----------
    command : bytes to send.
    reply : pattern of a whole reply, with the group ``value``.
    answered_when : power states in which the question is worth asking.
    """

    command: bytes
    reply: re.Pattern[bytes]
    answered_when: frozenset[Power] = WHEN_ON


@dataclass(frozen=True, slots=True)
class Timings:
    """How long things take.

    Attributes
    ----------
    reply_s : longest wait for an ordinary reply, on the wire [s].
    source_reply_s : longest wait for the reply to an input change, on the wire [s].
    quiet_s : silence on the wire after which nothing late is expected any more [s].
    power_poll_s, confirm_poll_s : pause between two looks at a change, in the rig's time [s].
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
    make : whose protocol this is, for messages.
    baud_rate : speed of the port [bit/s].
    terminator : bytes that end every reply.
    synchronise, synchronised : a command without effect, and the only reply it can get.
    done : pattern of the reply to a command that was carried out.
    refused : pattern of the reply to a command or question that was not.
    attempts : times that a question is put before giving up.
    power, shutter, source, hours, errors : the questions.
    power_codes : what the answer to `power` means.
    power_on, power_off : commands.
    shutter_codes : what the answer to `shutter` means; True is dark.
    shutter_commands : command by wanted state; True is dark.
    source_command : prefix and suffix round a source code.
    source_code : pattern of a whole source code.
    source_names : what each source code stands for, on most models.
    source_groups : codes that may be read back after a code that lets the projector choose.
    error_texts : what an error code means; empty where it stands for no error.
    timings : how long things take.
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
