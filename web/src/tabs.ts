/** The steps as tabs: arrow keys move, the address remembers, and a step's code is fetched when it is first opened. */
import { element, make, messageOf } from "./dom";

/** What fills a step's panel. */
type Start = (panel: HTMLElement) => void | Promise<void>;

const STEPS: Record<string, () => Promise<{ start: Start }>> = {
  video: () => import("./video"),
  calibrate: () => import("./calibrate"),
  label: () => import("./label"),
  tune: () => import("./tune"),
};

const started = new Set<string>(["try"]);

/** Shows the step that the address names, and listens. */
export function startTabs(): void {
  const list = element("steps");
  const tabs = [...list.querySelectorAll<HTMLButtonElement>('[role="tab"]')];
  for (const tab of tabs) tab.addEventListener("click", () => (location.hash = nameOf(tab)));
  list.addEventListener("keydown", (event) => {
    const from = tabs.indexOf(document.activeElement as HTMLButtonElement);
    const steps: Record<string, number> = { ArrowRight: from + 1, ArrowLeft: from - 1, Home: 0, End: -1 };
    const to = steps[event.key];
    if (to === undefined || from < 0) return;
    event.preventDefault();
    const tab = tabs.at(to % tabs.length);
    tab?.focus();
    tab?.click();
  });
  const follow = () => void show(tabs, location.hash.slice(1));
  addEventListener("hashchange", follow);
  follow();
}

function nameOf(tab: HTMLElement): string {
  return tab.id.replace(/^tab-/, "");
}

async function show(tabs: HTMLButtonElement[], requested: string): Promise<void> {
  const chosen = tabs.find((tab) => nameOf(tab) === requested) ?? tabs[0];
  for (const tab of tabs) {
    const isChosen = tab === chosen;
    tab.setAttribute("aria-selected", String(isChosen));
    tab.tabIndex = isChosen ? 0 : -1;
    element(`panel-${nameOf(tab)}`).hidden = !isChosen;
  }
  document.title = chosen && chosen !== tabs[0] ? `${chosen.textContent} · gravisight` : "gravisight";
  // On a phone not all tabs are in sight.
  chosen?.scrollIntoView({ block: "nearest", inline: "center" });
  const name = chosen ? nameOf(chosen) : "try";
  const load = STEPS[name];
  if (!load || started.has(name)) return;
  started.add(name);
  const panel = element(`panel-${name}`);
  panel.replaceChildren(make("p", { class: "waiting", text: "Loading…" }));
  try {
    const { start } = await load();
    panel.replaceChildren();
    await start(panel);
  } catch (thrown) {
    started.delete(name);
    const alert = make("p", { class: "alert", text: `This step could not be loaded: ${messageOf(thrown)}` });
    alert.setAttribute("role", "alert");
    panel.replaceChildren(alert);
  }
}
