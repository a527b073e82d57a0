// What marks look like: every mark as a shape with handles, each handle with the path of its place in the table.

export const EDGES = edges();

/** The twelve edges of a room, pairs of corner names. */
function edges() {
  const names = ["back", "front"].flatMap((z) => ["left", "right"].flatMap((x) => ["floor", "ceiling"].map((y) => `${z}_${x}_${y}`)));
  const differ = (a, b) => a.split("_").filter((word, k) => word !== b.split("_")[k]).length === 1;
  return names.flatMap((a, k) => names.slice(k + 1).filter((b) => differ(a, b)).map((b) => [a, b]));
}

const polygon = (path, points, kind, name) => ({
  path, kind, name, points, closed: true, lines: [], handles: points.map((place, k) => ({ place, path: [...path, k] })),
});

function room(table) {
  const corners = table.room?.corners;
  if (!corners) return [];
  const handles = Object.entries(corners).map(([name, place]) => ({ place, path: ["room", "corners", name], title: name.replaceAll("_", " ") }));
  const lines = EDGES.filter(([a, b]) => corners[a] && corners[b]).map(([a, b]) => [corners[a], corners[b]]);
  return [{ path: ["room"], kind: "room", name: "room", points: [], closed: false, lines, handles }];
}

function windows(table) {
  return (table.window ?? []).flatMap((mark, k) => {
    const frame = polygon(["window", k, "polygon"], mark.polygon, "window", "window");
    if (!mark.lit) return [frame];
    const lit = polygon(["window", k, "lit"], mark.lit, "lit", "lit floor");
    lit.lines = mark.lit.map((place, j) => [mark.polygon[j], place]);
    return [lit, frame];
  });
}

function cuboids(table) {
  return (table.cuboid ?? []).map((mark, k) => {
    const shape = polygon(["cuboid", k, "base"], mark.base, "cuboid", "furniture");
    if (!mark.top) return shape;
    const up = [mark.top[0] - mark.base[0][0], mark.top[1] - mark.base[0][1]];
    shape.lines = mark.base.map((place) => [place, [place[0] + up[0], place[1] + up[1]]]);
    shape.handles.push({ place: mark.top, path: ["cuboid", k, "top"], title: "height" });
    return shape;
  });
}

function lamps(table) {
  return (table.lamp ?? []).map((mark, k) => {
    const handles = [{ place: mark.at, path: ["lamp", k, "at"], title: "lamp" }];
    if (mark.foot) handles.push({ place: mark.foot, path: ["lamp", k, "foot"], title: "foot on the ground" });
    return { path: ["lamp", k], kind: "lamp", name: "lamp", points: [], closed: false, lines: mark.foot ? [[mark.at, mark.foot]] : [], handles };
  });
}

function outdoor({ outdoor: mark, camera }, width) {
  if (!mark && camera?.horizon === undefined) return [];
  const shapes = [];
  for (const [key, name] of [["shadow", "shadow"], ["sunlit", "sunlit ground"]])
    if (mark?.[key]) shapes.push(polygon(["outdoor", key], mark[key], key, name));
  if (mark?.object_top && mark.shadow_tip)
    shapes.push({
      path: ["outdoor", "object_top"], kind: "sun", name: "object and shadow", points: [], closed: false,
      lines: [[mark.object_top, mark.shadow_tip]],
      handles: [
        { place: mark.object_top, path: ["outdoor", "object_top"], title: "top of a thing" },
        { place: mark.shadow_tip, path: ["outdoor", "shadow_tip"], title: "where its shadow ends" },
      ],
    });
  if (camera?.horizon !== undefined) {
    const row = camera.horizon;
    shapes.push({
      path: ["camera", "horizon"], kind: "horizon", name: "horizon", points: [], closed: false, lines: [[[0, row], [width, row]]],
      handles: [{ place: [0.06 * width, row], path: ["camera", "horizon"], title: "horizon", row: true }],
    });
  }
  return shapes;
}

/** Shapes of all marks of a photo, those on top last. */
export function shapesOf(marks, width) {
  const { table, indoors } = marks;
  const regions = (table.region ?? []).map((mark, k) => polygon(["region", k, "polygon"], mark.polygon, mark.label, mark.label));
  const lights = (table.light ?? []).map((mark, k) => polygon(["light", k, "polygon"], mark.polygon, "light", "light"));
  const shown = indoors ? [...room(table), ...cuboids(table), ...windows(table), ...lights] : [...regions, ...outdoor(table, width)];
  return [...shown, ...lamps(table)];
}

