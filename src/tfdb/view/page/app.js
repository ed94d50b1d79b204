// The page: what the server sends becomes a world, which the tree and the scene draw.

import { Scene } from "./scene.js";
import { SIGNS, Tree } from "./tree.js";

const KINDS = { changed: 1, whole: 2, past: 3 };
const TRAIL = 10; // seconds
const LATE = 4; // periods of an edge: its newest sample is late, then silent
const SILENT = 12;
const STATES = {
  fresh: "moving",
  late: "late",
  silent: "silent",
  static: "static",
  none: "without data",
};
const EVENTS = 200; // listed at most
const element = (id) => document.getElementById(id);

/** Frames by row, in the order of the tree. */
const world = {
  names: [],
  parents: [],
  depths: [],
  children: [],
  byDepth: [],
  roots: [],
  seen: new Uint8Array(0),
  places: new Float64Array(0),
  turns: new Float64Array(0),
  states: [],
  rowOf: (name) => state.rowOf.get(name) ?? -1,
  stateOf: (row) => world.states[row] ?? "none",
  rateText,
  ageText,
  titleOf,
};

const state = {
  socket: null,
  tries: 0,
  hello: null,
  topology: 0,
  rowOf: new Map(),
  isStatic: new Uint8Array(0),
  origins: new Map(),
  poses: new Float64Array(0),
  isMissing: true,
  facts: null, // by row: rate, age, gap, late, newest, authority
  broken: new Map(),
  alarms: [],
  chosen: "",
  hovered: -1,
  fixed: "",
  fixedIsOurs: true,
  at: null, // nanoseconds; null: the newest samples
  shownAt: null,
  waits: false, // for the poses of a stamp
  asked: null,
  looked: 0, // when ages were counted last, as performance.now()
  plays: false,
  played: 0,
  start: null,
  end: null,
  now: null,
  answer: null,
  answered: 0,
  question: 0,
  askedAt: 0,
  events: [],
  theme: localStorage.getItem("tfdb-theme"),
};

// Reading the time of stamps, which are BigInt.

const NS = 1_000_000_000n;

function seconds(ns) {
  return Number(ns) / 1e9;
}

function stampText(ns) {
  const text = String(ns).padStart(10, "0");
  return `${text.slice(0, -9)}.${text.slice(-9)}`;
}

function dateText(ns) {
  if (ns < 946_684_800n * NS) return "";
  return new Date(Number(ns / 1_000_000n)).toISOString().replace("T", " ").replace("Z", "");
}

function duration(value) {
  const size = Math.abs(value);
  if (size === 0) return "0 s";
  if (size < 1e-6) return `${(value * 1e9).toPrecision(3)} ns`;
  if (size < 1e-3) return `${(value * 1e6).toPrecision(3)} µs`;
  if (size < 1) return `${Number((value * 1e3).toPrecision(3))} ms`;
  if (size < 100) return `${Number(value.toPrecision(3))} s`;
  if (size < 6000) return `${Math.floor(value / 60)} min ${Math.floor(value % 60)} s`;
  if (size < 172_800) return `${Math.floor(value / 3600)} h ${Math.floor((value % 3600) / 60)} min`;
  return `${Math.floor(value / 86_400)} d`;
}

// The connection.

function connect() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const socket = new WebSocket(`${scheme}//${location.host}/live`);
  socket.binaryType = "arraybuffer";
  state.socket = socket;
  socket.onmessage = ({ data }) => {
    if (typeof data === "string") takeText(JSON.parse(data));
    else takePoses(data);
  };
  socket.onclose = () => lost();
}

async function lost() {
  showLink("down", "no connection");
  state.tries++;
  if (state.tries === 1 && !state.ending) banner("The connection is lost. The page continues when tfdb view runs again.");
  const wait = Math.min(500 * 2 ** Math.min(state.tries - 1, 3), 4000);
  setTimeout(connect, wait);
  try {
    const answer = await fetch("live", { cache: "no-store" });
    if ([401, 403, 503].includes(answer.status)) banner(await answer.text());
  } catch {
    // The server is not there: the banner stays.
  }
}

function send(type, fields) {
  if (state.socket.readyState !== WebSocket.OPEN) return false;
  state.socket.send(JSON.stringify({ type, ...fields }));
  return true;
}

function takeText(message) {
  if (message.type === "hello") takeHello(message);
  else if (message.type === "tree") takeTree(message);
  else if (message.type === "facts") takeFacts(message);
  else if (message.type === "answer") takeAnswer(message);
  else if (message.type === "event") takeEvents([message]);
  else if (message.type === "error") {
    state.waits = false;
    state.ending = message.ends;
    const rest = message.ends ? ". Start tfdb view again: the page then goes on." : "";
    banner(message.text + rest);
    if (!message.ends) setTimeout(() => banner(""), 5000);
  }
}

