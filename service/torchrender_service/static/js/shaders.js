// Shaders of the warp (GLSL ES 3.00).

/** Samples of one depth image: corner (u, v, 1/z) to clip space. Sky has 1/z = 0 and lands at infinity. */
export const WARP_VERTEX = `
precision highp float;
in vec3 corner;
uniform mat4 clip_from_source;
out vec3 source;
void main() {
  source = corner;
  gl_Position = clip_from_source * vec4(corner.xy, 1.0, corner.z);
}`;

// An `if` of what few pixels need. Drawn in software, both sides of an `if` are worked out for all pixels; a loop that no
// pixel enters costs nothing.
const SELDOM = `
#define SELDOM(condition) for (bool enters = (condition); enters; enters = false)
`;

// sRGB, there and back.
const LIGHT = `
vec3 to_linear(vec3 c) {
  return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), vec3(greaterThan(c, vec3(0.04045))));
}
vec3 to_display(vec3 c) {
  return mix(12.92 * c, 1.055 * pow(max(c, vec3(1e-9)), vec3(1.0 / 2.4)) - 0.055, vec3(greaterThan(c, vec3(0.0031308))));
}`;

const EXPOSED = `
uniform float gain;        // of linear light; 1: colours as they came
vec3 exposed(vec3 c) {
  SELDOM(gain != 1.0) c = to_display(min(to_linear(c) * gain, 1.0));
  return c;
}`;

