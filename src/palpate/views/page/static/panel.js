// The panel over the picture in an experiment: texts, questions with buttons and keys, pauses. `order` sends the answers.

const cover = document.getElementById("panel");
let now = null, since = 0, clock = 0;

export function panel(told, order) {
  document.body.classList.toggle("experiment", Boolean(told));
  if (!told || told.shown === now?.told.shown) return;
  clearInterval(clock);
  now = { told, order, left: Math.ceil(told.wait ?? 0) };
  document.body.classList.toggle("interval", Boolean(told.interval));
  cover.hidden = Boolean(told.interval);
  since = performance.now();
  if (told.interval) { document.getElementById("view").focus(); return; }
  fill();
  if (now.left) clock = setInterval(() => { if (--now.left <= 0) clearInterval(clock); fill(); }, 1000);
}

function fill() {
  const { told, left } = now, parts = [make("h1", told.title), ...(told.text ?? "").split(/\n\s*\n/).map((text) => make("p", text))];
  if (told.number) parts.push(field());
  const buttons = make("div", "");
  for (const { label, key, answer } of told.buttons ?? []) {
    const button = make("button", label);
    button.append(make("kbd", key)); button.disabled = left > 0;
    button.addEventListener("click", () => done(answer));
    buttons.append(button);
  }
  if (left > 0) buttons.append(make("small", `${left} s`));
  cover.replaceChildren(...parts, buttons);
  (cover.querySelector("input") ?? document.activeElement)?.focus?.();
}

function field() {
  const form = make("form", ""), input = Object.assign(make("input", ""), { type: "number", min: 0, step: "any", required: true });
  input.setAttribute("aria-label", now.told.title);
  form.append(input, make("button", "answer"));
  form.addEventListener("submit", (event) => { event.preventDefault(); done(input.value); });
  return form;
}

const make = (kind, text) => Object.assign(document.createElement(kind), { textContent: text });

function done(answer) {
  now.order({ shown: now.told.shown, answer, seconds: 1e-3 * (performance.now() - since) });
}

// A key press counts once; repeats of a key that is held down are ignored. A foot pedal acts as a keyboard.
window.addEventListener("keydown", (event) => {
  if (!now || event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
  const pressed = event.key.toLowerCase();
  if (now.told.interval) {
    if (pressed !== now.told.end_key?.toLowerCase()) return;
    done("");
  } else {
    const button = now.left > 0 ? null : (now.told.buttons ?? []).find(({ key }) => key.toLowerCase() === pressed);
    if (!button) return;
    done(button.answer);
  }
  event.preventDefault(); event.stopPropagation();
}, true);