function takeHello(hello) {
  state.tries = 0;
  state.ending = false;
  state.waits = false;
  state.question = 0;
  state.answered = 0;
  state.topology = 0;
  state.hello = hello;
  document.title = `${hello.source} · tfdb`;
  element("source").textContent = hello.source;
  element("source").title = hello.source;
  element("live").hidden = !hello.live;
  banner("");
  showLink("up", hello.live ? "live" : "recording");
  state.events = [];
  takeEvents(hello.events);
  loadShapes(hello.shapes);
  if (state.at !== null) ask(state.at);
}

async function loadShapes(mark) {
  element("shapes").hidden = !mark;
  try {
    await scene.shapes.load(mark);
    scene.update();
    showTime();
  } catch (error) {
    scene.shapes.mark = ""; // the next connection tries again
    banner(`The shapes of the robot were not loaded: ${error.message}`);
  }
}

// The tree and its poses.

function takeTree(tree) {
  const count = tree.names.length;
  state.topology = tree.topology;
  state.rowOf = new Map(tree.names.map((name, row) => [name, row]));
  state.origins = new Map(Object.entries(tree.origins).map(([row, origin]) => [Number(row), origin]));
  state.isStatic = new Uint8Array(count);
  state.poses = new Float64Array(7 * count).fill(NaN);
  for (const [row, pose] of Object.entries(tree.static)) {
    state.isStatic[row] = 1;
    state.poses.set(pose.map((value) => value ?? NaN), 7 * row);
  }
  const depths = new Array(count).fill(0);
  const children = new Array(count).fill(0);
  const roots = new Array(count).fill(0);
  tree.parents.forEach((parent, row) => {
    roots[row] = parent < 0 ? row : roots[parent];
    if (parent < 0) return;
    depths[row] = depths[parent] + 1;
    children[parent]++;
  });
  const byDepth = tree.names.map((_, row) => row).sort((one, other) => depths[one] - depths[other]);
  Object.assign(world, {
    names: tree.names,
    parents: tree.parents,
    depths,
    children,
    roots,
    byDepth,
    seen: new Uint8Array(count),
    places: new Float64Array(3 * count),
    turns: new Float64Array(4 * count),
    states: new Array(count).fill("none"),
  });
  state.worlds = new Float64Array(7 * count);
  state.facts = null;
  if (!state.rowOf.has(state.fixed) && (state.fixedIsOurs || !state.fixed)) {
    state.fixed = tree.names[0] ?? "";
    state.fixedIsOurs = true;
  }
  element("fixed").value = state.fixed;
  element("frames").replaceChildren(...tree.names.slice(0, 3000).map((name) => new Option(name)));
  list.hovered = scene.hovered = -1;
  showChosen();
  list.list();
}

function takePoses(data) {
  const head = new DataView(data);
  const kind = head.getUint32(0, true);
  if (head.getUint32(4, true) !== state.topology) return;
  const count = head.getUint32(16, true);
  const rows = new Uint32Array(data, 24, count);
  const values = new Float32Array(data, 24 + 4 * count, 7 * count);
  if (kind === KINDS.past) {
    state.waits = false;
    state.shownAt = head.getBigInt64(8, true);
    if (state.asked !== null) ask(state.asked);
  } else if (state.at !== null) return;
  else state.shownAt = null;
  const { poses, origins } = state;
  for (let each = 0; each < count; each++) {
    const at = 7 * rows[each];
    for (let column = 0; column < 7; column++) poses[at + column] = values[7 * each + column];
    const origin = origins.get(rows[each]);
    if (origin) for (let axis = 0; axis < 3; axis++) poses[at + axis] += origin[axis];
  }
  compose();
  if (!scene.isFitted) scene.fit();
  if (kind !== KINDS.changed) {
    judge();
    showTime();
  }
}

