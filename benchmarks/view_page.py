"""How soon a step of a slider is on the screen, and how many frames a second the 3-D view draws.

    python benchmarks/view_page.py [--steps 20] [--points 1000000]

In Chromium without a graphics card: the page is drawn by the processor, WebGL by SwiftShader. The time of
a step is counted by the page itself, from the event of the key that moves the slider to the frame after the
new map was drawn.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import sys
from pathlib import Path

from playwright.sync_api import Browser, Page

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from view_browser import chromium, served

# A wavy wall of so many points, as the 3-D tab would be handed it.
FRAMES = """async ([points, shape]) => {
  const {Space} = await import("/static/space.js");
  const box = document.createElement("div");
  box.style.width = "1280px";
  box.style.height = "720px";
  document.body.replaceChildren(box);
  const space = new Space(box);
  const width = Math.round(Math.sqrt(points * 1.6)), height = Math.round(points / width);
  const disparity = new Float32Array(width * height), tints = new Uint8Array(3 * width * height);
  for (let i = 0; i < disparity.length; i++) {
    disparity[i] = 40 + 20 * Math.sin(i % width / 90) + 10 * Math.cos(i / width / 70);
    tints.set([i % 256, (i >> 8) % 256, 128], 3 * i);
  }
  const calibration = {focal_length: width, baseline: 0.5, cx: width / 2, cy: height / 2, doffs: 0};
  space.load({width, height, disparity, tints, calibration});
  space.shape = shape;
  space.home();
  space.measure(2);
  const all = space.measure(12);
  return [all, space.count, ...await space.measureMoving(8)];
}"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20, help="steps of the slider")
    parser.add_argument("--points", type=int, default=1_000_000, help="points of the 3-D view")
    given = parser.parse_args()
    with served() as address, chromium() as browser:
        load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
        print(
            f"{platform.machine()}, {os.cpu_count()} cores, load before {load:.1f}, "
            f"Chromium {browser.version}, Python {platform.python_version()}"
        )
        times = latencies(browser, address, given.steps)
        print(
            f"slider to screen, 880 x 400, fast: median {statistics.median(times):.0f} ms, "
            f"{min(times):.0f} to {max(times):.0f}, {len(times)} steps"
        )
        print(f"WebGL: {drawn_by(browser)}")
        for shape in ("points", "surface"):
            frames, count, moving, part = rate(browser, address, given.points, shape)
            print(
                f"{shape}, {count} points, 1280 x 720: {frames:.1f} frames a second; "
                f"while it is turned {moving:.0f}, with {part:.0%} of the points"
            )


def latencies(browser: Browser, address: str, steps: int) -> list[float]:
    """Milliseconds of each step; every one asks for a window that was not matched before."""
    page = opened(browser, address)
    page.get_by_label("Window, width in pixels").focus()
    times = []
    for _ in range(steps):
        before = page.locator("html").get_attribute("data-result")
        page.keyboard.press("ArrowRight")
        page.locator(f'html:not([data-result="{before}"])').wait_for(state="attached")
        page.wait_for_timeout(400)
        times.append(float(page.locator("html").get_attribute("data-latency") or "nan"))
    page.close()
    return times


def rate(browser: Browser, address: str, points: int, shape: str) -> tuple[float, int, float, float]:
    """Frames a second, each waited for, and their points; the same while it is turned, and their part."""
    page = opened(browser, address)
    frames, count, moving, part = page.evaluate(FRAMES, [points, shape])
    page.close()
    return frames, count, moving, part


def drawn_by(browser: Browser) -> str:
    """What draws the 3-D view."""
    page = browser.new_page()
    told: str = page.evaluate(
        """() => {
          const gl = document.createElement("canvas").getContext("webgl2");
          return gl.getParameter(gl.getExtension("WEBGL_debug_renderer_info").UNMASKED_RENDERER_WEBGL);
        }"""
    )
    page.close()
    return told


def opened(browser: Browser, address: str) -> Page:
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    page.goto(address)
    page.locator("html[data-latency]").wait_for(state="attached")
    page.wait_for_timeout(1500)
    return page


if __name__ == "__main__":
    main()
