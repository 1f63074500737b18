"use strict";
// Time, controls and keys. The tick is that of the longest replay; the others show their last tick up to its time.

const SPEEDS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1];
const PLAY_ABOUT_S = 20; // the first speed makes the whole replay about this long

const find = (id) => document.getElementById(id);

// Index of the last time up to t.
function tickAt(times, t) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t + 1e-9) low = middle;
    else high = middle - 1;
  }
  return low;
}

class Player {
  constructor(header, data) {
    this.header = header;
    this.data = data;
    this.replays = header.replays.map((_, i) => data[`replay${i}`]);
    this.times = this.replays.reduce((best, r) => (r.t_s[r.t_s.length - 1] > best[best.length - 1] ? r.t_s : best), this.replays[0].t_s);
    this.frames = this.times.length;
    this.frame = 0;
    this.playing = false;
    this.display = false;
    this.by = "zones";
    this.makePanes();
    try {
      this.stage = new Stage(find("stage"), header, data);
    } catch (error) {
      find("trouble").textContent = `no 3D picture: ${error.message}`;
      find("trouble").hidden = false;
    }
    this.plots = new Plots(find("plots"), header, data, (t) => this.seek(tickAt(this.times, t)));
    this.makeControls();
    new ResizeObserver(() => this.layout()).observe(find("stage"));
    this.setTheme(matchMedia("(prefers-color-scheme: dark)").matches);
    const asked = new URLSearchParams(location.hash.slice(1)).get("frame");
    this.seek(asked === null ? tickAt(this.times, header.start_s) : Number(asked) || 0);
    this.layout();
    const loop = (now) => {
      this.advance(now);
      this.draw();
      requestAnimationFrame(loop);
    };
    requestAnimationFrame(loop);
  }

  makePanes() {
    this.panes = this.header.replays.map(({ name, stiffness_N_m, preview, held, settings }, i) => {
      const pane = find("panes").appendChild(document.createElement("div"));
      pane.className = "pane";
      const told = pane.appendChild(document.createElement("div"));
      told.className = "told";
      const chip = told.appendChild(document.createElement("span"));
      chip.className = "chip";
      chip.style.background = `var(--replay${i})`;
      told.appendChild(document.createElement("b")).textContent = name;
      if (preview) told.appendChild(document.createElement("p")).textContent = `not replayed yet: ${settings}`;
      const table = told.appendChild(document.createElement("table"));
      const values = ["force", "torque", held ? "spring" : "depth", "turn", "amplification", "tick", "contact"].map((label) => {
        const row = table.insertRow();
        row.insertCell().textContent = label;
        if (label === "spring") row.title = "how far the hand is from the held tool";
        if (label === "amplification") row.title = `of ${+stiffness_N_m.toPrecision(3)} N/m, the table's stiffness`;
        return row.insertCell();
      });
      const points = told.appendChild(document.createElement("table"));
      points.className = "points";
      return { pane, told, values, points };
    });
  }

  makeControls() {
    for (const speed of SPEEDS) find("speed").add(new Option(`${speed} x`, speed));
    const seconds = this.times[this.frames - 1] || 1;
    find("speed").value = SPEEDS.filter((speed) => seconds / speed >= PLAY_ABOUT_S).pop() ?? SPEEDS[0];
    find("frame").max = this.frames - 1;
    find("frame").addEventListener("input", () => this.seek(Number(find("frame").value)));
    find("play").addEventListener("click", () => this.setPlaying(!this.playing));
    find("colour").addEventListener("click", () => this.setColour(this.by === "zones" ? "areas" : "zones"));
    find("pose").addEventListener("click", () => this.setDisplay(!this.display));
    find("home").addEventListener("click", () => this.stage?.home());
    find("track").addEventListener("click", () => this.setTrack(!this.withTrack));
    find("points").addEventListener("click", () => this.setPoints(!this.withPoints));
    find("jump").addEventListener("click", () => this.jump(1));
    this.jumps = this.jumpFrames();
    find("jump").disabled = this.jumps.length === 0;
    find("jump").title = this.jumps.length ? `${this.jumps.length} where the force jumps (j, back: shift)` : "the force jumps nowhere";
    this.setTrack(this.header.replays.some(({ preview }) => preview));
    this.setPoints(innerWidth > 900);
    find("theme").addEventListener("click", () => this.setTheme(!this.dark));
    this.setDisplay(this.header.replays.some(({ held }) => held));
    addEventListener("keydown", (event) => this.key(event));
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.tagName === "SELECT") return;
    const step = event.shiftKey ? 20 : 1;
    const action = {
      " ": () => this.setPlaying(!this.playing), ArrowRight: () => this.seek(this.frame + step), ArrowLeft: () => this.seek(this.frame - step),
      Home: () => this.seek(0), End: () => this.seek(this.frames - 1), c: () => find("colour").click(), d: () => find("pose").click(),
      r: () => find("home").click(), t: () => find("theme").click(), p: () => find("track").click(), l: () => find("points").click(),
      j: () => this.jump(1), J: () => this.jump(-1),
    }[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }

