/** Files that a user chooses or drops. */

/** Calls `take` with the files chosen in `input`. */
export function listenForChosen(input: HTMLInputElement, take: (files: File[]) => void): void {
  input.addEventListener("change", () => {
    const files = [...(input.files ?? [])];
    // So that choosing the same file again is a change.
    input.value = "";
    if (files.length > 0) take(files);
  });
}

/** Calls `take` with files dropped anywhere on the page while `panel` is shown; `zone` tells that they may be dropped. */
export function listenForDropped(panel: HTMLElement, zone: HTMLElement, take: (files: File[]) => void): void {
  const on = (name: "dragover" | "dragleave" | "drop", act: (event: DragEvent) => void) =>
    document.addEventListener(name, (event) => {
      // Whoever takes it: a dropped file must not replace the page.
      event.preventDefault();
      if (!panel.hidden) act(event);
    });
  on("dragover", () => zone.classList.add("over"));
  on("dragleave", (event) => !event.relatedTarget && zone.classList.remove("over"));
  on("drop", (event) => {
    zone.classList.remove("over");
    const files = [...(event.dataTransfer?.files ?? [])];
    if (files.length > 0) take(files);
  });
}
