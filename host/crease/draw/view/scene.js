"use strict";
// The panes: one canvas, one view of the same bodies for each replay. Nothing is drawn unless something changed.

const ZONE_COLOURS = ["#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#e6d400", "#a6611a", "#8a6bd1", "#7fbf3f"];
const FIELD_OF_VIEW_DEG = 30;
const ARROW_SPAN = 0.62; // longest force arrow, in half heights of the first view

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const vector = (values, i) => new THREE.Vector3(values[3 * i], values[3 * i + 1], values[3 * i + 2]);

// Corner normals that are smooth up to the crease angle. Corners are not shared between triangles.
function creasedGeometry(vertices, triangles, creaseRad) {
  const count = triangles.length / 3, least = Math.cos(creaseRad);
  const faces = new Float32Array(triangles.length), degree = new Uint32Array(vertices.length / 3);
  const a = new THREE.Vector3(), b = new THREE.Vector3(), c = new THREE.Vector3();
  for (let t = 0; t < count; t++) {
    a.fromArray(vertices, 3 * triangles[3 * t]);
    b.fromArray(vertices, 3 * triangles[3 * t + 1]).sub(a);
    c.fromArray(vertices, 3 * triangles[3 * t + 2]).sub(a);
    b.cross(c).toArray(faces, 3 * t); // length: twice the area
    for (let k = 0; k < 3; k++) degree[triangles[3 * t + k]]++;
  }
  const first = starts(degree), around = new Uint32Array(triangles.length), filled = first.slice();
  for (let i = 0; i < triangles.length; i++) around[filled[triangles[i]]++] = Math.floor(i / 3);
  const position = new Float32Array(9 * count), normal = new Float32Array(9 * count);
  for (let i = 0; i < triangles.length; i++) {
    const mine = 3 * Math.floor(i / 3), vertex = triangles[i];
    b.fromArray(faces, mine).normalize();
    c.set(0, 0, 0);
    for (let k = first[vertex]; k < first[vertex + 1]; k++) {
      a.fromArray(faces, 3 * around[k]);
      if (a.dot(b) >= least * a.length()) c.add(a);
    }
    c.normalize().toArray(normal, 3 * i);
    for (let k = 0; k < 3; k++) position[3 * i + k] = vertices[3 * vertex + k];
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(normal, 3));
  return geometry;
}

// A body with its creases as lines.
function makeBody(vertices, triangles, creaseRad, opacity) {
  const geometry = creasedGeometry(vertices, triangles, creaseRad);
  const solid = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({
    transparent: opacity < 1, opacity, depthWrite: opacity === 1,
    polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
  }));
  const edges = new THREE.EdgesGeometry(geometry, THREE.MathUtils.radToDeg(creaseRad));
  const lines = new THREE.LineSegments(edges, new THREE.LineBasicMaterial({ transparent: true, opacity: 0.6 }));
  const group = new THREE.Group();
  group.add(solid, lines);
  return { group, solid, lines };
}

// An arrow along +z whose head keeps its shape.
class Arrow {
  constructor(width, lit) {
    const Material = lit ? THREE.MeshLambertMaterial : THREE.MeshBasicMaterial;
    this.material = new Material(lit ? {} : { depthTest: false });
    const shaft = new THREE.CylinderGeometry(0.5, 0.5, 1, 20), head = new THREE.ConeGeometry(1.4, 3.6, 28);
    shaft.rotateX(Math.PI / 2).translate(0, 0, 0.5);
    head.rotateX(Math.PI / 2).translate(0, 0, -1.8);
    this.width = width;
    this.shaft = new THREE.Mesh(shaft, this.material);
    this.head = new THREE.Mesh(head, this.material);
    this.group = new THREE.Group();
    this.group.add(this.shaft, this.head);
  }

  set(from, direction, length) {
    const size = direction.length();
    this.group.visible = size > 0 && length > 0;
    if (!this.group.visible) return;
    const head = Math.min(3.2 * this.width, 0.7 * length);
    this.group.position.copy(from);
    this.group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), direction.clone().divideScalar(size));
    this.shaft.scale.set(this.width, this.width, length - head);
    this.head.scale.setScalar(head / 3.6);
    this.head.position.z = length;
  }
}

