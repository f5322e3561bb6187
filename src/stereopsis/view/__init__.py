"""See it: a local page on which a pair, its disparity, its errors and its points in space are looked at.

::

    from stereopsis import view
    view.serve(view.street())
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from stereopsis import _extras
from stereopsis.view.targets import Target, open_target, street

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Target", "open_target", "require", "serve", "street"]


def require() -> None:
    """Check that what the extra ``view`` brings is installed.

    Raises
    ------
    ModuleNotFoundError
        Something is missing; names it and the extra.
    """
    _extras.require("the page needs", "view", "fastapi", "uvicorn", "python_multipart")


def serve(
    target: Target,
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    ready: Callable[[str], object] | None = None,
) -> None:
    """Serve the page until Ctrl-C.

    Parameters
    ----------
    target : Target
        What is looked at: `street()`, or what `open_target` made of paths.
    host : str
        Where to listen. Anything but a loopback address makes the page ask for a token, which the address
        carries.
    port : int
        0: any that is free.
    ready : callable, optional
        Called with the page's address as soon as it listens.

    Raises
    ------
    ModuleNotFoundError
        The extra ``view`` is not installed.
    OSError
        The address cannot be listened on.
    """
    require()
    from stereopsis.view.server import run

    run(target, host, port, ready)
