"use strict";
// The running loop: views come over a socket, the wish of the hand goes back. The drawing is that of the page of replays.

const find = (id) => document.getElementById(id);
const PLOT_HEIGHT = 150, SPAN_S = 4, PLOT_EVERY_MS = 40;
const FULL_N = 20; // the device gives no more: the bar is full then

// Times of the last second, with another one.
const lastSecond = (times_ms, now_ms) => [...times_ms.filter((t) => t > now_ms - 1000), now_ms];

// One tick, in the arrays that Stage draws a replay from; each view is written over the one before.
function emptyTick() {
  const zeros = (n) => new Float64Array(n);
  return {
    replay0: { position_m: zeros(3), quaternion: Float64Array.of(1, 0, 0, 0), shift_m: zeros(3), force_N: zeros(3), torque_Nm: zeros(3),
      areas: [0], area_count: [0], area_point_m: [], area_force_N: [], area_depth_m: [] },
    contacts0: { changes: [0], sample: [], state: [], states: [], zone_count: [0], point_m: zeros(3), zone: [], zone_centre_m: [],
      zone_normal: [], zone_radius_m: [], zone_share: [] },
  };
}

// Until the first view the head says what is waited for, and for how long by now.
const wait = {
  since_ms: performance.now(),
  steps: [["unpacking the parts", 1], ["asking the loop for its first view; it runs already", 1], ["drawing the first picture", 2]],
  at: 0,
  tell() {
    const [what, usual_s] = wait.steps[wait.at], so_far_s = Math.round((performance.now() - wait.since_ms) / 1000);
    const late = so_far_s > 15 ? "; is the program that gave this address still there?" : "";
    find("state").textContent = `${what}: about ${usual_s} s, ${so_far_s} s so far${late}`;
  },
  next(step) {
    wait.at = step;
    wait.tell();
  },
  end() {
    clearInterval(wait.clock);
  },
};
wait.clock = setInterval(wait.tell, 500);
wait.tell();

