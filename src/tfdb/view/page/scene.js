// Frames in 3D: axes, links to parents, a path, a trail, names, shapes of a robot.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  GridHelper,
  LineMaterial,
  LineSegments2,
  LineSegmentsGeometry,
  OrbitControls,
  PerspectiveCamera,
  Points,
  PointsMaterial,
  Scene as Three,
  Vector3,
  WebGLRenderer,
} from "./three.js";
import { Shapes } from "./shapes.js";

const NAMES = 70; // that are drawn at most
const NEAR = 14; // pixels from a frame at which a click takes it
const MANY = 400; // frames: beyond, axes are thinner

/** Lines of a width in pixels; `room` grows as it is needed. */
class Lines {
  constructor(scene, width, order) {
    this.material = new LineMaterial({ linewidth: width, vertexColors: true });
    this.material.depthTest = order < 2;
    this.scene = scene;
    this.order = order;
    this.room = 0;
    this.count = 0;
    this.#grow(64);
  }

  #grow(room) {
    const old = this.lines;
    this.room = room;
    this.places = new Float32Array(6 * room);
    this.colors = new Float32Array(6 * room);
    const geometry = new LineSegmentsGeometry();
    geometry.setPositions(this.places);
    geometry.setColors(this.colors);
    this.lines = new LineSegments2(geometry, this.material);
    this.lines.frustumCulled = false;
    this.lines.renderOrder = this.order;
    this.scene.add(this.lines);
    // The geometry may have copied the arrays.
    this.places = geometry.attributes.instanceStart.data.array;
    this.colors = geometry.attributes.instanceColorStart.data.array;
    if (old) {
      this.scene.remove(old);
      old.geometry.dispose();
    }
  }

  /** Begins anew, with room for so many lines. */
  begin(most) {
    if (most > this.room) this.#grow(Math.max(most, 2 * this.room));
    this.count = 0;
  }

  add(x, y, z, x2, y2, z2, color) {
    const at = 6 * this.count++;
    const { places, colors } = this;
    places[at] = x;
    places[at + 1] = y;
    places[at + 2] = z;
    places[at + 3] = x2;
    places[at + 4] = y2;
    places[at + 5] = z2;
    for (let part = 0; part < 6; part += 3) {
      colors[at + part] = color.r;
      colors[at + part + 1] = color.g;
      colors[at + part + 2] = color.b;
    }
  }

  end() {
    const { attributes } = this.lines.geometry;
    attributes.instanceStart.data.needsUpdate = true;
    attributes.instanceColorStart.data.needsUpdate = true;
    this.lines.geometry.instanceCount = this.count;
    this.lines.visible = this.count > 0;
  }
}

