"""The process that computes: takes jobs on its standard input, answers on its standard output.

Apart from the server, so that no image and no setting can take the server with it, and so that a job can be
stopped at any moment: where the core does not look up in time, the process is ended.
"""

from __future__ import annotations

import _thread
import os
import queue
import signal
import sys
import threading
from io import FileIO
from types import FrameType
from typing import Any

from stereopsis.view import work
from stereopsis.view.wire import receive, send

MESSAGE_LIMIT = 500


class Stopped(BaseException):
    """The job that runs is not wanted any more."""


class _Inbox:
    """Jobs in order; what stops one is heard while another runs."""

    def __init__(self, pipe: FileIO) -> None:
        self.jobs: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.running: int | None = None
        self.unwanted = -1
        self._pipe = pipe
        signal.signal(signal.SIGTERM, self._raise)
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        while True:
            try:
                number, *job = receive(self._pipe)
            except (EOFError, OSError):
                os._exit(0)  # the server has ended
            if job:
                self.jobs.put((number, *job))
            else:
                self.unwanted = number
                # As if that signal had come: the core asks for signals while it computes.
                _thread.interrupt_main(signal.SIGTERM)

    def _raise(self, number: int, frame: FrameType | None) -> None:
        if self.running is not None and self.running == self.unwanted:
            raise Stopped


def main() -> None:
    """Answer jobs until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's Ctrl-C is the server's
    outbox = FileIO(os.dup(1), "w")
    os.dup2(2, 1)  # what a library prints must not get among the answers
    inbox = _Inbox(FileIO(os.dup(0), "r"))
    _limit_memory(int(sys.argv[1]))
    desk = work.Desk()
    while True:
        number, function, arguments, parcel = inbox.jobs.get()
        answer: tuple[Any, ...]
        desk.keep(*parcel)
        try:
            inbox.running = number
            if number == inbox.unwanted:
                raise Stopped
            answer = (number, "done", desk.do(function, parcel[0], arguments))
            inbox.running = None
        except Stopped:
            answer = (number, "stopped", None)
        except MemoryError:
            answer = (number, "refused", "not enough memory for this computation")
        except (ValueError, TypeError, OSError) as error:
            answer = (number, "refused", " ".join(str(error).split())[:MESSAGE_LIMIT])
        except Exception as error:
            answer = (number, "failed", f"{type(error).__name__}: {error}"[:MESSAGE_LIMIT])
        inbox.running = None
        send(outbox, answer)
        del answer, arguments, parcel


def _limit_memory(size: int) -> None:
    """So that a computation that is too large is refused, and nothing else is starved."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    if size:
        resource.setrlimit(resource.RLIMIT_DATA, (size, size))


if __name__ == "__main__":
    main()