class Live {
  constructor(header, data) {
    this.header = { ...header, replays: [{ name: "live", contacts: "contacts0" }] };
    this.data = Object.assign(data, emptyTick());
    this.patches = new Map();
    this.views = 0;
    this.drawn = 0;
    this.drawings = []; // ms, of the last second, as `arrivals` those of the views
    this.arrivals = [];
    this.stage = new Stage(find("stage"), this.header, this.data);
    this.stage.force_max_N = 6;
    this.stage.torque_max_Nm = 0.15;
    this.makeHand();
    this.rows = Object.fromEntries(["contact", "torque", "depth", "zones", "loop", "behind", "received", "drawn"].map((label) => {
      const row = find("values").insertRow();
      row.insertCell().textContent = label;
      return [label, row.insertCell()];
    }));
    this.makePlots();
    this.listen();
    this.setTheme(matchMedia("(prefers-color-scheme: dark)").matches);
    new ResizeObserver(() => this.layout()).observe(find("stage"));
    this.layout();
    const frame = (now) => {
      this.draw(now);
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  // A ring where the hand wants the tool's origin, and a line to where it is.
  makeHand() {
    const size = 0.07 * this.header.camera.span_m;
    this.material = new THREE.MeshBasicMaterial({ depthTest: false, transparent: true, opacity: 0.9, side: THREE.DoubleSide });
    this.ring = new THREE.Mesh(new THREE.RingGeometry(0.75 * size, size, 40), this.material);
    const geometry = new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(new Float32Array(6), 3));
    this.spring = new THREE.Line(geometry, new THREE.LineBasicMaterial({ depthTest: false }));
    this.spring.frustumCulled = false;
    this.stage.overlay.add(this.ring, this.spring);
    this.hand = new THREE.Vector3();
  }

  makePlots() {
    this.trace = [[], [], [], []]; // s, N of the contact, N at the hand, mm
    const panel = (title, lines) => {
      const box = find("plots").appendChild(document.createElement("div"));
      box.className = "plot";
      const head = box.appendChild(document.createElement("h2"));
      head.append(title[0]);
      head.appendChild(document.createElement("span")).textContent = title[1];
      const pen = { stroke: () => css("--soft"), font: "11px system-ui, Arial, sans-serif", gap: 4, grid: { stroke: () => css("--grid"), width: 1 }, ticks: { show: false } };
      const plot = new uPlot({
        width: box.clientWidth || 300, height: PLOT_HEIGHT, padding: [6, 10, 0, 0], legend: { show: false }, cursor: { show: false },
        scales: { x: { time: false, range: (_, low, high) => [high - SPAN_S, high] }, y: { range: (_, low, high) => [0, Math.max(1.1 * high, 1)] } },
        axes: [{ ...pen, size: 24 }, { ...pen, size: 40 }],
        series: [{}, ...lines.map(([k, width]) => ({ stroke: () => css(`--replay${k}`), width, points: { show: false } }))],
      }, [[0], ...lines.map(() => [0])], box);
      return { box, plot };
    };
    this.plots = [panel(["force, N", "blue: of the contact, orange: at the hand, every millisecond"], [[0, 2], [1, 1.2]]), panel(["depth, mm", ""], [[0, 1.5]])];
    new ResizeObserver(() => this.plots.forEach(({ box, plot }) => plot.setSize({ width: box.clientWidth, height: PLOT_HEIGHT }))).observe(find("plots"));
  }

  setTheme(dark) {
    this.dark = dark;
    document.documentElement.classList.toggle("dark", dark);
    this.stage.samples.contacts0.now.fill(0); // painted again with the next view
    this.stage.paint("zones");
    this.material.color.set(css("--replay1")).convertSRGBToLinear();
    this.spring.material.color.set(css("--replay1")).convertSRGBToLinear();
    this.plots.forEach(({ plot }) => plot.redraw(false));
  }

  layout() {
    const { clientWidth: width, clientHeight: height } = find("stage");
    this.stage.resize([{ x: 0, y: 0, width: Math.max(1, width), height: Math.max(1, height), shift: width < 900 ? Math.round(0.1 * width) : 0 }]);
  }

  listen() {
    const { canvas } = this.stage;
    const first = (kind, handler) => canvas.addEventListener(kind, handler, { capture: true });
    first("pointerdown", (event) => this.take(event));
    first("pointermove", (event) => this.lead(event));
    for (const kind of ["pointerup", "pointercancel"]) first(kind, () => this.release());
    canvas.addEventListener("wheel", (event) => this.push(event), { capture: true, passive: false });
    find("home").addEventListener("click", () => this.stage.home());
    find("theme").addEventListener("click", () => this.setTheme(!this.dark));
    find("back").addEventListener("click", () => this.say(null));
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      ({ r: () => find("home").click(), t: () => find("theme").click(), b: () => find("back").click() })[event.key]?.();
    });
  }

  // The ray under the mouse.
  ray(event) {
    const { left, top, width, height } = this.stage.canvas.getBoundingClientRect();
    const caster = new THREE.Raycaster();
    caster.setFromCamera(new THREE.Vector2((2 * (event.clientX - left)) / width - 1, 1 - (2 * (event.clientY - top)) / height), this.stage.camera);
    return caster;
  }

  // Where on the tool, or null.
  touched(event) {
    return this.ray(event).intersectObject(this.stage.tool.solid, false)[0]?.point ?? null;
  }

  take(event) {
    const point = event.button === 0 && !event.shiftKey ? this.touched(event) : null;
    if (!point) return;
    event.stopImmediatePropagation();
    this.stage.canvas.setPointerCapture(event.pointerId);
    this.grip = { offset: this.at().sub(point), plane: new THREE.Plane().setFromNormalAndCoplanarPoint(this.stage.camera.getWorldDirection(new THREE.Vector3()), point) };
    this.stage.canvas.classList.add("held");
    find("hint").hidden = true;
  }

  lead(event) {
    if (event.buttons !== 0) find("hint").hidden = true;
    if (!this.grip) {
      if (event.buttons === 0) this.stage.canvas.classList.toggle("grab", this.touched(event) !== null);
      return;
    }
    event.stopImmediatePropagation();
    const point = this.ray(event).ray.intersectPlane(this.grip.plane, new THREE.Vector3());
    if (!point) return;
    this.point = point;
    this.say(point.clone().add(this.grip.offset).toArray());
  }

  release() {
    this.grip = undefined;
    this.stage.canvas.classList.remove("held");
  }

  // The wheel, while the tool is held: along the line of sight.
  push(event) {
    if (!this.grip || !this.point) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    const way = this.grip.plane.normal.clone().multiplyScalar(-1e-4 * event.deltaY * this.header.camera.span_m);
    this.point.add(way);
    this.grip.plane.setFromNormalAndCoplanarPoint(this.grip.plane.normal, this.point);
    this.say(this.point.clone().add(this.grip.offset).toArray());
  }

  at() {
    return vector(this.data.replay0.position_m, 0);
  }

  say(hand) {
    if (hand) find("hint").hidden = true;
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ hand }));
  }

  connect() {
    this.socket = new WebSocket(this.header.socket);
    this.socket.addEventListener("message", (event) => this.takeView(JSON.parse(event.data)));
    this.socket.addEventListener("close", () => {
      wait.end();
      if (!this.drawn) find("state").textContent = "";
      find("trouble").textContent = "the loop has ended; start it again and open the address that it says";
      find("trouble").hidden = false;
    });
    return new Promise((done) => { this.first = done; });
  }

  takeView(view) {
    this.view = view;
    this.views++;
    this.arrivals = lastSecond(this.arrivals, performance.now());
    if (this.views === 1) wait.next(2);
    const { replay0, contacts0 } = this.data;
    replay0.position_m.set(view.position_m);
    replay0.quaternion.set(view.quaternion);
    replay0.force_N.set(view.contact_N);
    replay0.torque_Nm.set(view.torque_Nm);
    contacts0.point_m.set(view.point_m);
    this.hand.fromArray(view.hand_m);
    this.takeAreas(replay0, view.areas);
    this.takeZones(contacts0, view.zones);
    this.takeSamples(view.samples);
    for (const tick of view.trace) tick.forEach((value, k) => this.trace[k].push(value));
    const old = this.trace[0].length - 1000 * SPAN_S;
    if (old > 500) this.trace.forEach((values) => values.splice(0, old));
    this.stage.dirty = true;
    this.first?.();
    this.first = undefined;
  }

  takeAreas(replay, areas) {
    replay.areas[0] = areas.length;
    replay.area_at = [0, areas.length];
    replay.area_point_m = areas.flatMap((area) => area.slice(0, 3));
    replay.area_force_N = areas.flatMap((area) => area.slice(3, 6));
    replay.area_depth_m = areas.map((area) => area[9]);
  }

  // Patches get their colours in the order in which they are met.
  zoneOf(patch) {
    if (patch < 0) return -1;
    if (!this.patches.has(patch)) this.patches.set(patch, this.patches.size);
    return this.patches.get(patch);
  }

  takeZones(contacts, zones) {
    contacts.zone_at = [0, zones.length];
    contacts.zone = zones.map(([patch]) => this.zoneOf(patch));
    contacts.zone_centre_m = zones.flatMap((zone) => zone.slice(1, 4));
    contacts.zone_normal = zones.flatMap((zone) => zone.slice(4, 7));
    contacts.zone_radius_m = zones.map((zone) => Math.sqrt(zone[7] / Math.PI));
    contacts.zone_share = zones.map((zone) => zone[8]);
  }

  takeSamples(pairs) {
    const samples = this.stage.samples.contacts0;
    samples.now.fill(0);
    samples.colours.fill(0);
    for (const [sample, patch] of pairs) {
      const zone = this.zoneOf(patch);
      samples.now[sample] = 2 + zone;
      samples.palette[zone + 1] ??= rgb(zoneColour(zone));
      samples.tint(sample);
    }
    samples.points.geometry.attributes.tint.needsUpdate = true;
  }

  draw(now_ms) {
    this.times = lastSecond(this.times ?? [], now_ms);
    if (!this.view || !this.stage.dirty) return;
    this.drawn++;
    this.drawings = lastSecond(this.drawings, now_ms);
    wait.end();
    this.keepUp(now_ms);
    const here = this.at();
    this.ring.position.copy(this.hand);
    this.ring.quaternion.copy(this.stage.camera.quaternion);
    this.spring.geometry.attributes.position.array.set([...here.toArray(), ...this.hand.toArray()]);
    this.spring.geometry.attributes.position.needsUpdate = true;
    this.ring.visible = this.spring.visible = here.distanceTo(this.hand) > 1e-4;
    this.stage.render([0], false);
    this.tell();
    if (now_ms - (this.plotted ?? 0) < PLOT_EVERY_MS) return;
    this.plotted = now_ms;
    const every = (values) => values.filter((_, i) => i % 3 === 0);
    const [t, contact, hand, depth] = this.trace.map(every);
    if (t.length > 1) {
      this.plots[0].plot.setData([t, contact, hand]);
      this.plots[1].plot.setData([t, depth]);
    }
  }

  // A machine that draws slowly gets a coarser picture: a hand needs it at once more than sharp.
  keepUp(now_ms) {
    this.judged ??= now_ms;
    if (now_ms - this.judged < 1500) return;
    this.judged = now_ms;
    if (this.times.length < 40 && this.stage.sharpness > 0.3) this.stage.sharpness *= 0.7;
  }

  tell() {
    const { view, rows } = this, size = (v) => Math.hypot(...v);
    const put = (cell, text) => { if (cell.textContent !== text) cell.textContent = text; };
    put(find("force").querySelector("b"), size(view.force_N).toFixed(2));
    find("force").querySelector("i").style.width = `${Math.min(100, (100 * size(view.force_N)) / FULL_N)}%`;
    put(rows.contact, `${size(view.contact_N).toFixed(2)} N`);
    put(rows.torque, `${(1000 * size(view.torque_Nm)).toFixed(1)} mN m`);
    put(rows.depth, `${(1000 * view.depth_m).toFixed(2)} mm`);
    put(rows.zones, `${view.areas.length} area${view.areas.length === 1 ? "" : "s"}, ${view.zones.length} zone${view.zones.length === 1 ? "" : "s"}`);
    put(rows.loop, `tick ${view.ticks}, ${view.lost} lost`);
    put(rows.behind, `${view.late_max_ms.toFixed(0)} ms at most`);
    put(rows.received, `${this.arrivals.length} views a second`);
    put(rows.drawn, `${this.drawings.length} of them`);
    listPoints(find("points"), view.areas.length, (k) => ({
      at: vector(this.data.replay0.area_point_m, k), depth: view.areas[k][9], force: size(view.areas[k].slice(3, 6)),
    }));
    const state = [view.mode, view.restarts ? `restarted ${view.restarts} x: ${view.why.join(", ")}` : "", view.refused ? "the device does not reach all of that" : ""];
    put(find("state"), state.filter(Boolean).join("   "));
    find("state").classList.toggle("bad", view.mode === "fault");
  }
}

// For scripts: crease.ready, then crease.live.
window.crease = {
  ready: (async () => {
    const header = JSON.parse(find("header").textContent);
    const live = new Live(header, await decodeArrays(find("data").textContent, header.arrays));
    wait.next(1);
    window.crease.live = live;
    await live.connect();
  })(),
};
