/** A pixel and its match, close up: the left image about the one, the right image about the other, its row marked. */

const SHOWN = { width: 45, height: 17 }; // pixels of the picture that each half shows

/** Draw on a canvas; without a match the right half shows the same columns as the left one. */
export function drawPatches(canvas, session, p) {
  const context = canvas.getContext("2d");
  const density = Math.min(devicePixelRatio, 2);
  const [width, gap] = [Math.round(canvas.clientWidth * density), 2 * density];
  const half = (width - gap) / 2;
  const scale = half / SHOWN.width;
  Object.assign(canvas, { width, height: Math.round(SHOWN.height * scale) });
  if (!p || !session.left || !session.right) return;
  const matched = Number.isFinite(p.match);
  context.imageSmoothingEnabled = false;
  for (const [i, [picture, x]] of [[session.left, p.x], [session.right, matched ? p.match : p.x]].entries()) {
    const start = i * (half + gap);
    context.save();
    context.beginPath();
    context.rect(start, 0, half, canvas.height);
    context.clip();
    const left = start + half / 2 - (x + 0.5) * scale;
    context.drawImage(picture, left, canvas.height / 2 - (p.y + 0.5) * scale, picture.width * scale, picture.height * scale);
    const row = canvas.height / 2;
    if (i === 1) stroke(context, density, (c) => { c.moveTo(start, row); c.lineTo(start + half, row); });
    if (i === 0 || matched) stroke(context, density, (c) => c.rect(start + half / 2 - scale / 2, row - scale / 2, scale, scale));
    context.restore();
  }
}

function stroke(context, density, path) {
  for (const [width, colour] of [[3, "rgb(0 0 0 / .7)"], [1.2, "#fff"]]) {
    context.lineWidth = width * density;
    context.strokeStyle = colour;
    context.beginPath();
    path(context);
    context.stroke();
  }
}
