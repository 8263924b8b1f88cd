export function start(panel: HTMLElement): void {
  panel.textContent = "";
}