/** Places all frames in the fixed frame. */
function compose() {
  const { names, parents, roots, seen, places, turns } = world;
  const { poses, worlds } = state;
  const count = names.length;
  for (let row = 0; row < count; row++) {
    if (parents[row] < 0) worlds.set(IDENTITY, 7 * row);
    else multiply(worlds, 7 * parents[row], poses, 7 * row, worlds, 7 * row);
  }
  const fixed = state.rowOf.get(state.fixed) ?? -1;
  const back = new Float64Array(7);
  if (fixed >= 0) invert(worlds, 7 * fixed, back);
  const found = new Float64Array(7);
  let drawn = 0;
  for (let row = 0; row < count; row++) {
    seen[row] = 0;
    if (fixed < 0 || roots[row] !== roots[fixed]) continue;
    multiply(back, 0, worlds, 7 * row, found, 0);
    if (!Number.isFinite(found[0] + found[1] + found[2] + found[6])) continue;
    seen[row] = 1;
    drawn++;
    for (let axis = 0; axis < 3; axis++) places[3 * row + axis] = found[axis];
    for (let part = 0; part < 4; part++) turns[4 * row + part] = found[3 + part];
  }
  state.drawn = drawn;
  scene.update();
}

const IDENTITY = [0, 0, 0, 0, 0, 0, 1];

/** Writes the product of two poses; the result may be neither of them. */
function multiply(a, i, b, j, out, k) {
  const [qx, qy, qz, qw] = [a[i + 3], a[i + 4], a[i + 5], a[i + 6]];
  const [x, y, z] = [b[j], b[j + 1], b[j + 2]];
  const [rx, ry, rz, rw] = [b[j + 3], b[j + 4], b[j + 5], b[j + 6]];
  const tx = 2 * (qy * z - qz * y);
  const ty = 2 * (qz * x - qx * z);
  const tz = 2 * (qx * y - qy * x);
  out[k] = a[i] + x + qw * tx + qy * tz - qz * ty;
  out[k + 1] = a[i + 1] + y + qw * ty + qz * tx - qx * tz;
  out[k + 2] = a[i + 2] + z + qw * tz + qx * ty - qy * tx;
  out[k + 3] = qw * rx + qx * rw + qy * rz - qz * ry;
  out[k + 4] = qw * ry - qx * rz + qy * rw + qz * rx;
  out[k + 5] = qw * rz + qx * ry - qy * rx + qz * rw;
  out[k + 6] = qw * rw - qx * rx - qy * ry - qz * rz;
}

function invert(a, i, out) {
  const inverse = [0, 0, 0, -a[i + 3], -a[i + 4], -a[i + 5], a[i + 6]];
  multiply(inverse, 0, [-a[i], -a[i + 1], -a[i + 2], 0, 0, 0, 1], 0, out, 0);
}

// Facts.

function takeFacts(facts) {
  const big = (text) => (text === null ? null : BigInt(text));
  [state.start, state.end, state.now] = [big(facts.start), big(facts.end), big(facts.now)];
  state.broken = new Map();
  state.alarms = [];
  for (const [frame, severity, text] of [...facts.broken].reverse()) {
    if (frame) state.broken.set(frame, [severity, text]);
    else state.alarms.push(text);
  }
  if (facts.topology === state.topology) {
    const count = world.names.length;
    const made = { rate: new Array(count), gap: new Array(count), late: new Array(count) };
    made.newest = new Array(count).fill(null);
    made.age = new Float64Array(count).fill(NaN);
    facts.rows.forEach((row, each) => {
      made.rate[row] = facts.rate[each] / 100;
      made.gap[row] = facts.gap[each] / 1e4;
      made.late[row] = facts.late[each];
      const newest = big(facts.newest[each]);
      made.newest[row] = newest;
      if (newest !== null) made.age[row] = seconds(state.now - newest);
    });
    made.authority = facts.authority.map((each) => facts.authorities[each]);
    made.received = performance.now();
    made.rest = facts.rest;
    made.speed = facts.speed;
    made.clock = facts.clock;
    state.facts = made;
  }
  judge();
  showTime();
  showDetails();
  if (state.at === null) lookUp();
}

function ageOf(row) {
  const { facts } = state;
  if (!facts) return NaN;
  // Facts come again within their rest if any commit comes: later, all edges age.
  const since = (state.looked - facts.received) / 1000;
  const passed = state.hello.live && since > facts.rest + 1 ? since : 0;
  return Math.max(facts.age[row] + passed * facts.speed, 0);
}

