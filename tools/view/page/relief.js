/** The relief: heights of cells as a surface that can be turned. WebGL 2, two small shaders. */

import { layerPixels } from "./pictures.js";
import { pixelOf, rampIndex, statePixels } from "./colours.js";
import { indexOf } from "./world.js";

const SURFACE = [
  `#version 300 es
uniform mat4 to_clip; uniform vec4 grid; uniform float steep;
in float height; in vec4 tint;
out vec3 place; out vec3 colour;
void main() {
  int n = int(grid.w);
  vec2 cell = vec2(float(gl_VertexID % n), float(gl_VertexID / n)) + 0.5;
  place = vec3(grid.xy + cell * grid.z, height * steep);
  colour = tint.rgb;
  gl_Position = to_clip * vec4(place, 1.0);
}`,
  `#version 300 es
precision highp float;
in vec3 place; in vec3 colour; out vec4 pixel;
void main() {
  vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
  float steepness = length(normal.xy) / max(abs(normal.z), 0.01);
  normal = normalize(mix(vec3(0.0, 0.0, 1.0), normal * sign(normal.z), smoothstep(0.4, 1.4, steepness))); // floor noise is no relief
  float light = 0.52 + 0.48 * abs(dot(normal, normalize(vec3(0.35, 0.5, 0.8))));
  pixel = vec4(colour * light, 1.0);
}`,
];
const MARKS = [
  `#version 300 es
uniform mat4 to_clip; uniform float point_px; in vec3 place;
void main() { gl_Position = to_clip * vec4(place, 1.0); gl_PointSize = point_px; }`,
  `#version 300 es
precision mediump float;
uniform vec4 colour; out vec4 pixel;
void main() { pixel = colour; }`,
];
const LOWEST_M = -4,
  HIGHEST_M = 8; // heights beyond are drawn there
const ROBOT_HIGH_M = 0.4,
  LIFTED_M = 0.03;