  // Frames where the force of any replay jumps, in order.
  jumpFrames() {
    const frames = this.header.replays.flatMap(({ jumps }, i) => jumps.map((tick) => tickAt(this.times, this.replays[i].t_s[tick])));
    return [...new Set(frames)].sort((a, b) => a - b);
  }

  // To the next jump, or the one before; round at the end.
  jump(way) {
    const { jumps } = this;
    if (!jumps.length) return;
    this.setPlaying(false);
    const next = way > 0 ? jumps.find((at) => at > this.frame) ?? jumps[0] : jumps.findLast((at) => at < this.frame) ?? jumps[jumps.length - 1];
    this.seek(next);
  }

  // The zones touched in this tick, each with its colour.
  tellZones(ticks) {
    const touched = new Set();
    ticks.forEach((tick, i) => {
      const contacts = this.data[this.header.replays[i].contacts];
      contacts.zone_at ??= starts(contacts.zone_count);
      for (let k = contacts.zone_at[tick]; k < contacts.zone_at[tick + 1]; k++) if (contacts.zone[k] >= 0) touched.add(contacts.zone[k]);
    });
    const shown = [...touched].sort((a, b) => a - b), key = shown.join();
    if (key === this.legend) return;
    this.legend = key;
    find("zones").replaceChildren(...shown.map((zone) => {
      const item = document.createElement("span");
      item.appendChild(document.createElement("i")).style.background = zoneColour(zone);
      item.append(`zone on patch ${this.header.patches[zone]}`);
      return item;
    }));
    if (!shown.length) find("zones").textContent = "no zone is touched";
  }

  setPlaying(playing) {
    this.playing = playing;
    if (playing && this.frame === this.frames - 1) this.seek(0);
    this.clock_s = this.times[this.frame];
    this.last_ms = undefined;
    find("play").textContent = playing ? "pause" : "play";
  }

  setTheme(dark) {
    this.dark = dark;
    document.documentElement.classList.toggle("dark", dark);
    this.setColour(this.by);
    this.plots.redraw();
  }

  setColour(by) {
    this.by = by;
    find("colour").textContent = `colour: ${by}`;
    find("zones").hidden = by !== "zones";
    this.stage?.paint(by);
  }

  setDisplay(display) {
    this.display = display;
    const held = this.header.replays.some((replay) => replay.held);
    find("pose").textContent = display ? (held ? "tool: held" : "tool: as displayed") : (held ? "tool: the hand's" : "tool: true pose");
    if (this.stage) this.stage.dirty = true;
  }

  setTrack(on) {
    this.withTrack = on;
    find("track").textContent = on ? "path: shown" : "path: hidden";
    if (!this.stage) return;
    this.stage.withTrack = on;
    this.stage.dirty = true;
  }

  setPoints(on) {
    this.withPoints = on;
    find("points").textContent = on ? "points: listed" : "points: not listed";
    if (this.clock_s === undefined) return;
    this.seek(this.frame);
    this.layout();
  }

  // Panes in the grid that gives each the most room.
  layout() {
    const { clientWidth: width, clientHeight: height } = find("stage"), count = this.panes.length;
    let best = { size: -1 };
    for (let columns = 1; columns <= count; columns++) {
      const rows = Math.ceil(count / columns), size = Math.min(width / columns, height / rows);
      if (size > best.size) best = { columns, rows, size };
    }
    const places = this.panes.map(({ pane, told }, i) => {
      const across = width / best.columns, down = height / best.rows;
      const place = { x: Math.round((i % best.columns) * across), y: Math.round(Math.floor(i / best.columns) * down) };
      place.width = Math.max(1, Math.round(across));
      place.height = Math.max(1, Math.round(down));
      // Beside the text, not behind it; below it where too little is left beside it.
      const share = told.offsetWidth / place.width;
      place.shift = share > 0.3 && share <= 0.6 ? Math.round(0.5 * told.offsetWidth) : 0;
      place.drop = share > 0.6 ? Math.round(0.5 * Math.min(told.offsetHeight, 0.6 * place.height)) : 0;
      Object.assign(pane.style, { left: `${place.x}px`, top: `${place.y}px`, width: `${place.width}px`, height: `${place.height}px` });
      return place;
    });
    this.stage?.resize(places);
  }

