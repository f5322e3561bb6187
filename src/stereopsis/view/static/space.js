/** The scene in three dimensions: coloured points or a surface, in metres, as the left camera saw it. */

import {
  BufferAttribute, BufferGeometry, Color, DoubleSide, Mesh, OrbitControls, PerspectiveCamera, Points, Scene, ShaderMaterial, Vector3, WebGLRenderer,
} from "./vendor/three.min.js";

/** Pictures of more pixels than this are thinned out. */
const MOST_POINTS = 4e6;

/** While the view moves, a frame should take so many milliseconds; else only a part of the points is drawn. */
const FLUENT = 33;
const LEAST_PART = 1 / 32;
const REST = 250;

/** Every so many-th pixel of both directions comes first, then those between: any first part is spread evenly. */
const PHASES = [[0, 0], [2, 2], [2, 0], [0, 2], [1, 1], [3, 3], [3, 1], [1, 3], [1, 0], [3, 2], [3, 0], [1, 2], [0, 1], [2, 3], [2, 1], [0, 3]];

const VERTEX = `
attribute vec3 tint;
uniform float size, scale;
varying vec3 vTint;
varying float vDepth;
void main() {
  vTint = tint;
  vDepth = -position.z;
  vec4 seen = modelViewMatrix * vec4(position, 1.0);
  gl_Position = projectionMatrix * seen;
  gl_PointSize = clamp(size * scale * vDepth / max(-seen.z, 1e-3), 1.0, 48.0);
}`;
const FRAGMENT = `
uniform float near, far;
varying vec3 vTint;
varying float vDepth;
void main() {
  if (vDepth < near || vDepth > far) discard;
  gl_FragColor = vec4(vTint, 1.0);
}`;

export class Space {
  #frame = 0;
  #held = new Set();
  #last = 0;
  #part = 1;
  #drawn = 0;
  #pace = FLUENT;
  #fence = null;
  #resting = 0;

