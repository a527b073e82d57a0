// Draws depth images from a new viewpoint: warp into a buffer, then fill holes on the way to the canvas.

import {
  BufferAttribute,
  BufferGeometry,
  Camera,
  ClampToEdgeWrapping,
  DataTexture,
  GLSL3,
  LinearFilter,
  Mesh,
  NearestFilter,
  NoBlending,
  NoColorSpace,
  RawShaderMaterial,
  RedIntegerFormat,
  RGBAFormat,
  Scene,
  Texture,
  UnsignedByteType,
  UnsignedShortType,
  Vector3,
  Vector4,
  WebGLRenderer,
  WebGLRenderTarget,
} from "../vendor/three/three.module.min.js";
import { clipFromSource, eyeOf, length, pixelsBetween, shiftBetween, subtract } from "./camera.js";
import { FIRST, PREFERENCE, Pyramid } from "./pyramid.js";
import {
  COUNT_FRAGMENT,
  COUNT_TILE,
  DIRECT_FRAGMENT,
  FILL_FRAGMENT,
  MIRROR_FRAGMENT,
  SCREEN_VERTEX,
  WARP_FRAGMENT,
  WARP_VERTEX,
} from "./shaders.js";

const FILL_RADIUS = 8; // pixels; farther into a hole the pyramid alone tells
const BACKDROP = [0.055, 0.063, 0.078];
// Of surfaces that agree within these shares of 1/depth the preferred picture is shown: the newest keyframe, then earlier
// ones, then extra layers. Samples of those stand alone, so their slope is often not known.
const EARLIER_BIAS = 0.004;
const EXTRA_BIAS = 0.01;
const STEP_BIAS = 0.001;
// Seen from the very eye of the preferred picture nothing can come out from behind anything: others only fill holes.
const SAME_EYE = 0.05; // in clip distances
const FILL_BIAS = 0.9;
const OWN_VIEW = 0.02; // pixels by which a view may differ from a picture's own to be shown as that

const material = (vertexShader, fragmentShader, uniforms, depth) =>
  new RawShaderMaterial({
    glslVersion: GLSL3,
    vertexShader,
    fragmentShader,
    uniforms,
    blending: NoBlending,
    depthTest: depth,
    depthWrite: depth,
  });

/** A texture whose bytes come through as they are. */
const exact = (texture, filter) => {
  texture.colorSpace = NoColorSpace;
  texture.minFilter = filter;
  texture.magFilter = filter;
  texture.wrapS = ClampToEdgeWrapping;
  texture.wrapT = ClampToEdgeWrapping;
  texture.generateMipmaps = false;
  texture.flipY = false;
  texture.unpackAlignment = 2;
  texture.needsUpdate = true;
  return texture;
};

/** Whether a picture was taken from where a view looks, and shows all that the view does. */
function showsAll({ camera, nearest, whole }, view) {
  if (!whole || !(shiftBetween(view, camera, nearest) < OWN_VIEW)) return false;
  const { left, across, top, down } = pixelsBetween(view, camera);
  const inside = (start, step, count, size) => start > -OWN_VIEW && start + step * count < size + OWN_VIEW;
  return inside(left, across, view.width, camera.width) && inside(top, down, view.height, camera.height);
}

/** Corner order of all quads, shared by all pictures. */
function quadIndex(count) {
  const index = new Uint32Array(6 * count);
  for (let q = 0; q < count; q++) index.set([4 * q, 4 * q + 1, 4 * q + 2, 4 * q, 4 * q + 2, 4 * q + 3], 6 * q);
  return new BufferAttribute(index, 1);
}