/** Draws a world: places and axes of frames in the fixed frame, in float64. */
export class Scene {
  constructor(canvas, labels, world, { choose, hover, focus }) {
    this.canvas = canvas;
    this.labels = labels;
    this.pen = labels.getContext("2d");
    this.world = world;
    this.showsNames = true;
    this.showsLinks = true;
    this.showsShapes = true;
    this.size = 1; // times the axes' own length
    this.axis = 0.1;
    this.cell = 1;
    this.origin = [0, 0, 0]; // of what is drawn, so that float32 suffices far from the fixed frame
    this.chosen = -1;
    this.hovered = -1;
    this.path = new Set();
    this.trail = [];
    this.isFitted = false;
    this.follows = ""; // a frame that the camera goes along with
    this.followed = null; // where it was
    this.isDirty = true;
    this.drawn = 0;
    this.renderer = new WebGLRenderer({ canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.three = new Three();
    this.camera = new PerspectiveCamera(45, 1, 0.01, 1000);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(3, -4, 3);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("change", () => this.redraw());
    this.shapes = new Shapes(this.three);
    this.links = new Lines(this.three, 1.2, 0);
    this.axes = new Lines(this.three, 2.4, 1);
    this.way = new Lines(this.three, 2.2, 2);
    this.marks = new Lines(this.three, 3.5, 3);
    this.dots = new Points(new BufferGeometry(), new PointsMaterial({ size: 6, sizeAttenuation: false, vertexColors: true }));
    this.dots.frustumCulled = false;
    this.three.add(this.dots);
    this.#roomForDots(64);
    this.#listen({ choose, hover, focus });
    new ResizeObserver(() => this.#resize()).observe(canvas);
    this.setColors();
    this.#resize();
    this.renderer.setAnimationLoop(() => this.#draw());
  }

  /** Takes the colors of the style sheet. */
  setColors() {
    const style = getComputedStyle(document.documentElement);
    const color = (name) => new Color(style.getPropertyValue(`--${name}`).trim());
    const names = ["back", "x", "y", "z", "link", "accent", "late", "silent", "static", "grid", "text", "quiet", "shape"];
    this.colors = Object.fromEntries(names.map((name) => [name, color(name)]));
    this.css = (name) => style.getPropertyValue(`--${name}`).trim();
    this.three.background = this.colors.back;
    this.shapes.setColor(this.colors.shape);
    this.#makeGrid();
    this.update();
  }

  redraw() {
    this.isDirty = true;
  }

  /** Reads the world anew. */
  update() {
    this.isStale = true;
    this.isDirty = true;
  }

  /** Looks at all frames. */
  fit() {
    const { places, seen } = this.world;
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    let count = 0;
    for (let row = 0; row < seen.length; row++) {
      if (!seen[row]) continue;
      count++;
      for (let axis = 0; axis < 3; axis++) {
        low[axis] = Math.min(low[axis], places[3 * row + axis]);
        high[axis] = Math.max(high[axis], places[3 * row + axis]);
      }
    }
    if (!count) return;
    const middle = low.map((value, axis) => (value + high[axis]) / 2);
    const far = Math.max(...low.map(Math.abs), ...high.map(Math.abs));
    this.origin = far > 1000 ? middle.map(Math.round) : [0, 0, 0];
    const span = Math.max(Math.hypot(...high.map((value, axis) => value - low[axis])), 0.2);
    this.#measure(span);
    const target = new Vector3(...middle.map((value, axis) => value - this.origin[axis]));
    const way = new Vector3().subVectors(this.camera.position, this.controls.target).normalize();
    if (!this.isFitted) way.set(0.55, -0.68, 0.48).normalize();
    this.isFitted = true;
    this.#follow(-1);
    const angle = (this.camera.fov / 360) * Math.PI;
    const narrow = Math.min(angle, Math.atan(Math.tan(angle) * this.camera.aspect));
    this.#look(target, way, (0.5 * span) / Math.sin(narrow) + this.axis);
    this.#makeGrid();
    this.update();
  }

  /** Looks at one frame, and follows it; -1: at none any more. */
  center(row) {
    this.#follow(row);
    if (row < 0 || !this.world.seen[row]) return;
    const target = new Vector3(...this.followed);
    const way = new Vector3().subVectors(this.camera.position, this.controls.target);
    const distance = Math.min(way.length(), 24 * this.axis * this.size);
    this.#look(target, way.normalize(), distance);
  }

  #follow(row) {
    this.follows = row < 0 ? "" : this.world.names[row];
    this.followed = row < 0 || !this.world.seen[row] ? null : this.#placeOf(row);
  }

  /** Moves the camera with the frame that it follows. */
  #goAlong() {
    const row = this.follows ? this.world.rowOf(this.follows) : -1;
    if (row < 0 || !this.world.seen[row]) return;
    const place = this.#placeOf(row);
    if (this.followed) {
      const moved = new Vector3(...place).sub(new Vector3(...this.followed));
      this.camera.position.add(moved);
      this.controls.target.add(moved);
      this.controls.update();
    }
    this.followed = place;
  }

  #placeOf(row) {
    return [0, 1, 2].map((axis) => this.world.places[3 * row + axis] - this.origin[axis]);
  }

  /** Draws longer or shorter axes. */
  scale(factor) {
    this.size = Math.min(Math.max(this.size * factor, 0.05), 20);
    this.update();
  }

  #look(target, way, distance) {
    this.controls.target.copy(target);
    this.camera.position.copy(target).addScaledVector(way, distance);
    this.controls.update();
    this.redraw();
  }

