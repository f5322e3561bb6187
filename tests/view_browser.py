"""The page and a browser that opens it: for the tests, the measurements and the pictures."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--no-sandbox",
    "--enable-unsafe-swiftshader",  # WebGL where there is no graphics card; the page itself is drawn without
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


class MissingBrowserError(Exception):
    """No Chromium is installed."""


@contextmanager
def chromium() -> Iterator[Browser]:
    """A Chromium without a window."""
    program = os.environ.get("STEREOPSIS_BROWSER") or next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        raise MissingBrowserError(
            "no Chromium is installed: run 'sh tools/browser.sh', or name one with STEREOPSIS_BROWSER"
        )
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def served(*arguments: str | Path) -> Iterator[str]:
    """The address of ``stereopsis view`` with some arguments."""
    command = [sys.executable, "-m", "stereopsis", "view", "--no-browser", *map(str, arguments)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        assert process.stderr is not None
        try:
            said = ""
            while not (found := re.search(r"http://\S+?/(?=[;\s])", said)):
                line = process.stderr.readline()
                assert line, f"stereopsis view ended: {said}"
                said += line
            yield found[0]
        finally:
            process.terminate()
            process.wait(60)
