"use strict";
(() => {
  const at = (id) => document.getElementById(id);
  const known = JSON.parse(at("designer").dataset.known);
  const shown = at("shown");
  const page = crypto.randomUUID();
  const PATIENCE = 250; // milliseconds that an answer may take before a newer question ends it
  const SPEAKING = 700; // milliseconds of rest before figures are spoken

  // --- what is asked for ---------------------------------------------------------------------------------------------

  const start = known.start;
  const state = {
    deriv: start.deriv, window: start.window_length, degree: start.degree, kappa: start.kappa, mu: start.mu,
    point: "center", lag: 0, seconds: 0, unit: known.delta === 1 ? "delta" : "fs", step: 0,
    column: 0, from: 0, to: known.shown,
  };
  const short = (value) => Number(value.toPrecision(12));
  state.step = state.unit === "fs" ? short(1 / known.delta) : known.delta;
  const delta = () => (state.unit === "fs" ? 1 / state.step : state.step);

  // The windows of the slider: every one at first, then odd ones, each about two percent longer than the last.
  const windows = [1];
  while (windows.at(-1) < known.slider) {
    const last = windows.at(-1);
    const next = Math.max(last + 1, Math.round(1.02 * last));
    windows.push(Math.min(next > 50 ? next | 1 : next, known.slider));
  }
  const place = (length) => {
    const found = windows.findIndex((one) => one >= length);
    return found < 0 ? windows.length - 1 : found;
  };

  const query = () => {
    const words = {
      window: state.window, deriv: state.deriv, degree: state.degree, kappa: state.kappa, mu: state.mu,
      [state.unit]: state.step, column: state.column, from: state.from, to: state.to, width: width(),
    };
    if (state.point === "samples") words.delay = short(state.lag * delta());
    else if (state.point === "time") words.delay = state.seconds;
    else words.tau = state.point;
    return words;
  };
  const width = () => {
    const figure = at("chart-signal"), style = getComputedStyle(figure);
    const inner = figure.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
    return Math.min(Math.max(Math.round(inner), 280), 1600);
  };
  const address = (path, words) => `${path}?${new URLSearchParams(words)}`;

  // --- asking: the newest question wins ------------------------------------------------------------------------------

  let number = 0, wanted = false, waiting = null, frame = 0;
  const changed = () => {
    wanted = true;
    frame ||= requestAnimationFrame(() => { frame = 0; ask(); });
  };
  const ask = async () => {
    if (!wanted) return;
    if (waiting) {
      // A young question is left to be answered, so that the picture moves with the slider.
      const old = waiting;
      old.timer ||= setTimeout(() => { if (wanted) old.abort.abort(); }, PATIENCE);
      return;
    }
    wanted = false;
    const words = query(), own = { abort: new AbortController(), timer: 0 };
    waiting = own;
    shown.setAttribute("aria-busy", "true");
    try {
      const found = await get("answer", words, own.abort.signal);
      if (found) show(found, words);
    } finally {
      clearTimeout(own.timer);
      waiting = null;
      if (wanted) changed();
      else shown.setAttribute("aria-busy", "false");
    }
  };
  const get = async (path, words, signal) => {
    try {
      const answer = await fetch(address(path, { ...words, page, n: ++number }), { signal, cache: "no-store" });
      const found = await answer.json();
      if (answer.ok) return found;
      if (answer.status !== 409) refuse(found.error, found.control);
    } catch (error) {
      if (error.name !== "AbortError") refuse("The server does not answer: is algdiff designer still running?", "");
    }
    return null;
  };

  // --- showing -------------------------------------------------------------------------------------------------------

  const controls = ["deriv", "window", "degree", "delay", "kappa", "mu", "step", "data", "from"];
  const refuse = (message, control) => {
    clear();
    shown.classList.add("stale");
    const beside = control && at(`${control}-error`);
    if (beside) {
      beside.textContent = message;
      at(control)?.setAttribute("aria-invalid", "true");
    } else {
      at("problem").textContent = message;
      at("problem").hidden = false;
    }
  };
  const clear = () => {
    shown.classList.remove("stale");
    at("problem").hidden = true;
    for (const name of controls) {
      at(`${name}-error`).textContent = "";
      at(name)?.removeAttribute("aria-invalid");
    }
  };
  const show = (found, words) => {
    clear();
    for (const [name, svg] of Object.entries(found.charts)) at(`chart-${name}`).innerHTML = svg;
    for (const output of document.querySelectorAll("[data-figure]")) {
      const name = output.dataset.figure;
      const [value, unit] = (found.shown[name] ?? "none").split(/(?=cycles\/sample)/);
      output.textContent = value;
      if (unit) output.append(broken(unit));
      output.dataset.value = JSON.stringify(found.figures[name] ?? null);
    }
    for (const [name, said] of Object.entries(found.words)) at(`${name}-said`).textContent = said;
    at("python").textContent = found.python;
    const list = document.createElement("ul");
    list.append(...found.warnings.map((one) => Object.assign(document.createElement("li"), { textContent: one })));
    at("warnings").replaceChildren(list);
    at("warnings").hidden = !found.warnings.length;
    for (const kind of ["json", "csv", "c"]) at(`export-${kind}`).href = address(`export/${kind}`, words);
    if (state.point in { center: 1, root: 1, newest: 1 }) {
      state.lag = found.figures.delay_samples;
      state.seconds = found.figures.delay;
      put();
    }
    speak(found.shown);
  };
  const broken = (unit) => {
    // A narrow box breaks before the unit, and a very narrow one behind its slash.
    const span = Object.assign(document.createElement("span"), { className: "unit" });
    const [first, ...rest] = unit.split(/(?<=\/)/);
    span.append(first, document.createElement("wbr"), ...rest);
    return span;
  };
  let speaking = 0;
  const speak = (said) => {
    clearTimeout(speaking);
    speaking = setTimeout(() => {
      at("spoken").textContent =
        `Window ${state.window} samples, degree ${state.degree}: delay ${said.delay}, noise gain ${said.noise_gain}, ` +
        `cutoff ${said.cutoff}, exact to degree ${said.exactness}.`;
    }, SPEAKING);
  };

  // --- controls ------------------------------------------------------------------------------------------------------

  const put = () => {
    // What is being typed is left alone.
    const set = (id, value) => { if (document.activeElement !== at(id) || !typing) at(id).value = value; };
    for (const name of ["deriv", "degree", "kappa", "mu"]) {
      set(name, state[name]);
      at(`${name}-slider`).value = state[name];
    }
    set("window", state.window);
    at("window-slider").max = windows.length - 1;
    at("window-slider").value = place(state.window);
    at("window-slider").setAttribute("aria-valuetext", `${state.window} samples`);
    at("point").value = state.point;
    set("delay", Number((state.point === "time" ? state.seconds : state.lag).toPrecision(6)));
    const slider = at("delay-slider");
    slider.max = state.window - 1;
    slider.step = Math.max(1, Math.round(state.window / 500));
    slider.value = state.lag;
    set("step", state.step);
    at("step-unit").value = state.unit;
    at("column").value = state.column;
    for (const name of ["from", "to"]) {
      set(name, Number(((known.first + state[name]) * delta()).toPrecision(7)));
      at(`${name}-slider`).value = Math.round((1000 * state[name]) / known.count);
    }
  };
  const fit = (name) => {
    // What cannot be meant otherwise: the other controls give way to the one that was moved.
    if (name === "deriv") state.degree = Math.max(state.degree, state.deriv);
    if (name === "degree") state.degree = Math.max(state.degree, state.deriv);
    state.window = Math.max(state.window, state.degree + 1);
    if (state.point === "samples") state.seconds = short(state.lag * delta());
    if (state.point === "time") state.lag = state.seconds / delta();
    put();
    changed();
  };

  let typing = false;
  const on = (id, kind, does) => at(id).addEventListener(kind, does);
  const read = (id, does) => {
    on(id, "input", () => { typing = true; });
    on(id, "change", () => {
      typing = false;
      const value = at(id).valueAsNumber;
      if (Number.isFinite(value)) does(value);
      else put();
    });
    on(id, "blur", () => { typing = false; put(); });
  };
  for (const name of ["deriv", "degree", "window"]) read(name, (value) => { state[name] = Math.round(value); fit(name); });
  for (const name of ["kappa", "mu"]) read(name, (value) => { state[name] = value; fit(name); });
  for (const name of ["deriv", "degree", "kappa", "mu"]) {
    on(`${name}-slider`, "input", () => { state[name] = at(`${name}-slider`).valueAsNumber; fit(name); });
  }
  on("window-slider", "input", () => { state.window = windows[at("window-slider").valueAsNumber]; fit("window"); });
  on("point", "change", () => {
    if (at("point").value === "samples") state.lag = Math.round(state.lag);
    state.point = at("point").value;
    fit("delay");
  });
  read("delay", (value) => {
    if (state.point !== "time") state.point = "samples";
    state[state.point === "time" ? "seconds" : "lag"] = value;
    fit("delay");
  });
  on("delay-slider", "input", () => {
    const samples = Math.min(at("delay-slider").valueAsNumber, state.window - 1);
    if (state.point !== "time") state.point = "samples";
    state.lag = samples;
    state.seconds = short(samples * delta());
    fit("delay");
  });
  read("step", (value) => { state.step = value; fit("step"); });
  on("step-unit", "change", () => {
    state.step = short(1 / state.step);
    state.unit = at("step-unit").value;
    fit("step");
  });
  on("column", "change", () => { state.column = Number(at("column").value); explain([]); fit("column"); });

  const LEAST = Math.min(8, known.count);
  const stretch = (name, sample) => {
    if (name === "from") state.from = Math.min(Math.max(sample, 0), known.count - LEAST);
    else state.to = Math.max(Math.min(sample, known.count), LEAST);
    if (name === "from") state.to = Math.max(state.to, state.from + LEAST);
    else state.from = Math.min(state.from, state.to - LEAST);
    put();
    changed();
  };
  for (const name of ["from", "to"]) {
    read(name, (value) => stretch(name, Math.round(value / delta()) - known.first));
    on(`${name}-slider`, "input", () => stretch(name, Math.round((known.count * at(`${name}-slider`).valueAsNumber) / 1000)));
  }
  on("whole", "click", () => { state.from = 0; state.to = known.count; put(); changed(); });

  const explain = (lines) => {
    at("explanation").textContent = lines.slice(0, 2).join(" ");
    at("rest").textContent = lines.slice(2).join(" ");
    at("more").hidden = lines.length < 3;
  };
  on("choose", "click", async () => {
    const button = at("choose");
    button.disabled = true;
    const { deriv, column } = state;
    const found = await get("suggestion", { deriv, column, [state.unit]: state.step });
    button.disabled = false;
    button.focus();
    if (!found) return;
    Object.assign(state, found.chosen, { window: found.chosen.window_length, point: "center" });
    explain(found.explanation);
    fit("data");
  });
  on("copy", "click", async () => {
    try {
      await navigator.clipboard.writeText(at("python").textContent);
      at("copied").textContent = "Copied.";
    } catch {
      getSelection().selectAllChildren(at("python"));
      at("copied").textContent = "Selected: copy it by hand.";
    }
    setTimeout(() => { at("copied").textContent = ""; }, 3000);
  });
  on("controls", "submit", (event) => event.preventDefault());
  let size = 0;
  addEventListener("resize", () => { if (width() !== size) { size = width(); changed(); } });

  size = width();
  put();
  changed();
})();
