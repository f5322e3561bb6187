/**
 * <swipe-view value="0.5" first="Left" second="Disparity">: its first two children lie upon each other, the first one is
 * seen left of a handle, the second one right of it. The handle is a slider: it is dragged, or moved with keys.
 * Fires "swipe" when the user moves it. Needs pieces.css; stands alone otherwise.
 */
export class SwipeView extends HTMLElement {
  static observedAttributes = ["value", "first", "second"];
  #handle = null;

  connectedCallback() {
    if (this.#handle) return;
    const handle = document.createElement("div");
    handle.className = "swipe-handle";
    handle.tabIndex = 0;
    handle.setAttribute("role", "slider");
    handle.setAttribute("aria-label", "Where one view ends and the other begins");
    handle.setAttribute("aria-valuemin", "0");
    handle.setAttribute("aria-valuemax", "100");
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      event.stopPropagation();
    });
    handle.addEventListener("pointermove", (event) => {
      if (!handle.hasPointerCapture(event.pointerId)) return;
      const box = this.getBoundingClientRect();
      this.#move((event.clientX - box.left) / box.width);
    });
    handle.addEventListener("keydown", (event) => this.#key(event));
    this.#handle = handle;
    this.append(handle);
    this.#show();
  }

  attributeChangedCallback() {
    this.#show();
  }

  /** The part of the width that the first view has, from 0 to 1. */
  get value() {
    const value = Number(this.getAttribute("value") ?? 0.5);
    return Number.isFinite(value) ? Math.min(Math.max(value, 0), 1) : 0.5;
  }

  set value(value) {
    this.setAttribute("value", String(Math.round(value * 1e4) / 1e4));
  }

  #move(value) {
    this.value = Math.min(Math.max(value, 0), 1);
    this.dispatchEvent(new CustomEvent("swipe", { bubbles: true, detail: this.value }));
  }

  #key(event) {
    const step = event.shiftKey ? 0.1 : 0.02;
    const to = {
      ArrowLeft: this.value - step, ArrowDown: this.value - step, ArrowRight: this.value + step, ArrowUp: this.value + step,
      PageDown: this.value - 0.1, PageUp: this.value + 0.1, Home: 0, End: 1,
    }[event.key];
    if (to === undefined || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    this.#move(to);
  }

  #show() {
    if (!this.#handle) return;
    const percent = Math.round(100 * this.value);
    const [first, second] = [this.getAttribute("first") ?? "the first", this.getAttribute("second") ?? "the second"];
    this.style.setProperty("--swipe", `${100 * this.value}%`);
    this.#handle.setAttribute("aria-valuenow", String(percent));
    this.#handle.setAttribute("aria-valuetext", `${first} over ${percent} % of the width, ${second} over the rest`);
  }
}

customElements.define("swipe-view", SwipeView);