/** The path of the whole mark that a shape or handle belongs to. */
export function markOf(path) {
  if (!path) return null;
  if (path[0] === "room") return ["room"];
  return path.slice(0, 2);
}

const box = ([x, y], w, h) => [[x - w, y - h], [x + w, y - h], [x + w, y + h], [x - w, y + h]];

/** Add a mark of a kind around a place; returns the path of what is selected then. */
export const MAKERS = {
  room(marks, [x, y], [w, h]) {
    const corners = {};
    for (const [side, sx] of [["left", -1], ["right", 1]]) {
      corners[`back_${side}_floor`] = [x + sx * 0.2 * w, y + 0.14 * h];
      corners[`back_${side}_ceiling`] = [x + sx * 0.2 * w, y - 0.18 * h];
      corners[`front_${side}_floor`] = [x + sx * 0.48 * w, y + 0.44 * h];
      corners[`front_${side}_ceiling`] = [x + sx * 0.48 * w, y - 0.48 * h];
    }
    marks.set(["room"], { corners });
    return ["room"];
  },
  light: (marks, place, [w, h]) => [...marks.add("light", { polygon: box(place, 0.06 * w, 0.03 * h) }), "polygon"],
  window(marks, [x, y], [w, h]) {
    const frame = box([x, y - 0.06 * h], 0.05 * w, 0.1 * h);
    const lit = box([x, y + 0.3 * h], 0.08 * w, 0.05 * h);
    return [...marks.add("window", { polygon: frame, lit }), "polygon"];
  },
  cuboid(marks, [x, y], [w, h]) {
    const base = [[x - 0.1 * w, y + 0.22 * h], [x - 0.06 * w, y + 0.16 * h], [x + 0.1 * w, y + 0.16 * h], [x + 0.12 * w, y + 0.22 * h]];
    return [...marks.add("cuboid", { base, top: [x - 0.1 * w, y + 0.06 * h] }), "base"];
  },
  lamp: (marks, place) => marks.add("lamp", { at: place }),
  shadow: (marks, [x, y], [w, h]) => outline(marks, "shadow", box([x, y + 0.2 * h], 0.07 * w, 0.04 * h)),
  sunlit: (marks, [x, y], [w, h]) => outline(marks, "sunlit", box([x, y + 0.3 * h], 0.07 * w, 0.04 * h)),
  sun(marks, [x, y], [w, h]) {
    marks.set(["outdoor", "object_top"], [x, y - 0.1 * h]);
    marks.set(["outdoor", "shadow_tip"], [x + 0.15 * w, y + 0.25 * h]);
    return ["outdoor", "object_top"];
  },
  horizon(marks, [, y]) {
    marks.set(["camera", "horizon"], y);
    return ["camera", "horizon"];
  },
};

function outline(marks, key, points) {
  marks.set(["outdoor", key], points);
  return ["outdoor", key];
}

/** Take a whole mark away. */
export function removeMark(marks, path) {
  const mark = markOf(path);
  if (mark[0] === "outdoor" && ["object_top", "shadow_tip"].includes(mark[1])) {
    marks.set(["outdoor", "object_top"], undefined);
    marks.set(["outdoor", "shadow_tip"], undefined);
  } else marks.remove(mark);
}

/** Insert a corner behind number `k` of an outline; a window and its lit floor keep as many corners as each other. */
export function insertCorner(marks, path, k, place) {
  const [list, index] = path;
  const other = list === "window" && marks.at([list, index, path[2] === "lit" ? "polygon" : "lit"]);
  marks.at(path).splice(k + 1, 0, place);
  if (other) {
    const [a, b] = [other[k], other[(k + 1) % other.length]];
    other.splice(k + 1, 0, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
  }
}

/** Take a corner away where that leaves an outline or a room; tells whether it could. */
export function removeCorner(marks, path) {
  if (path[0] === "room") {
    if (Object.keys(marks.at(["room", "corners"])).length <= 4) return false;
    marks.set(path, undefined);
    return true;
  }
  const outline = marks.at(path.slice(0, -1));
  const number = path.at(-1);
  if (!Array.isArray(outline) || typeof number !== "number" || outline.length <= 3) return false;
  const [list, index, which] = path;
  const other = list === "window" && marks.at([list, index, which === "lit" ? "polygon" : "lit"]);
  for (const points of [outline, other].filter(Boolean)) points.splice(number, 1);
  return true;
}
