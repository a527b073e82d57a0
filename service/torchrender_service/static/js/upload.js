// Files that are dropped on the page become scenes of the server; those of this browser can be taken away again.

import { zip } from "./zip.js";

const $ = (id) => document.getElementById(id);
const OWN = "torchrender.own"; // ids of scenes that this browser has sent
const MAIN = /\.(glb|gltf|obj|ply|stl|toml|zip)$/i;
const ALONE = { glb: "model/gltf-binary", toml: "application/toml", zip: "application/zip" };

const own = () => new Set(JSON.parse(localStorage.getItem(OWN) ?? "[]"));
const keepOwn = (ids) => localStorage.setItem(OWN, JSON.stringify([...ids]));
const suffix = (name) => name.slice(name.lastIndexOf(".") + 1).toLowerCase();
const megabytes = (bytes) => `${(bytes / 1e6).toFixed(bytes < 1e7 ? 1 : 0)} MB`;

/** [path, File] of everything that was dropped, folders included. */
async function filesOf(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (!entries.length) return [...transfer.files].map((file) => [file.name, file]);
  const found = [];
  const visit = async (entry) => {
    if (entry.isFile) {
      const file = await new Promise((done, failed) => entry.file(done, failed));
      found.push([entry.fullPath.replace(/^\//, ""), file]);
      return;
    }
    const reader = entry.createReader();
    for (;;) {
      const some = await new Promise((done, failed) => reader.readEntries(done, failed));
      if (!some.length) return;
      for (const one of some) await visit(one);
    }
  };
  for (const entry of entries) await visit(entry);
  return found;
}

export class Upload {
  /**
   * Calls `ready(facts)` with a scene that the server has taken, `gone(id)` after one was taken away; `tell(text)` says
   * something in passing.
   */
  constructor({ key, ready, gone, tell }) {
    this.hooks = { key, ready, gone, tell };
    this.request = null;
    $("add").addEventListener("click", () => $("upload").showModal());
    $("upload-close").addEventListener("click", () => this.close());
    $("upload").addEventListener("cancel", () => this.request?.abort());
    $("upload-files").addEventListener("change", () => {
      this.send([...$("upload-files").files].map((file) => [file.webkitRelativePath || file.name, file]));
      $("upload-files").value = "";
    });
    $("upload-delete").addEventListener("click", () => this.remove());
    for (const name of ["dragenter", "dragover"])
      window.addEventListener(name, (event) => {
        if (![...event.dataTransfer.types].includes("Files")) return;
        event.preventDefault();
        document.body.classList.add("dropping");
      });
    window.addEventListener("dragleave", (event) => event.relatedTarget === null && document.body.classList.remove("dropping"));
    window.addEventListener("drop", (event) => {
      document.body.classList.remove("dropping");
      if (!event.dataTransfer.files.length) return;
      event.preventDefault();
      if (!$("upload").open) $("upload").showModal();
      filesOf(event.dataTransfer).then((files) => this.send(files));
    });
  }

  close() {
    this.request?.abort();
    $("upload").close();
  }

  say(text, kind = "") {
    $("upload-text").textContent = text;
    $("upload-text").dataset.kind = kind;
  }

  async send(files) {
    const main = files.map(([path]) => path).find((path) => MAIN.test(path));
    $("upload-report").replaceChildren();
    if (!main) return this.say("None of these files is a scene: GLB, glTF, OBJ, PLY, STL, TOML or ZIP.", "bad");
    const name = main.slice(main.lastIndexOf("/") + 1).replace(/\.\w+$/, "");
    const type = files.length === 1 ? ALONE[suffix(main)] : undefined;
    this.say("reading the files");
    try {
      const body = type ? files[0][1] : await zip(files);
      const facts = await this.post(name, type ?? "application/zip", body);
      keepOwn(own().add(facts.id));
      this.report(facts);
      this.hooks.ready(facts);
      $("upload").close(); // the scene is what was asked for
    } catch (error) {
      this.say(error.message, "bad");
    } finally {
      this.request = null;
      $("upload-progress").hidden = true;
    }
  }

  /** A request that tells how far it is: fetch does not. */
  post(name, type, body) {
    const request = new XMLHttpRequest();
    this.request = request;
    const bar = $("upload-progress");
    bar.hidden = false;
    bar.value = 0;
    request.upload.onprogress = ({ loaded, total }) => {
      bar.value = loaded / total;
      this.say(loaded < total ? `sending ${megabytes(loaded)} of ${megabytes(total)}` : "the server reads the scene");
    };
    return new Promise((done, failed) => {
      request.onload = () => {
        const answer = request.response ?? {};
        if (request.status < 300) done(answer);
        else failed(new Error(answer.detail ?? answer.title ?? `the server answered ${request.status}`));
      };
      request.onerror = () => failed(new Error("the server cannot be reached"));
      request.onabort = () => failed(new Error("stopped"));
      request.open("POST", `v1/scenes?name=${encodeURIComponent(name.slice(0, 80))}`);
      request.responseType = "json";
      request.setRequestHeader("Content-Type", type);
      request.setRequestHeader("Accept", "application/json");
      if (this.hooks.key()) request.setRequestHeader("Authorization", `Bearer ${this.hooks.key()}`);
      request.send(body);
    });
  }

  /** What the server read, repaired, and did not use. */
  report({ name, triangles, report = {} }) {
    const points = /^points \((\d+)\)$/.exec((report.read ?? []).find((note) => note.startsWith("points (")) ?? "");
    const what = points ? `${Number(points[1]).toLocaleString("en")} points` : `${triangles.toLocaleString("en")} triangles`;
    const unused = report.not_used ?? [];
    this.say(`${name}: ${what}`, unused.length ? "partly" : "good");
    const more = unused.length > 1 ? ` and ${unused.length - 1} more (see Open)` : "";
    this.hooks.tell(`${name}: ${what}${unused.length ? `; not used: ${unused[0]}${more}` : ""}`);
    for (const [part, title] of [["not_used", "not used"], ["repaired", "repaired"]])
      for (const note of report[part] ?? []) {
        const item = document.createElement("li");
        item.textContent = `${title}: ${note}`;
        $("upload-report").append(item);
      }
  }

  /** Another scene is shown: its own ones can be deleted. */
  showScene(id) {
    this.shown = id;
    $("upload-delete").hidden = !own().has(id);
  }

  async remove() {
    const id = this.shown;
    const headers = this.hooks.key() ? { Authorization: `Bearer ${this.hooks.key()}` } : {};
    const response = await fetch(`v1/scenes/${id}`, { method: "DELETE", headers });
    if (!response.ok && response.status !== 404) return this.say("The server does not delete it.", "bad");
    const ids = own();
    ids.delete(id);
    keepOwn(ids);
    this.say("deleted");
    $("upload-report").replaceChildren();
    this.hooks.gone(id);
  }
}
