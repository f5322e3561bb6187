"""What every test starts with."""

import signal


def pytest_configure() -> None:
    """Ctrl-C interrupts, as in a terminal: programs that a shell starts in the background ignore it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