  ticks() {
    const t = this.times[this.frame];
    return this.replays.map((r) => (r.t_s === this.times ? this.frame : tickAt(r.t_s, t)));
  }

  seek(frame) {
    this.frame = Math.max(0, Math.min(this.frames - 1, Math.round(frame)));
    this.clock_s = this.times[this.frame];
    find("frame").value = this.frame;
    find("clock").textContent = `tick ${this.frame} of ${this.frames - 1}   ${this.times[this.frame].toFixed(3)} s`;
    const ticks = this.ticks();
    ticks.forEach((tick, i) => {
      this.tell(i, tick, this.panes[i].values);
      this.list(this.replays[i], tick, this.panes[i].points, this.header.replays[i].held);
    });
    this.tellZones(ticks);
    this.plots.show(this.times[this.frame]);
    if (this.stage) this.stage.dirty = true;
  }

  tell(k, i, cells) {
    const replay = this.replays[k], turn = replay.turn_deg[i], amplification = replay.amplification[i];
    const plural = (n, word) => `${n} ${word}${n === 1 ? "" : "s"}`;
    const texts = [
      `${vector(replay.force_N, i).length().toFixed(2)} N`, `${(1000 * vector(replay.torque_Nm, i).length()).toFixed(1)} mN m`,
      `${(1000 * replay.depth_m[i]).toFixed(2)} mm`, turn < 0 ? "no force" : `${turn.toFixed(2)} deg`,
      amplification.toFixed(2),
      `${(replay.tick_ns[i] / 1000).toFixed(1)} us`,
      !replay.areas[i] ? "none" : this.header.replays[k].held ? `${plural(replay.areas[i], "point")} of ${replay.zones[i]}`
        : `${plural(replay.areas[i], "area")}, ${plural(replay.zones[i], "zone")}`,
    ];
    texts.forEach((text, n) => { cells[n].textContent = text; });
  }

  // Where the tool touches: place, depth and force of each contact area.
  list(replay, tick, table, held) {
    const from = replay.area_at?.[tick] ?? 0, to = this.withPoints ? replay.area_at?.[tick + 1] ?? 0 : 0;
    listPoints(table, to - from, (k) => ({
      at: vector(replay.area_point_m, from + k), depth: replay.area_depth_m[from + k], force: vector(replay.area_force_N, from + k).length(),
    }), held ? IN_UM : IN_MM);
  }

  advance(now_ms) {
    if (!this.playing) return;
    const passed_s = this.last_ms === undefined ? 0 : (now_ms - this.last_ms) / 1000;
    this.last_ms = now_ms;
    const clock_s = this.clock_s + passed_s * Number(find("speed").value);
    const frame = tickAt(this.times, clock_s);
    if (frame !== this.frame) this.seek(frame);
    this.clock_s = clock_s;
    if (this.frame === this.frames - 1) this.setPlaying(false);
  }

  draw() {
    this.stage?.render(this.ticks(), this.display);
  }
}

// For scripts: crease.ready, then crease.seek(tick), crease.look(replay).
window.crease = {
  ready: (async () => {
    const header = JSON.parse(find("header").textContent);
    const player = new Player(header, await decodeArrays(find("data").textContent, header.arrays));
    Object.assign(window.crease, {
      player,
      frames: player.frames,
      seek: (frame) => player.seek(frame),
      draw: () => player.draw(),
      // Pose (16 numbers, columns first) and force of a replay in the tick shown, samples drawn in contact, and cursor in s.
      look: (i) => {
        const tick = player.ticks()[i], { contacts } = header.replays[i];
        player.draw();
        return {
          tick, tool: player.stage.toolMatrix(i, tick, player.display).elements, force_N: vector(player.replays[i].force_N, tick).toArray(),
          samples: player.stage.samples[contacts].now.reduce((sum, state) => sum + (state > 0), 0), cursor_s: player.plots.time_s,
        };
      },
    });
  })(),
};
