/** The scene that is open and the result that is shown; computes anew when settings change. */

import { client, getArray, getJSON, getPicture, postForm, postJSON, Refused } from "./api.js";

/** A computation that has run for so many milliseconds is given up for a newer one; a younger one may finish. */
const PATIENCE = 250;

/** Fires "scene", "result" (detail: when the change was made), "arrays" (what came later), "busy" and "refused". */
export class Session extends EventTarget {
  scene = null;
  left = null; // pictures
  right = null;
  leftValues = null;
  rightValues = null;
  truth = null;
  result = null;
  disparity = null;
  flags = null;
  confidence = null;
  #opening = 0;
  #wanted = null;
  #running = null;

  constructor(info) {
    super();
    this.info = info;
  }

  /** Open a sample by its name, or the files of a form; tells whether it is there. */
  async open(what) {
    const turn = ++this.#opening;
    this.#wanted = null;
    this.#running?.abort.abort();
    this.#busy(true);
    try {
      const scene = what instanceof FormData ? await postForm("/api/open", what) : await postJSON("/api/open", { sample: what });
      const at = `/api/scenes/${encodeURIComponent(scene.scene)}`;
      const has = { left: scene.has_left !== false, right: scene.has_right !== false };
      const [left, right, leftValues, rightValues, truth] = await Promise.all([
        has.left ? getPicture(`${at}/left.png`) : null,
        has.right ? getPicture(`${at}/right.png`) : null,
        has.left ? getArray(`${at}/left.bin`, scene.dtype ?? "uint8") : null,
        has.right ? getArray(`${at}/right.bin`, scene.dtype ?? "uint8") : null,
        scene.has_truth ? getArray(`${at}/truth.bin`, "float32") : null,
      ]);
      if (turn !== this.#opening) return false;
      Object.assign(this, { scene, left, right, leftValues, rightValues, truth });
      Object.assign(this, { result: null, disparity: null, flags: null, confidence: null });
      this.#tell("scene");
      if (scene.result) await this.#adopt(scene.result, null, null);
      return true;
    } catch (error) {
      if (turn === this.#opening) this.#refuse(error);
      return false;
    } finally {
      if (turn === this.#opening) this.#busy(false);
    }
  }

  get canMatch() {
    return Boolean(this.scene && this.left && this.right);
  }

  /** Nothing newer than the result is asked for. */
  get settled() {
    return !this.#wanted && !this.#running;
  }

  /** Match with these settings; a newer call wins. `since`: when the user asked, for measuring. */
  match(settings, since = performance.now()) {
    if (!this.canMatch) return;
    this.#wanted = { settings, since };
    if (!this.#running) this.#pump();
    else {
      const running = this.#running;
      setTimeout(() => running === this.#running && this.#wanted && running.abort.abort(), Math.max(0, running.started + PATIENCE - performance.now()));
    }
  }

  async #pump() {
    this.#busy(true);
    while (this.#wanted) {
      const { settings, since } = this.#wanted;
      this.#wanted = null;
      const running = { abort: new AbortController(), started: performance.now() };
      this.#running = running;
      const scene = this.scene;
      try {
        const result = await postJSON("/api/match", { scene: scene.scene, client, settings }, running.abort.signal);
        if (scene === this.scene) await this.#adopt(result, since, running.abort.signal);
      } catch (error) {
        const replaced = error.name === "AbortError" || (error instanceof Refused && error.status === 409);
        if (!replaced && scene === this.scene) this.#refuse(error);
      }
      this.#running = null;
    }
    this.#busy(false);
  }

  async #adopt(result, since, signal) {
    const scene = this.scene;
    const at = `/api/results/${encodeURIComponent(result.result)}`;
    const has = (name) => !result.arrays || result.arrays.includes(name);
    const eager = has("confidence") && (this.eager?.() ?? false);
    const [disparity, flags, confidence] = await Promise.all([
      getArray(`${at}/disparity.bin`, "float32", signal),
      has("flags") ? getArray(`${at}/flags.bin`, "uint8", signal) : null,
      eager ? getArray(`${at}/confidence.bin`, "float32", signal) : null,
    ]);
    if (scene !== this.scene) return;
    Object.assign(this, { result, disparity, flags, confidence });
    this.#tell("result", since);
    if (!eager && has("confidence")) this.#later(result, at);
  }

  /** What only the read-out needs, once the picture is on the screen and nothing newer is on its way. */
  #later(result, at) {
    setTimeout(async () => {
      if (this.result !== result || this.#running) return;
      try {
        const confidence = await getArray(`${at}/confidence.bin`, "float32");
        if (this.result !== result) return;
        this.confidence = confidence;
        this.#tell("arrays");
      } catch {
        // A later result replaced it; the read-out goes without.
      }
    }, 400);
  }

  /** The confidence, fetched where a view needs it at once. */
  async needConfidence() {
    if (!this.result || this.confidence || this.result.arrays?.includes("confidence") === false) return;
    const result = this.result;
    try {
      const confidence = await getArray(`/api/results/${encodeURIComponent(result.result)}/confidence.bin`, "float32");
      if (this.result !== result) return;
      this.confidence = confidence;
      this.#tell("arrays");
    } catch (error) {
      if (this.result === result) this.#refuse(error);
    }
  }

  /** What each disparity costs at a pixel. */
  async costs(x, y, signal) {
    return getJSON(`/api/results/${encodeURIComponent(this.result.result)}/cost?x=${x}&y=${y}`, signal);
  }

  /** Distance along the optical axis in metres; NaN where there is none. */
  depth(disparity) {
    const c = this.scene.calibration;
    const shifted = disparity + (c.doffs ?? 0);
    return shifted > 0 ? (c.focal_length * c.baseline) / shifted : NaN;
  }

  #busy(busy) {
    this.busy = busy;
    this.#tell("busy", busy);
  }

  #refuse(error) {
    this.#tell("refused", error.message);
  }

  #tell(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }
}
