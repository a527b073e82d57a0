// The marks of a photo, as they stand in a file of marks, with undoing.

const MOST_UNDOS = 100;
const INDOORS = ["room", "light", "window", "cuboid"];
const OUTDOORS = ["region", "outdoor"];
const LISTS = ["light", "window", "cuboid", "lamp", "region"];

export class Marks {
  /** `changed()` is called after every change. */
  constructor(changed) {
    this.changed = changed;
    this.table = {};
    this.indoors = true;
    this.past = [];
    this.future = [];
  }

  /** Remember how things are: the next changes are undone together. */
  remember() {
    this.past.push(JSON.stringify([this.indoors, this.table]));
    if (this.past.length > MOST_UNDOS) this.past.shift();
    this.future = [];
  }

  /** Change the table in one step that can be undone; `make` gets the table. */
  change(make) {
    this.remember();
    const made = make(this.table);
    this.changed();
    return made;
  }

  undo() {
    this.swap(this.past, this.future);
  }

  redo() {
    this.swap(this.future, this.past);
  }

  swap(from, to) {
    if (!from.length) return;
    to.push(JSON.stringify([this.indoors, this.table]));
    [this.indoors, this.table] = JSON.parse(from.pop());
    this.changed();
  }

  /** The value at a path of keys, undefined where there is none. */
  at(path) {
    return path.reduce((value, key) => value?.[key], this.table);
  }

  /** Put a value at a path; what is missing on the way is made, undefined takes the key away. */
  set(path, value) {
    let place = this.table;
    for (const key of path.slice(0, -1)) place = place[key] ??= {};
    const last = path.at(-1);
    if (value === undefined) delete place[last];
    else place[last] = value;
  }

  /** Add an entry to a list of the table; returns its path. */
  add(list, entry) {
    const entries = (this.table[list] ??= []);
    entries.push(entry);
    return [list, entries.length - 1];
  }

  remove(path) {
    const [list, index] = path;
    if (LISTS.includes(list)) {
      this.table[list].splice(index, 1);
      if (!this.table[list].length) delete this.table[list];
    } else this.set(path, undefined);
  }

  /** Take the table of a file; the photo decides whether places must be stretched. */
  load(table, width, height) {
    const own = [table.photo?.width ?? width, table.photo?.height ?? height];
    if (Math.abs(own[0] * height - own[1] * width) > 0.02 * width * height)
      throw new Error(`The marks are those of a photo of ${own[0]} × ${own[1]} pixels, this one has ${width} × ${height}.`);
    this.remember();
    const { photo, ...rest } = structuredClone(table);
    this.table = own[0] === width ? rest : scaled(rest, width / own[0], height / own[1]);
    this.indoors = Boolean(this.table.room) || !(this.table.region || this.table.outdoor || this.table.labels);
    this.changed();
  }

  /** What a file holds, and what the service gets: marks of the other kind of photo are left out. */
  file(width, height) {
    const left = this.indoors ? OUTDOORS : INDOORS;
    const kept = Object.entries(this.table).filter(([key, value]) => !left.includes(key) && value != null);
    return { photo: { width, height }, ...Object.fromEntries(kept) };
  }

  /** Whether there is enough for a picture; if not, what is missing. */
  missing() {
    if (this.indoors) return this.table.room ? null : "Mark the room: press Room and drag its corners.";
    return this.table.region?.length ? null : "Mark ground, things and sky: press Paint and draw a stroke on each.";
  }
}

const WIDTHS = ["focal", "radius"];
const HEIGHTS = ["horizon"];
const LEFT = ["direction", "color"];

/** Places of a table times (x, y). */
function scaled(value, x, y, key = "") {
  if (LEFT.includes(key)) return value;
  if (Array.isArray(value)) {
    if (value.length === 2 && value.every((v) => typeof v === "number")) return [value[0] * x, value[1] * y];
    return value.map((entry) => scaled(entry, x, y));
  }
  if (value && typeof value === "object")
    return Object.fromEntries(Object.entries(value).map(([name, inner]) => [name, scaled(inner, x, y, name)]));
  if (WIDTHS.includes(key)) return value * x;
  return HEIGHTS.includes(key) ? value * y : value;
}