export class Relief {
  /** `gl` is null where there is no WebGL 2: then nothing is drawn, and `draw` says so. */
  constructor(canvas, camera) {
    this.canvas = canvas;
    this.camera = camera;
    this.gl =
      canvas.getContext("webgl2", { antialias: true, failIfMajorPerformanceCaveat: true }) ??
      canvas.getContext("webgl2", { antialias: false }); // drawn without a graphics card
    this.begin();
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.begin());
  }

  begin() {
    const { gl } = this;
    this.key = null;
    this.corners = 0; // of all triangles
    if (!gl || gl.isContextLost()) return;
    this.surface = program(gl, SURFACE, ["to_clip", "grid", "steep"]);
    this.marks = program(gl, MARKS, ["to_clip", "colour", "point_px"]);
    this.buffers = Object.fromEntries(
      ["height", "tint", "index", "place"].map((name) => [name, gl.createBuffer()]),
    );
    gl.enable(gl.DEPTH_TEST);
  }

  /** Draws; gives one line instead where it cannot. */
  draw(scene) {
    const { gl, canvas, camera } = this;
    if (!gl || gl.isContextLost())
      return "This browser gives no WebGL 2: the relief cannot be drawn.";
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const [w, h] = [canvas.clientWidth, canvas.clientHeight].map((side) =>
      Math.max(1, Math.round(side * ratio)),
    );
    if (canvas.width !== w) canvas.width = w;
    if (canvas.height !== h) canvas.height = h;
    gl.viewport(0, 0, w, h);
    gl.clearColor(...rgba(scene.look.colours.outside));
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const heights = scene.world.layers.get("height");
    if (!heights) return "Waiting for the layer of heights.";
    const to_clip = camera.matrix(w / h);
    this.fill(heights, scene);
    this.drawSurface(heights, to_clip, scene.steep);
    this.drawMarks(scene, heights, to_clip, ratio);
    return "";
  }

  /** Heights and colours of all cells into their buffers, when they have changed. */
  fill(heights, { world, look, layer, scale }) {
    const key = [
      heights.t_s,
      layer?.name,
      layer?.t_s,
      scale?.low,
      scale?.high,
      look.key,
      look.is_stale,
    ];
    if (!layer) key.push(world.window?.version);
    if (key.join() === this.key) return;
    this.key = key.join();
    const { gl, buffers } = this;
    const z = heights.values.map((value) =>
      value > LOWEST_M ? Math.min(value, HIGHEST_M) : value <= LOWEST_M ? LOWEST_M : 0,
    );
    put(gl, gl.ARRAY_BUFFER, buffers.height, z);
    put(gl, gl.ARRAY_BUFFER, buffers.tint, tints(heights, { world, look, layer, scale }));
    const corners = triangles(heights.values, heights.size);
    put(gl, gl.ELEMENT_ARRAY_BUFFER, buffers.index, corners);
    this.corners = corners.length;
  }

  drawSurface({ i, j, size, cell_m }, to_clip, steep) {
    const { gl, camera, surface, buffers } = this;
    gl.useProgram(surface.program);
    gl.uniformMatrix4fv(surface.to_clip, false, to_clip);
    gl.uniform4f(surface.grid, i * cell_m - camera.x_m, j * cell_m - camera.y_m, cell_m, size);
    gl.uniform1f(surface.steep, steep);
    attribute(gl, surface.program, "height", buffers.height, 1, gl.FLOAT, false);
    attribute(gl, surface.program, "tint", buffers.tint, 4, gl.UNSIGNED_BYTE, true);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers.index);
    gl.drawElements(gl.TRIANGLES, this.corners, gl.UNSIGNED_INT, 0);
  }

  /** Robot, path and scan line. */
  drawMarks({ world, look, path, robot, shows, steep }, heights, to_clip, ratio) {
    const { gl, marks } = this,
      { colours } = look,
      pose = world.state?.pose;
    gl.useProgram(marks.program);
    gl.uniformMatrix4fv(marks.to_clip, false, to_clip);
    gl.uniform1f(marks.point_px, 3 * ratio);
    const ground = (x, y) => (heightAt(heights, x, y) + LIFTED_M) * steep;
    if (shows.path)
      this.put(
        gl.LINES,
        path
          .flatMap((to, k) => (to.is_first || k === 0 ? [] : [path[k - 1], to]))
          .flatMap(({ x, y }) => [x, y, ground(x, y)]),
        colours.path,
      );
    if (shows.scan && world.scan) {
      const { points } = world.scan;
      this.put(
        gl.POINTS,
        Array.from(points, (value, k) => (k % 3 === 2 ? (value + LIFTED_M) * steep : value)),
        colours.scan,
      );
    }
    if (!pose) return;
    const z = ground(pose.x, pose.y);
    const colour = look.is_stale ? colours.stale_obstacle : colours.robot,
      { sides, top } = box(pose, robot, z, z + ROBOT_HIGH_M * steep);
    this.put(gl.TRIANGLES, sides, colour, 0.72);
    this.put(gl.TRIANGLES, top, colour);
    this.put(
      gl.TRIANGLES,
      arrow(pose, robot, z + (ROBOT_HIGH_M + LIFTED_M) * steep),
      colours.robot_edge,
    );
  }

  /** Places (x, y of the map, z) as marks of one colour. */
  put(kind, places, colour, light = 1) {
    const { gl, marks, buffers, camera } = this;
    const near = Float32Array.from(
      places,
      (value, k) => value - (k % 3 === 0 ? camera.x_m : k % 3 === 1 ? camera.y_m : 0),
    );
    put(gl, gl.ARRAY_BUFFER, buffers.place, near);
    attribute(gl, marks.program, "place", buffers.place, 3, gl.FLOAT, false);
    gl.uniform4fv(
      marks.colour,
      rgba(colour).map((part, k) => (k < 3 ? part * light : part)),
    );
    gl.drawArrays(kind, 0, near.length / 3);
  }
}

