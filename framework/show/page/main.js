// The page: one column a film (or one robot to move by hand), one clock for all.

const HELD = 2; // seconds for which a playing film stands at a singular instant
const SNAP = 0.006; // share of the duration within which the time bar takes to a singular instant

class Clock {
  constructor(films, bar) {
    this.films = films;
    this.duration = Math.max(...films.map(({ duration }) => duration));
    this.instants = [...new Set(films.flatMap(({ content }) => content.instants.map(({ time }) => time)))].sort((a, b) => a - b);
    this.holding = 0; // seconds for which it still stands
    this.t = 0;
    this.playing = false;
    bar.innerHTML = `<button class="play" type="button">▶ Play</button>
      <button class="telling" type="button" title="each scene at its own singular instant">At the singularity</button>
      <input type="range" class="bar" min="0" max="${this.duration}" step="any" value="0" aria-label="time">
      <span class="clock"></span>
      <label><span class="what">speed</span> <select class="speed" aria-label="speed">${[1, 0.5, 0.25, 0.1, 0.05].map((value) =>
        `<option value="${value}">${value === 1 ? "real time" : `× ${value}`}</option>`).join("")}</select></label>`;
    this.button = bar.querySelector(".play");
    this.bar = bar.querySelector(".bar");
    this.clock = bar.querySelector(".clock");
    this.speed = bar.querySelector(".speed");
    this.speed.value = this.duration < 4 ? "0.25" : "1";
    this.button.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
    const telling = bar.querySelector(".telling");
    telling.addEventListener("click", () => this.tell());
    if (!this.instants.length) telling.remove();
    this.bar.addEventListener("input", () => this.take(Number(this.bar.value)));
    // the space bar plays as long as the scene is in sight, but for what it operates itself
    const plays = (event) => {
      const { top, bottom } = byId("stage").getBoundingClientRect();
      return event.code === "Space" && bottom > 0 && top < innerHeight && !event.target.closest("button, select, a, summary");
    };
    // so do the arrow keys lead it, in hundredths
    document.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: -1, ArrowRight: 1 }[event.code];
      const { top, bottom } = byId("stage").getBoundingClientRect();
      if (!way || event.defaultPrevented || bottom <= 0 || top >= innerHeight) return;
      if (event.target.closest("input, select, textarea, [tabindex]")) return;
      event.preventDefault();
      this.take(this.t + (way * this.duration) / 100);
    });
    document.addEventListener("keydown", (event) => {
      if (!plays(event)) return;
      event.preventDefault();
      if (!event.repeat) this.button.click();
    }, true);
    document.addEventListener("keyup", (event) => { if (plays(event)) event.preventDefault(); }, true);
  }

  // What a hand leads to: a time, or the singular instant that it means.
  take(t) {
    this.pause();
    const near = this.instants.find((instant) => Math.abs(instant - t) < SNAP * this.duration);
    this.seek(near === undefined ? t : near);
  }

  seek(t) {
    this.t = Math.min(Math.max(t, 0), this.duration);
    this.bar.value = this.t;
    this.bar.setAttribute("aria-valuetext", `${this.t.toFixed(3)} seconds of ${this.duration}`);
    this.clock.textContent = `${this.t.toFixed(3)} of ${this.duration} s`;
    for (const film of this.films) film.show(this.t);
  }

  // Each film at its own singular instant, one that has none at that of the last which has.
  tell() {
    this.pause();
    const own = this.films.map((film) => film.tellingTime);
    const last = own.filter((t) => t !== null).pop();
    this.seek(last === undefined ? 0.5 * this.duration : last);
    own.forEach((t, k) => { if (t !== null) this.films[k].show(t); });
    const told = [...new Set(own.filter((t) => t !== null))];
    if (told.length > 1) this.clock.textContent = told.map((t) => `${t.toFixed(3)} s`).join(", ");
  }

  play() {
    if (this.t >= this.duration) this.t = 0;
    this.playing = true;
    this.button.textContent = "❚❚ Pause";
    let last = performance.now(), rest = 0;
    const step = (now) => {
      if (!this.playing) return;
      const passed = (now - last) / 1000;
      last = now;
      if (this.t >= this.duration && (rest += passed) > 1.2) { this.t = 0; rest = 0; }
      else if (this.holding > 0) this.holding -= passed;
      else if (this.t < this.duration) this.advance(passed);
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  // Slower near a singular instant, and never past one without standing there.
  advance(passed) {
    const apart = Math.min(...this.instants.map((instant) => Math.abs(instant - this.t)), this.duration);
    const slow = Math.min(1, 0.2 + 0.8 * (apart / (0.08 * this.duration)));
    const next = this.t + Math.min(passed, 0.1) * Number(this.speed.value) * slow;
    const instant = this.instants.find((time) => this.t < time && time <= next);
    if (instant !== undefined) this.holding = HELD;
    this.seek(instant === undefined ? next : instant);
  }

  pause() {
    this.playing = false;
    this.holding = 0;
    this.button.textContent = "▶ Play";
  }
}

// Side by side, the views take what height the two upper curves leave of the window.
function fillHeight(films, columns) {
  if (isOnPaper()) { columns.style.removeProperty("--view-height"); return; }
  const bottom = (film) => {
    const chart = columns.querySelectorAll(".side")[films.indexOf(film)].querySelectorAll(".chart")[1];
    return chart ? chart.getBoundingClientRect().bottom + scrollY - film.view.element.offsetHeight : 0;
  };
  const taken = Math.max(...films.map(bottom)) + byId("controls").offsetHeight;
  columns.style.setProperty("--view-height", `${Math.max(200, innerHeight - taken - 2)}px`);
}

function start() {
  const contents = data, columns = byId("columns");
  const section = () => {
    const made = columns.appendChild(document.createElement("section"));
    made.className = contents.length === 1 ? "column single" : "column";
    return made;
  };
  if (contents[0].kind === "hand") {
    const hand = new Hand(section(), contents[0]);
    window.crossing = { hand };
    onNewWidth(() => hand.view.resize(), (isPrinted) => hand.view.onPaper(isPrinted));
    return;
  }
  const limit = Math.max(...contents.map((content) => content.torque_limit));
  const force = Math.max(...contents.flatMap(({ power }) => [...decoded(power)].map(Math.abs)).filter(isFinite));
  contents.forEach((content) => { content.shared_limit = limit; content.shared_force = force; });
  const sprung = contents.filter(({ springs }) => springs);
  for (const part of ["slide", "turn"]) { // one factor for all, as one legend tells it
    const factors = sprung.map(({ springs }) => springs.factors[part]).filter(Boolean);
    for (const { springs } of sprung) if (springs.factors[part]) springs.factors[part] = Math.min(...factors);
  }
  byId("legend").dataset.columns = contents.length;
  let clock = null;
  byId("controls").innerHTML = "<button>Play</button>"; // as high as it will be
  const sections = contents.map(section); // all of them, so that each knows its width
  const films = contents.map((content, k) => new Film(sections[k], content, (t) => clock.take(t)));
  clock = new Clock(films, byId("controls"));
  window.crossing = { films, clock };
  const makeRoom = () => {
    const shown = films.map((film) => film.shown);
    for (const film of films) film.layCurves();
    const height = Math.max(...films.map((film) => film.wordiest));
    for (const film of films) film.caption.style.height = `${height}px`;
    if (films.length > 1) fillHeight(films, columns);
    films.forEach((film, k) => film.show(shown[k]));
  };
  makeRoom();
  onNewWidth(makeRoom, (isPrinted) => { // the scenes stand below one another
    clock.pause();
    for (const { view } of films) view.onPaper(isPrinted);
  });
  const asked = /[#&]t=([\d.]+|singular)/.exec(location.hash);
  if (asked && asked[1] === "singular") { clock.tell(); return; }
  clock.seek(asked ? Number(asked[1]) : 0);
  if (!asked && !matchMedia("(prefers-reduced-motion: reduce)").matches) clock.play();
}

start();
