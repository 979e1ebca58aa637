"""The explorer: latency, expected errors, screenshots."""
