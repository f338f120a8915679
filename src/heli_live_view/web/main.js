// SPDX-License-Identifier: Apache-2.0
// Puts the page together: messages in, thirty frames a second out.

import { Alarms } from "./alarms.js";
import { Charts } from "./charts.js";
import { Commands } from "./commands.js";
import { Connection } from "./connection.js";
import { Flight } from "./flight.js";
import { fixed, put } from "./format.js";
import { Actuators, BoundsTable, TopLine, WindCompass } from "./gauges.js";
import { Horizon } from "./horizon.js";
import { Replay } from "./replay.js";
import { Scene3d } from "./scene3d.js";
import { Theme } from "./theme.js";
import { Track } from "./track.js";

const FRAME_MS = 1000 / 30;
const WORDS_MS = 125;

const byId = (id) => document.getElementById(id);
const { title } = document;
const theme = new Theme(byId("theme"));
const flight = new Flight();
const wish = new URLSearchParams(location.search).get("quality") ?? "auto";
const scene = new Scene3d(byId("scene"), {
  buttons: [...document.querySelectorAll("[data-camera]")], fallback: byId("scene-fallback"), labels: byId("labels"),
  altitude: byId("s-altitude"), distance: byId("s-distance"), rotor: byId("s-rotor"), note: byId("scene-note"),
}, theme, wish);
const horizon = new Horizon(byId("horizon"), theme);
const charts = new Charts(byId("charts"), theme);
const track = new Track(byId("track"), byId("track-scale"), theme, (e, n) => commands.picked(e, n));
const wind = new WindCompass(byId("wind"), {
  speed: byId("wind-speed"), from: byId("wind-from"), nose: byId("wind-nose"), up: byId("wind-up"),
}, theme);
const bounds = new BoundsTable(byId("bounds"));
const actuators = new Actuators(byId("actuators"));
const topLine = new TopLine({
  name: byId("flight-name"), mode: byId("mode"), time: byId("time"), rtf: byId("rtf"), rtfName: byId("rtf-name"), gps: byId("gps"),
});
const alarms = new Alarms({ nodes: byId("nodes"), alarms: byId("alarms"), events: byId("events") }, (t) => replay.jump(t));
const commands = new Commands(byId("commands"), byId("permission"), byId("ask"), (message) => connection.send(message), track);
const replay = new Replay(byId, flight, (message) => connection.send(message));
const sources = [...document.querySelectorAll("input[name=source]")];
for (const input of sources) {
  input.addEventListener("change", () => {
    flight.source = input.value;
  });
}

function hello(message) {
  flight.hello(message);
  topLine.flight(message);
  commands.permit(message);
  replay.hello(message);
  // After the flight its report is served here: look for it often.
  connection.longest = message.after ? 1 : 8;
  scene.setRadius(message.aircraft?.rotor_radius_m || 0.7);
  put(byId("foxglove"), message.foxglove_url ? `All topics for Foxglove: ${message.foxglove_url}` : "");
}

const scheme = location.protocol === "https:" ? "wss" : "ws";
const connection = new Connection(`${scheme}://${location.host}/ws`, {
  hello,
  state: (message) => {
    flight.state(message);
    replay.state(message);
  },
  event: (message) => flight.event(message),
  answer: (message) => commands.answer(message),
  change: () => tellConnection(),
});
byId("retry").addEventListener("click", () => connection.connect());
connection.connect();

// How each kind of end is called: its word in the chip, and the beginning of the sentence on top.
const ENDS = {
  lost: ["lost", (t) => `LOST after ${t}.`],
  over: ["flight over", (t) => `The flight is over after ${t}.`],
  interrupted: ["interrupted", (t) => `Interrupted after ${t}.`],
  silent: ["signal lost", (t) => `Signal lost after ${t}.`],
};
const NOT_HELD = "Attitude only: nothing holds position and altitude. The helicopter drifts with the wind and sinks or climbs.";

// What the user must know about what is shown: [state of the chip, its text, sentence of the banner, its countdown].
function situation() {
  const { open, everOpen, retryAt } = connection;
  const { end } = flight;
  if (replay.shown) return replay.situation(connection, ENDS);
  const pause = retryAt === null ? "Trying now." : `Next try in ${Math.max(0, Math.ceil((retryAt - performance.now()) / 1000))} s.`;
  if (end) {
    const [word, sentence] = ENDS[end.kind];
    const cause = end.kind === "over" ? "" : ` ${end.text}`;
    const gone = open ? "" : flight.info?.after ? " Its report is being written: this page will show it, and the flight again." : " Its server has ended, too.";
    return [end.kind, word, `${sentence(fixed(flight.last.t, 1, "s"))}${cause} What is shown is its end.${gone}`, open ? "" : pause];
  }
  if (!open) {
    if (!everOpen && retryAt === null) return ["stale", "connecting", "", ""];
    return ["offline", "no connection", "No connection to the flight. What is shown is the last that came.", pause];
  }
  if (!flight.last) return ["stale", "waiting", "Connected. Waiting for the flight to begin.", ""];
  if (flight.stale) {
    const silent = flight.silentMs > 1500;
    const since = `For ${fixed((silent ? flight.silentMs : flight.standingMs) / 1000, 0)} s.`;
    return ["stale", "stale", silent ? "No state comes. What is shown is old." : "The flight's clock stands still. What is shown is old.", since];
  }
  return ["live", "live", flight.last.mode === "attitude" ? NOT_HELD : "", ""];
}