// Colours are filtered only among texels of one surface. At the keyframe's own view the weights select one texel, whose
// bytes come through.
export const WARP_FRAGMENT = `
precision highp float;
precision highp int;
precision highp usampler2D;
${SELDOM}
in vec3 source;
uniform usampler2D depth;   // codes of 1/z; 65535 where there is no sample
uniform usampler2D joined;  // which of the four texels around each corner are of one surface
uniform sampler2D color;
uniform float code_scale;  // 1/z of code 1
uniform float enhance;     // how much shape is made easier to read; 0: colours as they came
uniform bool parted;        // what mirrors show apart from the rest
uniform sampler2D shown;    // what mirrors show, a part of the colours
uniform usampler2D behind;  // codes of it: 65535 where nothing mirrors
uniform bool trim;         // leave out what lies beside something nearer: smooth outlines and JPEG mix the colours of both
layout(location = 0) out vec4 picture;  // display colour; a > 0 tells that the pixel is covered, and how near it is
layout(location = 1) out vec4 painted;  // what mirrors show, a part of the light; a > 0 where a mirror is seen

const float RIP = 0.12;      // share of 1/z by which a fragment may differ from its texel
const float NEARER = 0.02;   // share of 1/z by which a texel of another surface must be nearer to spoil colours
const float OCTAVES = 12.0;
const float BREAK = 0.03;    // share of 1/z between texels beyond which they are of different surfaces
const float STRETCHED = 3.0; // pixels of the view across one of the picture, from which on it is drawn out
const float GAIN = 45.0;     // bend, as a share of 1/z, that counts by half: 1 / GAIN

// Whether one pixel of the picture is drawn over many of the view, as where a surface is seen from its side that was
// seen at a grazing angle: the least pixels of the picture per pixel of the view, over all directions.
bool drawn_out() {
  vec2 across = dFdx(source.xy);
  vec2 down = dFdy(source.xy);
  float sum = dot(across, across) + dot(down, down);
  float area = across.x * down.y - across.y * down.x;
  float least = 0.5 * (sum - sqrt(max(sum * sum - 4.0 * area * area, 0.0)));
  return least * STRETCHED * STRETCHED < 1.0;
}

float at(ivec2 p) {
  uint code = texelFetch(depth, p, 0).r;
  return code == 65535u ? -1.0 : float(code) * code_scale;
}

// Whether another surface, with 1/z beyond a limit, is in one of the eight texels around one.
bool beside_nearer(ivec2 own, float limit, ivec2 last) {
  for (int k = 0; k < 4; k++) {
    ivec2 corner = own + ivec2(k & 1, k >> 1);
    uint word = texelFetch(joined, corner, 0).r;
    uint label = (word >> (2 * (3 - k))) & 3u;
    for (int m = 0; m < 4; m++) {
      ivec2 p = clamp(corner - 1 + ivec2(m & 1, m >> 1), ivec2(0), last);
      if (((word >> (2 * m)) & 3u) != label && at(p) > limit) return true;
    }
  }
  return false;
}

${LIGHT}
${EXPOSED}
// The two parts of a colour, \`all\` becomes the rest: what mirrors show may not be brighter than all. White hides how
// bright it is: where what is mirrored does not make it so, something else does, and stays.
vec3 mirrored_part(inout vec3 all, vec3 mirrored) {
  vec3 light = min(to_linear(mirrored), to_linear(all));
  vec3 rest = to_display(to_linear(all) - light);
  all = mix(rest, all, vec3(greaterThan(all, vec3(0.998))) * vec3(lessThan(light, vec3(1.0))));
  return to_display(light);
}

vec3 color_at(ivec2 p) {
  return texelFetch(color, p, 0).rgb;
}

// How a surface bends around a texel, in [-1, 1]; ridges are positive. 1/z of a plane changes evenly over the picture,
// so that what is left of it beside two texels that face each other is bend.
float shape(ivec2 p, float z, ivec2 last) {
  float bend = 0.0;
  float pairs = 0.0;
  for (int k = 0; k < 12; k++) {
    float angle = 0.78539816 * float(k) / 3.0;
    ivec2 way = ivec2(round(vec2(cos(angle), sin(angle)) * float(1 + k % 3)));
    ivec2 a = p + way;
    ivec2 b = p - way;
    if (any(lessThan(min(a, b), ivec2(0))) || any(greaterThan(max(a, b), last))) continue;
    float before = at(a);
    float after = at(b);
    if (before < 0.0 || after < 0.0 || abs(2.0 * z - before - after) > BREAK * z) continue;
    bend += 2.0 * z - before - after;
    pairs += 1.0;
  }
  if (pairs == 0.0) return 0.0;
  float share = GAIN * bend / (pairs * z);
  return share / (1.0 + abs(share));
}

void main() {
  bool stretched = drawn_out(); // before anything is discarded: it looks at the pixels beside
  ivec2 last = textureSize(depth, 0) - 1;
  float z = source.z;
  float step = 2.0 * code_scale;
  vec2 place = source.xy - 0.5;
  vec2 t = fract(place);
  ivec2 low = ivec2(floor(place));
  ivec2 p0 = clamp(low, ivec2(0), last);
  ivec2 p3 = clamp(low + 1, ivec2(0), last);
  ivec2 p1 = ivec2(p3.x, p0.y);
  ivec2 p2 = ivec2(p0.x, p3.y);
  ivec2 own = t.y < 0.5 ? (t.x < 0.5 ? p0 : p1) : (t.x < 0.5 ? p2 : p3);
  float near = at(own);
  if (near < 0.0 || abs(near - z) > RIP * max(near, z) + step) discard;
  uint word = texelFetch(joined, clamp(low + 1, ivec2(0), last + 1), 0).r;
  uint label = (word >> (2u * ((t.x < 0.5 ? 0u : 1u) + (t.y < 0.5 ? 0u : 2u)))) & 3u;
  uvec4 labels = (uvec4(word) >> uvec4(0u, 2u, 4u, 6u)) & 3u;
  vec4 alike = vec4(equal(labels, uvec4(label)));
  bool spoilt = false;
  SELDOM(trim) spoilt = beside_nearer(own, (1.0 + NEARER) * near + step, last);
  if (spoilt) discard;
  bool mirrors = parted && texelFetch(behind, own, 0).r != 65535u;
  bool whole = alike == vec4(1.0);
  vec3 c = textureLod(color, source.xy / vec2(last + 1), 0.0).rgb;
  vec3 m = vec3(0.0);
  SELDOM(mirrors) m = (whole ? textureLod(shown, source.xy / vec2(last + 1), 0.0) : texelFetch(shown, own, 0)).rgb;
  SELDOM(!whole) {
    vec4 weight = vec4(1.0 - t.x, t.x, 1.0 - t.x, t.x) * vec4(1.0 - t.y, 1.0 - t.y, t.y, t.y) * alike;
    weight /= dot(weight, vec4(1.0));
    c = weight.x * color_at(p0) + weight.y * color_at(p1) + weight.z * color_at(p2) + weight.w * color_at(p3);
  }
  painted = vec4(0.0);
  SELDOM(mirrors) painted = vec4(exposed(mirrored_part(c, m)), 1.0);
  SELDOM(enhance != 0.0 && near > 0.0) c = clamp(c * (1.0 + enhance * shape(own, near, last)), 0.0, 1.0);
  c = exposed(c);
  // The buffer holds 1 - near / depth; steps of 7 % of the depth tell well enough what lies behind what. The lowest bit
  // tells pixels that are drawn out.
  float key = clamp(1.0 + log2(max(1.0 - gl_FragCoord.z, 1e-9)) / OCTAVES, 0.0, 1.0);
  picture = vec4(c, (1.0 + 2.0 * floor(126.0 * key + 0.5) + (stretched ? 1.0 : 0.0)) / 255.0);
}`;