// A torque: an arc about its axis, clockwise seen along it, as long as the torque is large; with a head.
class Ring {
  constructor(radius, width) {
    const steps = 96, round = 10, positions = [], normals = [], index = [];
    for (let i = 0; i <= steps; i++) {
      const angle = (1.75 * Math.PI * i) / steps, c = Math.cos(angle), s = Math.sin(angle);
      for (let k = 0; k < round; k++) {
        const u = Math.cos((2 * Math.PI * k) / round), v = Math.sin((2 * Math.PI * k) / round);
        positions.push(c * (radius + 0.5 * width * u), s * (radius + 0.5 * width * u), 0.5 * width * v);
        normals.push(c * u, s * u, v);
        const a = i * round + k, b = i * round + ((k + 1) % round);
        if (i < steps) index.push(a, a + round, b, b, a + round, b + round);
      }
    }
    this.tube = new THREE.BufferGeometry();
    this.tube.setAttribute("position", new THREE.Float32BufferAttribute(positions, 3));
    this.tube.setAttribute("normal", new THREE.Float32BufferAttribute(normals, 3));
    this.tube.setIndex(index);
    this.steps = steps;
    this.perStep = 6 * round;
    this.radius = radius;
    this.material = new THREE.MeshLambertMaterial({ side: THREE.DoubleSide });
    this.head = new THREE.Mesh(new THREE.ConeGeometry(1.5 * width, 3.4 * width, 24), this.material);
    this.group = new THREE.Group();
    this.group.add(new THREE.Mesh(this.tube, this.material), this.head);
  }

  // share: 0..1 of the largest torque.
  set(at, torque, share) {
    const size = torque.length(), steps = Math.round(this.steps * Math.min(share, 1));
    this.group.visible = size > 0 && steps > 2;
    if (!this.group.visible) return;
    this.tube.setDrawRange(0, steps * this.perStep);
    const angle = (1.75 * Math.PI * steps) / this.steps;
    this.head.position.set(this.radius * Math.cos(angle), this.radius * Math.sin(angle), 0);
    this.head.rotation.z = angle;
    this.group.position.copy(at);
    this.group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), torque.clone().divideScalar(size));
  }
}

// The way of the tool's origin; where it touches in the colour of the replay.
function makeTrack(replay) {
  const count = replay.areas.length, colours = new Float32Array(3 * count);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(replay.position_m), 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
  const line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ vertexColors: true, depthTest: false }));
  line.frustumCulled = false;
  const paint = (free, touching) => {
    const [a, b] = [free, touching].map((colour) => new THREE.Color(colour).convertSRGBToLinear());
    for (let i = 0; i < count; i++) (replay.areas[i] ? b : a).toArray(colours, 3 * i);
    geometry.attributes.color.needsUpdate = true;
  };
  return { line, paint };
}

