/** Beside what was scrolled to, CSS pixels. */
const ROOM = 4;

/** The element with this id; the page is broken without it. */
export function element<T extends HTMLElement>(id: string): T {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no #${id}`);
  return found as T;
}

/** Makes an element. */
export function make<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  properties: { class?: string; text?: string; part?: string } = {},
  ...children: Node[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  if (properties.class) made.className = properties.class;
  if (properties.text !== undefined) made.textContent = properties.text;
  if (properties.part) made.dataset.part = properties.part;
  made.append(...children);
  return made;
}

/** A button that looks like a link; `label` is what it is called where its words alone say too little. */
export function textButton(text: string, name: string, label: string, act: () => void): HTMLButtonElement {
  const made = make("button", { class: "text-button", text, part: name });
  made.type = "button";
  made.setAttribute("aria-label", label);
  made.addEventListener("click", act);
  return made;
}

/** Scrolls a list so far that one of its items is seen; the page itself does not jump. */
export function reveal(item: HTMLElement, list: HTMLElement): void {
  const { offsetTop, offsetHeight } = item;
  if (offsetTop < list.scrollTop) list.scrollTop = offsetTop - ROOM;
  else if (offsetTop + offsetHeight > list.scrollTop + list.clientHeight) list.scrollTop = offsetTop + offsetHeight + ROOM - list.clientHeight;
}

/** The 2D context of a canvas. */
export function contextOf(canvas: HTMLCanvasElement): CanvasRenderingContext2D {
  const context = canvas.getContext("2d");
  if (!context) throw new Error("this browser gives no 2D canvas");
  return context;
}

/** The message of anything that was thrown. */
export function messageOf(thrown: unknown): string {
  return thrown instanceof Error ? thrown.message : String(thrown);
}