export const SCREEN_VERTEX = `
precision highp float;
in vec3 position;
void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }`;

// A picture seen from where it was taken: every pixel is covered, and nothing hides anything.
export const DIRECT_FRAGMENT = `
precision highp float;
precision highp int;
uniform sampler2D color;
uniform vec4 place;  // where the lower left corner of the view lies in the picture, and one pixel of the view
layout(location = 0) out vec4 picture;
${SELDOM}
${LIGHT}
${EXPOSED}
void main() {
  vec2 p = place.xy + place.zw * gl_FragCoord.xy;
  picture = vec4(exposed(textureLod(color, p / vec2(textureSize(color, 0)), 0.0).rgb), 1.0);
}`;

// A picture with the light that its mirrors show, from where that seems to be; where no such sample reaches, it stays
// where it was, painted on the mirror.
export const MIRROR_FRAGMENT = `
precision highp float;
uniform sampler2D warped;   // the rest of the light
uniform sampler2D painted;  // what mirrors showed; a > 0 where a mirror is seen
uniform sampler2D beyond;   // what lies behind the mirrors, seen as if they were windows
layout(location = 0) out vec4 picture;
${SELDOM}
${LIGHT}
void main() {
  ivec2 own = ivec2(gl_FragCoord.xy);
  vec4 rest = texelFetch(warped, own, 0);
  vec4 paint = texelFetch(painted, own, 0);
  SELDOM(paint.a > 0.0) {
    vec4 through = texelFetch(beyond, own, 0);
    vec3 light = through.a > 0.0 && through.a <= rest.a + 0.005 ? through.rgb : paint.rgb;
    rest.rgb = to_display(min(to_linear(rest.rgb) + to_linear(light), 1.0));
  }
  picture = rest;
}`;

// What lies farther counts, the more so the larger the preference: a hole hides what is behind. Keys tell how near something is, in twelfths of 12 octaves.
const BEHIND = `
const float BEHIND = 0.02;  // a quarter of an octave of depth
float behind(float key, float farthest, float preference) {
  return exp2(-preference * max(key - farthest - BEHIND, 0.0)) + 0.01;
}

// A level of the pyramid between its cells, the farther ones preferred; \`place\` in its pixels.
vec4 between(sampler2D level, vec2 place, float preference) {
  ivec2 last = textureSize(level, 0) - 1;
  ivec2 low = ivec2(floor(place - 0.5));
  vec2 share = clamp(place - 0.5 - vec2(low), 0.001, 0.999);
  vec4 cells[4];
  float farthest = 2.0;
  for (int k = 0; k < 4; k++) {
    cells[k] = texelFetch(level, clamp(low + ivec2(k & 1, k >> 1), ivec2(0), last), 0);
    if (cells[k].a > 0.0) farthest = min(farthest, cells[k].a);
  }
  vec4 sum = vec4(0.0);
  float weights = 0.0;
  for (int k = 0; k < 4; k++) {
    if (cells[k].a == 0.0) continue;
    float weight = ((k & 1) == 1 ? share.x : 1.0 - share.x) * (k > 1 ? share.y : 1.0 - share.y);
    weight *= behind(cells[k].a, farthest, preference);
    sum += weight * cells[k];
    weights += weight;
  }
  return weights > 0.0 ? sum / weights : vec4(0.0);
}`;