export class Warp {
  /** Throws where the browser has no WebGL2. */
  constructor(canvas) {
    this.renderer = new WebGLRenderer({ canvas, antialias: false, alpha: false, depth: false, stencil: false });
    // Asking for errors waits for the graphics card, and so for all that the browser draws meanwhile. A shader that is not
    // accepted still says so in the console.
    this.renderer.debug.checkShaderErrors = false;
    this.renderer.autoClear = false;
    this.renderer.sortObjects = false;
    this.renderer.setClearColor(0x000000, 0);
    this.camera = new Camera();
    this.scene = new Scene();
    this.scene.matrixWorldAutoUpdate = false;
    this.index = quadIndex(16384);
    this.pictures = new Set();
    this.waiting = []; // textures of samples, to be uploaded while nothing is drawn: a picture shown as it is needs none
    this.prepared = null; // a picture of nothing, whose shaders are those of all pictures
    this.target = null;
    const triangle = new BufferGeometry();
    triangle.setAttribute("position", new BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
    this.fill = this.pass(triangle, FILL_FRAGMENT, {
      warped: { value: null },
      around: { value: null },
      cell: { value: FIRST },
      preference: { value: PREFERENCE },
      backdrop: { value: new Vector3(...BACKDROP) },
      radius: { value: FILL_RADIUS },
      mark: { value: false },
      before: { value: null },
      fade: { value: 1 },
    });
    this.pyramid = new Pyramid(
      (fragment, uniforms) => this.pass(triangle, fragment, uniforms),
      (width, height, textures) => this.buffer(width, height, false, textures),
    );
    this.joint = this.pass(triangle, MIRROR_FRAGMENT, {
      warped: { value: null },
      painted: { value: null },
      beyond: { value: null },
    });
    this.mirrorBuffers = null; // made when a mirror is first seen
    this.whole = false; // what was warped last is a picture as it is: samples cover all of it
    this.drawn = true; // and is in the buffer
    this.direct = this.pass(triangle, DIRECT_FRAGMENT, {
      color: { value: null },
      place: { value: new Vector4() },
      gain: { value: 1 },
    });
    this.count = this.pass(triangle, COUNT_FRAGMENT, { warped: { value: null } });
    this.counting = false;
  }

  /** Have the shaders of the first picture compiled beside everything else; what is compiled once is kept. */
  async prepare() {
    if (this.prepared) return;
    const color = await createImageBitmap(new ImageData(1, 1));
    const quads = { data: new Float32Array(12), count: 1, joined: new Uint8Array(4) };
    const header = { camera: { width: 1, height: 1 }, depth: { near: 1 }, layer: 0 };
    this.prepared = this.add({ header, codes: new Uint16Array(1), scale: 1, quads, color });
    const passes = [this.direct, this.fill, this.count, ...this.pyramid.passes].map(({ scene }) => scene);
    for (const what of [this.prepared.mesh, ...passes]) this.renderer.compile(what, this.camera);
  }

  pass(geometry, fragment, uniforms) {
    const scene = new Scene();
    const mesh = new Mesh(geometry, material(SCREEN_VERTEX, fragment, uniforms, false));
    mesh.frustumCulled = false;
    scene.add(mesh);
    return { scene, uniforms };
  }

  get context() {
    return this.renderer.getContext();
  }

  /** Size of the picture in pixels; the page's style scales it. */
  resize(width, height) {
    if (this.target?.width === width && this.target.height === height) return;
    this.renderer.setPixelRatio(1);
    this.renderer.setSize(width, height, false);
    this.target?.dispose();
    this.target = this.buffer(width, height, true);
    this.shown = this.target; // what was drawn last
    for (const buffer of Object.values(this.put ?? {})) buffer?.dispose();
    this.put = null; // buffers of what was drawn before that, while it fades out
    for (const buffer of Object.values(this.mirrorBuffers ?? {})) buffer.dispose();
    this.mirrorBuffers = null;
    this.pyramid.resize(width, height);
    this.counts?.dispose();
    this.counts = this.buffer(Math.ceil(width / COUNT_TILE), Math.ceil(height / COUNT_TILE), false);
  }

  buffer(width, height, depthBuffer, count = 1) {
    return new WebGLRenderTarget(width, height, {
      count,
      format: RGBAFormat,
      type: UnsignedByteType,
      colorSpace: NoColorSpace,
      minFilter: NearestFilter,
      magFilter: NearestFilter,
      depthBuffer,
      stencilBuffer: false,
      generateMipmaps: false,
    });
  }

  /** Put a decoded image (of the decode worker) onto the GPU. */
  add(image) {
    const { width, height } = image.header.camera;
    const depth = exact(new DataTexture(image.codes, width, height, RedIntegerFormat, UnsignedShortType), NearestFilter);
    depth.internalFormat = "R16UI";
    const shared = new DataTexture(image.quads.joined, width + 1, height + 1, RedIntegerFormat, UnsignedByteType);
    const joined = exact(shared, NearestFilter);
    joined.internalFormat = "R8UI";
    joined.unpackAlignment = 1;
    const color = exact(new Texture(image.color), LinearFilter);
    const uniforms = {
      clip_from_source: { value: null },
      depth: { value: depth },
      joined: { value: joined },
      color: { value: color },
      code_scale: { value: image.scale },
      enhance: { value: 0 },
      trim: { value: false },
      parted: { value: false },
      gain: { value: 1 },
      shown: { value: color }, // textures of the right kind, until mirrors come
      behind: { value: depth },
    };
    const geometry = new BufferGeometry();
    geometry.setAttribute("corner", new BufferAttribute(image.quads.data, 3));
    const mesh = new Mesh(geometry, material(WARP_VERTEX, WARP_FRAGMENT, uniforms, true));
    mesh.frustumCulled = false;
    mesh.matrixAutoUpdate = false;
    if (6 * image.quads.count > this.index.count) this.growIndex(image.quads.count);
    geometry.setIndex(this.index);
    geometry.setDrawRange(0, 6 * image.quads.count);
    const { camera, layer, depth: { near }, mask } = image.header;
    const { exposure = 0, tone_map: tone = "none" } = image.header;
    const shown = { exposure, linear: tone === "none" };
    const picture = { camera, extra: layer > 0, shown, mesh, uniforms, quads: image.quads.count, bitmap: image.color, mirrors: null };
    Object.assign(picture, { nearest: near, whole: layer === 0 && !mask });
    this.pictures.add(picture);
    this.renderer.initTexture(color);
    this.waiting.push(depth, joined);
    return picture;
  }

  /** Upload a texture that a warp will need. */
  uploadNext() {
    const texture = this.waiting.shift();
    if (texture) this.renderer.initTexture(texture);
  }

  /** Join to a picture the one of what its mirrors show. */
  addMirrors(picture, mirrors) {
    if (picture.mirrors) this.remove(picture.mirrors);
    picture.mirrors = mirrors;
    picture.uniforms.shown.value = mirrors.uniforms.color.value;
    picture.uniforms.behind.value = mirrors.uniforms.depth.value;
  }

  growIndex(count) {
    const old = this.index;
    this.index = quadIndex(Math.ceil(1.25 * count));
    for (const picture of this.pictures) picture.mesh.geometry.setIndex(this.index);
    // Three.js frees the buffer of an index with the geometry that it is set in.
    const holder = new BufferGeometry();
    holder.setIndex(old);
    holder.dispose();
  }

  remove(picture) {
    this.pictures.delete(picture);
    if (picture.mirrors) this.remove(picture.mirrors);
    const { mesh, uniforms } = picture;
    mesh.geometry.setIndex(null); // the others still use it
    mesh.geometry.dispose();
    mesh.material.dispose();
    this.waiting = this.waiting.filter((texture) => texture !== uniforms.depth.value && texture !== uniforms.joined.value);
    uniforms.depth.value.dispose();
    uniforms.joined.value.dispose();
    uniforms.color.value.dispose();
    picture.bitmap.close();
  }

  /**
   * Warp `pictures`, the preferred one first, into the buffer as `camera` sees them. `near`: clip distance; `enhance`:
   * how much shape is made easier to read; `mirrors`: what the preferred picture's mirrors show moves by itself;
   * `exposure`: EV to show pictures with that were not tone mapped, null: as they came; `direct`: seen from where it was
   * taken, the preferred picture is shown as it is.
   */
  warp(pictures, camera, near, { enhance = 0, mirrors = true, exposure = null, direct = true } = {}) {
    this.scene.clear();
    const first = pictures[0] ?? null;
    this.whole = direct && !enhance && first !== null && showsAll(first, camera);
    this.drawn = true;
    if (this.whole) return this.show(first, camera, exposure);
    const step = first ? length(subtract(eyeOf(first.camera), eyeOf(camera))) : 0;
    const still = step < SAME_EYE * near;
    const least = still ? FILL_BIAS : 0;
    pictures.forEach((picture, rank) => {
      const bias = rank === 0 ? 0 : Math.max(least, picture.extra ? EXTRA_BIAS : EARLIER_BIAS) + rank * STEP_BIAS;
      picture.uniforms.enhance.value = enhance;
      this.expose(picture, exposure);
      picture.uniforms.trim.value = rank > 0 && !picture.extra; // outlines of keyframes are smooth
      picture.uniforms.clip_from_source.value = clipFromSource(picture.camera, camera, near, bias);
    });
    // No bias tells skies apart: the last one drawn shows, and through media each view has its own.
    for (const picture of [...pictures].reverse()) this.scene.add(picture.mesh);
    this.shown = this.target;
    const parted = mirrors && !still && Boolean(first?.mirrors); // from the same eye a mirror shows what it showed
    pictures.forEach((picture, rank) => (picture.uniforms.parted.value = parted && rank === 0));
    if (!parted) return this.drawScene(this.target);
    const buffers = this.makeMirrorBuffers();
    this.drawScene(buffers.parts);
    this.scene.clear();
    this.scene.add(first.mirrors.mesh);
    first.mirrors.uniforms.clip_from_source.value = clipFromSource(first.mirrors.camera, camera, near, 0);
    this.drawScene(buffers.beyond);
    const { uniforms } = this.joint;
    [uniforms.warped.value, uniforms.painted.value] = buffers.parts.textures;
    uniforms.beyond.value = buffers.beyond.texture;
    this.run(this.joint, buffers.joint);
    this.shown = buffers.joint;
  }

  /** Have a picture drawn as it is, for a view of all or of a part of it: once it is known where. */
  show(picture, camera, exposure) {
    this.expose(picture, exposure);
    const { left, across, top, down } = pixelsBetween(camera, picture.camera);
    const { uniforms } = this.direct;
    uniforms.place.value.set(left, top + down * camera.height, across, -down);
    uniforms.color.value = picture.uniforms.color.value;
    uniforms.gain.value = picture.uniforms.gain.value;
    this.shown = this.target;
    this.drawn = false;
  }

  /** Draw into the buffer what was not drawn yet. */
  complete() {
    if (!this.drawn) this.run(this.direct, this.target);
    this.drawn = true;
  }

  /** Make a picture, and what its mirrors show, as bright as it would be with another exposure. */
  expose(picture, exposure) {
    const gain = exposure === null || !picture.shown.linear ? 1 : 2 ** (exposure - picture.shown.exposure);
    picture.uniforms.gain.value = Math.abs(gain - 1) < 1e-6 ? 1 : gain;
    if (picture.mirrors) picture.mirrors.uniforms.gain.value = picture.uniforms.gain.value;
  }

  drawScene(target) {
    this.renderer.setRenderTarget(target);
    this.renderer.clear(true, true, false);
    this.renderer.render(this.scene, this.camera);
  }

  makeMirrorBuffers() {
    const { width, height } = this.target;
    this.mirrorBuffers ??= {
      parts: this.buffer(width, height, true, 2),
      beyond: this.buffer(width, height, true),
      joint: this.buffer(width, height, false),
    };
    return this.mirrorBuffers;
  }

  /** Keep what was warped, to be faded out: the next `warp` draws elsewhere. */
  putAside() {
    this.complete();
    const { width, height } = this.target;
    const joint = this.mirrorBuffers?.joint;
    const before = this.shown;
    this.put ??= { target: this.buffer(width, height, true), joint: null };
    [this.target, this.put.target] = [this.put.target, this.target];
    if (joint) {
      this.put.joint ??= this.buffer(width, height, false);
      [this.mirrorBuffers.joint, this.put.joint] = [this.put.joint, joint];
    }
    return before;
  }

  /**
   * Fill holes and show the picture; `before`: what `putAside` gave, of which `1 - fade` is still seen where both
   * have samples.
   */
  present({ fill = true, mark = false, target = null, before = null, fade = 1 } = {}) {
    if (this.whole && !before) return this.run(this.direct, target);
    this.complete();
    this.fill.uniforms.warped.value = this.shown.texture;
    this.fill.uniforms.before.value = (before ?? this.shown).texture;
    this.fill.uniforms.fade.value = before ? fade : 1;
    this.fill.uniforms.radius.value = fill ? FILL_RADIUS : 0;
    this.fill.uniforms.mark.value = mark;
    if (fill && !this.whole) this.fill.uniforms.around.value = this.pyramid.build(this.shown.texture, this.run);
    this.run(this.fill, target);
  }

  /** Draw a pass over all pixels of `target`; null: the canvas. */
  run = ({ scene }, target) => {
    this.renderer.setRenderTarget(target);
    this.renderer.render(scene, this.camera);
  };

  drawCounts() {
    this.count.uniforms.warped.value = this.shown.texture;
    this.run(this.count, this.counts);
  }

  /**
   * Shares of the picture's pixels, read without waiting: `holes` that no sample reaches, whether they are filled or not,
   * and `stretched` ones, which a sample covers that stands for much less. Null while a reading is under way.
   */
  async holeShare() {
    if (this.whole) return { holes: 0, stretched: 0 };
    if (this.counting || !this.target) return null;
    this.counting = true;
    try {
      const { width, height } = this.counts;
      const pixels = this.target.width * this.target.height;
      const bytes = new Uint8Array(4 * width * height);
      this.drawCounts();
      await this.renderer.readRenderTargetPixelsAsync(this.counts, 0, 0, width, height, bytes);
      let covered = 0;
      let stretched = 0;
      for (let i = 0; i < bytes.length; i += 4) {
        covered += bytes[i] + 256 * bytes[i + 1];
        stretched += bytes[i + 2] + 256 * bytes[i + 3];
      }
      return { holes: 1 - covered / pixels, stretched: stretched / pixels };
    } finally {
      this.counting = false;
    }
  }

  /** RGBA bytes of what `warp` drew, top row first; alpha is 255 where a sample reaches and 0 in holes. Waits. */
  capture(fill) {
    const { width, height } = this.target;
    const target = this.buffer(width, height, false);
    this.present({ fill, mark: true, target });
    const bytes = new Uint8Array(4 * width * height);
    this.read(target, width, height, bytes);
    target.dispose();
    const out = new Uint8Array(bytes.length);
    for (let y = 0; y < height; y++) out.set(bytes.subarray(4 * width * y, 4 * width * (y + 1)), 4 * width * (height - 1 - y));
    return out;
  }

  /** Wait until everything drawn so far is done. */
  finish() {
    this.complete();
    this.read(this.shown, 1, 1, new Uint8Array(4));
  }

  /** Read the lower left pixels of `target` at once. */
  read(target, width, height, bytes) {
    const gl = this.context;
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null); // a reading of the hole share may have left its own
    this.renderer.readRenderTargetPixels(target, 0, 0, width, height, bytes);
  }
}
