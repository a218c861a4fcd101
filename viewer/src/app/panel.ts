/** The panel: figures on top, then light and quality, each a row made from a short description. */

/** A box to be ticked. */
export interface Toggle {
  readonly label: string;
  readonly on: () => boolean;
  readonly turn: (on: boolean) => void;
}

/** A slider of the panel. */
export interface Control {
  readonly label: string;
  readonly min: number;
  readonly max: number;
  readonly step: number;
  readonly unit?: string;
  /** What is shown of a value; by default the number and the unit. */
  readonly text?: (value: number) => string;
  readonly get: () => number;
  readonly set: (value: number) => void;
}

export interface PanelParts {
  readonly title: string;
  readonly light: readonly (Control | Toggle)[];
  readonly quality: readonly (Control | Toggle)[];
  readonly home: () => void;
  readonly share: () => void;
}

/** Screens on which the panel begins folded: it would hide most of the picture. */
const SMALL = "(max-width: 760px), (max-height: 560px)";

const HELP = "Drag to orbit, right-drag to look, shift-drag to shift, wheel to approach; W A S D Q E to fly, shift for faster; click to ask what is there.";

export class Panel {
  private readonly figures = document.createElement("dl");
  private readonly rows = new Map<string, HTMLElement>();
  private readonly refreshers: (() => void)[] = [];

  constructor(root: HTMLElement, parts: PanelParts) {
    const body = make("div", "body");
    const toggle = button("–", () => fold(!body.hidden));
    const fold = (folded: boolean): void => {
      body.hidden = folded;
      toggle.textContent = folded ? "+" : "–";
      toggle.setAttribute("aria-expanded", String(!folded));
      toggle.setAttribute("aria-label", folded ? "Show figures and controls" : "Hide figures and controls");
    };
    const title = make("h1");
    title.textContent = parts.title;
    const header = make("header");
    header.append(title, toggle);
    const row = make("div", "row");
    row.append(button("Whole world", parts.home), button("Copy link", parts.share));
    const help = make("p", "help");
    help.textContent = HELP;
    body.append(heading("Figures"), this.figures, heading("Light"), ...this.controls(parts.light));
    body.append(heading("Quality"), ...this.controls(parts.quality), row, help);
    root.replaceChildren(header, body);
    fold(matchMedia(SMALL).matches);
  }

  /** Shows figures in the order given; unknown ones get a row. */
  show(figures: Readonly<Record<string, string>>): void {
    for (const [name, value] of Object.entries(figures)) {
      const known = this.rows.get(name) ?? this.addRow(name);
      if (known.textContent !== value) known.textContent = value;
    }
  }

  /** Brings the sliders to what they stand for now. */
  refresh(): void {
    for (const refresh of this.refreshers) refresh();
  }

  private addRow(name: string): HTMLElement {
    const [term, value] = [make("dt"), make("dd")];
    term.textContent = name;
    this.figures.append(term, value);
    this.rows.set(name, value);
    return value;
  }

  private controls(list: readonly (Control | Toggle)[]): HTMLElement[] {
    return list.map((control) => ("turn" in control ? this.toggle(control) : this.slider(control)));
  }

  private toggle({ label, on, turn }: Toggle): HTMLElement {
    const [row, name, input] = [make("label"), make("span"), document.createElement("input")];
    name.textContent = label;
    input.type = "checkbox";
    input.addEventListener("change", () => turn(input.checked));
    this.keep(() => (input.checked = on()));
    row.append(name, input);
    return row;
  }

  private slider({ label, min, max, step, unit = "", text, get, set }: Control): HTMLElement {
    const [row, name, input, output] = [make("label"), make("span"), document.createElement("input"), make("output")];
    name.textContent = label;
    Object.assign(input, { type: "range", min, max, step });
    const refresh = (): void => {
      input.value = String(get());
      output.textContent = text?.(get()) ?? `${Math.round(get() * 100) / 100}${unit}`;
    };
    input.addEventListener("input", () => {
      set(input.valueAsNumber);
      refresh();
    });
    this.keep(refresh);
    row.append(name, input, output);
    return row;
  }

  private keep(refresh: () => void): void {
    this.refreshers.push(refresh);
    refresh();
  }
}

function make(name: string, className = ""): HTMLElement {
  const made = document.createElement(name);
  if (className) made.className = className;
  return made;
}

function heading(text: string): HTMLElement {
  const made = make("h2");
  made.textContent = text;
  return made;
}

function button(text: string, use: () => void): HTMLElement {
  const made = make("button");
  made.textContent = text;
  made.addEventListener("click", use);
  return made;
}
