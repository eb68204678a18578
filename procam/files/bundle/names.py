"""The names that files in a bundle may have. The list is closed: nothing else is written or unpacked."""

import re

MANIFEST, README, VENUE = "manifest.json", "README.txt", "venue.toml"
ORIGINAL = "original/calibration.json"
SESSION = "sessions/0001"
PLAN = f"{SESSION}/plan.json"
_NAME = r"[A-Za-z0-9][A-Za-z0-9_-]*"
_PLACES = (
    *map(re.escape, (MANIFEST, README, VENUE, ORIGINAL, PLAN)),
    r"masks/[0-9]+\.png",
    r"responses/[0-9]+\.csv",
    r"meshes/[0-9]+\.obj",
    rf"{SESSION}/patterns/(?:[A-Za-z0-9_-]+/)*[A-Za-z0-9_-]+\.png",
    rf"{SESSION}/captures/{_NAME}/(?:index\.jsonl|{_NAME}@[0-9.e+-]+\.tif)",
)
ALLOWED = re.compile("|".join(_PLACES))
MOST_LETTERS = 200  # Windows allows 260, with the folder's own
# of Windows, where they open a device whatever their suffix and case
DEVICES = {
    *("con", "prn", "aux", "nul"),
    *(f"{port}{number}" for port in ("com", "lpt") for number in range(10)),
}


def is_allowed(name: str) -> bool:
    """Whether a file in a bundle may have this name.

    >>> [is_allowed(n) for n in ("venue.toml", "../venue.toml", "sessions/0001/captures/con/index.jsonl")]
    [True, False, False]
    """
    if len(name) > MOST_LETTERS or not ALLOWED.fullmatch(name):
        return False
    return not any(part.split(".")[0].lower() in DEVICES for part in name.split("/"))
