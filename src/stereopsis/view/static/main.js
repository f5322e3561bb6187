/** Brings the parts of the page together. */

import "./swipe.js";
import { getJSON } from "./api.js";
import { lookup, quantiles, setFlagColours, tableOf } from "./colour.js";
import { Controls, flattened } from "./controls.js";
import { costCurves } from "./curve.js";
import { $, el, number } from "./dom.js";
import { downloadLinks, repeats, saveCanvas } from "./downloads.js";
import { acceptDrops, askForFiles } from "./files.js";
import { shortcuts } from "./keys.js";
import { LAYERS, Painter } from "./layers.js";
import { colourBar, flagLegend } from "./legend.js";
import { readLink, writeLink } from "./link.js";
import { scoreTable, stageBars, summary } from "./measures.js";
import { drawPatches } from "./patches.js";
import { probe, showReadout } from "./readout.js";
import { Samples } from "./samples.js";
import { Session } from "./session.js";
import { SpaceTab } from "./space-tab.js";
import { Stage } from "./stage.js";
import { isDark, theme } from "./theme.js";
import { Viewport } from "./viewport.js";

const TABS = ["maps", "space", "samples"];
const MAPS = ["viridis", "cividis"];

function say(sentence) {
  $("alert").hidden = !sentence;
  $("alert").querySelector("p").textContent = sentence ?? "";
}

/** Go on once what was drawn is on the screen: when the next frame begins. */
function onScreen(then) {
  if (document.hidden) setTimeout(then);
  else requestAnimationFrame(() => requestAnimationFrame(then));
}