function tellConnection() {
  const { end } = flight;
  const [state, word, sentence, count] = situation();
  const chip = byId("connection");
  chip.dataset.state = state;
  put(byId("connection-text"), word);
  const banner = byId("banner");
  banner.dataset.state = state;
  banner.hidden = !sentence;
  put(byId("banner-text"), sentence);
  // By itself, so that a screen reader says the sentence once and does not count.
  put(byId("banner-count"), count);
  replay.tellReport(byId("banner-report"), Boolean(sentence) && Boolean(end));
  byId("retry").hidden = connection.open || connection.retryAt === null;
  document.body.dataset.live = String(["live", "replay"].includes(state) || Boolean(flight.end));
  const name = replay.shown ? title.replace("Live view", "Replay") : title;
  document.title = state === "lost" ? `✖ LOST · ${name}` : name;
}

// The climb's figures, once the reference has arrived.
function tellClimb(climb) {
  const figure = (value, unit) => (value === null ? "not reached" : `${fixed(value, 2)} ${unit}`);
  byId("climb").hidden = !climb;
  if (!climb) return;
  const { climb_overshoot: over, climb_time: time, climb_lag: lag } = climb;
  put(byId("climb"), `climb: overshoot ${figure(over, "m")}, time ${figure(time, "s")}, lag ${figure(lag, "s")}`);
}

function tellSource(state, shown) {
  for (const input of sources) {
    input.disabled = Boolean(state) && !state[input.value];
    input.checked = input.value === shown;
  }
  const source = shown === "nav" ? "navigation, as in the paper" : "ground truth";
  const since = flight.last?.largest?.since_s ?? 0;
  tellClimb(flight.last?.largest?.climb?.[shown]);
  put(byId("bounds-of"), since > 1 ? `${source}, from ${since.toFixed(0)} s on` : source);
}

let [lastFrame, lastWords, frames, fps, counted] = [performance.now(), 0, 0, 0, performance.now()];
let work = 0;

function words(state, shown) {
  topLine.update(flight.last ?? flight.waiting);
  scene.tell(state, shown);
  const psi = state?.[shown]?.euler_deg[2];
  wind.draw(state?.wind_enu, psi);
  wind.tell(state?.wind_enu, psi);
  bounds.update(state, flight, shown);
  actuators.update(state?.u);
  alarms.update(flight.last ?? flight.waiting, flight);
  commands.update(flight.last, flight, connection.open);
  tellSource(state, shown);
  tellConnection();
  const drawing = scene.renderer ? `${scene.software ? "software 3-D" : "3-D"} at ${Math.round(100 * scene.renderer.getPixelRatio())} %` : "no 3-D";
  put(byId("performance"), `${fps.toFixed(0)} frames/s, ${drawing}`);
}

function frame(now) {
  requestAnimationFrame(frame);
  // Half a screen's refresh of tolerance: a 60 Hz screen gives every second frame, not every third.
  if (now - lastFrame < FRAME_MS - 8) return;
  const [begun, dt] = [performance.now(), Math.min(0.2, (now - lastFrame) / 1000)];
  scene.adapt(now - lastFrame);
  lastFrame = now;
  frames += 1;
  if (now - counted >= 1000) [fps, frames, counted] = [(1000 * frames) / (now - counted), 0, now];
  const state = flight.sample(now);
  const shown = flight.shown(state);
  scene.draw(state, flight, shown, dt);
  horizon.draw(state?.[shown], state?.ref, state?.setpoint_deg);
  charts.update(flight, shown);
  if (now - lastWords >= WORDS_MS) {
    lastWords = now;
    track.draw(state, flight, shown);
    words(state, shown);
  }
  work = 0.95 * work + 0.05 * (performance.now() - begun);
}
requestAnimationFrame(frame);

// For tests, and for whoever wants to know: what is drawn, where, how fast.
window.heliView = {
  flight, connection, scene, parts: { horizon, charts, track },
  get fps() { return fps; },
  get workMs() { return work; },
  projected: () => scene.projected(),
  pixels: (x, y, half) => scene.pixels(x, y, half),
};
