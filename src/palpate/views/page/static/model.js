// The bodies from the fast to the exact one, with the error and the time of each; and the list of what runs and what does not.

const $ = (id) => document.getElementById(id);
const short = (name) => name.split(".").pop();
const micro = (seconds) => `${Number((1e6 * seconds).toPrecision(2))} µs`;

export class Bodies {
  constructor(order) {
    this.order = order; this.names = []; this.here = new Map(); this.figures = null;
    $("exact").addEventListener("input", () => this.label());
    $("exact").addEventListener("change", () => order({ body: this.names[$("exact").value] }));
    $("measure").addEventListener("click", () => order({ measure: true }));
  }

  // A run has begun. figures: error and time of each body (`studies/body_figures.py`), if they are measured.
  begin({ body, figures, measures }) {
    this.body = body; this.measures = measures;
    this.show(figures ?? this.figures);
  }

  show(figures) {
    this.figures = figures;
    const known = figures?.bodies ?? {}, offered = [...$("body").options].map(({ value }) => value);
    this.names = offered.filter((name) => known[name]).sort((a, b) => known[b].error - known[a].error);
    $("exactness").hidden = this.names.length < 2;
    $("measure").hidden = !this.measures || Boolean(figures);
    $("exact").max = Math.max(this.names.length - 1, 0);
    $("exact").value = Math.max(this.names.indexOf(this.body), 0);
    this.label();
  }

  label() {
    const { names, figures } = this, name = names[$("exact").value], one = figures?.bodies?.[name];
    $("priced").textContent = figures?.running ? "measuring each body; the run goes on" : figures?.why ? `not measured: ${figures.why}` : "";
    if (!one) return;
    const here = this.here.get(name), base = short(figures.reference);
    $("exact").setAttribute("aria-valuetext", short(name));
    $("priced").textContent = `${short(name)}: error ${Number((100 * one.error).toPrecision(2))} % of the peak force, ${micro(one.time)} a tick${here ? `, here ${micro(here)}` : ""}`;
    $("priced").title = `RMS error on the touch of this graph against ${base}, whose known error of ${Number((100 * figures.known).toPrecision(2))} % is included; median time of a tick as palpate tune measures it, and that of this run`;
  }

  // The time [s] of a tick in this run.
  took(seconds) {
    if (!(seconds > 0)) return;
    this.here.set(this.body, seconds);
    if (this.names[$("exact").value] === this.body) this.label();
  }
}

// Nodes that run; nodes and effects that do not, each with the rule that decided, as `palpate plan` lists them.
export function list(plan) {
  $("plan").hidden = !plan;
  if (!plan) return;
  const off = plan.effects.filter(([, on]) => !on), count = plan.left_out.length;
  $("planned").textContent = `${plan.runs.length} nodes run, ${count} ${count === 1 ? "does" : "do"} not`;
  const entry = ([name, text, about]) => {
    const both = [make("dt", name), make("dd", text)];
    if (about) both[1].title = about;
    return both;
  };
  const group = (title, rows) => {
    const list = make("dl", "");
    list.append(...rows.flatMap(entry));
    return rows.length ? [make("h3", title), list] : [];
  };
  $("runs").replaceChildren(
    ...group("left out, and why", plan.left_out),
    ...group("effects that are not computed", off.map(([name, , rule, about]) => [name, rule, about])),
    ...group("runs", plan.runs),
  );
}

const make = (kind, text) => Object.assign(document.createElement(kind), { textContent: text });
