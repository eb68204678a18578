"""The clock of a simulated scene: sleeping takes no real time and advances the scene's time."""

import threading


class SceneClock:
    """Seconds since the scene was opened, for every device of the scene."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Scene time [s]."""
        with self._lock:
            return self._now_s

    def sleep(self, duration_s: float) -> None:
        """Advance the time by `duration_s` [s]."""
        with self._lock:
            self._now_s += max(0.0, duration_s)