// One cell of the next level: the mean colour and key of what is covered, mostly of the farthest, and which share is.
export const PULL_FRAGMENT = `
precision highp float;
precision highp int;
uniform sampler2D finer;     // colours and keys
uniform sampler2D coverage;  // roots of the shares that are covered
uniform bool weighted;       // there are such shares; otherwise keys tell what is covered
uniform int cell;            // of its pixels along a side
uniform float preference;
layout(location = 0) out vec4 mean;
layout(location = 1) out vec4 covered;

${BEHIND}
void main() {
  ivec2 first = ivec2(gl_FragCoord.xy) * cell;
  ivec2 end = min(first + cell, textureSize(finer, 0));
  float farthest = 2.0;
  float nearest = 0.0;
  vec4 sum = vec4(0.0);
  for (int y = first.y; y < end.y; y++)
    for (int x = first.x; x < end.x; x++) {
      vec4 texel = texelFetch(finer, ivec2(x, y), 0);
      farthest = min(farthest, texel.a);
      nearest = max(nearest, texel.a);
      sum += texel;
    }
  ivec2 size = end - first;
  if (!weighted && farthest > 0.0 && nearest <= farthest + BEHIND) { // as most are: all is covered, by one surface
    mean = sum / float(size.x * size.y);
    covered = vec4(1.0);
    return;
  }
  farthest = 2.0;
  for (int y = first.y; y < end.y; y++)
    for (int x = first.x; x < end.x; x++) {
      float key = texelFetch(finer, ivec2(x, y), 0).a;
      if (key > 0.0) farthest = min(farthest, key);
    }
  sum = vec4(0.0);
  float weights = 0.0;
  float shares = 0.0;
  for (int y = first.y; y < end.y; y++)
    for (int x = first.x; x < end.x; x++) {
      vec4 texel = texelFetch(finer, ivec2(x, y), 0);
      if (texel.a == 0.0) continue;
      float root = weighted ? texelFetch(coverage, ivec2(x, y), 0).r : 1.0;
      float weight = root * root * behind(texel.a, farthest, preference);
      sum += weight * texel;
      weights += weight;
      shares += root * root;
    }
  mean = weights > 0.0 ? sum / weights : vec4(0.0);
  covered = vec4(weights > 0.0 ? max(sqrt(shares / float(size.x * size.y)), 1.0 / 255.0) : 0.0);
}`;

// A cell with holes in it shows those what lies around: itself by the share that is covered, the rest from the coarser
// level, and of both rather what is farther.
export const PUSH_FRAGMENT = `
precision highp float;
precision highp int;
uniform sampler2D own;
uniform sampler2D coverage;
uniform sampler2D coarser;
uniform float preference;
layout(location = 0) out vec4 filled;
${SELDOM}
const float ENOUGH = 0.75;  // a share that is covered from which on nothing else counts
${BEHIND}
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy);
  vec4 mean = texelFetch(own, p, 0);
  float root = texelFetch(coverage, p, 0).r;
  float share = min(root * root / ENOUGH, 1.0);
  filled = mean;
  SELDOM(share < 1.0) {
    vec4 around = between(coarser, 0.5 * gl_FragCoord.xy, preference);
    float farthest = mean.a > 0.0 ? min(mean.a, around.a) : around.a;
    float within = share * behind(mean.a, farthest, preference);
    float beside = (1.0 - share) * behind(around.a, farthest, preference);
    filled = mix(around, mean, within / (within + beside));
  }
}`;

