"""Photograph the page on the synthetic street: python docs/view_pictures.py [FOLDER]."""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
)
PIXEL = "pixel=300,250"

# Name, what the link says, width, height, appearance.
SHOTS = (
    ("view-maps", PIXEL, 1440, 900, "light"),
    ("view-flags", f"{PIXEL}&preset=balanced&mode=side&first=flags&second=error", 1440, 900, "dark"),
    ("view-space", f"{PIXEL}&preset=balanced&tab=space", 1440, 900, "light"),
    ("view-phone", f"{PIXEL}&first=right&second=confidence", 390, 1180, "light"),
)


def main(arguments: Sequence[str]) -> None:
    folder = Path(arguments[0]) if arguments else Path(__file__).parent / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    program = os.environ.get("STEREOPSIS_BROWSER") or next(filter(None, map(shutil.which, BROWSERS)))
    with served() as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        for name, hash, width, height, scheme in SHOTS:
            page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
            page.goto(f"{address}#{hash}")
            page.locator("html[data-latency]").wait_for(state="attached", timeout=120_000)
            page.locator(".costcurve").first.wait_for(timeout=120_000)
            page.wait_for_timeout(2500)
            with Image.open(io.BytesIO(page.screenshot())) as picture:
                picture.convert("RGB").save(folder / f"{name}.webp", quality=82, method=6)
            page.close()
        browser.close()


@contextmanager
def served() -> Iterator[str]:
    """The address of ``stereopsis view``."""
    command = [sys.executable, "-m", "stereopsis", "view", "--no-browser"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            said = ""
            while not (found := re.search(r"http://\S+?/(?=[;\s])", said)):
                said += process.stderr.readline()
            yield found[0]
        finally:
            process.terminate()


if __name__ == "__main__":
    main(sys.argv[1:])
