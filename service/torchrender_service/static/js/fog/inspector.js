// What is known of the selected mark, as fields.

import { markOf } from "./shapes.js";

const WALLS = [["", "found"], ["left"], ["right"], ["back"], ["front"], ["floor"], ["ceiling"]];
const WAYS = { down: [0, -1, 0], "to us": [0, 0, 1], away: [0, 0, -1], left: [-1, 0, 0], right: [1, 0, 0] };

const field = (name, make) => ({ name, make });
const number = (name, path, { unit = "", min, max, step = "any", usual = "" } = {}) =>
  field(name, (marks, change) => {
    const input = Object.assign(document.createElement("input"), { type: "number", min, max, step, placeholder: usual });
    input.value = marks.at(path) ?? "";
    input.addEventListener("change", () => {
      const value = input.value === "" ? undefined : Number(input.value);
      if (value !== undefined && !input.checkValidity()) return input.reportValidity();
      change(() => marks.set(path, value));
    });
    return [input, unit];
  });
const choice = (name, path, options, { read = (v) => v ?? "", write = (v) => v || undefined } = {}) =>
  field(name, (marks, change) => {
    const select = document.createElement("select");
    select.replaceChildren(...options.map(([value, label]) => new Option(label ?? value, value)));
    select.value = read(marks.at(path));
    select.addEventListener("change", () => change(() => marks.set(path, write(select.value))));
    return [select];
  });
const flag = (name, path, usual) =>
  field(name, (marks, change) => {
    const input = Object.assign(document.createElement("input"), { type: "checkbox", checked: marks.at(path) ?? usual });
    input.addEventListener("change", () => change(() => marks.set(path, input.checked === usual ? undefined : input.checked)));
    return [input];
  });

/** A window's lit floor comes and goes. */
const sunny = (path) =>
  field("sun", (marks, change) => {
    const input = Object.assign(document.createElement("input"), { type: "checkbox", checked: Boolean(marks.at([...path, "lit"])) });
    input.addEventListener("change", () =>
      change(() => {
        const frame = marks.at([...path, "polygon"]);
        const low = Math.max(...frame.map((p) => p[1])) - Math.min(...frame.map((p) => p[1]));
        marks.set([...path, "lit"], input.checked ? frame.map(([x, y]) => [x, y + 1.6 * low]) : undefined);
      }),
    );
    return [input];
  });

const way = (path) =>
  choice("shines", path, Object.keys(WAYS).map((name) => [name]), {
    read: (v) => Object.keys(WAYS).find((name) => String(WAYS[name]) === String(v)) ?? "down",
    write: (name) => (name === "down" ? undefined : WAYS[name]),
  });

/** A lamp stands on the ground somewhere, which tells how far it is. */
const foot = (path) =>
  field("foot", (marks, change) => {
    const input = Object.assign(document.createElement("input"), { type: "checkbox", checked: Boolean(marks.at([...path, "foot"])) });
    input.addEventListener("change", () =>
      change(() => {
        const [x, y] = marks.at([...path, "at"]);
        marks.set([...path, "foot"], input.checked ? [x, y + 120] : undefined);
      }),
    );
    return [input];
  });

function fieldsOf(marks, path) {
  const mark = markOf(path);
  const camera = [
    number("eye height", ["camera", "height"], { unit: "m", min: 0.05, max: 500, usual: "1.6" }),
    number("focal length", ["camera", "focal"], { unit: "px", min: 1, max: 1e6, usual: "found" }),
  ];
  const distances = ["near", "far", "sky"].map((name) =>
    number(name, ["outdoor", name], { unit: "m", min: 0.1, max: 1e6, usual: name === "sky" ? "5000" : "by horizon" }),
  );
  if (!mark) return marks.indoors ? ["Camera", camera] : ["Camera and ground", [...camera, ...distances]];
  const lamp = [
    number("distance", [...mark, "distance"], { unit: "m", min: 0.05, max: 1e5, usual: "by depth" }),
    foot(mark),
    number("strength", [...mark, "strength"], { unit: "×", min: 0, max: 1e6, usual: "1" }),
    number("radius", [...mark, "radius"], { unit: "px", min: 0, max: 1e4, usual: "4" }),
    choice("kind", [...mark, "kind"], [["", "all around"], ["cone"]]),
    ...(marks.at([...mark, "kind"]) === "cone" ? [way([...mark, "direction"]), number("half angle", [...mark, "angle_deg"], { unit: "°", min: 1, max: 89, usual: "50" })] : []),
  ];
  const kinds = {
    room: ["Room", [...camera, number("room height", ["room", "height"], { unit: "m", min: 0.5, max: 100, usual: "found" })]],
    light: ["Light", [choice("wall", [...mark, "wall"], WALLS), flag("is on", [...mark, "on"], true)]],
    window: ["Window", [choice("wall", [...mark, "wall"], WALLS), sunny(mark), flag("sky light", [...mark, "glow"], true)]],
    cuboid: ["Furniture", []],
    lamp: ["Lamp", lamp],
    region: ["Part of the photo", [
      choice("label", [...mark, "label"], [["ground"], ["vertical", "thing"], ["sky"]]),
      ...(marks.at([...mark, "label"]) === "vertical" ? [number("depth", [...mark, "depth"], { unit: "m", min: 0.1, max: 1e5, usual: "by its foot" })] : []),
    ]],
    outdoor: ["Light on the ground", distances],
    camera: ["Horizon", camera],
  };
  return kinds[mark[0]];
}

/** Fill the fieldset `into` with fields of the selected mark, or of the camera where none is selected. */
export function inspect(into, marks, path, change) {
  const [title, fields] = fieldsOf(marks, path);
  const rows = fields.map(({ name, make }) => {
    const row = document.createElement("label");
    row.className = "field";
    const caption = document.createElement("span");
    caption.textContent = name;
    const [input, unit] = make(marks, change);
    input.dataset.field = name;
    row.append(caption, input);
    if (unit) row.append(Object.assign(document.createElement("small"), { textContent: unit }));
    return row;
  });
  const legend = Object.assign(document.createElement("h2"), { textContent: title });
  into.replaceChildren(legend, ...rows);
}
