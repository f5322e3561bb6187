"""What an extra brings: one sentence where it is not installed."""

from __future__ import annotations

from importlib.util import find_spec


class MissingExtraError(ModuleNotFoundError):
    """Something that an extra brings is not installed; the message names both."""


def require(needs: str, extra: str, *modules: str, instead: str = "") -> None:
    """Check that what an extra brings is installed.

    Parameters
    ----------
    needs : str
        Who needs it, such as ``"the study needs"``.
    extra, *modules : str
        The extra, and what of it is needed.
    instead : str
        What else can be done.

    Raises
    ------
    MissingExtraError
        Something is missing.
    """
    missing = [module.replace("_", "-") for module in modules if find_spec(module) is None]
    if missing:
        install = f"python -m pip install 'stereopsis[{extra}]'"
        raise MissingExtraError(f"{needs} {', '.join(missing)}: install it with {install}{instead}")
