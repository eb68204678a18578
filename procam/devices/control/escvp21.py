r"""ESC/VP21, the serial protocol of Epson projectors.

Commands end with a carriage return. The reply to a command that was carried out is ``:``, to a query
``NAME=VALUE\r:``, to a refused one ``ERR\r:``, and to an empty command ``:``. The reply to ``PWR ON``
may come only after the warm-up, 40 s to 100 s later; a projector with a fault answers few queries.
Source: Epson, ESC/VP21 Command User's Guide, chapters 2 and 5, and the command lists in the manuals
of single models.
"""

import re

from procam.devices.control.serial_table import Query, SerialTable, Timings
from procam.devices.protocols import Power

_COMPUTER = frozenset({"11", "12", "13", "14"})
_VIDEO = frozenset({"41", "42"})
_BNC = frozenset({"B1", "B2", "B3", "B4"})

ESC_VP21 = SerialTable(
    make="Epson ESC/VP21",
    baud_rate=9600,
    terminator=b":",
    synchronise=b"\r",
    synchronised=b":",
    done=re.compile(rb":"),
    refused=re.compile(rb"ERR\r:"),
    attempts=3,
    power=Query(b"PWR?\r", re.compile(rb"PWR=(?P<value>[0-9A-F]{2})\r:"), frozenset(Power)),
    power_codes={
        "00": Power.STANDBY,
        "01": Power.ON,
        "02": Power.WARMING,
        "03": Power.COOLING,
        "04": Power.STANDBY,  # with the network listening
        "05": Power.ERROR,
        "09": Power.STANDBY,  # with picture and sound passed through
    },
    power_on=b"PWR ON\r",
    power_off=b"PWR OFF\r",
    shutter=Query(b"MUTE?\r", re.compile(rb"MUTE=(?P<value>ON|OFF)\r:")),
    shutter_codes={"ON": True, "OFF": False},
    shutter_commands={True: b"MUTE ON\r", False: b"MUTE OFF\r"},
    source=Query(b"SOURCE?\r", re.compile(rb"SOURCE=(?P<value>[0-9A-F]{2})\r:")),
    source_command=(b"SOURCE ", b"\r"),
    source_code=re.compile(r"[0-9A-E][0-9A-F]"),  # F0 and up step through inputs blindly
    source_names={
        "11": "computer 1 RGB",
        "14": "computer 1 component",
        "1F": "computer 1",
        "30": "HDMI 1",
        "41": "video",
        "42": "S-video",
        "53": "network",
        "60": "SDI",
        "80": "HDBaseT",
        "A0": "DVI-D or HDMI 2",
        "B1": "BNC RGB",
        "B4": "BNC component",
        "BF": "BNC",
    },
    source_groups={"10": _COMPUTER, "1F": _COMPUTER, "40": _VIDEO, "B0": _BNC, "BF": _BNC},
    hours=Query(
        b"LAMP?\r",
        re.compile(rb"LAMP=(?P<value>\d+(?: \d+)*)\r:"),  # one number per lamp
        frozenset({Power.ON, Power.STANDBY}),
    ),
    errors=Query(
        b"ERR?\r",
        re.compile(rb"ERR=(?P<value>[0-9A-F]{2}(?: [0-9A-F]{2})*)\r:"),
        frozenset({Power.ON, Power.STANDBY, Power.ERROR}),
    ),
    error_texts={
        "00": "",
        "01": "fan",
        "03": "lamp failed at power on",
        "04": "internal temperature high",
        "06": "lamp",
        "07": "lamp cover open",
        "08": "cinema filter",
        "09": "capacitor disconnected",
        "0A": "auto iris",
        "0B": "subsystem",
        "0C": "air flow low",
        "0D": "air filter flow sensor",
        "0E": "power supply (ballast)",
        "0F": "shutter",
        "10": "cooling (Peltier element)",
        "11": "cooling (pump)",
        "12": "static iris",
        "13": "power supply unit",
        "14": "exhaust shutter",
        "15": "obstacle detected",
        "16": "interface board not recognised",
    },
    timings=Timings(
        reply_s=2.0,
        source_reply_s=8.0,  # 5 s with a stable signal, more without
        quiet_s=0.2,
        power_poll_s=1.0,
        confirm_poll_s=0.2,
        power_change_s=240.0,  # cool-down, then three tries to ignite a lamp: 100 s
        confirm_s=3.0,
    ),
)