/** Gives each frame its state. */
function judge() {
  const { names, parents, states } = world;
  const counts = {};
  state.looked = performance.now();
  const showsAges = state.hello.live && state.at === null;
  for (let row = 0; row < names.length; row++) {
    let found = "fresh";
    const broken = showsAges && state.broken.get(names[row]);
    if (parents[row] < 0) found = world.children[row] ? "static" : "none";
    else if (broken) found = broken[0] === "warning" ? "late" : "silent";
    else if (!Number.isFinite(state.poses[7 * row])) found = "none";
    else if (state.isStatic[row]) found = "static";
    else if (showsAges && !state.hello.judged && state.facts) {
      const periods = ageOf(row) * (state.facts.rate[row] || 0);
      found = periods > SILENT ? "silent" : periods > LATE ? "late" : "fresh";
    }
    states[row] = found;
    if (parents[row] >= 0) counts[found] = (counts[found] ?? 0) + 1;
  }
  STATES.fresh = showsAges ? "in time" : "moving";
  element("tree").parentElement.classList.toggle("ageless", !showsAges);
  showFilters(counts);
  if (list.only) list.list();
  else list.draw();
  scene.update();
}

function rateText(row) {
  if (state.isStatic[row]) return "static";
  const rate = state.facts?.rate[row];
  return rate ? `${Number(rate.toPrecision(3))} Hz` : "";
}

function ageText(row) {
  if (!state.hello.live || state.at !== null || state.isStatic[row]) return "";
  const age = ageOf(row);
  return Number.isFinite(age) ? duration(age) : "";
}

function titleOf(row, names = true) {
  const words = [STATES[world.stateOf(row)]];
  if (world.parents[row] < 0) words[0] = "root";
  else words.push(`child of ${world.names[world.parents[row]]}`);
  const authority = state.facts?.authority[row];
  if (authority && names) words.push(`by ${authority}`);
  const broken = state.broken.get(world.names[row]);
  if (broken) words.push(broken[1]);
  return words.join(", ");
}

function showFilters(counts) {
  const box = element("filters");
  for (const [name, text] of Object.entries(STATES)) {
    let button = box.querySelector(`[data-state="${name}"]`);
    if (!button) {
      button = document.createElement("button");
      button.dataset.state = name;
      const sign = document.createElement("span");
      sign.className = name;
      sign.textContent = SIGNS[name];
      button.append(sign, document.createElement("span"));
      button.onclick = () => {
        list.only = list.only === name ? "" : name;
        element("tree").scrollTop = 0;
        judge();
        list.list();
      };
      box.append(button);
    }
    const count = counts[name] ?? 0;
    button.hidden = !count && list.only !== name;
    button.setAttribute("aria-pressed", list.only === name);
    button.lastChild.textContent = ` ${count} ${text}`;
  }
}

// The chosen frame.

function choose(row) {
  state.chosen = world.names[row] ?? "";
  state.answer = null;
  scene.trail = [];
  showChosen();
  list.reveal(row);
  list.draw();
  showDetails();
  showTime();
  lookUp();
}

function hover(row) {
  if (row === state.hovered) return;
  state.hovered = list.hovered = scene.hovered = row;
  list.draw();
  scene.update();
}

function focus(row) {
  if (row < 0) return;
  choose(row);
  follow(row);
}

/** Lets the camera go along with a frame; -1: with none. */
function follow(row) {
  scene.center(row);
  element("center").setAttribute("aria-pressed", scene.follows !== "");
}

/** Marks the chosen frame and its way to the fixed frame. */
function showChosen() {
  const row = state.rowOf.get(state.chosen) ?? -1;
  const fixed = state.rowOf.get(state.fixed) ?? -1;
  list.chosen = scene.chosen = row;
  const path = wayOf(fixed, row);
  list.path = scene.path = new Set(path);
  scene.update();
}

/** Lists the frames from one to another, if they are in one tree. */
function wayOf(from, to) {
  if (from < 0 || to < 0 || world.roots[from] !== world.roots[to]) return [];
  const up = [from];
  while (world.parents[up.at(-1)] >= 0) up.push(world.parents[up.at(-1)]);
  const down = [to];
  while (!up.includes(down.at(-1))) down.push(world.parents[down.at(-1)]);
  return [...up.slice(0, up.indexOf(down.at(-1))), ...down.reverse()];
}

function lookUp() {
  if (!state.chosen || !state.fixed) return;
  if (state.question > state.answered && performance.now() - state.askedAt < 2000) {
    state.isOwed = true;
    return;
  }
  const stamp = state.at === null ? null : String(state.at);
  const asked = { id: state.question + 1, target: state.fixed, source: state.chosen, stamp, trail: TRAIL };
  if (!send("lookup", asked)) return;
  state.question++;
  state.askedAt = performance.now();
}

function takeAnswer(answer) {
  state.answered = Math.max(state.answered, answer.id);
  if (answer.source === state.chosen && answer.target === state.fixed) {
    const isNew = state.answer === null;
    state.answer = answer;
    scene.trail = answer.trail ?? [];
    scene.update();
    showDetails();
    showTime();
    if (isNew) speak();
  }
  if (state.isOwed) {
    state.isOwed = false;
    lookUp();
  }
}