async function start() {
  $("alert").querySelector("button").addEventListener("click", () => say(null));
  const [info, list] = await Promise.all([getJSON("/api/info"), getJSON("/api/samples")]);
  $("version").textContent = info.version;
  setFlagColours(info.flags);
  const tables = Object.fromEntries(Object.entries(info.colormaps).map(([name, table]) => [name, lookup(tableOf(table))]));
  const diverging = tables.diverging ?? tables[Object.keys(tables).find((name) => !MAPS.includes(name))];

  const session = new Session(info);
  const painter = new Painter(session);
  const viewport = new Viewport();
  const stage = new Stage($("stage"), $("swipe"), viewport, painter);
  const link = readLink();
  const state = {
    tab: "maps", ...flattened(info.defaults, info), linked: false, map: "viridis", error: 3, range: null, auto: null, sample: null, pinned: null, hover: null,
  };
  const look = () => ({
    map: tables[state.map], mapName: state.map, confidenceMap: tables.cividis, errorMap: diverging, range: state.range ?? state.auto ?? [0, 1], error: state.error,
    none: isDark() ? [58, 62, 70] : [205, 205, 205],
  });
  const space = new SpaceTab(session, painter, look, { bar: $("space-bar"), box: $("space"), note: $("space-note"), home: $("home") }, say);

  // Settings

  const settings = () => ({ preset: state.preset ?? null, ...state.set });
  const compute = (since) => session.match(settings(), since);
  const controls = new Controls($("controls"), info, {
    preset(name, since) {
      const { disparities } = state.set;
      Object.assign(state, { preset: name, set: disparities ? { disparities } : {} });
      changed(since);
    },
    change(changes, since) {
      for (const [name, value] of Object.entries(changes)) {
        if (value === undefined) delete state.set[name];
        else state.set[name] = value;
      }
      changed(since);
    },
  });
  function changed(since) {
    $("reset").disabled = Object.keys(state.set).length === 0;
    remember();
    compute(since);
  }
  $("reset").addEventListener("click", (event) => {
    state.set = {};
    changed(event.timeStamp);
  });

  // Views

  const boxes = { first: $("first"), second: $("second") };
  function listLayers() {
    for (const [i, box] of [boxes.first, boxes.second].entries()) {
      const there = Object.entries(LAYERS).filter(([name, layer]) => layer.has(session) || (["disparity", "confidence", "flags"].includes(name) && session.canMatch) || (name === "error" && session.truth));
      const names = there.map(([name]) => name);
      if (!names.includes(stage.layers[i])) stage.layers[i] = names.includes(i ? "disparity" : "left") ? (i ? "disparity" : "left") : names[0] ?? "disparity";
      box.replaceChildren(...there.map(([name, { label }]) => el("option", { value: name }, label)));
      box.value = stage.layers[i];
    }
  }
  function show(i, name) {
    stage.layers[i] = name;
    [boxes.first, boxes.second][i].value = name;
    if (stage.layers.includes("confidence")) session.needConfidence();
    redraw();
    remember();
  }
  boxes.first.addEventListener("change", () => show(0, boxes.first.value));
  boxes.second.addEventListener("change", () => show(1, boxes.second.value));
  session.eager = () => stage.layers.includes("confidence");
  function setMode(mode) {
    const input = $("mode").querySelector(`input[value="${mode}"]`);
    if (!input) return;
    input.checked = true;
    stage.mode = mode;
    remember();
  }
  $("mode").addEventListener("change", (event) => setMode(event.target.value));
  $("swipe").addEventListener("swipe", () => remember());
  $("in").addEventListener("click", () => viewport.zoomBy(1.5));
  $("out").addEventListener("click", () => viewport.zoomBy(1 / 1.5));
  $("fit").addEventListener("click", () => viewport.fit());
  viewport.addEventListener("change", () => {
    $("zoom").textContent = `${Math.round(100 * viewport.zoom)} %`;
    remember();
  });

  function redraw() {
    stage.look = look();
    stage.draw();
    legends();
    space.look_();
  }

  function legends() {
    const shown = new Map();
    for (const name of stage.layers) {
      const kind = name === "truth" ? "disparity" : name;
      if (!shown.has(kind) && !["left", "right"].includes(name)) shown.set(kind, name);
    }
    const { range } = look();
    $("legends").replaceChildren(...[...shown.keys()].map((kind) => {
      const box = el("section", { className: "legend" });
      const head = el("h3", {}, kind === "disparity" ? "Disparity (px)" : kind === "error" ? "Error: answer − truth (px)" : LAYERS[kind].label);
      box.append(head);
      if (kind === "flags") {
        if (session.flags) box.append(flagLegend(session.flags, info.flags));
        return box;
      }
      if (kind === "disparity") {
        box.append(colourBar(tables[state.map], ...range, "px", "Disparity"));
        const map = el("select", { id: "map" }, ...MAPS.filter((name) => tables[name]).map((name) => el("option", { value: name }, name)));
        map.value = state.map;
        map.addEventListener("change", () => {
          state.map = map.value;
          redraw();
          space.changed();
          remember();
          $("map").focus();
        });
        const ends = range.map((value, i) => {
          const input = el("input", { type: "number", step: "any", id: i ? "scale-to" : "scale-from", value: Math.round(value * 10) / 10, "aria-label": `The disparity of the ${i ? "last" : "first"} colour` });
          input.addEventListener("change", () => {
            const next = ["scale-from", "scale-to"].map((id) => Number($(id).value));
            if (next[0] < next[1]) state.range = next;
            redraw();
            remember();
          });
          return input;
        });
        const auto = el("button", { type: "button", className: "quiet", onclick: () => { Object.assign(state, { range: null, auto: span() }); redraw(); remember(); } }, "Fit");
        box.append(el("div", { className: "scale" }, el("label", {}, "Colours ", map), ends[0], el("span", {}, "to"), ends[1], auto));
      } else if (kind === "error") {
        box.append(colourBar(diverging, -state.error, state.error, "px", "Error"));
        const limit = el("select", { id: "error-scale" }, ...[0.5, 1, 3, 10, 30].map((value) => el("option", { value }, `± ${value} px`)));
        limit.value = String(state.error);
        limit.addEventListener("change", () => {
          state.error = Number(limit.value);
          redraw();
          $("error-scale").focus();
        });
        box.append(el("div", { className: "scale" }, el("label", {}, "Scale ", limit)));
      } else box.append(colourBar(tables.cividis, 0, 1, "", "Confidence"));
      const swatch = el("i", { className: "swatch" });
      swatch.style.background = `rgb(${look().none.join(" ")})`;
      box.append(el("p", { className: "none" }, swatch, kind === "error" ? "not answered, or truth unknown" : "not answered"));
      return box;
    }));
  }

  /** What the disparity's colours span. */
  function span() {
    const [low, high] = quantiles(session.truth ?? session.disparity ?? [0, 1], 0.01, 0.99);
    return high - low > 1e-3 ? [Math.floor(low), Math.ceil(high)] : [low - 0.5, high + 0.5];
  }

  // The pixel

  function read() {
    const at = state.hover ?? state.pinned;
    const p = showReadout($("readout"), $("assumed"), session, at);
    $("patches").hidden = !p || !session.canMatch;
    if (!$("patches").hidden) drawPatches($("patches"), session, p);
    stage.pixel = p && { ...p, range: session.result?.disparities };
    stage.draw();
  }
  let asking = null;
  async function curve() {
    asking?.abort();
    if (!state.pinned || !session.result) return;
    const [x, y] = state.pinned;
    asking = new AbortController();
    const result = session.result;
    try {
      const costs = await session.costs(x, y, asking.signal);
      if (result !== session.result) return;
      const { truth, d } = probe(session, x, y);
      const drawings = costCurves(costs, truth, [x, y]);
      const said = [`At ${x}, ${y}: least at ${costs.winner} px`, Number.isFinite(costs.subpixel) ? `refined ${number(costs.subpixel, 2)} px` : null, Number.isNaN(d) ? "not answered" : null, Number.isFinite(truth) ? `truth ${number(truth, 2)} px` : null];
      const key = (name, title) => el("li", {}, el("i", { className: `key ${name}` }), title);
      $("curve").replaceChildren(...(drawings.length ? [...drawings, el("ul", { className: "flags" }, key("winner", "winner"), ...(costs.fit ? [key("fit", `fit (${costs.fit.kind})`)] : []), ...(Number.isFinite(truth) ? [key("truth", "truth")] : [])), el("p", { className: "hint" }, `${said.filter(Boolean).join(", ")}.${costs.note ? ` ${costs.note}` : ""}`)] : [el("p", { className: "hint" }, "No disparity of the range can be matched at this pixel.")]));
    } catch (error) {
      if (error.name !== "AbortError" && result === session.result) $("curve").replaceChildren(el("p", { className: "hint" }, error.message));
    }
  }
  function pin(pixel) {
    state.pinned = pixel;
    read();
    curve();
    remember();
  }
  // A pixel of the right image is read at the same place of the left one: its own has no disparity here.
  viewport.addEventListener("hover", ({ detail }) => {
    state.hover = detail.pixel;
    read();
  });
  viewport.addEventListener("pick", ({ detail }) => pin(detail.pixel));
  $("stage").addEventListener("keydown", (event) => {
    if (event.target !== $("stage") || event.ctrlKey || event.metaKey || !session.scene) return;
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const { width, height } = session.scene;
    if (way && event.altKey) viewport.set(viewport.zoom, viewport.centre.map((c, i) => c + (way[i] * 0.1 * [width, height][i]) / viewport.zoom));
    else if (way) {
      const by = event.shiftKey ? 10 : 1;
      const from = state.hover ?? state.pinned ?? viewport.centre.map(Math.floor);
      state.hover = from.map((v, i) => Math.min(Math.max(v + way[i] * by, 0), [width, height][i] - 1));
      viewport.reveal(state.hover);
      read();
    } else if (event.key === "Enter" || event.key === " ") pin(state.hover ?? state.pinned ?? viewport.centre.map(Math.floor));
    else if (event.key === "+" || event.key === "=") viewport.zoomBy(1.25, state.hover ?? viewport.centre);
    else if (event.key === "-") viewport.zoomBy(0.8, state.hover ?? viewport.centre);
    else if (event.key === "0") viewport.fit();
    else return;
    event.preventDefault();
    event.stopPropagation();
  });

  // Results

  session.addEventListener("scene", () => {
    const { scene } = session;
    if (scene.settings && !state.linked) Object.assign(state, flattened(scene.settings, info));
    state.linked = false;
    $("reset").disabled = Object.keys(state.set).length === 0;
    document.title = `${scene.name} – stereopsis`;
    $("scene").replaceChildren(el("strong", {}, scene.name), el("span", {}, ` ${scene.width} × ${scene.height}${scene.bits ? `, ${scene.bits} bit` : ""}`));
    viewport.resize(scene.width, scene.height);
    Object.assign(state, { sample: samples.names.includes(scene.name) ? scene.name : null, auto: session.truth ? span() : null, hover: null });
    if (state.pinned && (state.pinned[0] >= scene.width || state.pinned[1] >= scene.height)) state.pinned = null;
    samples.mark(scene.name);
    listLayers();
    controls.disabled = !session.canMatch;
    $("controls-note").hidden = session.canMatch;
    $("controls-note").textContent = "Without both images there is nothing to compute: this is the map as it came.";
    if (!session.canMatch) $("controls").hidden = true;
    else $("controls").hidden = false;
    $("curve").replaceChildren(el("p", { className: "hint" }, "Click a pixel to see what each disparity costs there."));
    $("scores").replaceChildren();
    $("stages").replaceChildren();
    $("summary").textContent = "";
    $("downloads").replaceChildren();
    $("repeat").replaceChildren();
    read();
    redraw();
  });

  session.addEventListener("result", ({ detail: since }) => {
    const { result } = session;
    state.auto ??= span();
    say(null);
    stage.look = look();
    if (state.tab === "maps") stage.drawNow();
    document.documentElement.dataset.result = result.result;
    $("summary").textContent = summary(result);
    onScreen(() => {
      if (session.result !== result) return;
      if (since) {
        const took = performance.now() - since;
        document.documentElement.dataset.latency = took.toFixed(1);
        $("summary").textContent = `${summary(result)} On screen after ${took.toFixed(0)} ms.`;
      }
      listLayers();
      legends();
      // A slider that has moved on since is not put back.
      if (result.settings?.cost && session.settled) controls.show(result.settings, state.preset);
      $("scores").replaceChildren(scoreTable(result.scores));
      const times = stageBars(result.stages ?? {}, result.seconds);
      $("stages").replaceChildren(times);
      $("downloads").replaceChildren(...downloadLinks(result, session.scene.calibration.stated,
        () => saveCanvas(stage.snapshot(), `${session.scene.name}-${stage.layers.join("-")}.png`)));
      const open = [...$("repeat").querySelectorAll("details")].map((box) => box.open);
      const boxes = repeats(result);
      boxes.forEach((box, i) => (box.open = open[i] ?? box.open));
      $("repeat").replaceChildren(...boxes);
      read();
      curve();
      space.changed();
      document.documentElement.dataset.told = result.result;
    });
  });
  session.addEventListener("arrays", () => {
    redraw();
    read();
  });
  session.addEventListener("busy", ({ detail }) => {
    document.documentElement.classList.toggle("busy", detail);
    document.querySelector("main").setAttribute("aria-busy", String(detail));
  });
  session.addEventListener("refused", ({ detail }) => {
    say(detail);
    if (!session.scene) $("scene").textContent = "Nothing is open";
  });

  // Samples and files

  async function open(what) {
    say(null);
    if ((await session.open(what)) && !session.result) compute();
    remember();
  }
  const samples = new Samples($("samples"), list, (name) => {
    tab("maps");
    open(name);
  });
  const many = samples.names.length > 1;
  $("tab-samples").hidden = !many;
  $("samples-note").textContent = many ? `${samples.names.length} samples; press a heading to sort, a row to open it.` : "";
  for (const [id, step] of [["previous", -1], ["next", 1]]) {
    $(id).hidden = !many;
    $(id).addEventListener("click", () => beside(step));
  }
  const beside = (step) => many && open(state.sample ? samples.beside(state.sample, step) : samples.names[0]);
  acceptDrops($("drop"), open);
  $("open").addEventListener("click", () => askForFiles($("files"), open));

  // Tabs

  function tab(name, focus = false) {
    if (!TABS.includes(name) || $(`tab-${name}`).hidden) return;
    state.tab = name;
    for (const one of TABS) {
      const chosen = one === name;
      $(`tab-${one}`).setAttribute("aria-selected", String(chosen));
      $(`tab-${one}`).tabIndex = chosen ? 0 : -1;
      $(`panel-${one}`).hidden = !chosen;
    }
    if (focus) $(`tab-${name}`).focus();
    name === "space" ? space.open() : space.close();
    stage.draw();
    remember();
  }
  for (const name of TABS) $(`tab-${name}`).addEventListener("click", () => tab(name));
  document.querySelector("[role=tablist]").addEventListener("keydown", (event) => {
    const there = TABS.filter((name) => !$(`tab-${name}`).hidden);
    const now = there.indexOf(state.tab);
    const next = { ArrowRight: now + 1, ArrowLeft: now - 1, Home: 0, End: there.length - 1 }[event.key];
    if (next === undefined) return;
    event.preventDefault();
    tab(there[(next + there.length) % there.length], true);
  });

  // Keys, appearance, link

  shortcuts([
    ["n", "next sample", () => beside(1)], ["p", "previous sample", () => beside(-1)],
    ["s", "swipe", () => setMode("swipe")], ["b", "side by side", () => setMode("side")], ["f", "flicker", () => (stage.mode === "flicker" ? stage.flip() : setMode("flicker"))],
    ["x", "exchange the two views", () => { const [a, b] = stage.layers; show(0, b); show(1, a); }],
    ...Object.entries(LAYERS).map(([name, { label }], i) => [String(i + 1), `${label} as the second view`, () => [...boxes.second.options].some((o) => o.value === name) && show(1, name)]),
    ["m", "maps", () => tab("maps")], ["d", "3-D", () => tab("space")],
    ["?", "these keys", () => $("keys").showModal()],
  ], $("letters"), $("keys").querySelector(".keys"));
  $("help").addEventListener("click", () => $("keys").showModal());
  theme($("theme"), () => {
    redraw();
    space.changed();
  });

  let remembering = 0;
  function remember() {
    clearTimeout(remembering);
    remembering = setTimeout(() => writeLink({
      sample: many ? state.sample : null, tab: state.tab === "maps" ? null : state.tab, first: stage.layers[0], second: stage.layers[1], mode: stage.mode === "swipe" ? null : stage.mode,
      swipe: $("swipe").value === 0.5 ? null : $("swipe").value, zoom: viewport.zoom === 1 ? null : viewport.zoom, centre: viewport.zoom === 1 ? null : viewport.centre,
      pixel: state.pinned, preset: state.preset, set: state.set, map: state.map === "viridis" ? null : state.map, range: state.range,
    }), 250);
  }
  function restore(given) {
    if (info.presets.includes(given.preset)) Object.assign(state, { preset: given.preset, set: given.set ?? {} });
    $("reset").disabled = Object.keys(state.set).length === 0;
    if (MAPS.includes(given.map)) state.map = given.map;
    if (given.range && given.range[0] < given.range[1]) state.range = given.range;
    if (given.swipe !== undefined) $("swipe").value = given.swipe;
    for (const [i, name] of [given.first, given.second].entries()) if (name in LAYERS) stage.layers[i] = name;
    if (given.pixel?.every((v) => Number.isInteger(v) && v >= 0)) state.pinned = given.pixel;
    if (["side", "flicker"].includes(given.mode)) setMode(given.mode);
  }
  async function follow(given) {
    restore(given);
    state.linked = info.presets.includes(given.preset);
    const wanted = samples.names.includes(given.sample) ? given.sample : samples.names[0];
    if (wanted !== undefined) await open(wanted);
    else $("scene").textContent = "Drop a left and a right image here";
    if (given.zoom > 1 && given.centre) viewport.set(given.zoom, given.centre);
    if (given.tab) tab(given.tab);
  }
  addEventListener("hashchange", () => follow(readLink()));
  showReadout($("readout"), $("assumed"), session, null);
  await follow(link);
  if (!link.tab && many && ["results"].includes(info.kind)) tab("samples");
  document.documentElement.dataset.ready = "yes";
}

start().catch((error) => say(error.message));
