// The frame tree as a list of rows, of which only those in sight are in the page.

const HEIGHT = 22;
const INDENT = 11;
const NAME_ROOM = 230; // pixels that the indent leaves to a name, its signs and figures

const TAIL = 9; // letters

export const SIGNS = { fresh: "●", late: "▲", silent: "■", static: "◆", none: "○" };

/** Lists frames. `world` gives names, parents, children, depths and facts by row. */
export class Tree {
  constructor(element, world, { choose, hover, focus }) {
    this.element = element;
    this.world = world;
    this.events = { choose, hover, focus };
    this.rows = document.createElement("div");
    this.rows.className = "rows";
    element.append(this.rows);
    this.folded = new Set(); // by name: a tree that changes keeps them
    this.query = "";
    this.only = ""; // a state
    this.shown = []; // rows of the world, in order
    this.drawn = [];
    this.chosen = -1;
    this.hovered = -1;
    this.path = new Set();
    element.addEventListener("scroll", () => this.draw());
    new ResizeObserver(() => this.draw()).observe(element);
    this.rows.addEventListener("click", (event) => this.#click(event));
    this.rows.addEventListener("dblclick", (event) => this.events.focus(this.#rowOf(event)));
    this.rows.addEventListener("mousemove", (event) => this.events.hover(this.#rowOf(event)));
    element.addEventListener("mouseleave", () => this.events.hover(-1));
    element.addEventListener("keydown", (event) => this.#key(event));
  }

  /** Lists anew: the frames, what is folded, the search or a state have changed. */
  list() {
    const { names, parents } = this.world;
    const words = this.query.toLowerCase().split(/\s+/).filter(Boolean);
    this.flat = words.length > 0 || this.only !== "";
    this.shown = [];
    const hidden = new Uint8Array(names.length);
    for (let row = 0; row < names.length; row++) {
      if (this.flat) {
        const name = names[row].toLowerCase();
        if (!words.every((word) => name.includes(word))) continue;
        if (this.only && this.world.stateOf(row) !== this.only) continue;
        this.shown.push(row);
        continue;
      }
      const parent = parents[row]; // comes before its children
      if (parent >= 0 && (hidden[parent] || this.folded.has(names[parent]))) hidden[row] = 1;
      else this.shown.push(row);
    }
    this.rows.style.height = `${this.shown.length * HEIGHT}px`;
    this.draw();
  }

  /** Draws the rows in sight. */
  draw() {
    const first = Math.max(Math.floor(this.element.scrollTop / HEIGHT) - 2, 0);
    const count = Math.ceil(this.element.clientHeight / HEIGHT) + 4;
    const rows = this.shown.slice(first, first + count);
    while (this.drawn.length < rows.length) this.drawn.push(this.#make());
    while (this.drawn.length > rows.length) this.drawn.pop().remove();
    rows.forEach((row, place) => this.#fill(this.drawn[place], row, first + place));
    const active = rows.indexOf(this.chosen);
    if (active >= 0) this.element.setAttribute("aria-activedescendant", this.drawn[active].id);
    else this.element.removeAttribute("aria-activedescendant");
  }

  /** Unfolds what hides a row, and brings it into sight. */
  reveal(row) {
    const { names, parents } = this.world;
    let unfolded = false;
    for (let at = parents[row]; at >= 0; at = parents[at]) {
      unfolded = this.folded.delete(names[at]) || unfolded;
    }
    if (unfolded) this.list();
    const place = this.shown.indexOf(row);
    if (place < 0) return;
    const top = place * HEIGHT;
    const height = this.element.clientHeight;
    const scrolled = this.element.scrollTop;
    if (top < scrolled - height || top > scrolled + 2 * height) {
      this.element.scrollTop = top - height / 2;
    } else if (top < scrolled) this.element.scrollTop = top - HEIGHT;
    else if (top + HEIGHT > scrolled + height) this.element.scrollTop = top - height + 2 * HEIGHT;
  }

  #make() {
    const made = document.createElement("div");
    made.className = "row";
    made.id = `row-${this.drawn.length}`;
    made.setAttribute("role", "treeitem");
    const cell = document.createElement("span");
    cell.className = "cell";
    for (const kind of ["fold", "sign", "name", "of"]) {
      const part = document.createElement("span");
      part.className = kind;
      cell.append(part);
    }
    made.append(cell, document.createElement("span"), document.createElement("span"));
    this.rows.append(made);
    return made;
  }

  #fill(made, row, place) {
    const { names, parents, depths, children } = this.world;
    const state = this.world.stateOf(row);
    const [cell, rate, age] = made.children;
    const [fold, sign, name, of] = cell.children;
    made.dataset.row = row;
    made.style.top = `${place * HEIGHT}px`;
    made.className = "row";
    made.classList.toggle("chosen", row === this.chosen);
    made.classList.toggle("hovered", row === this.hovered);
    made.classList.toggle("onpath", this.path.has(row));
    const parent = children[row] > 0 && !this.flat;
    const folded = this.folded.has(names[row]);
    // Ever less for each level: the names of deep chains keep their room.
    const room = Math.max(this.element.clientWidth - NAME_ROOM, 1);
    const indent = this.flat ? 0 : room * (1 - Math.exp((-depths[row] * INDENT) / room));
    cell.style.paddingLeft = `${indent}px`;
    set(fold, this.flat ? "" : parent ? (folded ? "▶" : "▼") : "");
    fold.style.display = this.flat ? "none" : "";
    sign.className = `sign ${state}`;
    set(sign, SIGNS[state]);
    this.#mark(name, names[row]);
    set(of, this.flat && parents[row] >= 0 ? names[parents[row]] : "");
    set(rate, this.world.rateText(row));
    set(age, this.world.ageText(row));
    age.className = state === "late" || state === "silent" ? state : "";
    made.title = this.world.titleOf(row);
    made.setAttribute("aria-level", depths[row] + 1);
    made.setAttribute("aria-selected", row === this.chosen);
    made.setAttribute("aria-label", `${names[row]}, ${made.title}`);
    if (parent) made.setAttribute("aria-expanded", !folded);
    else made.removeAttribute("aria-expanded");
  }

  #mark(element, name) {
    const word = this.query.trim().split(/\s+/)[0].toLowerCase();
    const at = word ? name.toLowerCase().indexOf(word) : -1;
    if (at < 0) {
      if (element.textContent === name && !element.querySelector("mark")) return;
      // Names that are too long keep their ends, in which they differ.
      const end = document.createElement("span");
      end.className = "end";
      end.textContent = name.length > TAIL + 3 ? name.slice(-TAIL) : "";
      const start = document.createElement("span");
      start.className = "start";
      start.textContent = name.slice(0, name.length - end.textContent.length);
      element.replaceChildren(start, end);
      return;
    }
    const found = document.createElement("mark");
    found.textContent = name.slice(at, at + word.length);
    element.replaceChildren(name.slice(0, at), found, name.slice(at + word.length));
  }

  #rowOf(event) {
    const made = event.target.closest(".row");
    return made ? Number(made.dataset.row) : -1;
  }

  #click(event) {
    const row = this.#rowOf(event);
    if (row < 0) return;
    if (event.target.className === "fold" && event.target.textContent) {
      this.#fold(row, !this.folded.has(this.world.names[row]));
    } else this.events.choose(row);
  }

  #fold(row, folded) {
    const name = this.world.names[row];
    if (folded) this.folded.add(name);
    else this.folded.delete(name);
    this.list();
  }

  #key(event) {
    const place = this.shown.indexOf(this.chosen);
    const page = Math.max(Math.floor(this.element.clientHeight / HEIGHT) - 1, 1);
    const steps = { ArrowUp: -1, ArrowDown: 1, PageUp: -page, PageDown: page };
    const { names, parents, children } = this.world;
    const row = this.chosen;
    let next = null;
    if (event.key in steps) next = place + steps[event.key];
    else if (event.key === "Home") next = 0;
    else if (event.key === "End") next = this.shown.length - 1;
    else if (event.key === "ArrowRight" && row >= 0 && children[row] && !this.flat) {
      if (this.folded.has(names[row])) this.#fold(row, false);
      else next = place + 1;
    } else if (event.key === "ArrowLeft" && row >= 0 && !this.flat) {
      if (children[row] && !this.folded.has(names[row])) this.#fold(row, true);
      else if (parents[row] >= 0) next = this.shown.indexOf(parents[row]);
    } else if (event.key === "Enter" && row >= 0) this.events.focus(row);
    else if (!event.key.startsWith("Arrow")) return;
    event.preventDefault();
    event.stopPropagation();
    if (next === null || !this.shown.length) return;
    this.events.choose(this.shown[Math.min(Math.max(next, 0), this.shown.length - 1)]);
  }
}

function set(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
