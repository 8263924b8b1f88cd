/** A label with a file input in it that takes dropped files, too. */

/** Calls `take` with chosen or dropped files; the rest of the page does not hear of them. */
export function listenForFiles(zone: HTMLElement, input: HTMLInputElement, take: (files: File[]) => void): void {
  input.addEventListener("change", () => {
    const files = [...(input.files ?? [])];
    // So that choosing the same file again is a change.
    input.value = "";
    if (files.length > 0) take(files);
  });
  const over = (isOver: boolean) => (event: DragEvent) => {
    event.preventDefault();
    event.stopPropagation();
    zone.classList.toggle("over", isOver);
  };
  zone.addEventListener("dragover", over(true));
  zone.addEventListener("dragleave", over(false));
  zone.addEventListener("drop", (event) => {
    over(false)(event);
    const files = [...(event.dataTransfer?.files ?? [])];
    if (files.length > 0) take(files);
  });
}

/** Drops that miss the zone must not reach the other steps. */
export function keepDrops(panel: HTMLElement, take: (files: File[]) => void): void {
  panel.addEventListener("drop", (event) => {
    event.preventDefault();
    event.stopPropagation();
    const files = [...(event.dataTransfer?.files ?? [])];
    if (files.length > 0) take(files);
  });
}