/** Makes an element with text or children. */
function make(tag, content = [], fields = {}) {
  const made = Object.assign(document.createElement(tag), fields);
  made.append(...(Array.isArray(content) ? content : [content]));
  return made;
}

function number(value, digits) {
  return value.toFixed(digits).replace("-", "−");
}

function showDetails() {
  const box = element("details");
  const row = state.rowOf.get(state.chosen) ?? -1;
  if (!state.chosen) {
    const alarms = state.alarms.map((text) => make("p", text, { className: "silent" }));
    box.replaceChildren(...alarms, make("p", "Choose a frame in the tree or in the scene.", { className: "quiet" }));
    return;
  }
  if (row < 0) {
    const text = `${state.chosen} does not exist ${state.at === null ? "now" : "at this stamp"}.`;
    box.replaceChildren(make("h3", state.chosen), make("p", text, { className: "quiet" }));
    return;
  }
  const { answer } = state;
  const scrolled = box.scrollTop;
  const parts = [make("h3", state.chosen), make("p", titleOf(row, false), { className: world.stateOf(row) })];
  parts.push(factsOf(row));
  if (answer && state.chosen !== state.fixed) {
    if (answer.ok) parts.push(...poseOf(answer));
    else parts.push(make("h2", `in ${state.fixed}`), make("pre", answer.text));
    const path = wayOf(state.rowOf.get(state.fixed) ?? -1, row);
    if (path.length) parts.push(make("h2", "path"), pathOf(path));
    if (answer.ok) parts.push(make("h2", "samples used"), ...reportOf(answer));
    parts.push(pythonOf(answer));
  }
  if (box.contains(document.activeElement) || (getSelection().toString() && box.contains(getSelection().anchorNode))) return;
  box.replaceChildren(...parts);
  box.scrollTop = scrolled;
}

function factsOf(row) {
  const rows = [];
  const { facts, answer } = state;
  const gaps = answer?.gaps;
  if (!state.isStatic[row] && facts && world.parents[row] >= 0) {
    rows.push(["rate", rateText(row)]);
    if (facts.newest[row] !== null) rows.push(["newest", stampText(facts.newest[row])]);
    if (ageText(row)) rows.push(["age", ageText(row)]);
    rows.push(["longest gap", facts.gap[row] ? duration(facts.gap[row]) : ""]);
    if (gaps?.count) rows.push(["gaps", `${gaps.count} over 5 periods`]);
    if (facts.late[row]) rows.push(["late samples", String(facts.late[row])]);
  }
  if (facts?.authority[row]) rows.push(["authority", facts.authority[row]]);
  return make("dl", rows.filter((each) => each[1]).flatMap(([name, text]) => [make("dt", name), make("dd", text)]));
}

function poseOf(answer) {
  const [x, y, z, qx, qy, qz, qw] = answer.pose;
  const degrees = answer.rpy.map((value) => (value * 180) / Math.PI);
  const line = (name, values, digits, colored) =>
    make("tr", [
      make("th", name, { scope: "row" }),
      ...values.map((value, axis) => make("td", number(value, digits), { className: colored ? `a${"xyz"[axis]}` : "" })),
    ]);
  const table = make("table", [
    line("xyz (m)", [x, y, z], 4, true),
    line("rpy (°)", degrees, 2, true),
    line("xyzw", [qx, qy, qz, qw], 4, false),
  ], { className: "numbers" });
  const distance = Math.hypot(x, y, z);
  const when = answer.stamp === null ? "at all times" : state.at === null && state.hello.live ? "by the newest samples" : "at the stamp";
  return [make("h2", `in ${state.fixed}`), table, make("p", `${number(distance, 4)} m away, ${when}`, { className: "quiet" })];
}

function pathOf(path) {
  const parts = path.flatMap((row, place) => {
    const button = make("button", world.names[row], { onclick: () => choose(row) });
    return place ? [make("i", "→"), button] : [button];
  });
  return make("div", parts, { className: "path" });
}

