/** What can be taken away: files, the settings, and how to repeat the result. */

import { el } from "./dom.js";

const FILES = [
  ["preview.png", "Picture, PNG"], ["disparity.png", "16-bit PNG"], ["disparity.pfm", "PFM"], ["depth.png", "Depth, PNG"], ["points.ply", "Points, PLY"],
  ["settings.toml", "Settings, TOML"],
];

/** `measured`: whether the cameras were stated, without which depth is a guess. */
export function downloadLinks(result, measured, saveView) {
  const at = `/api/results/${encodeURIComponent(result.result)}/download`;
  const files = FILES.filter(([file]) => measured || file !== "depth.png");
  const links = files.map(([file, title]) => el("a", { className: "button", href: `${at}/${file}`, download: file }, title));
  return [el("button", { type: "button", onclick: saveView }, "This view, PNG"), ...links];
}

/** The command, the Python and the TOML, each with a button that copies it. */
export function repeats(result) {
  return [["Command", result.command], ["Python", result.python], ["Settings", result.toml]].filter(([, text]) => text).map(([title, text]) => {
    const copy = el("button", { type: "button", className: "quiet", "aria-label": `Copy: ${title}` }, "Copy");
    copy.addEventListener("click", async () => {
      try {
        await navigator.clipboard.writeText(text);
        copy.textContent = "Copied";
      } catch {
        getSelection().selectAllChildren(code);
        copy.textContent = "Selected";
      }
      setTimeout(() => (copy.textContent = "Copy"), 1500);
    });
    const code = el("pre", { tabIndex: 0 }, text.trimEnd());
    const box = el("details", {}, el("summary", {}, title), el("div", { className: "code" }, copy, code));
    box.open = title === "Command";
    return box;
  });
}

/** Save a canvas as a file. */
export function saveCanvas(canvas, name) {
  canvas.toBlob((blob) => {
    const link = el("a", { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  });
}