// The samples in contact of one path. Changes are followed forwards and backwards from tick to tick.
class Samples {
  constructor(contacts, positions, radius) {
    this.contacts = contacts;
    this.at = starts(contacts.changes);
    this.now = new Uint16Array(positions.length / 3);
    this.before = new Uint16Array(contacts.sample.length);
    for (let i = 0; i < contacts.sample.length; i++) {
      this.before[i] = this.now[contacts.sample[i]];
      this.now[contacts.sample[i]] = contacts.state[i];
    }
    this.frame = contacts.changes.length - 1;
    this.colours = new Uint8Array(4 * this.now.length);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(positions), 3));
    geometry.setAttribute("tint", new THREE.BufferAttribute(this.colours, 4, true));
    this.material = new THREE.ShaderMaterial({
      uniforms: { size: { value: 2 * radius }, scale: { value: 1 } }, transparent: true, depthTest: false, depthWrite: false,
      vertexShader: `attribute vec4 tint; uniform float size, scale; varying vec4 colour;
        void main() {
          vec4 p = modelViewMatrix * vec4(position, 1.0);
          colour = tint;
          gl_PointSize = max(3.0, size * scale / -p.z);
          gl_Position = tint.a > 0.0 ? projectionMatrix * p : vec4(2.0, 2.0, 2.0, 1.0);
        }`,
      fragmentShader: `varying vec4 colour;
        void main() {
          float r = length(gl_PointCoord - 0.5);
          if (r > 0.5) discard;
          gl_FragColor = vec4(r > 0.38 ? colour.rgb * 0.55 : colour.rgb, 0.92);
        }`,
    });
    this.points = new THREE.Points(geometry, this.material);
    this.points.frustumCulled = false;
    this.palette = [];
  }

  // Colours of the states, [r, g, b] each.
  paint(palette) {
    this.palette = palette;
    for (let i = 0; i < this.now.length; i++) this.tint(i);
    this.points.geometry.attributes.tint.needsUpdate = true;
  }

  tint(sample) {
    const state = this.now[sample];
    this.colours.set(state ? this.palette[state - 1] : [0, 0, 0], 4 * sample);
    this.colours[4 * sample + 3] = state ? 255 : 0;
  }

  seek(frame) {
    if (frame === this.frame) return;
    const { sample, state } = this.contacts;
    for (let i = this.at[this.frame + 1]; i < this.at[frame + 1]; i++) {
      this.now[sample[i]] = state[i];
      this.tint(sample[i]);
    }
    for (let i = this.at[this.frame + 1] - 1; i >= this.at[frame + 1]; i--) {
      this.now[sample[i]] = this.before[i];
      this.tint(sample[i]);
    }
    this.frame = frame;
    this.points.geometry.attributes.tint.needsUpdate = true;
  }
}

// Discs and normals of the zones of a tick; the length of a normal is the zone's weight.
class Zones {
  constructor(span) {
    this.span = span;
    this.group = new THREE.Group();
    this.pool = [];
  }

  make() {
    const material = new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.3, depthTest: false, side: THREE.DoubleSide });
    const disc = new THREE.Mesh(new THREE.CircleGeometry(1, 40), material);
    const arrow = new Arrow(0.012 * this.span, false);
    disc.renderOrder = 1;
    for (const part of [arrow.shaft, arrow.head]) part.renderOrder = 2;
    this.group.add(disc, arrow.group);
    return { disc, arrow };
  }

  show(contacts, from, to) {
    while (this.pool.length < to - from) this.pool.push(this.make());
    this.pool.forEach(({ disc, arrow }, k) => {
      const i = from + k;
      disc.visible = i < to;
      arrow.group.visible = disc.visible;
      if (!disc.visible) return;
      const centre = vector(contacts.zone_centre_m, i), normal = vector(contacts.zone_normal, i);
      const colour = zoneColour(contacts.zone[i]);
      disc.position.copy(centre);
      disc.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), normal.clone().normalize());
      disc.scale.setScalar(Math.max(contacts.zone_radius_m[i], 1e-6));
      disc.material.color.set(colour).convertSRGBToLinear();
      arrow.material.color.set(colour).convertSRGBToLinear();
      arrow.set(centre, normal, 0.45 * this.span * contacts.zone_share[i]);
    });
  }
}

// Grey: of no zone. After the eight that anyone tells apart come others, none twice.
function zoneColour(zone) {
  if (zone < 0) return "#9aa4b2";
  if (zone < ZONE_COLOURS.length) return ZONE_COLOURS[zone];
  const k = zone - ZONE_COLOURS.length;
  return `hsl(${Math.round(20 + 137.508 * k) % 360}, ${[70, 45][k % 2]}%, ${[45, 60, 35][k % 3]}%)`;
}
const rgb = (text) => new THREE.Color(text).toArray().map((v) => Math.round(255 * v));

