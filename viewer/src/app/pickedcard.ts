import type { AttributeValue } from "../core/attributes.js";
import type { Picked } from "../three/picker.js";

/** The attribute that a thing is called by, if it has one. */
const NAME = "name";

/** The card that says what was clicked. */
export class PickedCard {
  /** close: what its button does. */
  constructor(
    private readonly root: HTMLElement,
    private readonly close: () => void,
  ) {}

  get isOpen(): boolean {
    return !this.root.hidden;
  }

  /** Says what an object is, with all that is known of it. */
  show({ id, attributes, position }: Picked): void {
    const name = attributes[NAME];
    const title = id === null ? "No object" : name === undefined ? `Object ${id}` : String(name);
    const place = ["x", "y", "z"].map((axis, a): [string, string] => [axis, `${position[a]!.toFixed(2)} m`]);
    const rows: [string, AttributeValue][] = [...(id === null ? [] : [["id", id] as [string, number]]), ...Object.entries(attributes), ...place];
    const parts: HTMLElement[] = [tableOf(rows)];
    if (id !== null && Object.keys(attributes).length === 0) parts.push(element("p", "It has no attributes."));
    this.fill(title, parts);
  }

  /** Says that the answer is on its way. */
  wait(): void {
    this.fill("Looking …", []);
  }

  /** Says why there is no answer. */
  fail(what: string): void {
    this.fill("Not known", [element("p", what)]);
  }

  hide(): void {
    this.root.hidden = true;
  }

  private fill(title: string, parts: readonly HTMLElement[]): void {
    const header = document.createElement("header");
    const button = element("button", "×");
    button.setAttribute("aria-label", "Close");
    button.addEventListener("click", this.close);
    header.append(element("h1", title), button);
    const body = document.createElement("div");
    body.className = "body";
    body.append(...parts);
    this.root.replaceChildren(header, ...(parts.length > 0 ? [body] : []));
    this.root.hidden = false;
    this.root.scrollTop = 0;
  }
}

function tableOf(rows: readonly (readonly [string, AttributeValue])[]): HTMLElement {
  const table = document.createElement("table");
  for (const [name, value] of rows) {
    const head = document.createElement("th");
    head.scope = "row";
    head.textContent = name;
    const row = table.insertRow();
    row.append(head);
    row.insertCell().textContent = String(value);
  }
  return table;
}

function element(name: string, text: string): HTMLElement {
  const made = document.createElement(name);
  made.textContent = text;
  return made;
}
