"""How often something may happen: so many a second for long, and a burst after a rest."""


class TokenBucket:
    """Gives places away, first come, first served."""

    def __init__(self, rate_hz: float, burst: float) -> None:
        self._each_s, self._burst_s = 1.0 / rate_hz, burst / rate_hz
        self._booked_s = float("-inf")  # up to when all is given away

    def book(self, now_s: float) -> float:
        """Take the next place; how long until it comes."""
        self._booked_s = max(self._booked_s, now_s - self._burst_s) + self._each_s
        return max(0.0, self._booked_s - now_s)