// A hole gets the colours of the covered pixels around it, mostly of the farthest ones: what a hole hides lies behind.
// Farther from them than the radius, or where they hide something farther, it shows what the pyramid has there.
export const FILL_FRAGMENT = `
precision highp float;
precision highp int;
uniform sampler2D warped;
uniform sampler2D around;  // of the pyramid, its finest level
uniform int cell;          // pixels along a side of its cells
uniform float preference;
uniform vec3 backdrop;
uniform int radius;  // 0: holes stay
uniform bool mark;   // alpha 0 in holes, for captures
uniform sampler2D before;  // what was shown until now
uniform float fade;  // of the new picture; 1: nothing else
layout(location = 0) out vec4 shown;
${SELDOM}
const int DIRECTIONS = 12;
// Directions in which something is found: fewer make a hole an open one, which the pyramid fills alone; a small one has more.
const float OPEN = 4.0;
const float ENCLOSED = 9.0;

${BEHIND}
// The colour of a hole.
vec3 filled(ivec2 own) {
  ivec2 last = textureSize(warped, 0) - 1;
  vec4 found[DIRECTIONS];
  float distances[DIRECTIONS];
  float farthest = 2.0;
  for (int k = 0; k < DIRECTIONS; k++) {
    float angle = 6.2831853 * (float(k) + 0.25) / float(DIRECTIONS);
    vec2 way = vec2(cos(angle), sin(angle));
    found[k] = vec4(0.0);
    for (int r = 1; r <= radius; r++) {
      ivec2 p = own + ivec2(round(way * float(r)));
      if (any(lessThan(p, ivec2(0))) || any(greaterThan(p, last))) break;
      vec4 other = texelFetch(warped, p, 0);
      if (other.a > 0.0) {
        found[k] = other;
        distances[k] = float(r);
        farthest = min(farthest, other.a);
        break;
      }
    }
  }
  vec3 sum = vec3(0.0);
  float weights = 0.0;
  float nearest = float(radius) + 1.0;
  float enclosing = 0.0;
  for (int k = 0; k < DIRECTIONS; k++) {
    if (found[k].a == 0.0) continue;
    float weight = (found[k].a <= farthest + BEHIND ? 1.0 : 0.01) / (distances[k] * distances[k]);
    sum += weight * found[k].rgb;
    weights += weight;
    nearest = min(nearest, distances[k]);
    enclosing += 1.0;
  }
  float trust = weights > 0.0 ? 1.0 - smoothstep(0.5, 1.0, (nearest - 1.0) / float(radius)) : 0.0;
  if (trust == 1.0 && enclosing >= ENCLOSED) return sum / weights;
  vec4 wide = between(around, gl_FragCoord.xy / float(cell), preference);
  if (wide.a == 0.0) wide.rgb = backdrop;
  else if (enclosing < ENCLOSED) trust *= smoothstep(OPEN, ENCLOSED, enclosing) * min(behind(farthest, wide.a, preference), 1.0);
  return mix(wide.rgb, sum / max(weights, 1e-6), trust);
}

void main() {
  ivec2 own = ivec2(gl_FragCoord.xy);
  vec4 texel = texelFetch(warped, own, 0);
  bool hole = texel.a == 0.0;
  shown = hole ? vec4(backdrop, mark ? 0.0 : 1.0) : vec4(texel.rgb, 1.0);
  SELDOM(!hole && fade < 1.0) {
    vec4 old = texelFetch(before, own, 0);
    if (old.a > 0.0) shown.rgb = mix(old.rgb, texel.rgb, fade);
  }
  SELDOM(hole && radius > 0) shown.rgb = filled(own);
}`;

// Covered pixels of each tile, as a count in the red and green bytes, and drawn-out ones in blue and alpha: the shares
// need no read-back of the picture.
export const COUNT_FRAGMENT = `
precision highp float;
precision highp int;
uniform sampler2D warped;
layout(location = 0) out vec4 count;

const int TILE = 16;

void main() {
  ivec2 first = ivec2(gl_FragCoord.xy) * TILE;
  ivec2 size = textureSize(warped, 0);
  int covered = 0;
  int stretched = 0;
  for (int y = 0; y < TILE; y++)
    for (int x = 0; x < TILE; x++) {
      ivec2 p = first + ivec2(x, y);
      int key = all(lessThan(p, size)) ? int(texelFetch(warped, p, 0).a * 255.0 + 0.5) : 0;
      if (key > 0) covered++;
      if (key > 0 && (key & 1) == 0) stretched++;
    }
  count = vec4(float(covered & 255), float(covered >> 8), float(stretched & 255), float(stretched >> 8)) / 255.0;
}`;
export const COUNT_TILE = 16;