/** Lists the samples of each moving edge, and says what their ages are counted from. */
function reportOf(answer) {
  const isLive = answer.at === null && state.hello.live;
  const moving = answer.edges.filter((edge) => edge.before !== null);
  const lines = moving.map((edge) => {
    const row = state.rowOf.get(edge.child) ?? -1;
    const known = isLive ? ageOf(row) : NaN;
    const age = Number.isFinite(known) ? known : edge.age;
    const stands = isLive && ["late", "silent"].includes(world.stateOf(row)) ? world.stateOf(row) : "";
    const title = `T[${edge.parent}<-${edge.child}]: ${edge.used}, sample at ${stampText(BigInt(edge.before))}, age ${duration(age)}`;
    return make("li", [make("b", edge.child), make("span", usedText(edge, isLive, age), { className: stands })], { title });
  });
  const fixed = answer.edges.length - moving.length;
  if (fixed) lines.push(make("li", `${fixed} static ${fixed === 1 ? "edge" : "edges"}`, { className: "quiet" }));
  const list = make("ul", lines, { className: "report" });
  if (!moving.length) return [list];
  let words = "age: from the sample to the shown stamp";
  if (isLive && state.facts?.clock) words = "age: from the stamp of the edge's newest sample to now";
  else if (isLive) words = "age: to the newest stamp of all edges, because the stamps come from another clock";
  return [list, make("p", words, { className: "quiet" })];
}

function usedText(edge, isLive, age) {
  if (isLive) return `newest sample, age ${duration(age)}`;
  if (edge.used === "exact") return "sample at this stamp";
  if (edge.before === edge.after) return `${edge.used}, age ${duration(age)}`;
  return `${edge.used}, gap ${duration(edge.gap)}, age ${duration(age)}`;
}

function pythonOf(answer) {
  const code = make("pre", answer.python);
  const button = make("button", "copy");
  button.onclick = async () => {
    try {
      await navigator.clipboard.writeText(answer.python);
      button.textContent = "copied";
    } catch {
      getSelection().selectAllChildren(code); // without a clipboard: to copy by hand
      return;
    }
    setTimeout(() => {
      button.textContent = "copy";
      button.blur();
    }, 1200);
  };
  return make("div", [make("div", [make("h2", "as Python"), button], { className: "bar" }), code]);
}

/** Says in words what the scene shows. */
function speak() {
  const { answer } = state;
  const { live } = state.hello;
  const count = `${state.drawn} of ${world.names.length} frames in ${state.fixed}`;
  const when = state.at !== null ? `at ${stampText(state.at)} seconds` : live ? "by the newest samples" : "at the end";
  let text = `${count}, ${when}.`;
  if (state.chosen && answer?.ok && state.chosen !== state.fixed) {
    const [x, y, z] = answer.pose.map((value) => value.toFixed(2));
    const turns = answer.rpy.map((value) => ((value * 180) / Math.PI).toFixed(0));
    const row = state.rowOf.get(state.chosen) ?? -1;
    text = `${state.chosen}, ${titleOf(row)}: x ${x}, y ${y}, z ${z} metres in ${state.fixed}; roll ${turns[0]}, pitch ${turns[1]}, yaw ${turns[2]} degrees. ${text}`;
  } else if (state.chosen && answer && !answer.ok) text = `${state.chosen}: ${answer.text} ${text}`;
  element("spoken").textContent = text;
  element("scene").setAttribute("aria-label", `Frames in 3D: ${text}`);
}

// Events.

function takeEvents(events) {
  state.events.push(...events);
  state.events.splice(0, state.events.length - 500);
  const box = element("events");
  const signs = { error: "silent", stale: "silent", warning: "late", ok: "fresh" };
  const shown = state.events.slice(-EVENTS);
  if (state.hello.live) shown.reverse();
  const items = shown.map((event) => {
    const kind = event.begins ? (signs[event.severity] ?? "static") : "fresh";
    const text = event.begins ? event.text : `${event.text} ended`;
    const time = make("time", clockText(BigInt(event.time)), { title: stampText(BigInt(event.time)) });
    const item = make("li", [make("span", SIGNS[kind], { className: kind }), make("span", text), time]);
    item.onclick = () => {
      if (state.start !== null) goTo(BigInt(event.time));
      const row = state.rowOf.get(event.frame);
      if (row !== undefined) choose(row);
    };
    return item;
  });
  box.replaceChildren(...items);
  element("count").textContent = state.events.length || "none";
  showMarks();
}

function clockText(ns) {
  const date = dateText(ns);
  if (date) return date.slice(11, 23);
  return `${seconds(ns).toFixed(3)} s`;
}

// Time.

/** Asks for everything at a stamp; one question at a time, then the newest. */
function ask(stamp) {
  if (state.waits) {
    state.asked = stamp;
    return;
  }
  state.asked = null;
  state.waits = send("at", { stamp: String(stamp) });
}

function goTo(stamp) {
  if (state.start === null) return;
  const low = state.start;
  const high = state.end;
  state.at = stamp < low ? low : stamp > high ? high : stamp;
  ask(state.at);
  if (!state.plays || performance.now() - state.askedAt > 200) lookUp();
  showTime();
}

