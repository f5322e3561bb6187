"""Photograph the page on the synthetic street: python docs/view_pictures.py [FOLDER]."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from view_browser import chromium, served

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
    with served() as address, chromium() as browser:
        for name, hash, width, height, scheme in SHOTS:
            page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
            page.goto(f"{address}#{hash}")
            page.locator("html[data-latency]").wait_for(state="attached", timeout=120_000)
            page.locator(".costcurve").first.wait_for(timeout=120_000)
            page.wait_for_timeout(2500)
            with Image.open(io.BytesIO(page.screenshot())) as picture:
                picture.convert("RGB").save(folder / f"{name}.webp", quality=82, method=6)
            page.close()


if __name__ == "__main__":
    main(sys.argv[1:])