class Stage {
  constructor(holder, header, data) {
    this.header = header;
    this.data = data;
    this.renderer = new THREE.WebGLRenderer({ antialias: true });
    this.renderer.autoClear = false;
    this.renderer.outputEncoding = THREE.sRGBEncoding;
    this.canvas = this.renderer.domElement;
    holder.prepend(this.canvas);
    this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 0.001, 100);
    this.camera.up.set(0, 0, 1);
    this.sharpness = 1; // share of the screen's pixels along each side
    this.makeBodies();
    this.makeOverlay();
    this.home();
    this.dirty = true;
    listenForOrbit(this);
  }

  makeBodies() {
    const { data, header } = this;
    this.world = new THREE.Scene();
    this.fixed = makeBody(data.static.vertices_m, data.static.triangles, header.crease_angle_rad, 1);
    this.tool = makeBody(data.tool.vertices_m, data.tool.triangles, header.crease_angle_rad, 0.5);
    this.tool.group.matrixAutoUpdate = false;
    this.sky = new THREE.HemisphereLight(0xffffff, 0x8a8f99, 0.75);
    this.lamp = new THREE.DirectionalLight(0xffffff, 0.6);
    this.hand = this.makeHand();
    this.world.add(this.fixed.group, this.tool.group, this.hand.group, this.sky, this.lamp, this.lamp.target);
  }

  // Where the hand has the tool while another pose of it is shown: the same body, faint.
  makeHand() {
    const solid = new THREE.Mesh(this.tool.solid.geometry, this.tool.solid.material.clone());
    const lines = new THREE.LineSegments(this.tool.lines.geometry, this.tool.lines.material.clone());
    const group = new THREE.Group();
    solid.material.opacity = 0.12;
    lines.material.opacity = 0.25;
    group.add(solid, lines);
    group.matrixAutoUpdate = false;
    return { group, solid, lines };
  }

  makeOverlay() {
    const { data, header } = this, span = header.camera.span_m;
    this.overlay = new THREE.Scene();
    this.samples = {};
    for (const { contacts } of header.replays) {
      if (this.samples[contacts]) continue;
      const samples = new Samples(data[contacts], data.samples_m, 0.4 * header.spacing_m);
      samples.points.matrixAutoUpdate = false;
      this.overlay.add(samples.points);
      this.samples[contacts] = samples;
      data[contacts].zone_at = starts(data[contacts].zone_count);
    }
    this.zones = new Zones(span);
    this.overlay.add(this.zones.group);
    this.top = new THREE.Scene();
    this.arrow = new Arrow(0.03 * span, true);
    this.ring = new Ring(0.2 * span, 0.018 * span);
    this.parts = [];
    this.top.add(this.arrow.group, this.ring.group, this.sky.clone(), this.lampTop = this.lamp.clone(), this.lampTop.target);
    this.arrowLength = ARROW_SPAN * span;
    const most = (name) => Math.max(...header.replays.map((_, i) => high(sizes(data[`replay${i}`][name]))), 1e-9);
    this.force_max_N = most("force_N");
    this.torque_max_Nm = most("torque_Nm");
    this.tracks = header.replays.map((_, i) => {
      const replay = data[`replay${i}`], track = makeTrack(replay);
      replay.area_at = starts(replay.area_count);
      this.overlay.add(track.line);
      return track;
    });
    this.withTrack = false;
  }

  // Colours of the page's theme and of the samples: by "zones" or by "areas".
  paint(by) {
    this.fixed.solid.material.color.set(css("--static")).convertSRGBToLinear();
    for (const body of [this.tool, this.hand]) body.solid.material.color.set(css("--tool")).convertSRGBToLinear();
    for (const body of [this.fixed, this.tool, this.hand]) body.lines.material.color.set(css("--edge")).convertSRGBToLinear();
    this.renderer.setClearColor(css("--sky"), 1);
    for (const samples of Object.values(this.samples)) {
      const { states } = samples.contacts;
      const palette = [];
      for (let i = 0; i < states.length; i += 2) {
        palette.push(rgb(by === "zones" ? zoneColour(states[i + 1]) : ZONE_COLOURS[states[i] % ZONE_COLOURS.length]));
      }
      samples.paint(palette);
    }
    this.tracks.forEach((track, i) => track.paint(css("--soft"), css(`--replay${i}`)));
    this.dirty = true;
  }

  home() {
    const { target_m, direction, span_m } = this.header.camera;
    this.target = new THREE.Vector3(...target_m);
    const [x, y, z] = direction;
    this.azimuth = Math.atan2(y, x);
    this.elevation = Math.asin(Math.max(-1, Math.min(1, z)));
    this.distance = span_m / Math.tan(THREE.MathUtils.degToRad(FIELD_OF_VIEW_DEG / 2));
    this.dirty = true;
  }

  // The pose of the tool of replay i in its own tick. A held tool is displayed with an attitude of its own.
  toolMatrix(i, frame, display) {
    const replay = this.data[`replay${i}`], q = (display && replay.held_quaternion) || replay.quaternion;
    const position = vector(replay.position_m, frame);
    if (display) position.add(vector(replay.shift_m, frame));
    const rotation = new THREE.Quaternion(q[4 * frame + 1], q[4 * frame + 2], q[4 * frame + 3], q[4 * frame]).normalize();
    return new THREE.Matrix4().compose(position, rotation, new THREE.Vector3(1, 1, 1));
  }

  show(i, frame, display) {
    const replay = this.data[`replay${i}`], name = this.header.replays[i].contacts, contacts = this.data[name];
    const matrix = this.toolMatrix(i, frame, display);
    this.tool.group.matrix.copy(matrix);
    this.hand.group.visible = display && this.header.replays[i].held;
    if (this.hand.group.visible) this.hand.group.matrix.copy(this.toolMatrix(i, frame, false));
    for (const [key, samples] of Object.entries(this.samples)) samples.points.visible = key === name;
    this.samples[name].seek(frame);
    this.samples[name].points.matrix.copy(this.toolMatrix(i, frame, false));
    this.zones.show(contacts, contacts.zone_at[frame], contacts.zone_at[frame + 1]);
    this.tracks.forEach((track, k) => { track.line.visible = this.withTrack && k === i; });
    const force = vector(replay.force_N, frame), colour = css(`--replay${i}`);
    this.arrow.material.color.set(colour).convertSRGBToLinear();
    this.arrow.set(vector(contacts.point_m, frame), force, this.lengthOf(force));
    this.ring.material.color.set(colour).convertSRGBToLinear();
    const torque = vector(replay.torque_Nm, frame);
    this.ring.set(vector(replay.position_m, frame), torque, torque.length() / this.torque_max_Nm);
    this.showParts(replay, replay.area_at[frame], replay.area_at[frame + 1], colour);
  }

  lengthOf(force) {
    return this.arrowLength * Math.min(force.length() / this.force_max_N, 1.6);
  }

  // The forces of the contact areas, thin, where there are several: one alone is the large arrow.
  showParts(replay, from, to, colour) {
    const several = to - from > 1;
    while (several && this.parts.length < to - from) {
      const part = new Arrow(0.014 * this.header.camera.span_m, true);
      this.parts.push(part);
      this.top.add(part.group);
    }
    this.parts.forEach((part, k) => {
      part.group.visible = several && k < to - from;
      if (!part.group.visible) return;
      const force = vector(replay.area_force_N, from + k);
      part.material.color.set(colour).convertSRGBToLinear();
      part.set(vector(replay.area_point_m, from + k), force, this.lengthOf(force));
    });
  }

  resize(panes) {
    this.panes = panes;
    this.dirty = true;
  }

  // frames: the tick of each replay.
  render(frames, display) {
    if (!this.dirty) return;
    this.dirty = false;
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    const ratio = Math.min(window.devicePixelRatio, 2) * this.sharpness;
    if (ratio !== this.renderer.getPixelRatio()) this.renderer.setPixelRatio(ratio); // makes all buffers anew
    const size = this.renderer.getSize(new THREE.Vector2());
    if (size.x !== width || size.y !== height) this.renderer.setSize(width, height, false);
    const tight = Math.min(1, ...this.panes.map((pane) => pane.width / pane.height)); // narrow panes are seen from farther
    this.aim(this.distance / tight);
    this.renderer.setScissorTest(false);
    this.renderer.clear();
    this.renderer.setScissorTest(true);
    this.panes.forEach((pane, i) => {
      const low = height - pane.y - pane.height;
      this.renderer.setViewport(pane.x, low, pane.width, pane.height);
      this.renderer.setScissor(pane.x, low, pane.width, pane.height);
      this.camera.aspect = pane.width / pane.height;
      this.camera.setViewOffset(pane.width, pane.height, -pane.shift, -(pane.drop ?? 0), pane.width, pane.height);
      this.camera.updateProjectionMatrix();
      this.show(i, frames[i], display);
      const scale = (pane.height * this.renderer.getPixelRatio()) / 2 / Math.tan(THREE.MathUtils.degToRad(FIELD_OF_VIEW_DEG / 2));
      for (const samples of Object.values(this.samples)) samples.material.uniforms.scale.value = scale;
      this.renderer.render(this.world, this.camera);
      this.renderer.render(this.overlay, this.camera);
      this.renderer.clearDepth();
      this.renderer.render(this.top, this.camera);
    });
  }

  aim(distance) {
    const level = Math.cos(this.elevation);
    const towards = new THREE.Vector3(level * Math.cos(this.azimuth), level * Math.sin(this.azimuth), Math.sin(this.elevation));
    this.camera.position.copy(this.target).addScaledVector(towards, distance);
    this.camera.lookAt(this.target);
    this.camera.near = distance / 100;
    this.camera.far = distance * 100;
    const side = new THREE.Vector3().crossVectors(this.camera.up, towards);
    for (const lamp of [this.lamp, this.lampTop]) {
      lamp.position.copy(towards).addScaledVector(side, 0.5).add(new THREE.Vector3(0, 0, 0.6));
    }
  }
}