function goLive() {
  if (!state.hello?.live) return;
  state.plays = false;
  state.at = state.asked = null;
  state.waits = false;
  send("at", { stamp: null });
  lookUp();
  showTime();
  judge();
}

function play() {
  if (state.start === null) return;
  if (state.at === null && state.hello.live) {
    goTo(state.end); // hold
    return;
  }
  state.plays = !state.plays;
  if (state.plays && (state.at === null || state.at >= state.end)) goTo(state.start);
  state.played = performance.now();
  if (state.plays) requestAnimationFrame(playOn);
  showTime();
}

function playOn(now) {
  if (!state.plays) return;
  const passed = (now - state.played) * Number(element("speed").value);
  state.played = now;
  const next = (state.at ?? state.start) + BigInt(Math.round(Math.max(passed, 0) * 1e6));
  if (next >= state.end) {
    state.plays = false;
    if (state.hello.live) goLive();
    else goTo(state.end);
    return;
  }
  goTo(next);
  requestAnimationFrame(playOn);
}

function step(direction) {
  if (state.start === null) return;
  const period = state.answer?.gaps?.period ?? 0.1;
  state.plays = false;
  goTo((state.at ?? state.end) + BigInt(Math.round(direction * period * 1e9)));
}

function showTime() {
  const { start, end, at, hello } = state;
  if (!hello) return;
  const isLive = at === null && hello.live;
  element("live").classList.toggle("on", isLive);
  element("live").setAttribute("aria-pressed", isLive);
  element("play").textContent = state.plays || isLive ? "❚❚" : "▶";
  const shown = at ?? end;
  const output = element("stamp");
  if (shown === null) output.textContent = "no samples";
  else output.replaceChildren(stampText(shown), make("small", dateText(shown) ? `  ${dateText(shown)} UTC` : "  s"));
  const words = isLive ? "each edge's newest sample" : at === null ? "each edge's newest sample, at the end" : "everything at one stamp, interpolated";
  element("mode").textContent = words;
  const slider = element("slider");
  slider.disabled = start === null || start === end;
  if (start !== null && end > start && document.activeElement !== slider) {
    slider.value = 10_000 * (seconds((at ?? end) - start) / seconds(end - start));
  } else if (start !== null && end > start && isLive) slider.value = 10_000;
  slider.setAttribute("aria-valuetext", shown === null ? "no samples" : `${stampText(shown)} s`);
  const drawn = state.drawn ?? 0;
  const rest = world.names.length - drawn;
  const { all } = scene.shapes;
  const here = all.filter(({ frame }) => state.rowOf.has(frame)).length;
  const shapes = all.length ? ` · ${here === all.length ? here : `${here} of ${all.length}`} shapes` : "";
  element("scale").textContent = `grid ${scene.cell} m · axes ${Number((scene.axis * scene.size).toPrecision(2))} m · ${drawn} frames${rest ? `, ${rest} not drawn` : ""}${shapes}`;
  const empty = element("empty");
  empty.hidden = drawn > 1;
  if (!world.names.length) empty.textContent = "The store has no frames yet.";
  else if (!state.rowOf.has(state.fixed)) empty.textContent = `The fixed frame ${state.fixed} does not exist.`;
  else empty.textContent = "No frame has data here: choose another stamp or fixed frame.";
  showMarks();
}

/** Draws the span, the chosen edge's samples and gaps, and events. */
function showMarks() {
  const canvas = element("marks");
  const { clientWidth: width, clientHeight: height } = canvas;
  const ratio = Math.min(devicePixelRatio, 2);
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  const style = getComputedStyle(document.documentElement);
  const color = (name) => style.getPropertyValue(`--${name}`);
  pen.fillStyle = color("raised");
  pen.fillRect(0, 13, width, 8);
  const { start, end } = state;
  if (start === null || end <= start) return;
  const whole = seconds(end - start);
  const place = (ns) => 5 + ((width - 10) * seconds(ns - start)) / whole; // as the slider's thumb
  const gaps = state.answer?.gaps;
  if (gaps?.start) {
    pen.fillStyle = color("link");
    const [from, to] = [place(BigInt(gaps.start)), place(BigInt(gaps.end))];
    pen.fillRect(from, 13, Math.max(to - from, 1), 8);
    pen.fillStyle = color("silent");
    for (const [before, after] of gaps.gaps) {
      const left = place(BigInt(before));
      pen.fillRect(left, 13, Math.max(place(BigInt(after)) - left, 1.5), 8);
    }
  }
  const colors = { error: "silent", stale: "silent", warning: "late", info: "quiet" };
  for (const event of state.events) {
    if (!event.begins) continue;
    const left = place(BigInt(event.time));
    if (left < 0 || left > width) continue;
    pen.fillStyle = color(colors[event.severity] ?? "quiet");
    pen.fillRect(left - 0.75, 3, 1.5, 7);
  }
}