/** A colour of each cell: of the chosen layer, else of its state; transparent where it is not known. */
function tints(heights, { world, look, layer, scale }) {
  const states = statePixels(look.colours, look.is_stale),
    table = layer && layerPixels(scale, look);
  const { values, i, j, size } = heights,
    unknown = pixelOf(look.colours.unknown);
  return Uint32Array.from(values, (height, k) => {
    if (Number.isNaN(height)) return 0;
    const cell_i = i + (k % size),
      cell_j = j + Math.floor(k / size);
    if (!layer) return states[world.cell(cell_i, cell_j) ?? 0] || unknown;
    const at = layer === heights ? k : indexOf(layer, cell_i, cell_j);
    const value = at === null ? NaN : layer.values[at];
    return Number.isNaN(value)
      ? unknown
      : table[scale.is_codes ? value & 255 : rampIndex(value, scale)];
  });
}

/** Two triangles for each four cells whose heights are all known: most of a window is not. */
function triangles(heights, n) {
  const corners = new Uint32Array(6 * (n - 1) * (n - 1));
  let count = 0;
  for (let at = 0; at < n * (n - 1) - 1; at += 1) {
    if (
      at % n === n - 1 ||
      Number.isNaN(heights[at] + heights[at + 1] + heights[at + n] + heights[at + n + 1])
    )
      continue;
    for (const corner of [at, at + 1, at + n, at + 1, at + n + 1, at + n])
      corners[count++] = corner;
  }
  return corners.subarray(0, count);
}

function heightAt(heights, x_m, y_m) {
  const at = indexOf(heights, Math.floor(x_m / heights.cell_m), Math.floor(y_m / heights.cell_m));
  return at === null || Number.isNaN(heights.values[at]) ? 0 : heights.values[at];
}

const GENERIC = { front_m: 0.3, rear_m: 0.3, width_m: 0.5 };

/** A robot's box, as triangles. */
function box(pose, robot, low, high) {
  const { front_m, rear_m, width_m } = robot ?? GENERIC;
  const corner = (u, v, z) => placed(pose, u, v, z);
  const [a, b, c, d] = [
    [front_m, 1],
    [front_m, -1],
    [-rear_m, -1],
    [-rear_m, 1],
  ].map(([u, side]) => [u, (side * width_m) / 2]);
  const sides = [
    [a, b],
    [b, c],
    [c, d],
    [d, a],
  ].flatMap(([p, q]) => [
    corner(...p, low),
    corner(...q, low),
    corner(...q, high),
    corner(...p, low),
    corner(...q, high),
    corner(...p, high),
  ]);
  const top = [a, b, c, a, c, d].map((p) => corner(...p, high));
  return { sides: sides.flat(), top: top.flat() };
}

function arrow(pose, robot, z) {
  const { front_m, rear_m, width_m } = robot ?? GENERIC;
  return [
    [0.75 * front_m, 0],
    [-0.3 * rear_m, 0.28 * width_m],
    [-0.3 * rear_m, -0.28 * width_m],
  ].flatMap(([u, v]) => placed(pose, u, v, z));
}

function placed({ x, y, yaw }, u, v, z) {
  const cos = Math.cos(yaw),
    sin = Math.sin(yaw);
  return [x + u * cos - v * sin, y + u * sin + v * cos, z];
}

function program(gl, [vertex, fragment], uniforms) {
  const made = gl.createProgram();
  for (const [kind, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return {
    program: made,
    ...Object.fromEntries(uniforms.map((name) => [name, gl.getUniformLocation(made, name)])),
  };
}

function put(gl, kind, buffer, data) {
  gl.bindBuffer(kind, buffer);
  gl.bufferData(kind, data, gl.DYNAMIC_DRAW);
}

function attribute(gl, in_program, name, buffer, parts, type, is_share) {
  const at = gl.getAttribLocation(in_program, name);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.enableVertexAttribArray(at);
  gl.vertexAttribPointer(at, parts, type, is_share, 0, 0);
}

function rgba(css) {
  const rgb = Number.parseInt(css.slice(1), 16);
  return [rgb >> 16, (rgb >> 8) & 255, rgb & 255, 255].map((part) => part / 255);
}