// Left button turns about the target, right button or shift moves it, wheel and two fingers zoom.
function listenForOrbit(stage) {
  const { canvas } = stage, fingers = new Map();
  const move = (dx, dy) => {
    const unit = (2 * stage.distance * Math.tan(THREE.MathUtils.degToRad(FIELD_OF_VIEW_DEG / 2))) / stage.panes[0].height;
    const right = new THREE.Vector3().setFromMatrixColumn(stage.camera.matrix, 0);
    const up = new THREE.Vector3().setFromMatrixColumn(stage.camera.matrix, 1);
    stage.target.addScaledVector(right, -dx * unit).addScaledVector(up, dy * unit);
  };
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
  });
  for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
    fingers.set(event.pointerId, event);
    if (fingers.size === 2) {
      const other = [...fingers.values()].find((finger) => finger.pointerId !== event.pointerId);
      const apart = (finger) => Math.hypot(finger.clientX - other.clientX, finger.clientY - other.clientY) + 1;
      stage.distance *= apart(before) / apart(event);
      move(dx / 2, dy / 2);
    } else if (event.buttons & 2 || event.shiftKey) {
      move(dx, dy);
    } else {
      stage.azimuth -= 0.008 * dx;
      stage.elevation = Math.max(-1.55, Math.min(1.55, stage.elevation + 0.008 * dy));
    }
    stage.dirty = true;
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    stage.distance *= Math.exp(0.0012 * event.deltaY);
    stage.dirty = true;
  }, { passive: false });
}

// Lengths of the rows of an (n, 3) array.
function sizes(values) {
  const out = new Float64Array(values.length / 3);
  for (let i = 0; i < out.length; i++) out[i] = Math.hypot(values[3 * i], values[3 * i + 1], values[3 * i + 2]);
  return out;
}

// The 99th percentile: a single spike must not shrink all arrows.
const high = (values) => Float64Array.from(values).sort()[Math.floor(0.99 * (values.length - 1))];