  /** Sets the length of the axes and the cells of the grid by the frames' distances. */
  #measure(span) {
    const { places, seen, parents } = this.world;
    const lengths = [];
    for (let row = 0; row < seen.length; row++) {
      const parent = parents[row];
      if (parent < 0 || !seen[row] || !seen[parent]) continue;
      const length = Math.hypot(...[0, 1, 2].map((axis) => places[3 * row + axis] - places[3 * parent + axis]));
      if (length > 1e-6) lengths.push(length);
    }
    lengths.sort((one, other) => one - other);
    const usual = lengths.length ? lengths[lengths.length >> 1] * 0.4 : span * 0.1;
    this.axis = Math.min(Math.max(usual, span * 0.012), span * 0.06);
    this.cell = 10 ** Math.round(Math.log10(span / 8));
  }

  #makeGrid() {
    if (this.grid) {
      this.three.remove(this.grid);
      this.grid.dispose();
    }
    const { grid, link } = this.colors;
    this.grid = new GridHelper(30 * this.cell, 30, new Color().lerpColors(grid, link, 0.5), grid);
    this.grid.rotation.x = Math.PI / 2;
    this.grid.position.z = -this.origin[2];
    const { target } = this.controls;
    for (const [axis, value] of [["x", target.x], ["y", target.y]]) {
      this.grid.position[axis] = this.origin.some(Boolean) ? Math.round(value / this.cell) * this.cell : 0;
    }
    this.three.add(this.grid);
  }

  #roomForDots(room) {
    this.dots.geometry.dispose();
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(3 * room), 3));
    geometry.setAttribute("color", new BufferAttribute(new Float32Array(3 * room), 3));
    this.dots.geometry = geometry;
    this.dotRoom = room;
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    const ratio = this.renderer.getPixelRatio();
    this.labels.width = width * ratio;
    this.labels.height = height * ratio;
    this.redraw();
  }

  #draw() {
    if (!this.isDirty) return;
    if (this.isStale) {
      this.#goAlong();
      this.#fill();
    }
    this.isStale = this.isDirty = false;
    const distance = this.camera.position.distanceTo(this.controls.target);
    this.camera.near = distance * 0.01;
    this.camera.far = distance * 100;
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.three, this.camera);
    this.#drawNames();
    this.drawn++;
  }

  /** Writes the world into the buffers. */
  #fill() {
    const { places, turns, seen, parents, states } = this.world;
    const [ox, oy, oz] = this.origin;
    const { colors, path } = this;
    this.shapes.place(this.world, this.origin, this.showsShapes);
    const count = seen.length;
    const long = this.axis * this.size;
    this.axes.material.linewidth = count > MANY ? 1.5 : 2.4;
    this.links.material.linewidth = count > MANY ? 0.8 : 1.2;
    const link = new Color().lerpColors(colors.back, colors.link, count > MANY ? 0.55 : 1);
    this.axes.begin(3 * count);
    this.links.begin(count);
    this.marks.begin(count + 3);
    if (count > this.dotRoom) this.#roomForDots(2 * count);
    const dots = this.dots.geometry.attributes;
    let dot = 0;
    for (let row = 0; row < count; row++) {
      if (!seen[row]) continue;
      const x = places[3 * row] - ox;
      const y = places[3 * row + 1] - oy;
      const z = places[3 * row + 2] - oz;
      const qx = turns[4 * row];
      const qy = turns[4 * row + 1];
      const qz = turns[4 * row + 2];
      const qw = turns[4 * row + 3];
      const size = row === this.chosen ? 1.6 * long : long;
      const lines = row === this.chosen ? this.marks : this.axes;
      lines.add(x, y, z, x + size * (1 - 2 * (qy * qy + qz * qz)), y + size * 2 * (qx * qy + qz * qw), z + size * 2 * (qx * qz - qy * qw), colors.x);
      lines.add(x, y, z, x + size * 2 * (qx * qy - qz * qw), y + size * (1 - 2 * (qx * qx + qz * qz)), z + size * 2 * (qy * qz + qx * qw), colors.y);
      lines.add(x, y, z, x + size * 2 * (qx * qz + qy * qw), y + size * 2 * (qy * qz - qx * qw), z + size * (1 - 2 * (qx * qx + qy * qy)), colors.z);
      const parent = parents[row];
      const state = states[row];
      const warns = state === "late" || state === "silent";
      if (parent >= 0 && seen[parent]) {
        const onPath = path.has(row) && path.has(parent);
        if (onPath || this.showsLinks) {
          const color = onPath ? colors.accent : warns ? colors[state] : link;
          const target = onPath ? this.marks : this.links;
          target.add(x, y, z, places[3 * parent] - ox, places[3 * parent + 1] - oy, places[3 * parent + 2] - oz, color);
        }
      }
      const color = row === this.chosen || row === this.hovered ? colors.accent : warns ? colors[state] : colors.static;
      dots.position.setXYZ(dot, x, y, z);
      dots.color.setXYZ(dot, color.r, color.g, color.b);
      dot++;
    }
    dots.position.needsUpdate = true;
    dots.color.needsUpdate = true;
    this.dots.geometry.setDrawRange(0, dot);
    this.dots.material.size = count > MANY ? 3.5 : 6;
    this.way.begin(this.trail.length);
    for (let at = 1; at < this.trail.length; at++) {
      const [from, to] = [this.trail[at - 1], this.trail[at]];
      const color = new Color().lerpColors(colors.back, colors.accent, 0.25 + (0.75 * at) / this.trail.length);
      this.way.add(from[0] - ox, from[1] - oy, from[2] - oz, to[0] - ox, to[1] - oy, to[2] - oz, color);
    }
    for (const lines of [this.axes, this.links, this.marks, this.way]) lines.end();
  }

  /** Finds where frames are on the screen, in pixels; those behind the camera are not there. */
  #project() {
    const { places, seen } = this.world;
    const count = seen.length;
    if (!this.screen || this.screen.length < 2 * count) this.screen = new Float32Array(4 * count);
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const at = new Vector3();
    for (let row = 0; row < count; row++) {
      this.screen[2 * row] = NaN;
      if (!seen[row]) continue;
      at.set(...[0, 1, 2].map((axis) => places[3 * row + axis] - this.origin[axis])).project(this.camera);
      if (at.z > 1) continue;
      this.screen[2 * row] = ((at.x + 1) / 2) * width;
      this.screen[2 * row + 1] = ((1 - at.y) / 2) * height;
    }
    return { width, height };
  }

  #drawNames() {
    const { pen } = this;
    const ratio = this.renderer.getPixelRatio();
    const { width, height } = this.#project();
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = `11px ${this.css("mono")}`;
    pen.textBaseline = "middle";
    pen.lineJoin = "round";
    pen.lineWidth = 3;
    pen.strokeStyle = this.css("back");
    const first = [this.chosen, this.hovered, ...this.path].filter((row) => row >= 0);
    const rows = this.showsNames ? [...first, ...this.world.byDepth] : first;
    const most = this.world.seen.length > MANY ? NAMES / 2 : NAMES;
    const placed = [];
    const done = new Set();
    for (const row of rows) {
      if (placed.length >= most) break;
      const x = this.screen[2 * row];
      const y = this.screen[2 * row + 1];
      if (done.has(row) || !(x >= 0 && x <= width && y >= 0 && y <= height)) continue;
      done.add(row);
      const name = this.world.names[row];
      const wide = 6.7 * Math.min(name.length, 40);
      const box = [x + 8, y - 17, x + 12 + wide, y - 3];
      const isFirst = first.includes(row);
      if (row !== this.chosen && placed.some((other) => overlap(box, other))) continue;
      placed.push(box);
      const text = name.length > 40 ? `${name.slice(0, 39)}…` : name;
      pen.strokeText(text, x + 9, y - 10);
      pen.fillStyle = this.css(row === this.chosen || row === this.hovered ? "accent" : isFirst ? "text" : "quiet");
      pen.fillText(text, x + 9, y - 10);
    }
  }

  /** Returns the frame nearest to a place on the screen; -1 where none is near. */
  #nearest(event) {
    const box = this.canvas.getBoundingClientRect();
    const x = event.clientX - box.left;
    const y = event.clientY - box.top;
    let best = -1;
    let least = NEAR * NEAR;
    for (let row = 0; row < this.world.seen.length; row++) {
      const away = (this.screen[2 * row] - x) ** 2 + (this.screen[2 * row + 1] - y) ** 2;
      if (away < least) [best, least] = [row, away];
    }
    return best;
  }

  #listen({ choose, hover, focus }) {
    const { canvas } = this;
    let pressed = null;
    canvas.addEventListener("pointerdown", (event) => {
      pressed = [event.clientX, event.clientY];
    });
    canvas.addEventListener("click", (event) => {
      if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
      const row = this.#nearest(event);
      if (row >= 0) choose(row);
    });
    canvas.addEventListener("dblclick", (event) => focus(this.#nearest(event)));
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons || !this.screen) return;
      const row = this.#nearest(event);
      canvas.style.cursor = row >= 0 ? "pointer" : "";
      hover(row);
    });
    canvas.addEventListener("pointerleave", () => hover(-1));
  }
}

function overlap(one, other) {
  return one[0] < other[2] && other[0] < one[2] && one[1] < other[3] && other[1] < one[3];
}