  /** Raises an error where the browser offers no WebGL. */
  constructor(box) {
    this.box = box;
    this.renderer = new WebGLRenderer({ antialias: false, preserveDrawingBuffer: true });
    const canvas = this.renderer.domElement;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-roledescription", "3-D view");
    canvas.setAttribute("aria-label", "The scene in three dimensions. Arrow keys turn it; W, A, S, D, Q and E fly through it; + and − change the distance; 0 resets.");
    box.replaceChildren(canvas);
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(50, 1, 0.01, 1e5);
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.addEventListener("change", () => this.#drawMoving());
    this.uniforms = { size: { value: 1 }, scale: { value: 1 }, near: { value: 0 }, far: { value: 1e5 } };
    this.material = new ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms: this.uniforms, side: DoubleSide });
    this.points = new Points(new BufferGeometry(), this.material);
    this.surface = new Mesh(new BufferGeometry(), this.material);
    for (const thing of [this.points, this.surface]) thing.frustumCulled = false;
    this.scene.add(this.points, this.surface);
    this.surface.visible = false;
    canvas.addEventListener("keydown", (event) => this.#down(event));
    canvas.addEventListener("keyup", (event) => this.#held.delete(event.key.toLowerCase()));
    canvas.addEventListener("blur", () => this.#held.clear());
    new ResizeObserver(() => this.#resize()).observe(box);
    this.#resize();
  }

  /** Take a map: `tints` holds three bytes a pixel. */
  load({ width, height, disparity, tints, calibration }) {
    const { focal_length: focal, baseline, cx, cy, doffs = 0 } = calibration;
    const step = Math.max(1, Math.ceil(Math.sqrt((width * height) / MOST_POINTS)));
    const [columns, rows] = [Math.ceil(width / step), Math.ceil(height / step)];
    const numbers = new Int32Array(columns * rows).fill(-1);
    const places = new Float32Array(columns * rows * 3);
    const colours = new Uint8Array(columns * rows * 3);
    let count = 0;
    for (const [across, down] of PHASES) {
      for (let row = down; row < rows; row += 4) {
        for (let column = across; column < columns; column += 4) {
          const [u, v] = [column * step, row * step];
          const i = v * width + u;
          const z = (focal * baseline) / (disparity[i] + doffs);
          if (!(z > 0 && z < 1e5)) continue;
          const at = 3 * count;
          places[at] = ((u - cx) * z) / focal;
          places[at + 1] = (-(v - cy) * z) / focal;
          places[at + 2] = -z;
          colours[at] = tints[3 * i];
          colours[at + 1] = tints[3 * i + 1];
          colours[at + 2] = tints[3 * i + 2];
          numbers[row * columns + column] = count++;
        }
      }
    }
    const geometry = this.#geometry(places.subarray(0, 3 * count), colours.subarray(0, 3 * count));
    this.points.geometry.dispose();
    this.points.geometry = geometry;
    this.surface.geometry.dispose();
    this.surface.geometry = new BufferGeometry();
    this.grid = { columns, rows, numbers, step };
    this.uniforms.scale.value = step;
    this.focal = focal;
    this.pictureHeight = height;
    this.count = count;
    this.depths = depthsOf(places, count);
    this.#resize();
    if (this.woven) this.#weave();
    this.draw();
  }

  #geometry(places, colours) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(places, 3));
    geometry.setAttribute("tint", new BufferAttribute(colours, 3, true));
    return geometry;
  }

  /** Triangles between neighbours that lie on one surface. */
  #weave() {
    const { columns, rows, numbers } = this.grid;
    const places = this.points.geometry.attributes.position.array;
    const z = (n) => -places[3 * n + 2];
    const index = new Uint32Array(6 * (columns - 1) * (rows - 1));
    let used = 0;
    const triangle = (a, b, c) => {
      if (a < 0 || b < 0 || c < 0) return;
      const near = Math.min(z(a), z(b), z(c));
      if (Math.max(z(a), z(b), z(c)) - near > 0.08 * near) return;
      index[used++] = a;
      index[used++] = b;
      index[used++] = c;
    };
    for (let v = 0; v + 1 < rows; v++) {
      for (let u = 0; u + 1 < columns; u++) {
        const i = v * columns + u;
        triangle(numbers[i], numbers[i + columns], numbers[i + 1]);
        triangle(numbers[i + 1], numbers[i + columns], numbers[i + columns + 1]);
      }
    }
    const geometry = new BufferGeometry();
    for (const name of ["position", "tint"]) geometry.setAttribute(name, this.points.geometry.attributes[name]);
    geometry.setIndex(new BufferAttribute(index.subarray(0, used), 1));
    this.surface.geometry = geometry;
  }

  /** "points" or "surface". */
  set shape(shape) {
    this.points.visible = shape === "points";
    this.surface.visible = shape === "surface";
    this.woven = this.surface.visible;
    if (this.woven && this.grid && !this.surface.geometry.index) this.#weave();
    this.draw();
  }

  set pointSize(size) {
    this.size = size;
    this.#resize();
  }

  clip(near, far) {
    this.uniforms.near.value = near;
    this.uniforms.far.value = far;
    this.draw();
  }

  /** Orbit about the scene, or fly: turn where one stands. */
  set flying(flying) {
    if (flying === this.fly) return;
    this.fly = flying;
    const ahead = this.camera.getWorldDirection(new Vector3());
    const reach = flying ? 0.01 : this.depths?.middle ?? 10;
    this.orbit.target.copy(this.camera.position).addScaledVector(ahead, reach);
    this.orbit.rotateSpeed = flying ? -0.4 : 1;
    this.orbit.enableZoom = !flying;
    this.orbit.update();
  }

  /** Behind and above the left camera, looking at the middle of the scene. */
  home() {
    if (!this.depths) return;
    const { middle } = this.depths;
    const wasFlying = this.fly;
    this.fly = false;
    this.orbit.rotateSpeed = 1;
    this.orbit.enableZoom = true;
    this.camera.position.set(-0.12 * middle, 0.1 * middle, 0.04 * middle);
    this.orbit.target.set(0, 0, -middle);
    this.orbit.update();
    if (wasFlying) this.flying = true;
    this.draw();
  }

  set paper(colour) {
    this.scene.background = new Color(colour);
    this.draw();
  }

  draw() {
    this.#frame ||= requestAnimationFrame(() => this.drawNow());
  }

  /** As `draw`, while the user moves the view: as many of the points as can be drawn fluently, all of them at rest. */
  #drawMoving() {
    clearTimeout(this.#resting);
    this.#resting = setTimeout(() => this.#rest(), REST);
    cancelAnimationFrame(this.#frame);
    this.#frame = requestAnimationFrame(() => this.#step());
  }

  #rest() {
    if (this.#frame || this.#lagging()) {
      this.#resting = setTimeout(() => this.#rest(), REST);
      return;
    }
    this.#drawn = 0;
    this.#show(1);
  }

  /** Whether the last frame is still being drawn. */
  #lagging() {
    const gl = this.renderer.getContext();
    return Boolean(this.#fence) && gl.getSyncParameter(this.#fence, gl.SYNC_STATUS) !== gl.SIGNALED;
  }

  /** One frame of a movement, once the one before is really drawn. */
  #step() {
    if (this.#lagging()) {
      this.#frame = requestAnimationFrame(() => this.#step());
      return;
    }
    const now = performance.now();
    if (this.#drawn) this.#pace += 0.4 * (Math.min(now - this.#drawn, 1000) - this.#pace);
    this.#drawn = now;
    if (this.#pace > 1.1 * FLUENT) this.#part = Math.max(this.#part / 2, LEAST_PART);
    else if (this.#pace < 0.6 * FLUENT) this.#part = Math.min(this.#part * 1.1, 1);
    this.#show(this.#part);
    const gl = this.renderer.getContext();
    if (this.#fence) gl.deleteSync(this.#fence);
    this.#fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  /** Draw a part of the points; of a surface that cannot be drawn fluently, its points stand in. */
  #show(part) {
    this.surface.visible = Boolean(this.woven) && part > 0.5;
    this.points.visible = !this.surface.visible;
    this.points.geometry.setDrawRange(0, Math.ceil(part * (this.count ?? 0)));
    this.uniforms.scale.value = (this.grid?.step ?? 1) / Math.sqrt(part);
    this.drawNow();
  }

  drawNow() {
    cancelAnimationFrame(this.#frame);
    this.#frame = 0;
    this.renderer.render(this.scene, this.camera);
  }

  /** Frames a second while the scene turns: each is waited for until it is drawn. */
  measure(frames = 20) {
    const { gl, one } = { gl: this.renderer.getContext(), one: new Uint8Array(4) };
    const finished = () => gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, one);
    clearTimeout(this.#resting);
    this.#show(1);
    finished();
    const start = performance.now();
    for (let i = 0; i < frames; i++) {
      this.camera.position.x += (i % 2 ? -1 : 1) * 0.01 * this.depths.middle;
      this.camera.lookAt(this.orbit.target);
      this.drawNow();
      finished();
    }
    return (1000 * frames) / (performance.now() - start);
  }

  /** Frames a second while the user turns the scene for so many seconds, and the part of the points that is then drawn. */
  async measureMoving(seconds = 3) {
    const start = performance.now();
    let [frames, settled] = [0, start];
    while (performance.now() - start < 1000 * seconds) {
      this.#turn(0.01, 0);
      const before = this.#drawn;
      while (this.#drawn === before && performance.now() - start < 2000 * seconds) await new Promise(requestAnimationFrame);
      if (performance.now() - start < 500 * seconds) settled = performance.now();
      else frames++;
    }
    return [(1000 * frames) / (performance.now() - settled), this.#part];
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.box;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    // As large as a picture's pixel is at its distance, seen from where the camera stood.
    const pixels = (0.5 * height * this.renderer.getPixelRatio()) / Math.tan((this.camera.fov * Math.PI) / 360);
    this.uniforms.size.value = (1.15 * (this.size ?? 1) * pixels) / (this.focal ?? pixels);
    this.draw();
  }

  #down(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const turn = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const key = event.key.toLowerCase();
    if (turn) this.#turn(...turn.map((t) => t * 0.06));
    else if ("wasdqe".includes(key) && key.length === 1) {
      this.#held.add(key);
      this.#last = performance.now();
      this.#move();
    } else if (key === "+" || key === "=") this.#dolly(0.9);
    else if (key === "-") this.#dolly(1 / 0.9);
    else if (key === "0") this.home();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  #turn(right, down) {
    const away = this.camera.position.clone().sub(this.orbit.target);
    const sign = this.fly ? -1 : 1;
    away.applyAxisAngle(new Vector3(0, 1, 0), sign * right);
    const axis = new Vector3(0, 1, 0).cross(away).normalize();
    const turned = away.clone().applyAxisAngle(axis, sign * down);
    if (Math.abs(turned.clone().normalize().y) < 0.98) away.copy(turned);
    if (this.fly) this.orbit.target.copy(this.camera.position).sub(away);
    else this.camera.position.copy(this.orbit.target).add(away);
    this.orbit.update();
    this.draw();
  }

  #dolly(factor) {
    const away = this.camera.position.clone().sub(this.orbit.target).multiplyScalar(factor);
    this.camera.position.copy(this.orbit.target).add(away);
    this.orbit.update();
    this.draw();
  }

  /** Fly as long as keys are held. */
  #move() {
    if (this.#held.size === 0 || !this.depths) return;
    const now = performance.now();
    const reach = (Math.min(now - this.#last, 100) / 1000 + 0.004) * 0.6 * this.depths.middle;
    this.#last = now;
    const ahead = this.camera.getWorldDirection(new Vector3());
    const right = ahead.clone().cross(this.camera.up).normalize();
    const step = new Vector3();
    const add = (key, way, sign) => this.#held.has(key) && step.addScaledVector(way, sign * reach);
    add("w", ahead, 1);
    add("s", ahead, -1);
    add("d", right, 1);
    add("a", right, -1);
    add("e", this.camera.up, 1);
    add("q", this.camera.up, -1);
    this.camera.position.add(step);
    this.orbit.target.add(step);
    this.#drawMoving();
    clearTimeout(this.moving);
    this.moving = setTimeout(() => this.#move(), 16);
  }
}

/** Some quantiles of the depths in metres. */
function depthsOf(places, count) {
  const step = Math.max(1, Math.floor(count / 20000));
  const some = [];
  for (let i = 0; i < count; i += step) some.push(-places[3 * i + 2]);
  some.sort((a, b) => a - b);
  const at = (part) => some[Math.floor(part * (some.length - 1))] ?? 1;
  return { least: at(0), middle: at(0.5), far: at(0.95), most: at(0.998) };
}