// Around it.

function banner(text) {
  element("banner").textContent = text;
  element("banner").hidden = !text;
}

function showLink(kind, text) {
  element("link").className = `pill ${kind}`;
  element("link").textContent = text;
}

function showTheme() {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = state.theme ?? (dark ? "dark" : "light");
  if (scene) scene.setColors();
  showMarks();
}

function changeTheme() {
  state.theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  localStorage.setItem("tfdb-theme", state.theme);
  showTheme();
}

function setFixed(name) {
  state.fixed = name;
  state.fixedIsOurs = false;
  state.answer = null;
  scene.trail = [];
  element("fixed").value = name;
  showChosen();
  compose();
  fit();
  showDetails();
  showTime();
  lookUp();
}

function fit() {
  scene.fit();
  follow(-1);
  showTime();
}

function toggle(button, field) {
  scene[field] = !scene[field];
  element(button).setAttribute("aria-pressed", scene[field]);
  scene.update();
}

function rescale(factor) {
  scene.scale(factor);
  showTime();
}

const ACTIONS = {
  "/": () => element("search").focus(),
  l: goLive,
  " ": play,
  ArrowLeft: () => step(-1),
  ArrowRight: () => step(1),
  f: fit,
  c: () => follow(scene.follows && scene.follows === state.chosen ? -1 : scene.chosen),
  n: () => toggle("names", "showsNames"),
  p: () => toggle("links", "showsLinks"),
  s: () => toggle("shapes", "showsShapes"),
  "+": () => rescale(1.3),
  "=": () => rescale(1.3),
  "-": () => rescale(1 / 1.3),
  x: () => state.chosen && setFixed(state.chosen),
  t: changeTheme,
  Escape: () => choose(-1),
  "?": () => element("keys").showModal(),
};

function listen() {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || element("keys").open) return;
    const { target } = event;
    if (target.tagName === "INPUT" && target.type !== "range") {
      if (event.key === "Escape") target.blur();
      return;
    }
    if (target.tagName === "SELECT" || (target.tagName === "BUTTON" && " Enter".includes(event.key))) return;
    const action = ACTIONS[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
  element("search").oninput = ({ target }) => {
    list.query = target.value;
    element("tree").scrollTop = 0;
    list.list();
  };
  element("search").onkeydown = (event) => {
    if (event.key === "Enter" && list.shown.length) focus(list.shown[0]);
    if (event.key === "ArrowDown") element("tree").focus();
  };
  element("fixed").onchange = ({ target }) => {
    if (state.rowOf.has(target.value)) setFixed(target.value);
    else target.value = state.fixed;
  };
  element("fixed").onfocus = ({ target }) => target.select();
  element("slider").oninput = ({ target }) => {
    if (state.start === null) return;
    state.plays = false;
    goTo(state.start + ((state.end - state.start) * BigInt(target.value)) / 10_000n);
  };
  element("slider").onchange = ({ target }) => target.blur();
  const clicks = {
    live: goLive,
    play,
    back: () => step(-1),
    next: () => step(1),
    theme: changeTheme,
    help: ACTIONS["?"],
    fit: ACTIONS.f,
    center: ACTIONS.c,
    names: ACTIONS.n,
    links: ACTIONS.p,
    shapes: ACTIONS.s,
    smaller: ACTIONS["-"],
    larger: ACTIONS["+"],
  };
  for (const [id, action] of Object.entries(clicks)) element(id).onclick = action;
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", showTheme);
  document.addEventListener("visibilitychange", () => send("rate", { hz: document.hidden ? 1 : 60 }));
  new ResizeObserver(showMarks).observe(element("track"));
}

if (new URLSearchParams(location.search).has("token")) history.replaceState(null, "", "/");
const list = new Tree(element("tree"), world, { choose, hover, focus });
let scene = null;
showTheme();
scene = new Scene(element("scene"), element("labels"), world, { choose, hover, focus });
listen();
setInterval(() => {
  if (!state.hello || !state.facts) return;
  judge();
  if (state.at === null && state.hello.live) showDetails();
}, 1000);
connect();
// For tests and the console.
window.tfdb = { state, world, scene, list, focus, goTo, goLive };
